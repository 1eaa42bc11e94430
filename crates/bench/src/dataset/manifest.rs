//! `datapackage.json`: a Frictionless data package, and under `microsig` what users of the images must know.
//!
//! Nothing in it depends on date, host, path or commit.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::calibration::CALIBRATION;
use super::checksums::Fingerprint;
use super::table::Table;
use super::truth::{Census, DISPLACEMENTS, FRAMES, TRACKS};
use crate::scenario::Scenario;
use crate::scenario::spec::Timing;

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

/// The tables of a dataset.
pub const TABLES: [&Table; 4] = [&FRAMES, &TRACKS, &DISPLACEMENTS, &CALIBRATION];

/// The manifest of a dataset with these files.
pub fn manifest(scenario: &Scenario, census: &Census, files: &BTreeMap<String, Fingerprint>) -> Value {
    let spec = &scenario.spec;
    let resources: Vec<Value> = files.iter().map(|(path, fingerprint)| resource(path, fingerprint)).collect();
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
        "licenses": [{
            "name": "CC-BY-4.0",
            "title": "Creative Commons Attribution 4.0",
            "path": "https://creativecommons.org/licenses/by/4.0/",
        }],
        "microsig": facts(scenario, census),
        "resources": resources,
    })
}

fn facts(scenario: &Scenario, census: &Census) -> Value {
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
            "bit_depth": scenario.detector.as_ref().map_or(16, |d| d.bits),
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

/// The camera's chain as the scenario says it; null for MicroSIG's own sensor.
fn spec_sensor(scenario: &Scenario) -> Value {
    // An infinite full well has no number in JSON and becomes null.
    serde_json::to_value(&scenario.spec.sensor).unwrap_or_default()
}

fn resource(path: &str, fingerprint: &Fingerprint) -> Value {
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
    if let Some(table) = TABLES.iter().find(|t| t.path == path) {
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
