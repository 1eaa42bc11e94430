//! Anchors: results of known quality, made from the truth.

use microsig_core::random::normal;
use microsig_core::stream::{Purpose, Streams};

use super::output::{Output, Row};
use super::piv;
use super::{Localization, Method, TrackOptions};
use storage::dataset::DatasetPlace;
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
    moved(dataset, |found| {
        found.x_px += options.noise_xy_px * normal(&mut stream);
        found.y_px += options.noise_xy_px * normal(&mut stream);
        found.z_um = found.z_um.map(|z| z + options.noise_z_um * normal(&mut stream));
    })
}

/// The visible truth with pixels numbered from 0 but declared as numbered from 1: `evaluate` must print a
/// hint.
fn offset(dataset: &DatasetPlace) -> Result<Output> {
    moved(dataset, |found| {
        found.x_px -= 1.0;
        found.y_px -= 1.0;
    })
}

fn moved(dataset: &DatasetPlace, mut change: impl FnMut(&mut Localization)) -> Result<Output> {
    let (rows, has_tracks) = dataset.tracks()?;
    let rows = rows.into_iter().filter(|row| row.visible).map(|row| {
        let z_um = Some(row.z_um).filter(|z_um| z_um.is_finite());
        let mut found = Localization { x_px: row.x_px, y_px: row.y_px, z_um, ..Localization::default() };
        change(&mut found);
        Row { frame: row.frame, track: if has_tracks { row.track.cast_signed() } else { -1 }, found }
    });
    Ok(Output::Points(rows.collect()))
}
