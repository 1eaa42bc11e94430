//! Images in the limit of many rays: no noise of the rays, and derivatives by the particle's place.
//!
//! The law is that of `rays` with isotropic directions and, for spheres, infinitely many source points, times
//! (n_rays + 1)/n_rays (the spiral's own excess over isotropic light): a particle sends (n_rays + 1) rays from each source
//! point toward the lens side, and a pixel gets its share of them. Images of spheres depend on depth, diameter and the pixel's
//! place relative to the particle alone, and come from tables (`block`), which are made when they are first needed, verified
//! while they are made (`build`), and shared by all clones of a renderer (`tables`); when they grow beyond 512 MB, those that
//! the current image does not need are dropped. With a cylindrical lens images have two mirror symmetries: a quadrant is
//! computed part by part of the lens (`exposure`, `stamp`) and drawn from a spline over it (`draw_quadrant`). Behind a
//! spherical lens images are round: they are computed as light within a radius (`encircled`), seen by a square pixel
//! (`pixel`), and drawn from a quadrant as well if few nodes are enough, along the radius (`draw_round`) if rims are sharp
//! or rings large. A spheroid is computed in the same way, directly and without tables (`spheroid`).

mod block;
mod build;
mod draw;
mod draw_quadrant;
mod draw_round;
mod encircled;
mod exposure;
mod layout;
mod pixel;
mod pupil;
mod rings;
mod sheet;
mod spheroid;
mod spline;
mod stamp;
mod surface;
mod tables;

use std::sync::Arc;

use rayon::prelude::*;

use super::instructions::InstructionSet;
use super::patch::Window;
use super::rays::RayRenderer;
use crate::emission::{self, SpheroidLaw};
use crate::error::Error;
use crate::optics::OpticalSystem;
use crate::particle::Particle;
use crate::sensor::{Image, Light, Sensor};
use crate::settings::Settings;
use crate::shelf::{Lent, Shelf};
use crate::stream::{Purpose, Streams};
use block::Block;
use build::Model;
use draw::{Canvas, Figure, Sphere};
use pixel::Pixels;
use pupil::Pupil;
use sheet::Sheet;
use surface::Surface;
use tables::Tables;

/// Error of an image, unless another is asked for: the root mean square over the pixels' possible places, as a share of
/// the image's peak. Single places, next to kinks of the model's image, may err by up to four times as much.
pub const DEFAULT_TOLERANCE: f64 = 1e-3;

/// The tolerances that tables can be asked for.
pub const TOLERANCES: std::ops::RangeInclusive<f64> = 1e-4..=0.1;

/// Rows that are exposed at a time, and the fewest that a thread draws.
const BAND: usize = 64;

/// Particles whose images are held at a time.
const PARTICLES: usize = 1024;

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
    instructions: InstructionSet,
    tables: Arc<Tables>,
    /// Working memory, kept from image to image.
    canvases: Shelf<Vec<f32>>,
}

