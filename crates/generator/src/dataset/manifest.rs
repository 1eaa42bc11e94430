//! Builds the manifest of a scenario's dataset. It does not depend on date, host, path or commit.

use std::collections::HashMap;
use std::path::Path;

use microsig_core::sensor::{Image, ImageFormat};
use serde_json::{Map, Value, json};

use super::truth::Totals;
use super::truth::depth::ParticleImage;
use super::{FileHashes, IMAGES, calibration, frame_paths};
use crate::preview::{Preview, SizeCurves};
use scenario::license::License;
use scenario::spec::{Motion, Timing};
use scenario::{Scenario, Weighting};
use storage::checksums::{Fingerprint, fingerprint};
use storage::dataset::Table;
use storage::dataset::manifest::{
    Facts, GENERATOR_VERSION, LAYOUT_VERSION, LicenseEntry, Manifest, MotionFacts, OpticsFacts,
    ParticleImageFacts, Resource, ScoringGates, SensorFacts, SizeFacts, SnrFacts, TimingFacts,
    TruthGridFacts, WaveFacts, ZERO_OF_DATASETS, coordinates, resource, seal,
};
use storage::error::{Error, Result};
use storage::folder::Partial;

/// Writes manifest and checksums into a dataset's folder, which must be complete otherwise. Errors: a file in
/// the folder that this program did not write; writing.
pub(crate) fn write(
    partial: &Partial,
    scenario: &Scenario,
    hashes: &FileHashes,
    head: Manifest,
) -> Result<()> {
    let (folder, tables) = (partial.folder(), super::tables(scenario));
    let paths = |frame| frame_paths(&scenario.recordings, frame).map(|path| (path, frame));
    let frames: HashMap<String, u32> = (0..scenario.recordings.frames()).flat_map(paths).collect();
    seal(folder, &head, |path: &str| {
        if partial.lists(path) {
            return entry(scenario, hashes, &tables, folder.path(), (path, frames.get(path).copied()));
        }
        let path = folder.join(path);
        Err(Error::input(format!("{}: microsig did not write it; move it elsewhere", path.display())))
    })
}

/// The manifest of a dataset without its files.
pub fn manifest(
    scenario: &Scenario,
    totals: &Totals,
    image: &ParticleImage,
    sizes: &[SizeFacts],
) -> Manifest {
    let spec = &scenario.spec;
    let title = match spec.description.lines().next() {
        Some(line) if !line.is_empty() => line,
        _ => &spec.name,
    };
    Manifest {
        profile: "data-package".to_owned(),
        name: spec.name.clone(),
        title: title.to_owned(),
        description: spec.description.clone(),
        version: "1.0.0".to_owned(),
        licenses: vec![license(scenario.license)],
        microsig: Facts { sizes: sizes.to_vec(), ..facts(scenario, totals, image) },
        resources: Vec::new(),
    }
}

/// Facts on particles of several sizes; none if there is one size only.
pub(crate) fn sizes(preview: &Preview) -> Vec<SizeFacts> {
    if preview.sizes.len() < 2 {
        return Vec::new();
    }
    let facts = |size: &SizeCurves| SizeFacts {
        d_um: size.d_um,
        focus_um: size.focus_um,
        peak_counts: size.range(|depth| Some(depth.peak_counts)).unwrap_or_default(),
        snr: size.range(|depth| depth.snr),
    };
    preview.sizes.iter().map(facts).collect()
}

/// The manifest's entry of a license.
pub fn license(License { id, title, url }: License) -> LicenseEntry {
    LicenseEntry { name: id.to_owned(), title: title.to_owned(), path: url.to_owned() }
}

pub(crate) fn bit_depth(scenario: &Scenario) -> u8 {
    match scenario.spec.image_format() {
        ImageFormat::Integer => scenario.detector.as_ref().map_or(16, |d| d.bits),
        ImageFormat::Float32 => Image::FLOAT_BITS,
    }
}

/// Definition of the SNR.
pub const SNR: &str = "(the particle's own noise-free peak - background) / standard deviation of the background, in counts; \
the value of a dataset is the median over 51 equispaced depths, of a sphere of the mean diameter and the middle brightness, \
centred on the pixel in the middle of the image; null without noise. The counting noise of rays is no part of it: it grows \
with gain at the same gain n_rays.";

/// Definitions of A_pi and N_S.
pub const N_S: &str = "a_pi_px: pixels of the noise-free image of a single sphere of the mean diameter above 10 % of its own \
peak, averaged over 51 equispaced depths; n_p: visible particles per frame, mean over frames; n_ppp = n_p / (width height); \
n_s = n_p a_pi_px / (width height)";

