//! Images in the limit of many rays: no noise of the rays, and derivatives by the particle's place.
//!
//! The law is that of `rays` with infinitely many source points and isotropic directions, times (n_rays + 1)/n_rays (the
//! spiral's own excess over isotropic light): a particle sends N_s (n_rays + 1) rays toward the lens side, and a pixel
//! gets its share of them. For a sphere this share depends on depth, diameter and the pixel's place relative to the
//! particle alone, and comes from a table (`block`): behind a spherical lens a radial profile with the few harmonics of
//! a square pixel (`encircled`, `pixel`), with a cylindrical lens one quadrant of the image (`planar`). Tables are made when
//! they are first needed, verified against images computed directly while they are made, and shared by all clones of a
//! renderer; when they grow beyond 512 MB, those that the current image does not need are dropped.
//!
//! Left out: spheroids, which [`ExpectedRenderer::check`] refuses.

mod block;
mod draw;
mod encircled;
mod pixel;
mod planar;
mod pupil;
mod slopes;
mod spline;
mod tables;

use std::sync::Arc;

use rayon::prelude::*;

use super::patch::Window;
use super::rays::RayRenderer;
use crate::emission::{self, SpheroidLaw};
use crate::error::Error;
use crate::optics::OpticalSystem;
use crate::particle::Particle;
use crate::sensor::Light;
use crate::settings::Settings;
use block::{Block, Model};
use draw::Drawing;
use pupil::Pupil;
use slopes::Sheet;
use tables::Tables;

/// Error of an image, unless another is asked for: the root mean square over the pixels' possible places, as a share of
/// the image's peak. Single places, next to kinks of the model's image, may err by up to four times as much.
pub const DEFAULT_TOLERANCE: f64 = 1e-3;

/// The tolerances that tables can be asked for.
pub const TOLERANCES: std::ops::RangeInclusive<f64> = 1e-4..=0.1;

/// Draws particles without the noise of rays.
///
/// # The noise-free image of one particle
/// ```
/// use microsig_core::emission::SpheroidLaw;
/// use microsig_core::render::expected::{DEFAULT_TOLERANCE, ExpectedRenderer};
/// use microsig_core::{Particle, Settings};
///
/// let renderer = ExpectedRenderer::new(&Settings::setting1(), SpheroidLaw::Original, DEFAULT_TOLERANCE)?;
/// let patch = renderer.patch(&Particle::sphere(100.3, 80.0, -30.0, 2.0)).expect("it lies on the sensor");
/// let counts: f64 = patch.counts.iter().sum();
/// let peak = patch.counts.iter().copied().fold(0.0, f64::max);
/// assert!(counts > 10_000.0 && peak > 50.0, "rays of brightness 1; times gain they are counts of the camera");
/// # Ok::<(), microsig_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct ExpectedRenderer {
    rays: RayRenderer,
    tables: Arc<Tables>,
}

/// Expected ray counts of one particle of brightness 1 on the sensor pixels it can reach.
#[derive(Debug, Clone, PartialEq)]
pub struct ExpectedPatch {
    /// Where on the sensor.
    pub window: Window,
    /// Counts, row by row.
    pub counts: Vec<f64>,
}

/// Expected ray counts of one particle and their derivatives by its place.
#[derive(Debug, Clone, PartialEq)]
pub struct Gradient {
    /// Where on the sensor.
    pub window: Window,
    /// For each pixel, row by row: counts, and their derivatives by x (1/px), y (1/px) and z (1/um).
    pub pixels: Vec<[f64; 4]>,
}

impl ExpectedRenderer {
    /// A renderer for these settings, with this tolerance (see [`DEFAULT_TOLERANCE`]).
    ///
    /// # Errors
    /// [`Error::Malformed`] if a setting is out of range, [`Error::Unsupported`] for a tolerance outside [`TOLERANCES`].
    pub fn new(settings: &Settings, law: SpheroidLaw, tolerance: f64) -> Result<Self, Error> {
        if !TOLERANCES.contains(&tolerance) {
            return Err(Error::Unsupported(format!(
                "tolerance = {tolerance}: expected {} to {}, a share of an image's peak",
                TOLERANCES.start(),
                TOLERANCES.end()
            )));
        }
        let rays = RayRenderer::new(settings, law)?;
        let pupil = Pupil { system: OpticalSystem::new(settings), pixel_size: settings.pixel_size };
        let margin = Self::margin(settings);
        let [x, y] = [settings.pixel_dim_x, settings.pixel_dim_y].map(|size| f64::from(size) + margin);
        let farthest_px =
            if pupil.system.cylinder.is_some() { [x, y] } else { [libm::sqrt(x * x + y * y); 2] };
        let model = Model { pupil, tolerance, farthest_px, pixels: Default::default() };
        Ok(ExpectedRenderer { rays, tables: Arc::new(Tables::new(model)) })
    }

    /// How far from the sensor a particle may lie, px, if its light falls on it.
    fn margin(settings: &Settings) -> f64 {
        (f64::from(settings.pixel_dim_x.max(settings.pixel_dim_y)) / 2.0).max(50.0)
    }

    /// The settings.
    pub fn settings(&self) -> &Settings {
        self.rays.settings()
    }

