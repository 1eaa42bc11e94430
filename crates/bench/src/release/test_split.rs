//! The public part of the test split: images, what a measurement would know about them, and a template for submissions.

use std::path::Path;

use serde_json::{Map, Value, json};

use super::about::Facts;
use super::package::Package;
use super::submission;
use crate::dataset::calibration::CALIBRATION;
use crate::dataset::checksums::{self, SHA256SUMS};
use crate::dataset::manifest::{self, MANIFEST};
use crate::dataset::truth::FRAMES;
use crate::error::{Error, Result};
use crate::scenario::Recordings;
use crate::scenario::license::LICENSE;

/// What the manifest tells about the measurement: nothing that was counted or measured in the truth, no seed.
const TOLD: [&str; 11] = [
    "generator",
    "generator_version",
    "layout_version",
    "um_per_px",
    "depth_factor",
    "sensor",
    "renderer",
    "depth_range_um",
    "depth_range_h_um",
    "coordinates",
    "scoring_gates",
];

/// The same of its timing.
const TIMING: [&str; 11] = [
    "mode",
    "pairs",
    "frames",
    "count",
    "dt_s",
    "gap_s",
    "interval_s",
    "seeding",
    "exposure_s",
    "flashes",
    "jitter_s",
];

/// Columns of the truth's table of frames that are no truth.
const COLUMNS: [&str; 5] = ["frame", "pair", "role", "t_s", "image"];

/// Path of the table of frames.
pub(super) const FRAMES_PATH: &str = "frames.csv";

/// Packs the split. `train` is the public dataset, whose calibration stack serves all splits; `test` the withheld one.
/// With `nominal` its frames have the times that were meant, without the jitter of each.
pub(super) fn package(
    train: &Path,
    test: &Path,
    nominal: Option<&Recordings>,
    about: &Facts<'_>,
) -> Result<Package> {
    let mut package = Package::default();
    package.copy_folder(test, |path| path.starts_with("images/"))?;
    package.copy_folder(train, |path| path.starts_with("calibration/"))?;
    package.copy("settings.txt", test.join("settings.txt"));
    let images = checksums::images_digest(&checksums::write(&package.fingerprints()?));
    package.write(FRAMES_PATH, frames(test, nominal)?);
    package.write("README.md", about.test_card());
    package.write(LICENSE, about.licence());
    package.write("submission/results.csv", submission::RESULTS_HEADER);
    package.write("submission/submission.json", submission::template());

    let fingerprints = package.fingerprints()?;
    let path = test.join(MANIFEST);
    let text = std::fs::read_to_string(&path).map_err(|e| Error::read(&path, e))?;
    let whole: Value =
        serde_json::from_str(&text).map_err(|e| Error::input(format!("{}: {e}", path.display())))?;
    let chosen = |from: &Value, keys: &[&str]| -> Map<String, Value> {
        keys.iter().filter_map(|&key| Some((key.to_owned(), from.get(key)?.clone()))).collect()
    };
    let mut told = chosen(&whole["microsig"], &TOLD);
    told.insert("timing".to_owned(), Value::Object(chosen(&whole["microsig"]["timing"], &TIMING)));
    told.insert("split".to_owned(), json!("test"));
    told.insert("truth".to_owned(), json!("withheld"));
    told.insert("images_sha256".to_owned(), json!(images));
    told.insert("commitment_sha256".to_owned(), json!(about.commitment));
    let tables = [CALIBRATION.clone()];
    let mut resources: Vec<Value> = fingerprints
        .iter()
        .map(|(path, fingerprint)| manifest::resource(path, fingerprint, &tables))
        .collect();
    for table in resources.iter_mut().filter(|r| r["path"] == FRAMES_PATH) {
        table["profile"] = json!("tabular-data-resource");
        table["description"] = json!(FRAMES.description);
        table["schema"] = schema(&whole, nominal.is_some());
    }
    let manifest = json!({
        "profile": "data-package",
        "name": format!("{}-test", about.name),
        "title": format!("{}: test split", about.title),
        "description": "Images whose truth is withheld; README.md says what to do with them.",
        "version": whole["version"],
        "licenses": whole["licenses"],
        "microsig": told,
        "resources": resources,
    });
    package.write(MANIFEST, format!("{manifest:#}\n"));
    package.write(SHA256SUMS, checksums::write(&package.fingerprints()?));
    Ok(package)
}

/// The table of frames without what the truth tells.
fn frames(test: &Path, nominal: Option<&Recordings>) -> Result<Vec<u8>> {
    let path = test.join(FRAMES.path);
    let failed = |e: csv::Error| Error::input(format!("{}: {e}", path.display()));
    let mut reader = csv::Reader::from_path(&path).map_err(failed)?;
    let header = reader.headers().map_err(failed)?.clone();
    let columns: Vec<usize> =
        COLUMNS.iter().filter_map(|name| header.iter().position(|h| h == *name)).collect();
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(columns.iter().map(|&c| &header[c])).map_err(failed)?;
    for (frame, record) in reader.records().enumerate() {
        let record = record.map_err(failed)?;
        let meant = nominal.map(|recordings| recordings.nominal_s(frame as u32).to_string());
        let cell = |&c: &usize| match &meant {
            Some(t_s) if &header[c] == "t_s" => t_s.clone(),
            _ => record[c].to_owned(),
        };
        writer.write_record(columns.iter().map(cell)).map_err(failed)?;
    }
    writer.into_inner().map_err(|e| failed(e.into_error().into()))
}

/// The manifest's entry of a table with those columns only that are told.
fn schema(whole: &Value, nominal: bool) -> Value {
    let tables = whole["resources"].as_array().into_iter().flatten();
    let fields = tables.filter(|r| r["path"] == FRAMES.path).flat_map(|r| r["schema"]["fields"].as_array());
    let told = |f: &&Value| COLUMNS.iter().any(|name| f["name"] == *name);
    let mut fields: Vec<Value> = fields.flatten().filter(told).cloned().collect();
    for field in fields.iter_mut().filter(|field| nominal && field["name"] == "t_s") {
        field["description"] = json!("nominal time of the middle of the exposure, without jitter");
    }
    json!({ "fields": fields, "missingValues": [""] })
}