/// The same where walls or bodies exclude particles from a part of the image.
pub const N_S_WITHIN_WALLS: &str = "a_pi_px: pixels of the noise-free image of a single sphere of the mean diameter above 10 % \
of its own peak, averaged over 51 equispaced depths; n_p: visible particles per frame, mean over frames; n_ppp = n_p / (width \
height); image_share: share of the sensor in which particles are, (int n dA)^2 / int n^2 dA over the sensor with n the depth of \
fluid, at t = 0; n_s = n_p a_pi_px / (image_share width height)";

fn facts(scenario: &Scenario, totals: &Totals, image: &ParticleImage) -> Facts {
    let settings = &scenario.settings;
    let (low, high) = scenario.depth_range_um;
    let pixels = f64::from(settings.pixel_dim_x) * f64::from(settings.pixel_dim_y);
    let n_p = totals.visible as f64 / f64::from(totals.frames.max(1));
    let image_share = scenario.image_share();
    let random_streams = match scenario.streams.seed() {
        Some(_) => "Philox4x32-10, addressed by (seed, purpose, frame, row)",
        None => "ChaCha20 with a secret key, addressed by (purpose, frame, row)",
    };
    Facts {
        generator: "microsig".to_owned(),
        generator_version: Some(GENERATOR_VERSION.to_owned()),
        layout_version: Some(LAYOUT_VERSION),
        seed: Some(scenario.streams.seed()),
        random_streams: Some(random_streams.to_owned()),
        timing: timing(scenario),
        um_per_px: Some(scenario.scale.um_per_px()),
        image_stretch: scenario.scale.stretch(),
        depth_factor: scenario.spec.optics.depth_factor,
        sensor: Some(SensorFacts {
            width_px: settings.pixel_dim_x,
            height_px: settings.pixel_dim_y,
            bit_depth: bit_depth(scenario),
            gain: settings.gain,
            background_mean_counts: settings.background_mean,
            background_noise_counts: settings.background_noise,
            image_format: scenario.spec.image_format,
            rounded_once: scenario.spec.image_format() == ImageFormat::Integer,
            // JSON has no infinity: an infinite full well becomes null.
            detector: serde_json::to_value(&scenario.spec.sensor).unwrap_or_default(),
        }),
        renderer: Some(scenario.renderer.name().to_owned()),
        waves: wave_facts(scenario, image.drawn_share),
        optics: optics(scenario),
        depth_range_um: Some([low, high]),
        depth_range_h_um: Some(high - low),
        coordinates: Some(coordinates(ZERO_OF_DATASETS)),
        n_p: Some(n_p),
        n_ppp: Some(n_p / pixels),
        n_s: Some(n_p * image.area_px / (pixels * image_share)),
        image_share: (image_share < 1.0).then_some(image_share),
        a_pi_px: Some(image.area_px),
        concentration_definition: Some(if image_share < 1.0 { N_S_WITHIN_WALLS } else { N_S }.to_owned()),
        snr: Some(SnrFacts {
            value: image.snr,
            definition: SNR.to_owned(),
            background_noise_counts: image.background_noise_counts,
            gain: settings.gain,
            n_rays: settings.n_rays,
        }),
        particle_image: Some(ParticleImageFacts { d_um: image.d_um, focus_um: image.focus_um }),
        calibration_places: calibration::places(scenario),
        calibration_d_um: Some(scenario.calibrated_um()).filter(|sizes| sizes.len() > 1).unwrap_or_default(),
        motion: Some(motion(scenario)),
        truth_grid: Some(truth_grid(scenario)),
        max_displacement_px: Some(totals.max_displacement_px),
        scoring_gates: Some(ScoringGates::by(scenario.spec.scoring.as_ref(), high - low)),
        scoring: scenario.spec.scoring.clone(),
        ..Facts::default()
    }
}

/// Light and objective for wave optics, with the least and greatest share of the light that images show; `None`
/// for other renderers.
pub fn wave_facts(scenario: &Scenario, drawn_share: Option<[f64; 2]>) -> Option<WaveFacts> {
    let renderer = scenario.spec.renderer();
    let (optics, tolerance) = (renderer.wave_optics()?, renderer.tolerance()?);
    let written = &scenario.spec.optics;
    Some(WaveFacts {
        wavelength_um: optics.wavelength_um,
        bandwidth_um: optics.bandwidth_um,
        emission: optics.emission,
        lens: optics.lens,
        airy_radius_px: optics.airy_radius_px(&scenario.settings),
        pupil: written.pupil.clone(),
        layers: written.layers,
        cyl_angle_deg: optics.cyl_angle_deg,
        cylinder: optics.cylinder,
        tolerance,
        drawn_share,
    })
}

