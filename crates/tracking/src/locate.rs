//! Localization in a frame: background, search on a binned image, final fit at full resolution.

use std::sync::{Mutex, PoisonError};

use super::acceptance::Rejections;
use super::denoise::PixelNoise;
use super::field_images::FieldPlaces;
use super::fit::{ParticleFit, Residual};
use super::gray_image::GrayImage;
use super::images::ParticleImages;
use super::job::Job;
use super::joint_fit::{Model, fit_all};
use super::maps::{KEPT_BYTES, MapTemplates};
use super::output::Output;
use super::positions::Position;
use super::regions;
use super::search::{COARSE, Search};
use super::sides;
use super::templates::Templates;
use super::{Localization, OtherSide};
use storage::error::Result;

/// Maximum half width of a template in the search, px: images are binned for larger templates.
const SEARCH_RADIUS: usize = 40;

/// Relative error assigned to templates during the search, when overlapping particles are not yet separated.
const ROUGH_ERROR: f32 = 0.1;

/// The search in a frame, binned if the templates are large.
pub(super) struct Coarse {
    /// Binned templates, of each size, at each place of the field of view.
    templates: Vec<MapTemplates>,
    /// These places, if there are several.
    places: Option<FieldPlaces>,
    /// Whether a candidate is compared with templates of its own size alone, of many similar ones.
    own_size: bool,
    /// Side of a binned pixel, px.
    bin: usize,
    /// Noise of a frame.
    noise: PixelNoise,
}

/// What a search found: background and noise of the frame, particles with positions on it, rejected candidates.
pub(super) struct Found {
    pub(super) level: f32,
    pub(super) noise: PixelNoise,
    pub(super) particles: Vec<ParticleFit>,
    pub(super) rejections: Rejections,
}

/// Localizes particles with known images.
pub(super) struct Locator<I> {
    /// Images for the final fit, of each size of particles.
    images: Vec<I>,
    /// Relative error of the images.
    error: f32,
    coarse: Coarse,
    step_um: f64,
    /// Whether standard deviations of positions are reported.
    has_deviations: bool,
    /// Whether the background may be uneven, which images of a model do not contain.
    is_uneven: bool,
    /// Diameters of the images, um, if they are reported; of all `images` that diameters are fitted with, the first are
    /// those of the search.
    diameters_um: Vec<f64>,
}

impl Coarse {
    fn new(templates: &[Vec<Templates>], places: Option<FieldPlaces>, noise: PixelNoise) -> Self {
        let all = templates.iter().flatten();
        let radii = all.flat_map(|templates| (0..templates.len()).map(|k| templates.get(k).radius));
        let largest = radii.max().unwrap_or(0);
        // Odd, so that the particle stays at the center of a pixel.
        let bin = largest.div_ceil(SEARCH_RADIUS).max(1) / 2 * 2 + 1;
        let binned = |place: &Vec<Templates>| {
            let sizes = place.iter().map(|templates| templates.binned(bin, noise)).collect();
            MapTemplates::new(sizes, COARSE, KEPT_BYTES / templates.len())
        };
        Coarse { templates: templates.iter().map(binned).collect(), places, own_size: false, bin, noise }
    }

    /// With templates of many shapes of a particle.
    pub(super) fn for_shapes(templates: Vec<Templates>, noise: PixelNoise) -> Self {
        Coarse { own_size: true, ..Coarse::new(&[templates], None, noise) }
    }

    /// Finds particles, or fits those at known positions only.
    pub(super) fn find(&self, image: &GrayImage, given: Option<&[Position]>) -> Found {
        let (level, deviation) = image.background();
        let noise = PixelNoise::new(deviation.powi(2), self.noise.gain);
        let mut binned = image.binned(self.bin);
        binned.counts.iter_mut().for_each(|c| *c -= level);
        let weight = weights(&binned, noise.binned(self.bin), ROUGH_ERROR);
        let residual = Residual { image: binned, weight };
        let (bin, middle) = (self.bin as f64, (self.bin / 2) as f64);
        let binned: Option<Vec<Position>> = given
            .map(|given| given.iter().map(|of| of.mapped(|at| at.map(|c| (c - middle) / bin))).collect());
        let (mut particles, rejections) = match &self.places {
            None => Search::run(&self.templates[0], self.own_size, residual, binned.as_deref()),
            Some(places) => regions::search(&self.templates, places, &residual, self.bin, binned.as_deref()),
        };
        particles.iter_mut().for_each(|fit| *fit = fit.mapped(|at| at.map(|c| c * bin + middle)));
        Found { level, noise, particles, rejections }
    }
}

