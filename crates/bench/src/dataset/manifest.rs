//! `datapackage.json`: a Frictionless data package, and under `microsig` what users of the images must know.
//!
//! Nothing in it depends on date, host, path or commit.

use std::path::Path;

use serde_json::{Value, json};

use super::checksums::{Fingerprint, fingerprint};
use super::table::Table;
use super::truth::Census;
use super::truth::depth::ParticleImage;
use super::{IMAGES, Ledger, Stem};
use crate::error::Result;
use crate::scenario::license::License;
use crate::scenario::spec::Timing;
use crate::scenario::{Scenario, Weighting};

/// Name of the file.
pub const MANIFEST: &str = "datapackage.json";

/// Version of the generator: it changes when the bytes of datasets do.
pub const GENERATOR_VERSION: &str = env!("CARGO_PKG_VERSION");

/// Version of the layout of a dataset.
pub const LAYOUT_VERSION: u32 = 1;

/// The coordinates, in words.
pub const COORDINATES: &str = "x_px and y_px are image coordinates: the centre of the top-left pixel is (1, 1), x grows to \
the right along columns, y downward along rows; pixel k covers [k - 0.5, k + 0.5). z_um is the physical depth in um, zero in \
the paraxial object plane, growing away from the lens. x_um and y_um are object-space coordinates from the middle of the \
image, in the directions of x_px and y_px. Frames count from 0.";

/// The manifest of a dataset without its files, which `entry` tells of.
pub fn manifest(scenario: &Scenario, census: &Census, image: &ParticleImage) -> Value {
    let spec = &scenario.spec;
    let title = match spec.description.lines().next() {
        Some(line) if !line.is_empty() => line,
        _ => &spec.name,
    };
    json!({
        "profile": "data-package",
        "name": spec.name,
        "title": title,
        "description": spec.description,
        "version": "1.0.0",
        "licenses": [license(scenario.license)],
        "microsig": facts(scenario, census, image),
    })
}

/// The manifest's entry of a licence.
pub(crate) fn license(License { id, title, url }: License) -> Value {
    json!({ "name": id, "title": title, "path": url })
}

/// Bits of a count.
pub(super) fn bit_depth(scenario: &Scenario) -> u8 {
    scenario.detector.as_ref().map_or(16, |d| d.bits)
}

/// What SNR means here.
pub const SNR: &str = "(the particle's own noise-free peak - background) / standard deviation of the background, in counts; \
the value of a dataset is the median over 51 equispaced depths, of a sphere of the mean diameter and the middle brightness, \
centred on the pixel in the middle of the image; null without noise. The counting noise of rays is no part of it: it grows \
with gain at the same gain n_rays.";

/// What A_pi and N_S mean here.
pub const N_S: &str = "a_pi_px: pixels of the noise-free image of a single sphere of the mean diameter above 10 % of its own \
peak, averaged over 51 equispaced depths; n_p: visible particles per frame, mean over frames; n_ppp = n_p / (width height); \
n_s = n_p a_pi_px / (width height)";

fn facts(scenario: &Scenario, census: &Census, image: &ParticleImage) -> Value {
    let settings = &scenario.settings;
    let (low, high) = scenario.depth_range_um;
    let pixels = f64::from(settings.pixel_dim_x) * f64::from(settings.pixel_dim_y);
    let n_p = census.visible as f64 / f64::from(census.frames.max(1));
    json!({
        "generator": "microsig",
        "generator_version": GENERATOR_VERSION,
        "layout_version": LAYOUT_VERSION,
        "seed": scenario.streams.seed(),
        "random_streams": match scenario.streams.seed() {
            Some(_) => "Philox4x32-10, addressed by (seed, purpose, frame, row)",
            None => "ChaCha20 with a secret key, addressed by (purpose, frame, row)",
        },
        "timing": timing(scenario),
        "um_per_px": scenario.scale.um_per_px(),
        "depth_factor": scenario.spec.optics.depth_factor,
        "sensor": {
            "width_px": settings.pixel_dim_x,
            "height_px": settings.pixel_dim_y,
            "bit_depth": bit_depth(scenario),
            "gain": settings.gain,
            "background_mean_counts": settings.background_mean,
            "background_noise_counts": settings.background_noise,
            "detector": spec_sensor(scenario),
        },
        "renderer": scenario.renderer.name(),
        "depth_range_um": [low, high],
        "depth_range_h_um": high - low,
        "coordinates": COORDINATES,
        "n_p": n_p,
        "n_ppp": n_p / pixels,
        "n_s": n_p * image.area_px / pixels,
        "a_pi_px": image.area_px,
        "concentration_definition": N_S,
        "snr": {
            "value": image.snr,
            "definition": SNR,
            "background_noise_counts": image.background_noise_counts,
            "gain": settings.gain,
            "n_rays": settings.n_rays,
        },
        "particle_image": { "d_um": image.d_um, "focus_um": image.focus_um },
        "motion": motion(scenario),
        "truth_grid": truth_grid(scenario),
        "max_displacement_px": census.max_displacement_px,
        "scoring_gates": { "xy_px": 2.0, "z_um": (high - low) / 10.0, "isbi_px": 5.0 },
    })
}

