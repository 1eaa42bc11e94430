//! Ensemble of images of one scene with independent rays: mean, variance, and measures with standard errors.

use microsig_core::emission::{self, SpheroidLaw};
use microsig_core::optics::{OpticalSystem, Ray};
use microsig_core::render::RayRenderer;
use microsig_core::render::Render;
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
    pub mean_measures: Measures,
    /// Standard errors of the measures: their spread over single images / sqrt(images).
    pub standard_errors: Measures,
}

/// Number of rays per random stream.
const RAYS_OF_A_BATCH: u64 = 1 << 18;

/// Sums over images. Counts times c_int are multiples of 1/2 in all cases, so sums are exact in any order.
#[derive(Clone)]
struct Sums {
    first: Vec<f64>,
    second: Vec<f64>,
}

impl Ensemble {
    /// Renders frames 0 to `images` - 1 of these particles.
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
            mean_measures: measure(width, &mean),
            standard_errors: standard_errors(&single),
            mean,
            variance,
        })
    }

    /// Images of a sphere with about `rays` rays in total, from random points of its near half in random
    /// directions.
    ///
    /// This is the distribution that the regular spirals of the model approximate. The spirals leave a row
    /// pattern in the mean of any number of images, random rays do not. Only directions that can reach the
    /// aperture are drawn.
    pub fn with_random_light(settings: &Settings, particle: &Particle, seed: u64, rays: u64) -> Self {
        let system = OpticalSystem::new(settings);
        let (width, height) = (settings.pixel_dim_x as usize, settings.pixel_dim_y as usize);
        let (distance, radius) = (system.objective.object_distance(particle.z_um), particle.d_um / 2.0);
        let slope = (system.objective.aperture_radius + radius) / (distance - radius);
        let least_cosine = 1.0 / f64::sqrt(1.0 + slope * slope);
        let points = emission::sphere_points(settings, particle.d_um) as f64;
        let an_image = points * (f64::from(settings.n_rays) + 1.0) * (1.0 - least_cosine);
        let images = (rays as f64 / an_image).ceil() as u32;
        let rays = (f64::from(images) * an_image).round() as u64;

        let streams = Streams::new(seed);
        let batches = rays.div_ceil(RAYS_OF_A_BATCH);
        let counts = (0..batches)
            .into_par_iter()
            .fold(
                || vec![0u64; width * height],
                |mut counts, batch| {
                    let mut stream = streams.stream(Purpose::Rays, batch as u32, 0);
                    for _ in 0..RAYS_OF_A_BATCH.min(rays - batch * RAYS_OF_A_BATCH) {
                        let mut cap = |low: f64| {
                            let cosine = low + (1.0 - low) * stream.uniform();
                            let (sine, azimuth) =
                                (f64::sqrt(1.0 - cosine * cosine), std::f64::consts::TAU * stream.uniform());
                            [cosine, sine * azimuth.cos(), sine * azimuth.sin()]
                        };
                        let ([toward, e2, e3], [d1, d2, d3]) = (cap(0.0), cap(least_cosine));
                        let ray = Ray { q_x: radius * e2, q_y: radius * e3, p_x: d2 / d1, p_y: d3 / d1 };
                        let Some((x, y)) = system.trace(ray, distance - radius * toward) else { continue };
                        let column = (x / settings.pixel_size + particle.x_px).round_ties_even();
                        let row = (y / settings.pixel_size + particle.y_px).round_ties_even();
                        if (1.0..=width as f64).contains(&column) && (1.0..=height as f64).contains(&row) {
                            counts[(row as usize - 1) * width + column as usize - 1] += 1;
                        }
                    }
                    counts
                },
            )
            .reduce(
                || vec![0; width * height],
                |mut a, b| {
                    a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
                    a
                },
            );
        let n = f64::from(images);
        let mean: Vec<f64> = counts.iter().map(|&c| c as f64 / n).collect();
        // Counts of independent rays are Poisson distributed.
        let mean_measures = measure(width, &mean);
        let mut errors = [f64::NAN; Measures::NAMES.len()];
        errors[0] = (mean_measures.total / n).sqrt();
        Ensemble {
            images,
            width,
            variance: mean.clone(),
            standard_errors: Measures::from_values(errors),
            mean_measures,
            mean,
        }
    }

    /// Fano factor: sum of the pixel variances over the sum of their means, over pixels with a mean above 5
    /// counts, as measured for the original.
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
