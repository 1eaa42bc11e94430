//! Localization in a frame: background, search on a binned image, final fit at full resolution.

use std::sync::{Mutex, PoisonError};

use super::Localization;
use super::acceptance::Rejections;
use super::denoise::PixelNoise;
use super::field_images::FieldPlaces;
use super::fit::Residual;
use super::gray_image::GrayImage;
use super::images::ParticleImages;
use super::job::Job;
use super::joint_fit::{Model, fit_all};
use super::output::Output;
use super::regions;
use super::search::Search;
use super::sides;
use super::templates::Templates;
use storage::error::Result;

/// Maximum half width of a template in the search, px: images are binned for larger templates.
const SEARCH_RADIUS: usize = 40;

/// Relative error assigned to templates during the search, when overlapping particles are not yet separated.
const ROUGH_ERROR: f32 = 0.1;

/// Localizes particles with known images.
pub(super) struct Locator<I> {
    /// Images for the final fit, of each size of particles.
    images: Vec<I>,
    /// Relative error of the images.
    error: f32,
    /// Binned templates for the search, of each size, at each place of the field of view.
    coarse: Vec<Vec<Templates>>,
    /// These places, if there are several.
    places: Option<FieldPlaces>,
    /// Side of a binned pixel, px.
    bin: usize,
    /// Whether the sizes are many similar shapes.
    shapes: bool,
    /// Noise of a frame.
    noise: PixelNoise,
    step_um: f64,
}

impl Locator<Templates> {
    /// With templates of particles of several shapes.
    pub(super) fn of_shapes(templates: Vec<Templates>, error: f32, noise: PixelNoise) -> Self {
        let both = templates.into_iter().map(|of_shape| (of_shape.clone(), of_shape)).collect();
        Locator { shapes: true, ..Locator::new(both, error, noise) }
    }
}

impl<I: ParticleImages> Locator<I> {
    /// For each size of particles, templates for the search and images for the final fit; `noise` is that of
    /// a frame.
    pub(super) fn new(sizes: Vec<(Templates, I)>, error: f32, noise: PixelNoise) -> Self {
        let (templates, images): (Vec<Templates>, Vec<I>) = sizes.into_iter().unzip();
        Locator::searching(vec![templates], None, images, error, noise)
    }

    /// For each place of the field of view, templates of each size for the search nearby; and images of each
    /// size for the final fit, which depend on the position.
    pub(super) fn over_field(
        templates: Vec<Vec<Templates>>,
        places: FieldPlaces,
        images: Vec<I>,
        error: f32,
        noise: PixelNoise,
    ) -> Self {
        let places = (templates.len() > 1).then_some(places);
        Locator::searching(templates, places, images, error, noise)
    }

    fn searching(
        templates: Vec<Vec<Templates>>,
        places: Option<FieldPlaces>,
        images: Vec<I>,
        error: f32,
        noise: PixelNoise,
    ) -> Self {
        let all = || templates.iter().flatten();
        let radii = all().flat_map(|of_size| (0..of_size.len()).map(|k| of_size.get(k).radius));
        let largest = radii.max().unwrap_or(0);
        // Odd, so that the particle stays at the center of a pixel.
        let bin = largest.div_ceil(SEARCH_RADIUS).max(1) / 2 * 2 + 1;
        Locator {
            images,
            error,
            coarse: templates
                .iter()
                .map(|of_place| of_place.iter().map(|of_size| of_size.binned(bin, noise)).collect())
                .collect(),
            places,
            bin,
            shapes: false,
            noise,
            step_um: all().map(Templates::step_um).fold(f64::INFINITY, f64::min),
        }
    }

    /// Localizes and links the particles of a recording.
    pub(super) fn particles(&self, job: &Job) -> Result<Output> {
        let (of_middle, noise) = (&self.coarse[self.coarse.len() / 2], self.noise.binned(self.bin));
        of_middle
            .iter()
            .filter_map(|of_size| sides::warning(of_size, noise, self.error))
            .for_each(|text| job.warn(text));
        let rejections = Mutex::new(Rejections::default());
        let output = job.particles(|image| {
            let (found, rejected) = self.find(image);
            rejections.lock().unwrap_or_else(PoisonError::into_inner).add(rejected);
            found
        })?;
        if output.rows() == 0 {
            job.warn(rejections.into_inner().unwrap_or_else(PoisonError::into_inner).warning());
        }
        Ok(output)
    }

    /// Localizes the particles of an image and counts the rejected candidates.
    pub(super) fn find(&self, image: &GrayImage) -> (Vec<Localization>, Rejections) {
        let (level, deviation) = image.background();
        let noise = PixelNoise::new(deviation.powi(2), self.noise.gain);
        let mut coarse = image.binned(self.bin);
        coarse.counts.iter_mut().for_each(|c| *c -= level);
        let weight = weights(&coarse, noise.binned(self.bin), ROUGH_ERROR);
        let residual = Residual { image: coarse, weight };
        let (mut found, rejections) = match &self.places {
            None => Search::run(&self.coarse[0], self.shapes, residual),
            Some(places) => regions::search(&self.coarse, places, &residual, self.bin),
        };
        for fit in &mut found {
            fit.at = fit.at.map(|c| c * self.bin as f64 + (self.bin / 2) as f64);
        }
        // Those of shapes are fitted by their own images, in place of the few of the search.
        if !self.shapes {
            let images = self.images.iter().map(|of_size| of_size as &dyn ParticleImages).collect();
            let model = Model { images, noise, error: self.error, step_um: self.step_um };
            found = fit_all(image, level, &model, found);
        }
        // Drop particles outside the image, whose light may reach it.
        let size = [image.width, image.height].map(|n| n as f64);
        let inside = found
            .iter()
            .filter(|fit| fit.at.iter().zip(size).all(|(c, n)| (-0.5..n - 0.5).contains(c)))
            .map(|fit| Localization {
                x_px: fit.at[0] + 1.0,
                y_px: fit.at[1] + 1.0,
                z_um: Some(fit.z_um),
                shape: None,
            });
        (inside.collect(), rejections)
    }
}

/// Inverse variance of each pixel: background noise, light-dependent noise, and relative error of templates.
pub(super) fn weights(frame: &GrayImage, noise: PixelNoise, error: f32) -> Vec<f32> {
    let variance = |(here, around): (&f32, &f32)| {
        let light = here.max(*around).max(0.0);
        noise.variance(light) + (error * light).powi(2)
    };
    frame.counts.iter().zip(&frame.smoothed(1.0).counts).map(|both| 1.0 / variance(both)).collect()
}
