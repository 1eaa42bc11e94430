//! The public part of the test split: images, the facts known in a measurement, and a template for
//! submissions.

use std::path::Path;

use super::about::ReleaseTexts;
use super::submission;
use crate::package::Package;
use generator::dataset::calibration;
use scenario::Recordings;
use scenario::license::LICENSE;
use storage::checksums::{self, SHA256SUMS};
use storage::dataset::manifest::{self, MANIFEST, Manifest, Resource, SuitePlace, TableSchema};
use storage::dataset::{FrameRow, Row, TableReader};
use storage::error::{Error, Result};

/// Published timing keys: none that are derived from the truth, and no seed.
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

/// Published columns of the table of frames.
const COLUMNS: [&str; 5] = ["frame", "pair", "role", "t_s", "image"];

/// Packs the split. `train` is the public dataset, whose calibration stack serves all splits; `test` is the
/// withheld dataset. With `nominal`, frames have their nominal times, without jitter.
pub(super) fn package(
    train: &Path,
    test: &Path,
    nominal: Option<&Recordings>,
    about: &ReleaseTexts<'_>,
) -> Result<Package> {
    let mut package = Package::default();
    package.copy_folder(test, |path| path.starts_with("images/"))?;
    package.copy_folder(train, |path| path.starts_with("calibration/"))?;
    package.copy("settings.txt", test.join("settings.txt"));
    let images = checksums::images_digest(&checksums::write(&package.fingerprints()?));
    package.write(FrameRow::RELEASED_PATH, frames(test, nominal)?);
    package.write("README.md", about.test_card());
    package.write(LICENSE, about.license_text());
    package.write("submission/results.csv", submission::results_header(about.is_for_fields()));
    let whole = Manifest::read(test)?;
    let suite = whole.microsig.scoring.as_ref().and_then(|rules| rules.suite.as_ref());
    let template = submission::template(suite.map(SuitePlace::edition).as_deref(), &"".into());
    package.write("submission/submission.json", template);

    let fingerprints = package.fingerprints()?;
    let manifest::Facts { calibration_d_um, calibration_places, .. } = Manifest::read(train)?.microsig;
    let tables = [calibration::table(&calibration_d_um, !calibration_places.is_empty())];
    let mut resources: Vec<Resource> = fingerprints
        .iter()
        .map(|(path, fingerprint)| {
            let frame = whole.resource(path).and_then(|image| image.frame);
            Resource { frame, ..manifest::resource(path, fingerprint, &tables) }
        })
        .collect();
    for table in resources.iter_mut().filter(|r| r.path == FrameRow::RELEASED_PATH) {
        table.profile = Some("tabular-data-resource".to_owned());
        table.description = Some(FrameRow::DESCRIPTION.to_owned());
        table.schema = Some(schema(&whole, nominal.is_some()));
    }
    let manifest = Manifest {
        profile: whole.profile.clone(),
        name: format!("{}-test", about.name),
        title: format!("{}: test split", about.title),
        description: "Images whose truth is withheld; README.md explains how to submit results.".to_owned(),
        version: whole.version.clone(),
        licenses: whole.licenses.clone(),
        microsig: manifest::Facts {
            calibration_d_um,
            calibration_places,
            ..public_facts(whole.microsig, &images, about)
        },
        resources,
    };
    let manifest = serde_json::to_string_pretty(&manifest).map_err(|e| Error::input(e.to_string()))?;
    package.write(MANIFEST, manifest + "\n");
    package.write(SHA256SUMS, checksums::write(&package.fingerprints()?));
    Ok(package)
}

/// Published facts of the manifest: none that are derived from the truth, and no seed.
fn public_facts(whole: manifest::Facts, images: &str, about: &ReleaseTexts<'_>) -> manifest::Facts {
    let mut timing = whole.timing;
    timing.0.retain(|key, _| TIMING.contains(&key.as_str()));
    manifest::Facts {
        generator: whole.generator,
        generator_version: whole.generator_version,
        layout_version: whole.layout_version,
        timing,
        um_per_px: whole.um_per_px,
        image_stretch: whole.image_stretch,
        depth_factor: whole.depth_factor,
        sensor: whole.sensor,
        renderer: whole.renderer,
        depth_range_um: whole.depth_range_um,
        depth_range_h_um: whole.depth_range_h_um,
        coordinates: whole.coordinates,
        scoring_gates: whole.scoring_gates,
        scoring: whole.scoring,
        split: Some("test".to_owned()),
        truth: Some("withheld".to_owned()),
        scored: Some(about.scored.clone()),
        images_sha256: Some(images.to_owned()),
        commitment_sha256: Some(about.commitment.to_owned()),
        deadline: about.deadline.map(|deadline| deadline.to_string()),
        ..manifest::Facts::default()
    }
}

/// The table of frames with its published columns.
fn frames(test: &Path, nominal: Option<&Recordings>) -> Result<Vec<u8>> {
    let mut table = TableReader::open(test.join(FrameRow::PATH))?;
    let columns: Vec<usize> = COLUMNS.iter().filter_map(|name| table.column(name)).collect();
    let header = table.header().to_vec();
    let failed = |e: csv::Error| Error::input(format!("{}: {e}", FrameRow::RELEASED_PATH));
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(columns.iter().map(|&c| &header[c])).map_err(failed)?;
    let mut times = nominal.map(|recordings| (0..).map(|frame| recordings.nominal_s(frame).to_string()));
    while let Some((_, cells)) = table.next_row()? {
        let meant = times.as_mut().and_then(Iterator::next);
        let cell = |&c: &usize| match &meant {
            Some(t_s) if header[c] == "t_s" => t_s.clone(),
            _ => cells[c].to_owned(),
        };
        writer.write_record(columns.iter().map(cell)).map_err(failed)?;
    }
    writer.into_inner().map_err(|e| failed(e.into_error().into()))
}

/// The table schema with the published columns only.
fn schema(whole: &Manifest, nominal: bool) -> TableSchema {
    let mut schema = whole.resource(FrameRow::PATH).and_then(|r| r.schema.clone()).unwrap_or_default();
    schema.fields.retain(|field| COLUMNS.contains(&field.name.as_str()));
    for field in schema.fields.iter_mut().filter(|field| nominal && field.name == "t_s") {
        field.description = "nominal time of the middle of the exposure, without jitter".to_owned();
    }
    schema
}
