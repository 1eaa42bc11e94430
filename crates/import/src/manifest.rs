//! The manifest of a recording.

use serde_json::{Map, Value, json};
use storage::checksums::fingerprint;
use storage::dataset::manifest::{
    Facts, GENERATOR_VERSION, LAYOUT_VERSION, Manifest, NoiseFacts, ParticleImageFacts, RECORDING, Resource,
    ScoringGates, SensorFacts, TimingFacts, coordinates, resource, seal as complete,
};
use storage::dataset::{CalibrationRow, Row, ScanParticleRow, Table};
use storage::error::{Error, Result};
use storage::folder::Partial;

use super::ImportOptions;
use super::frames::{Frames, Written};
use super::known::Known;
use super::optics::Model;
use super::stacks::Stacks;

/// Where `z_um` of recordings is zero.
pub(crate) const ZERO: &str = "where the stage is at zero";

/// All that is said about a recording.
pub(crate) struct About<'a> {
    pub(crate) name: String,
    pub(crate) um_per_px: f64,
    pub(crate) options: &'a ImportOptions,
    pub(crate) frames: &'a Frames,
    pub(crate) written: &'a Written,
    /// The calibration stacks and the noise of the scan, if there is one.
    pub(crate) made: Option<&'a Stacks>,
    pub(crate) noise: Option<&'a NoiseFacts>,
    pub(crate) known: &'a Known,
    pub(crate) model: Option<&'a Model>,
    /// What was done to the images, as a clause.
    pub(crate) correction: &'static str,
}

impl About<'_> {
    /// Least and greatest depth of the calibration, um.
    pub(crate) fn depths_um(&self) -> Option<[f64; 2]> {
        let depths = &self.made?.depths_um;
        Some([*depths.first()?, *depths.last()?])
    }
}

/// Writes manifest and checksums.
pub(crate) fn seal(partial: &Partial, about: &About<'_>) -> Result<()> {
    let folder = partial.folder();
    let size = about.frames.size();
    let mut tables: Vec<Table> = about.known.tables();
    tables.extend(about.made.iter().flat_map(|made| [made.table(), ScanParticleRow::table(&[])]));
    let frames: std::collections::BTreeMap<String, u32> =
        (0..about.frames.len()).map(|frame| (about.frames.path(frame), frame as u32)).collect();
    complete(folder, &manifest(about), |path: &str| {
        if !partial.lists(path) {
            let path = folder.join(path);
            let what = "microsig did not write it; move it elsewhere";
            return Err(Error::input(format!("{}: {what}", path.display())));
        }
        let found = fingerprint(&folder.join(path))?;
        let of = resource(path, &found, &tables);
        let Some(frame) = frames.get(path) else {
            let is_calibration = path.starts_with("calibration/images/");
            let side = about.made.map(Stacks::side_px).filter(|_| is_calibration);
            return Ok((found, Resource { width_px: side, height_px: side, ..of }));
        };
        let image = Resource {
            frame: Some(*frame),
            width_px: Some(size.width),
            height_px: Some(size.height),
            bit_depth: Some(about.bits()),
            ..of
        };
        Ok((found, image))
    })
}

impl About<'_> {
    fn bits(&self) -> u8 {
        if self.correction.is_empty() { self.frames.size().bits } else { 16 }
    }

    fn timing(&self) -> TimingFacts {
        let mut keys = Map::new();
        let frames = self.frames.len();
        let mut put = |key: &str, value: Value| drop(keys.insert(key.to_owned(), value));
        if let Some(dt_s) = self.options.dt_s {
            put("dt_s", json!(dt_s));
        }
        put("mode", json!(if self.frames.are_pairs() { "pairs" } else { "sequence" }));
        put("frames", json!(frames));
        if self.frames.are_pairs() {
            put("pairs", json!(frames / 2));
        }
        TimingFacts(keys)
    }
}

fn manifest(about: &About<'_>) -> Manifest {
    let (made, model) = (about.made, about.model);
    let depths_um = about.depths_um();
    let h_um = depths_um.map(|[low, high]| high - low);
    let size = about.frames.size();
    let facts = Facts {
        generator: "microsig".to_owned(),
        generator_version: Some(GENERATOR_VERSION.to_owned()),
        layout_version: Some(LAYOUT_VERSION),
        timing: about.timing(),
        um_per_px: Some(about.um_per_px),
        depth_factor: model.map(|model| model.depth_factor),
        sensor: Some(SensorFacts {
            width_px: size.width,
            height_px: size.height,
            bit_depth: about.bits(),
            gain: model.map_or(f64::NAN, |model| model.settings.gain),
            background_mean_counts: about.written.background[0],
            background_noise_counts: about.written.background[1],
            rounded_once: true,
            ..SensorFacts::default()
        }),
        renderer: model.map(|model| model.renderer.to_owned()),
        waves: model.and_then(|model| model.waves.clone()),
        optics: model.and_then(|model| model.optics),
        depth_range_um: depths_um,
        depth_range_h_um: h_um,
        coordinates: Some(coordinates(ZERO)),
        a_pi_px: made.map(Stacks::area_px),
        particle_image: Some(ParticleImageFacts {
            d_um: model.map_or(0.0, |model| model.d_um),
            focus_um: made.map(|made| made.focus_um(made.central())),
        }),
        scoring_gates: h_um.map(ScoringGates::over),
        kind: Some(RECORDING.to_owned()),
        known: Some(about.known.facts()),
        noise: about.noise.cloned(),
        calibration_places: made.iter().flat_map(|made| &made.places).map(|stack| stack.place).collect(),
        ..Facts::default()
    };
    Manifest {
        profile: "data-package".to_owned(),
        name: about.name.clone(),
        title: format!("{}: a recording", about.name),
        description: match made {
            Some(_) => "Recorded images, with calibration stacks cut from a scan".to_owned(),
            None => "Recorded images of particles in focus".to_owned(),
        },
        version: "1.0.0".to_owned(),
        licenses: Vec::new(),
        microsig: facts,
        resources: Vec::new(),
    }
}

/// The table of the stacks' images.
impl Stacks {
    pub(crate) fn table(&self) -> Table {
        let about = "One row per image of the calibration stacks: averages of particles of a scan.";
        let parts: &[&str] = if self.is_field { &[storage::dataset::rows::PLACES] } else { &[] };
        CalibrationRow::table(parts).described(about)
    }
}
