//! Anchors: results of known quality, made from the truth.

use microsig_core::random::normal;
use microsig_core::stream::{Purpose, Streams};

use super::output::{Output, Row};
use super::piv;
use super::{Method, TrackOptions};
use generator::runner::DatasetPlace;
use scoring::evaluate::truth::TrueParticles;
use storage::error::Result;

pub(super) const TRUTH_NOISE: Method = Method {
    name: "truth-noise",
    about: "Anchor: the visible truth with normal noise added",
    run: |job| noisy(job.dataset, job.options),
};

pub(super) const OFFSET: Method = Method {
    name: "offset",
    about: "Anchor: the visible truth, 1 px off along x and y",
    run: |job| offset(job.dataset),
};

pub(super) const STATIC: Method = Method {
    name: "static",
    about: "Anchor: a displacement field of zeros",
    run: |job| job.fields(piv::zeros),
};

pub(super) const EMPTY: Method =
    Method { name: "empty", about: "Anchor: nothing found", run: |_| Ok(Output::Points(Vec::new())) };

/// The visible truth with independent normal noise.
fn noisy(dataset: &DatasetPlace, options: &TrackOptions) -> Result<Output> {
    let mut stream = Streams::new(options.seed).stream(Purpose::BackgroundNoise, 0, 0);
    moved(dataset, |row| {
        row.x_px += options.noise_xy_px * normal(&mut stream);
        row.y_px += options.noise_xy_px * normal(&mut stream);
        row.z_um = row.z_um.map(|z| z + options.noise_z_um * normal(&mut stream));
    })
}

/// The visible truth with pixels numbered from 0 but declared as numbered from 1: `evaluate` must print a
/// hint.
fn offset(dataset: &DatasetPlace) -> Result<Output> {
    moved(dataset, |row| {
        row.x_px -= 1.0;
        row.y_px -= 1.0;
    })
}

fn moved(dataset: &DatasetPlace, mut change: impl FnMut(&mut Row)) -> Result<Output> {
    let truth = TrueParticles::from_place(dataset)?;
    let visible = truth.rows.iter().zip(&truth.visible).filter(|(_, visible)| **visible);
    let rows = visible.map(|(row, _)| {
        let z_um = truth.has_z.then_some(row.at.z_um);
        let mut row = Row {
            frame: row.frame,
            track: row.track,
            x_px: row.at.x_px,
            y_px: row.at.y_px,
            z_um,
            deviations: None,
            d_um: None,
            shape: None,
        };
        change(&mut row);
        row
    });
    Ok(Output::Points(rows.collect()))
}