/// Blur, how the optics vary over the field of view, and what emits; `None` without any of it.
pub fn optics(scenario: &Scenario) -> Option<OpticsFacts> {
    let (blur_um, field) = (scenario.spec.optics.blur_um.unwrap_or_default(), scenario.spec.optics.field);
    let law = scenario.renderer.spheroid_law().filter(|_| scenario.layout.spheroids);
    let facts = OpticsFacts { blur_um, field, spheroids: law.unwrap_or_default() };
    (facts != OpticsFacts::default()).then_some(facts)
}

/// Times of the frames: the keys of the scenario and, in all modes, the number of frames.
fn timing(scenario: &Scenario) -> TimingFacts {
    let recordings = &scenario.recordings;
    let keys = match recordings.timing() {
        Timing::Pairs(p) => serde_json::to_value(p),
        Timing::Sequence(s) => serde_json::to_value(s),
        Timing::FourPulse(f) => serde_json::to_value(f),
    };
    let mut keys = match keys {
        Ok(Value::Object(keys)) => keys,
        _ => Map::new(),
    };
    keys.insert("mode".to_owned(), json!(recordings.timing().mode()));
    keys.insert("frames".to_owned(), json!(recordings.frames()));
    if recordings.are_pairs() {
        keys.insert("pairs".to_owned(), json!(recordings.frames() / 2));
    }
    TimingFacts(keys)
}

/// The flow and its parameters as in the scenario, with the formula of every field in it.
fn motion(scenario: &Scenario) -> MotionFacts {
    let written = serde_json::to_value(&scenario.spec.motion).unwrap_or_default();
    let mut formulas = Map::new();
    if let Motion::Flow(flow) = &scenario.spec.motion {
        flow.field.visit(&mut |field| {
            let name = field.name();
            if let Some(entry) = flows::registry::ENTRIES.iter().find(|entry| entry.name == name) {
                formulas.insert(name, json!({ "formula": entry.formula, "source": entry.source }));
            }
        });
    }
    MotionFacts { scenario: written, formulas }
}

/// The grid of `truth/field.csv` and its depth weighting.
fn truth_grid(scenario: &Scenario) -> Option<TruthGridFacts> {
    let nodes = scenario.truth_grid()?;
    let weighting = match nodes.weighting {
        Weighting::PeakSquared => {
            "sum w(z) D(z) / sum w(z) over the depths of truth/depth.csv, w the squared peak there"
        }
        Weighting::Curvature => {
            "sum w(z) D(z) / sum w(z) over the depths of truth/depth.csv, w the curvature of the image's autocorrelation at its top"
        }
        Weighting::None => "none",
    };
    Some(TruthGridFacts {
        columns: nodes.x_px.len(),
        rows: nodes.y_px.len(),
        planes_um: nodes.planes_um,
        weighting: weighting.to_owned(),
        window_px: nodes.window_px,
        definition: "forward: of the fluid at the node in the first frame; central: half-way in time; of the fluid, without \
    random motion and settling"
            .to_owned(),
    })
}

/// The fingerprint of a file of a dataset (its path, and its frame if it is of one) and its entry in the manifest;
/// the file is read only if the hashes does not contain it.
fn entry(
    scenario: &Scenario,
    hashes: &FileHashes,
    tables: &[Table],
    folder: &Path,
    (path, frame): (&str, Option<u32>),
) -> Result<(Fingerprint, Resource)> {
    let Some(frame) = frame else {
        let fingerprint = match hashes.others.get(path) {
            Some(known) => *known,
            None => fingerprint(&folder.join(path))?,
        };
        return Ok((fingerprint, resource(path, &fingerprint, tables)));
    };
    let entry = &hashes.frames[frame as usize];
    if !path.starts_with(IMAGES) {
        return Ok((entry.particles, resource(path, &entry.particles, tables)));
    }
    let resource = Resource {
        frame: Some(frame),
        width_px: Some(scenario.settings.pixel_dim_x),
        height_px: Some(scenario.settings.pixel_dim_y),
        bit_depth: Some(bit_depth(scenario)),
        n_visible: Some(entry.visible),
        ..resource(path, &entry.image, tables)
    };
    Ok((entry.image, resource))
}
