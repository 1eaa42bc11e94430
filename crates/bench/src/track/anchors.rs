//! Results of known quality, made from the truth.

use std::path::Path;

use microsig_core::random::normal;
use microsig_core::stream::{Purpose, Streams};

use super::Options;
use super::output::{Output, Row};
use crate::error::Result;
use crate::evaluate::truth::Truth;
use crate::results::Conventions;

/// The visible truth with independent normal noise.
pub(super) fn noisy(dataset: &Path, options: &Options) -> Result<Output> {
    let mut stream = Streams::new(options.seed).stream(Purpose::BackgroundNoise, 0, 0);
    moved(dataset, |row| {
        row.x_px += options.noise_px * normal(&mut stream);
        row.y_px += options.noise_px * normal(&mut stream);
        row.z_um = row.z_um.map(|z| z + options.noise_um * normal(&mut stream));
    })
}

/// The visible truth as a program has it that counts pixels from 0 and says it counts from 1: `evaluate` must notice.
pub(super) fn offset(dataset: &Path) -> Result<Output> {
    moved(dataset, |row| {
        row.x_px -= 1.0;
        row.y_px -= 1.0;
    })
}

fn moved(dataset: &Path, mut change: impl FnMut(&mut Row)) -> Result<Output> {
    let truth = Truth::read(dataset, &Conventions::default())?;
    let visible = truth.rows.iter().zip(&truth.visible).filter(|(_, visible)| **visible);
    let rows = visible.map(|(row, _)| {
        let z_um = truth.has_z.then_some(row.at.z_um);
        let mut row = Row { frame: row.frame, track: row.track, x_px: row.at.x_px, y_px: row.at.y_px, z_um };
        change(&mut row);
        row
    });
    Ok(Output::Points(rows.collect()))
}