/// What a particle is drawn from.
enum Template {
    Block(Arc<Block>),
    Patch(Window, Vec<f32>),
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
        Self::on(InstructionSet::best(), settings, law, tolerance)
    }

    /// The same with an instruction set of one's choice; all give the same images.
    ///
    /// # Errors
    /// As [`ExpectedRenderer::new`].
    pub fn on(
        instructions: InstructionSet,
        settings: &Settings,
        law: SpheroidLaw,
        tolerance: f64,
    ) -> Result<Self, Error> {
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
        let model = Model { pupil, tolerance, farthest_px, pixels: Pixels::default(), instructions };
        Ok(ExpectedRenderer {
            rays,
            instructions,
            tables: Arc::new(Tables::new(model)),
            canvases: Shelf::default(),
        })
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
    /// [`Error::Unsupported`] as [`RayRenderer::check`], and for a sphere so far outside the sensor that no table reaches
    /// from it to there.
    pub fn check(&self, particle: &Particle) -> Result<Option<String>, Error> {
        let warning = self.rays.check(particle)?;
        if self.is_spheroid(particle) {
            return Ok(warning);
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
        self.tables.blocks(particles.iter().filter(|particle| !self.is_spheroid(particle)));
    }

    /// The expected counts of one particle. `None`: none of its light can fall on the sensor.
    pub fn patch(&self, particle: &Particle) -> Option<ExpectedPatch> {
        let image = self.images(std::slice::from_ref(particle)).remove(0);
        let figure = self.figure(particle, &image, 1.0);
        let (Figure::Sphere(Sphere { window, .. }) | Figure::Patch { window, .. }) = figure;
        if window.area() == 0 {
            return None;
        }
        let stride = draw::stride(window.width);
        let mut pixels = vec![0.0; window.height * stride];
        let canvas = Canvas { x0: window.x0, y0: window.y0, stride, pixels: &mut pixels };
        draw::draw(self.instructions, std::iter::once(figure), canvas);
        let mut counts = vec![0.0; window.area()];
        draw::copy(&pixels, window.width, &mut counts);
        Some(ExpectedPatch { window, counts })
    }

    /// The expected counts of one particle with their derivatives: those of the tables for spheres, differences over half a
    /// pixel and 1 um for spheroids. `None`: none of its light can fall on the sensor.
    pub fn gradient(&self, particle: &Particle) -> Option<Gradient> {
        if self.is_spheroid(particle) {
            return self.gradient_by_differences(particle);
        }
        let block = self.tables.blocks(std::iter::once(particle)).remove(0);
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

    fn gradient_by_differences(&self, particle: &Particle) -> Option<Gradient> {
        /// Half the distance of the two images of a difference: px, px, um.
        const STEPS: [f64; 3] = [0.25, 0.25, 0.5];
        let window = self.spheroid_window(particle);
        if window.area() == 0 {
            return None;
        }
        let surface = spheroid::surface(self.settings(), self.rays.law(), particle);
        let at = |axis: usize, by: f64| {
            let mut place = [particle.x_px, particle.y_px, particle.z_um];
            place[axis] += by;
            self.spheroid(&surface, place, window)
        };
        let mut pixels: Vec<[f64; 4]> =
            at(0, 0.0).into_iter().map(|v| [f64::from(v), 0.0, 0.0, 0.0]).collect();
        for (axis, step) in STEPS.into_iter().enumerate() {
            for ((pixel, low), high) in pixels.iter_mut().zip(at(axis, -step)).zip(at(axis, step)) {
                pixel[axis + 1] = f64::from(high - low) / (2.0 * step);
            }
        }
        Some(Gradient { window, pixels })
    }

    /// Adds up the light of all particles of one image.
    pub fn light(&self, particles: &[Particle]) -> Light {
        let mut light = Light::dark(self.settings());
        draw::copy(&self.canvas(particles), light.width as usize, &mut light.values);
        light
    }

    /// The image that `sensor`, one of these settings, makes of [`ExpectedRenderer::light`], faster: without memory for this
    /// light.
    pub fn image(
        &self,
        particles: &[Particle],
        sensor: &Sensor,
        streams: &Streams,
        purpose: Purpose,
        frame: u32,
    ) -> Image {
        let canvas = self.canvas(particles);
        let (columns, rows) = (self.settings().pixel_dim_x, self.settings().pixel_dim_y);
        let stride = draw::stride(columns as usize);
        sensor.expose_bands((columns, rows), BAND, streams, purpose, frame, |first, light| {
            draw::copy(&canvas[first * stride..], columns as usize, light);
        })
    }

    /// Draws all particles of one image.
    fn canvas(&self, particles: &[Particle]) -> Lent<'_, Vec<f32>> {
        let stride = draw::stride(self.settings().pixel_dim_x as usize);
        let rows = self.settings().pixel_dim_y as usize;
        let mut canvas = self.canvases.lend();
        canvas.resize(rows * stride, 0.0);
        // Each thread has a band of rows and all particles in the order of their rows in the data file: no sum depends on
        // the number of threads.
        let band = rows.div_ceil(rayon::current_num_threads()).max(BAND);
        for particles in particles.chunks(PARTICLES) {
            let images = self.images(particles);
            canvas.par_chunks_mut(band * stride).enumerate().for_each(|(i, pixels)| {
                let canvas = Canvas { x0: 1, y0: (i * band) as i64 + 1, stride, pixels };
                let figures = particles.iter().zip(&images);
                let figures = figures.map(|(particle, image)| self.figure(particle, image, particle.c_int));
                draw::draw(self.instructions, figures, canvas);
            });
        }
        canvas
    }

    /// Number of blocks of the tables, their memory in bytes, and the largest error found in any of them as a share of
    /// an image's peak.
    pub fn tables(&self) -> (usize, usize, f64) {
        self.tables.state()
    }

    /// How the tables made so far miss the tolerance, if they do.
    pub fn shortfall(&self) -> Option<String> {
        let ((_, _, error), tolerance) = (self.tables(), self.tolerance());
        (error > tolerance).then(|| {
            format!("expected images err by up to {error:.1e} of their peaks, more than the tolerance of {tolerance:.1e}")
        })
    }

    /// Whether a particle is computed directly. With the uniform law a spheroid of aspect ratio 1 is the sphere.
    fn is_spheroid(&self, particle: &Particle) -> bool {
        particle.spheroid.is_some_and(|s| s.e_p != 1.0 || self.rays.law() == SpheroidLaw::Original)
    }

    /// What each particle is drawn from.
    fn images(&self, particles: &[Particle]) -> Vec<Template> {
        let mut blocks = self.tables.blocks(particles.iter().filter(|p| !self.is_spheroid(p))).into_iter();
        let patches: Vec<Option<Template>> = particles
            .par_iter()
            .map(|particle| {
                self.is_spheroid(particle).then(|| {
                    let window = self.spheroid_window(particle);
                    let surface = spheroid::surface(self.settings(), self.rays.law(), particle);
                    let place = [particle.x_px, particle.y_px, particle.z_um];
                    Template::Patch(window, self.spheroid(&surface, place, window))
                })
            })
            .collect();
        patches.into_iter().filter_map(|patch| patch.or_else(|| blocks.next().map(Template::Block))).collect()
    }

    fn spheroid(&self, surface: &Surface, place: [f64; 3], window: Window) -> Vec<f32> {
        if window.area() == 0 {
            return Vec::new();
        }
        spheroid::patch(&self.tables.model, self.settings(), surface, place, window)
    }

    fn spheroid_window(&self, particle: &Particle) -> Window {
        let sensor = (self.settings().pixel_dim_x, self.settings().pixel_dim_y);
        Window::around(particle.x_px, particle.y_px, self.image_extent(particle), sensor)
    }

    fn figure<'a>(&self, particle: &Particle, image: &'a Template, factor: f64) -> Figure<'a> {
        match image {
            Template::Patch(window, counts) => {
                Figure::Patch { window: *window, counts, factor: factor as f32 }
            }
            Template::Block(block) => Figure::Sphere(Sphere {
                block,
                window: self.window(particle, block),
                x_px: particle.x_px,
                y_px: particle.y_px,
                z_um: particle.z_um,
                radius_um: 0.5 * particle.d_um,
                light: factor * self.total(particle),
            }),
        }
    }

    /// The light that a sphere sends toward the lens side, in rays.
    fn total(&self, particle: &Particle) -> f64 {
        let points = emission::sphere_points(self.settings(), particle.d_um);
        points as f64 * (f64::from(self.settings().n_rays) + 1.0)
    }

    fn window(&self, particle: &Particle, block: &Block) -> Window {
        let sensor = (self.settings().pixel_dim_x, self.settings().pixel_dim_y);
        Window::around(particle.x_px, particle.y_px, (block.reach_px[0], block.reach_px[1]), sensor)
    }
}