    /// Whether this particle can be drawn, and what should be known about its image if so.
    ///
    /// # Errors
    /// [`Error::Unsupported`] as [`RayRenderer::check`], for spheroids, and for a particle so far outside the sensor that
    /// no table reaches from it to there.
    pub fn check(&self, particle: &Particle) -> Result<Option<String>, Error> {
        let warning = self.rays.check(particle)?;
        if particle.spheroid.is_some() {
            return Err(Error::Unsupported("spheroids cannot be drawn as expected images yet".to_owned()));
        }
        let (settings, margin) = (self.settings(), Self::margin(self.settings()));
        let outside = |at: f64, size: u32| (0.5 - at).max(at - f64::from(size) - 0.5);
        let farthest =
            outside(particle.x_px, settings.pixel_dim_x).max(outside(particle.y_px, settings.pixel_dim_y));
        if farthest > margin && self.rays.reaches_sensor(particle) {
            return Err(Error::Unsupported(format!(
                "it lies {farthest:.1} px outside the sensor, onto which its light falls; expected images reach particles up to {margin} px outside"
            )));
        }
        Ok(warning)
    }

    /// Half width and half height of a particle's image, px, with some margin.
    pub fn image_extent(&self, particle: &Particle) -> (f64, f64) {
        self.rays.image_extent(particle)
    }

    /// Whether some of a particle's light may fall on the sensor.
    pub fn reaches_sensor(&self, particle: &Particle) -> bool {
        self.rays.reaches_sensor(particle)
    }

    /// The tolerance.
    pub fn tolerance(&self) -> f64 {
        self.tables.model.tolerance
    }

    /// Makes the tables for these particles now rather than when they are drawn.
    pub fn prepare(&self, particles: &[Particle]) {
        self.blocks(particles.iter());
    }

    /// The expected counts of one particle. `None`: none of its light can fall on the sensor.
    pub fn patch(&self, particle: &Particle) -> Option<ExpectedPatch> {
        let block = self.block(particle);
        let window = self.window(particle, &block);
        if window.area() == 0 {
            return None;
        }
        let drawing = self.drawing(particle, &block, 1.0);
        let mut counts = vec![0.0; window.area()];
        drawing.add_to(&mut counts);
        Some(ExpectedPatch { window, counts })
    }

    /// The expected counts of one sphere with their derivatives. `None`: none of its light can fall on the sensor.
    pub fn gradient(&self, particle: &Particle) -> Option<Gradient> {
        let block = self.block(particle);
        let window = self.window(particle, &block);
        if window.area() == 0 {
            return None;
        }
        let sheet = Sheet::new(&block, particle.z_um, 0.5 * particle.d_um);
        let light = self.total(particle);
        let pixels = (0..window.area())
            .map(|i| {
                let dx = (window.x0 + (i % window.width) as i64) as f64 - particle.x_px;
                let dy = (window.y0 + (i / window.width) as i64) as f64 - particle.y_px;
                let [value, by_x, by_y, by_z] = sheet.at(dx, dy);
                // A particle that moves to the right is a pixel that moves to the left.
                [light * value, -light * by_x, -light * by_y, light * by_z]
            })
            .collect();
        Some(Gradient { window, pixels })
    }

    /// Adds up the light of all particles of one image.
    pub fn light(&self, particles: &[Particle]) -> Light {
        let mut light = Light::dark(self.settings());
        let width = light.width as usize;
        let blocks = self.blocks(particles.iter());
        let drawings: Vec<Drawing> = particles
            .par_iter()
            .zip(&blocks)
            .map(|(particle, block)| self.drawing(particle, block, particle.c_int))
            .collect();
        light.values.par_chunks_mut(width).enumerate().with_min_len(64).for_each(|(row, pixels)| {
            for drawing in &drawings {
                drawing.add_row(row, pixels);
            }
        });
        light
    }

    /// Number of blocks of the tables, their memory in bytes, and the largest error found in any of them as a share of
    /// an image's peak.
    pub fn tables(&self) -> (usize, usize, f64) {
        self.tables.state()
    }

    fn blocks<'a>(&self, particles: impl Iterator<Item = &'a Particle>) -> Vec<Arc<Block>> {
        self.tables.blocks(particles)
    }

    fn block(&self, particle: &Particle) -> Arc<Block> {
        self.blocks(std::iter::once(particle)).remove(0)
    }

    fn drawing(&self, particle: &Particle, block: &Block, factor: f64) -> Drawing {
        let place = [particle.x_px, particle.y_px, particle.z_um];
        let light = factor * self.total(particle);
        Drawing::new(block, place, 0.5 * particle.d_um, light, self.window(particle, block))
    }

    /// The light that a particle sends toward the lens side, in rays.
    fn total(&self, particle: &Particle) -> f64 {
        let points = emission::surface_points(self.settings(), particle);
        points as f64 * (f64::from(self.settings().n_rays) + 1.0)
    }

    fn window(&self, particle: &Particle, block: &Block) -> Window {
        let sensor = (self.settings().pixel_dim_x, self.settings().pixel_dim_y);
        Window::around(particle.x_px, particle.y_px, (block.reach_px[0], block.reach_px[1]), sensor)
    }
}
