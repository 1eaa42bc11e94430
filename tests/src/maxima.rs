//! Maximum of the final image of one particle against depth, as in Fig. 3C and D of the paper.

use std::path::Path;

use microsig_core::emission::SpheroidLaw;
use microsig_core::render::RayRenderer;
use microsig_core::render::Render;
use microsig_core::sensor::Sensor;
use microsig_core::stream::{Purpose, Streams};
use microsig_core::{Particle, Settings};
use rayon::prelude::*;

/// Mean and standard deviation of the maximum at one depth.
#[derive(Debug, Clone, Copy)]
pub struct Maximum {
    /// Depth, um.
    pub z_um: f64,
    /// Mean over images, counts.
    pub mean: f64,
    /// Standard deviation of single images, counts.
    pub deviation: f64,
    /// Number of images.
    pub images: u32,
}

/// The original's curve from `fig3c.csv` or `fig3d.csv`.
pub fn read(path: &Path) -> anyhow::Result<Vec<Maximum>> {
    let mut curve = Vec::new();
    for row in csv::Reader::from_path(path)?.deserialize() {
        let row: std::collections::HashMap<String, f64> = row?;
        curve.push(Maximum {
            z_um: row["z"],
            mean: row["max_mean"],
            deviation: row["max_std"],
            images: row["seeds"] as u32,
        });
    }
    Ok(curve)
}

/// The curve by microsig: a particle at a pixel center in the middle of the sensor, with background and
/// noise.
pub fn curve(
    settings: &Settings,
    d_um: f64,
    depths_um: &[f64],
    seed: u64,
    images: u32,
) -> anyhow::Result<Vec<Maximum>> {
    let renderer = RayRenderer::new(settings, SpheroidLaw::Original)?;
    let sensor = Sensor::new(settings);
    let streams = Streams::new(seed);
    let middle = |size: u32| f64::from(size / 2 + 1);
    let maxima: Vec<Maximum> = depths_um
        .par_iter()
        .enumerate()
        .map(|(step, &z_um)| {
            let particle =
                Particle::sphere(middle(settings.pixel_dim_x), middle(settings.pixel_dim_y), z_um, d_um);
            let brightest: Vec<f64> = (0..images)
                .map(|i| {
                    let frame = step as u32 * images + i;
                    let light = renderer.light(&[particle], &streams, Purpose::Rays, frame);
                    let image = sensor.expose(&light, &streams, Purpose::BackgroundNoise, frame);
                    image.counts.values().fold(0.0, f64::max)
                })
                .collect();
            let n = f64::from(images);
            let mean = brightest.iter().sum::<f64>() / n;
            let squares = brightest.iter().map(|b| (b - mean) * (b - mean)).sum::<f64>();
            Maximum { z_um, mean, deviation: (squares / (n - 1.0)).sqrt(), images }
        })
        .collect();
    Ok(maxima)
}