impl<I: ParticleImages> Locator<I> {
    /// For each size of particles, templates for the search and images for the final fit; `noise` is the noise of
    /// a frame.
    pub(super) fn new(sizes: Vec<(Templates, I)>, error: f32, noise: PixelNoise) -> Self {
        let (templates, images): (Vec<Templates>, Vec<I>) = sizes.into_iter().unzip();
        Locator::over_field(vec![templates], FieldPlaces::new(Vec::new()), images, error, noise)
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
        let step_um = templates.iter().flatten().map(Templates::step_um).fold(f64::INFINITY, f64::min);
        let coarse = Coarse::new(&templates, places, noise);
        Locator {
            images,
            error,
            coarse,
            step_um,
            has_deviations: false,
            is_uneven: false,
            diameters_um: Vec::new(),
        }
    }

    /// The same with standard deviations of positions, which images without errors of their own determine.
    pub(super) fn with_deviations(self) -> Self {
        Locator { has_deviations: true, ..self }
    }

    /// The same for frames of a recording, whose background may be uneven.
    pub(super) fn on_uneven(self, is_uneven: bool) -> Self {
        Locator { is_uneven, ..self }
    }

    /// The same with the diameter of each particle: of several `calibrated_um`, that of the images which it resembles most.
    pub(super) fn with_classes(self, calibrated_um: Vec<f64>) -> Self {
        let diameters_um = if calibrated_um.len() > 1 { calibrated_um } else { Vec::new() };
        Locator { diameters_um, ..self }
    }

    /// The same with the diameter of each particle fitted, by images at further diameters (um, ascending).
    pub(super) fn with_diameters(mut self, at: Vec<(f64, I)>) -> Self {
        for (d_um, images) in at {
            self.diameters_um.push(d_um);
            self.images.push(images);
        }
        self
    }

    /// Localizes and links the particles of a recording.
    pub(super) fn particles(&self, job: &Job) -> Result<Output> {
        let Coarse { templates, noise, bin, .. } = &self.coarse;
        let noise = noise.binned(*bin);
        templates[templates.len() / 2]
            .sizes
            .iter()
            .filter_map(|templates| sides::warning(templates, noise, self.error))
            .for_each(|text| job.warn(text));
        let rejections = Mutex::new(Rejections::default());
        let output = job.particles(|frame, image| {
            let (found, rejected) = self.find(image, job.given(frame));
            rejections.lock().unwrap_or_else(PoisonError::into_inner).add(rejected);
            found
        })?;
        if output.rows() == 0 && job.positions.is_none() {
            job.warn(rejections.into_inner().unwrap_or_else(PoisonError::into_inner).warning());
        }
        Ok(output)
    }

    /// Localizes the particles of an image, or those at known positions, and counts the rejected candidates.
    pub(super) fn find(
        &self,
        image: &GrayImage,
        given: Option<&[Position]>,
    ) -> (Vec<Localization>, Rejections) {
        let even = self.is_uneven.then(|| image.evened());
        let image = even.as_ref().unwrap_or(image);
        let Found { level, noise, particles, rejections } = self.coarse.find(image, given);
        let images = self.images.iter().map(|templates| templates as &dyn ParticleImages).collect();
        let searched = self.coarse.templates.first().map_or(0, |place| place.sizes.len());
        let is_fitted = self.images.len() > searched;
        let ladder = if is_fitted { &self.diameters_um[..] } else { &[] };
        let model = Model { images, ladder, noise, error: self.error, step_um: self.step_um };
        // Without particles beyond the image, whose light may reach it.
        let found = fit_all(image, level, &model, particles).into_iter().filter(|fit| image.contains(fit.at));
        let reported = |deviations: Option<[f64; 3]>| deviations.filter(|_| self.has_deviations);
        let other_side = |other: OtherSide| OtherSide {
            at: other.at.map(|at| at + 1.0),
            deviations: reported(other.deviations),
            ..other
        };
        let localization = |fit: ParticleFit| Localization {
            x_px: fit.at[0] + 1.0,
            y_px: fit.at[1] + 1.0,
            z_um: Some(fit.z_um),
            deviations: reported(fit.deviations),
            d_um: fit.d_um.or_else(|| self.diameters_um.get(fit.size).copied()),
            shape: None,
            other: fit.other.map(other_side),
            track: fit.given.and_then(|given| given.track),
        };
        (found.map(localization).collect(), rejections)
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
