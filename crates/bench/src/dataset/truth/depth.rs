//! `truth/depth.csv`: what the noise-free image of a particle is at each depth, and how much the depth counts.

use std::path::Path;

use super::field;
use crate::dataset::table::{Table, TableFile, column};
use crate::error::Result;
use crate::light::Stack;
use crate::scenario::{Scenario, Weighting};
use glam::DVec3;

/// One row per depth.
pub static DEPTH: Table = Table::new(
    "truth/depth.csv",
    "One row per depth, 51 of them through the depth range: the noise-free image of a sphere of the mean diameter and the \
     middle brightness, centred on a pixel in the middle of the image, in the light there.",
    &[
        column("z_um", "number", "um", "physical depth, growing away from the lens"),
        column("peak_counts", "number", "counts", "greatest count of the image above the background"),
        column(
            "snr",
            "number",
            "",
            "peak_counts over the standard deviation of the background; empty without noise",
        ),
        column("area_px", "number", "px", "pixels above 10 % of the peak"),
        column(
            "weight",
            "number",
            "",
            "share of this depth in the depth-weighted displacement; empty if there is none",
        ),
    ],
);

/// What the manifest tells of particle images.
#[derive(Debug, Clone, PartialEq)]
pub struct ParticleImage {
    /// Diameter of the particle, um.
    pub d_um: f64,
    /// A_pi: the image's area, averaged over depth, px.
    pub area_px: f64,
    /// Median over depth of the signal-to-noise ratio; `None` without noise.
    pub snr: Option<f64>,
    /// The background, counts.
    pub background_counts: f64,
    /// Standard deviation of the background, counts.
    pub background_noise_counts: f64,
    /// The depth of the highest peak, um; `None` where all depths are in focus.
    pub focus_um: Option<f64>,
}

/// Writes the table into a dataset's folder.
///
/// # Errors
/// Writing.
pub fn write(folder: &Path, scenario: &Scenario, stack: &Stack) -> Result<ParticleImage> {
    let (settings, d_um) = (&scenario.settings, scenario.seeding.diameters().mean());
    let middle = (settings.pixel_dim_y / 2) as usize * settings.pixel_dim_x as usize
        + (settings.pixel_dim_x / 2) as usize;
    let response = scenario.sensor()?.response(middle);
    let counts = response.slope * scenario.cloud.intensities.typical(d_um);
    let noise = response.background_noise;
    let weights = scenario.truth_grid().filter(|nodes| nodes.weighting != Weighting::None).map(|nodes| {
        let light = stack.depths_um.iter().map(|z_um| scenario.illumination.at(DVec3::Z * *z_um));
        field::normalised(&field::weights(stack, nodes.weighting), light)
    });
    let mut writer = TableFile::create(folder, &DEPTH)?;
    let mut peaks = Vec::with_capacity(stack.spots.len());
    for (k, (z_um, spot)) in stack.depths_um.iter().zip(&stack.spots).enumerate() {
        let peak = counts * spot.peak * scenario.illumination.at(DVec3::Z * *z_um);
        peaks.push(peak);
        let weight = weights.as_ref().map_or(f64::NAN, |weights| weights[k]);
        // Without noise the ratio is infinite, which is an empty cell.
        writer.cells().numbers(&[*z_um, peak, peak / noise, spot.area_px, weight]);
        writer.end_row()?;
    }
    writer.finish()?;
    peaks.sort_unstable_by(f64::total_cmp);
    Ok(ParticleImage {
        d_um,
        area_px: stack.area_px(),
        snr: (noise > 0.0).then(|| peaks[peaks.len() / 2] / noise),
        background_counts: response.background,
        background_noise_counts: noise,
        focus_um: stack.focus_um(),
    })
}