/// When frames are taken: the keys of the scenario and, in every mode, the number of frames.
fn timing(scenario: &Scenario) -> Value {
    let recordings = &scenario.recordings;
    let keys = match recordings.timing() {
        Timing::Pairs(p) => serde_json::to_value(p),
        Timing::Sequence(s) => serde_json::to_value(s),
        Timing::FourPulse(f) => serde_json::to_value(f),
    };
    let mut facts = keys.unwrap_or_default();
    facts["mode"] = json!(recordings.timing().mode());
    facts["frames"] = json!(recordings.frames());
    if recordings.are_pairs() {
        facts["pairs"] = json!(recordings.frames() / 2);
    }
    facts
}

/// The flow and its parameters as the scenario has them, with the formula of every field in it.
fn motion(scenario: &Scenario) -> Value {
    let written = serde_json::to_value(&scenario.spec.motion).unwrap_or_default();
    let mut formulas = serde_json::Map::new();
    name_formulas(&written, &mut formulas);
    json!({ "scenario": written, "formulas": formulas })
}

/// Collects the formulas of all fields below a value: they are the keys that the registry knows.
fn name_formulas(value: &Value, formulas: &mut serde_json::Map<String, Value>) {
    match value {
        Value::Object(parts) => {
            for (key, part) in parts {
                if let Some(entry) = flows::registry::ENTRIES.iter().find(|entry| entry.name == key) {
                    formulas.insert(key.clone(), json!({ "formula": entry.formula, "source": entry.source }));
                }
                name_formulas(part, formulas);
            }
        }
        Value::Array(parts) => parts.iter().for_each(|part| name_formulas(part, formulas)),
        _ => {}
    }
}

/// The grid of field.csv, and by which weight of depths; null if there is none.
fn truth_grid(scenario: &Scenario) -> Value {
    let Some(nodes) = scenario.truth_grid() else { return Value::Null };
    let weighting = match nodes.weighting {
        Weighting::PeakSquared => {
            "sum w(z) D(z) / sum w(z) over the depths of truth/depth.csv, w the squared peak there"
        }
        Weighting::Curvature => {
            "sum w(z) D(z) / sum w(z) over the depths of truth/depth.csv, w the curvature of the image's autocorrelation at its top"
        }
        Weighting::None => "none",
    };
    json!({
        "planes_um": nodes.planes_um,
        "columns": nodes.x_px.len(),
        "rows": nodes.y_px.len(),
        "weighting": weighting,
        "window_px": nodes.window_px,
        "definition": "forward: of the fluid at the node in the first frame; central: half-way in time; of the fluid, without \
    random motion and settling",
    })
}

/// The camera's chain as the scenario says it; null for MicroSIG's own sensor.
fn spec_sensor(scenario: &Scenario) -> Value {
    // An infinite full well has no number in JSON and becomes null.
    serde_json::to_value(&scenario.spec.sensor).unwrap_or_default()
}

/// The fingerprint of a file of a dataset and its entry in the manifest; the file is read only if the ledger does not know it.
pub(crate) fn entry(
    scenario: &Scenario,
    ledger: &Ledger,
    tables: &[Table],
    folder: &Path,
    path: &str,
) -> Result<(Fingerprint, Value)> {
    let Some(frame) = Stem::frame_of(&scenario.recordings, path) else {
        let fingerprint = ledger.other(path).map_or_else(|| fingerprint(&folder.join(path)), Ok)?;
        return Ok((fingerprint, resource(path, &fingerprint, tables)));
    };
    let entry = ledger.frame(frame)?;
    if !path.starts_with(IMAGES) {
        return Ok((entry.particles, resource(path, &entry.particles, tables)));
    }
    let mut resource = resource(path, &entry.image, tables);
    resource["frame"] = json!(frame);
    resource["width_px"] = json!(scenario.settings.pixel_dim_x);
    resource["height_px"] = json!(scenario.settings.pixel_dim_y);
    resource["bit_depth"] = json!(bit_depth(scenario));
    resource["n_visible"] = json!(entry.visible);
    Ok((entry.image, resource))
}

/// The manifest's entry of a file, with the columns of those tables.
pub(crate) fn resource(path: &str, fingerprint: &Fingerprint, tables: &[Table]) -> Value {
    let extension = path.rsplit_once('.').map_or("", |(_, e)| e);
    let mediatype = match extension {
        "csv" => "text/csv",
        "tif" => "image/tiff",
        "png" => "image/png",
        "md" => "text/markdown",
        _ => "text/plain",
    };
    let mut resource = json!({
        "name": resource_name(path),
        "path": path,
        "format": if extension.is_empty() { "txt" } else { extension },
        "mediatype": mediatype,
        "bytes": fingerprint.bytes,
        "hash": format!("sha256:{}", fingerprint.sha256),
    });
    if let Some(table) = tables.iter().find(|t| t.path == path) {
        resource["profile"] = json!("tabular-data-resource");
        resource["encoding"] = json!("utf-8");
        resource["description"] = json!(table.description);
        resource["schema"] = schema(table);
    }
    resource
}

fn schema(table: &Table) -> Value {
    let fields: Vec<Value> = table
        .columns
        .iter()
        .map(|c| json!({ "name": c.name, "type": c.kind, "unit": c.unit, "description": c.description }))
        .collect();
    json!({ "fields": fields, "missingValues": [""] })
}

/// Names of resources are lower case, without slashes.
fn resource_name(path: &str) -> String {
    path.chars()
        .map(|c| match c.to_ascii_lowercase() {
            c if c.is_ascii_alphanumeric() || "._-".contains(c) => c,
            '/' => '-',
            _ => '_',
        })
        .collect()
}
