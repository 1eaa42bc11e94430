//! Many images of one scene with independent rays: mean, variance and measures with their standard errors.

use microsig_core::emission::SpheroidLaw;
use microsig_core::render::RayRenderer;
use microsig_core::stream::{Purpose, Streams};
use microsig_core::{Particle, Settings};
use rayon::prelude::*;

use crate::measure::{Measures, measure};

/// Statistics of `images` noise-free images of gain 1.
#[derive(Debug, Clone)]
pub struct Ensemble {
    /// Number of images.
    pub images: u32,
    /// Width, px.
    pub width: usize,
    /// Mean image, counts.
    pub mean: Vec<f64>,
    /// Unbiased variance of each pixel, counts^2.
    pub variance: Vec<f64>,
    /// Measures of the mean image.
    pub of_mean: Measures,
    /// Standard errors of the measures: their spread over single images / sqrt(images).
    pub standard_errors: Measures,
}

/// Sums over images. Counts times c_int are multiples of 1/2 in all our cases, so sums are exact in any order.
#[derive(Clone)]
struct Sums {
    first: Vec<f64>,
    second: Vec<f64>,
}

impl Ensemble {
    /// Draws frames 0 to `images` - 1 of these particles.
    pub fn draw(
        settings: &Settings,
        particles: &[Particle],
        law: SpheroidLaw,
        seed: u64,
        images: u32,
    ) -> anyhow::Result<Self> {
        let renderer = RayRenderer::new(settings, law)?;
        let streams = Streams::new(seed);
        let width = settings.pixel_dim_x as usize;
        let pixels = width * settings.pixel_dim_y as usize;
        let batch = images.div_ceil(16).max(1);
        let starts: Vec<u32> = (0..images).step_by(batch as usize).collect();
        let batches: Vec<(Sums, Vec<Measures>)> = starts
            .into_par_iter()
            .map(|start| {
                let mut sums = Sums { first: vec![0.0; pixels], second: vec![0.0; pixels] };
                let measures = (start..images.min(start + batch))
                    .map(|frame| {
                        let light = renderer.light(particles, &streams, Purpose::Rays, frame);
                        for (i, &v) in light.values.iter().enumerate() {
                            sums.first[i] += v;
                            sums.second[i] += v * v;
                        }
                        measure(width, &light.values)
                    })
                    .collect();
                (sums, measures)
            })
            .collect();

        let mut sums = Sums { first: vec![0.0; pixels], second: vec![0.0; pixels] };
        for (part, _) in &batches {
            for i in 0..pixels {
                sums.first[i] += part.first[i];
                sums.second[i] += part.second[i];
            }
        }
        let n = f64::from(images);
        let mean: Vec<f64> = sums.first.iter().map(|s| s / n).collect();
        let variance =
            sums.second.iter().zip(&mean).map(|(s, m)| ((s - n * m * m) / (n - 1.0)).max(0.0)).collect();
        let single: Vec<Measures> = batches.into_iter().flat_map(|(_, measures)| measures).collect();
        Ok(Ensemble {
            images,
            width,
            of_mean: measure(width, &mean),
            standard_errors: standard_errors(&single),
            mean,
            variance,
        })
    }

    /// Sum of the pixels' variances over the sum of their means, over pixels whose mean is above 5 counts, as the
    /// original's was measured.
    pub fn fano(&self) -> f64 {
        let lit = || self.mean.iter().zip(&self.variance).filter(|(m, _)| **m > 5.0);
        lit().map(|(_, v)| v).sum::<f64>() / lit().map(|(m, _)| m).sum::<f64>()
    }
}

fn standard_errors(single: &[Measures]) -> Measures {
    let n = single.len() as f64;
    Measures::from_values(std::array::from_fn(|i| {
        let mean = single.iter().map(|m| m.values()[i]).sum::<f64>() / n;
        let squares = single.iter().map(|m| (m.values()[i] - mean).powi(2)).sum::<f64>();
        (squares / (n - 1.0) / n).sqrt()
    }))
}
