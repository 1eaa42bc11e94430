//! Images in the limit of infinitely many rays: without ray noise, and with derivatives with respect to the
//! particle position.
//!
//! The model is that of `rays` with isotropic directions and, for spheres, infinitely many source points,
//! times (n_rays + 1)/n_rays (the excess of the spiral over isotropic emission): a particle emits
//! (n_rays + 1) rays from each source point toward the lens side, and a pixel receives its fraction of them.
//! With few rays (n_rays NA below about 15) the mean of ray images differs, because their directions are
//! fixed up to a rotation (`emission::aperture_excess`).
//!
//! Images of spheres depend only on depth, diameter and pixel position relative to the particle. They come
//! from tables (`depth_table`), which are built when first needed, verified during construction (`build`) and
//! shared by all clones of a renderer (`cache`); when they exceed 512 MB, those not needed by the current
//! image are dropped. With a cylindrical lens images have two mirror symmetries: a quadrant is computed by an
//! integral over the aperture (`aperture_integral`, `subaperture`) and drawn from a spline over it
//! (`draw_quadrant`). With a spherical lens images are round: they are computed as light within a radius
//! (`encircled`), integrated over square pixels (`pixel_integral`), and drawn from a quadrant too if few
//! nodes are sufficient, or along the radius (`draw_radial`) if rims are sharp or rings large. The image of a
//! spheroid is computed by the aperture integral, directly and without tables (`spheroid`).

mod accumulator;
mod aperture_integral;
mod build;
mod cache;
mod depth_table;
mod draw;
mod draw_quadrant;
mod draw_radial;
mod encircled;
mod image_model;
mod interpolated;
mod limits;
mod pixel_integral;
mod pupil;
mod quadrant_layout;
mod radial_layout;
mod spheroid;
mod subaperture;
mod surface;

use std::sync::Arc;

use rayon::prelude::*;

use super::gradient::Gradient;
use super::image_sum::{self, ImageSum, SphereImage};
use super::instructions::InstructionSet;
use super::interface::{Description, ImageStreams, Render};
pub use super::patch::ExpectedPatch;
use super::patch::Window;
use super::rays::{LARGEST_EXCESS, RayRenderer};
use crate::cancel::checkpoint;
use crate::emission::{self, SpheroidLaw};
use crate::error::Error;
use crate::optics::OpticalSystem;
use crate::particle::Particle;
use crate::pool::BufferPool;
use crate::sensor::{Image, Light, Sensor};
use crate::settings::Settings;
use crate::stream::{Purpose, Streams};
use cache::TableCache;
use depth_table::DepthTable;
use draw::DrawnParticle;
use image_model::ImageModel;
use interpolated::InterpolatedImage;
use pupil::Pupil;
use subaperture::Buffers;
use surface::EmittingSurface;

/// Default tolerance of an image: the root mean square error over all sub-pixel positions, relative to the
/// peak of the image. At single positions, next to kinks of the image, the error may be up to four times as
/// large.
///
/// 0.3 % of the peak is the standard error of the mean of 100 ray images with 1000 rays in the brightest
/// pixel; the error of tables is usually half the tolerance.
pub const DEFAULT_TOLERANCE: f64 = 3e-3;

/// The allowed range of tolerances, relative to the peak.
pub const TOLERANCES: std::ops::RangeInclusive<f64> = 1e-4..=0.1;

/// Maximum number of particles whose images are in memory at the same time.
const PARTICLES: usize = 1024;

/// Renders particles without ray noise.
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
/// // Rays at brightness 1; times `gain` they are counts of the camera.
/// assert!(counts > 10_000.0 && peak > 50.0);
/// # Ok::<(), microsig_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct ExpectedRenderer {
    rays: RayRenderer,
    instructions: InstructionSet,
    cache: Arc<TableCache>,
    /// Working memory, reused from image to image.
    images: BufferPool<Vec<f32>>,
}

/// The data from which a particle is drawn.
enum ImageSource {
    Table(Arc<DepthTable>),
    Patch(Window, Vec<f32>),
}

impl ExpectedRenderer {
    /// A renderer for these settings, with this tolerance (see [`DEFAULT_TOLERANCE`]).
    ///
    /// # Errors
    /// [`Error::Malformed`] if a setting is out of range, [`Error::Unsupported`] for a tolerance outside
    /// [`TOLERANCES`].
    pub fn new(settings: &Settings, law: SpheroidLaw, tolerance: f64) -> Result<Self, Error> {
        Self::on(InstructionSet::best(), settings, law, tolerance)
    }

    /// The same using the given instruction set; all give the same images.
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
        limits::check_cylinder(settings, &pupil)?;
        let buffers = Buffers::default();
        let model = ImageModel { pupil, tolerance, farthest_px, instructions, buffers };
        Ok(ExpectedRenderer {
            rays,
            instructions,
            cache: Arc::new(TableCache::new(model)),
            images: BufferPool::default(),
        })
    }

    /// Largest distance (px) from the sensor at which a particle can still illuminate it.
    fn margin(settings: &Settings) -> f64 {
        (f64::from(settings.pixel_dim_x.max(settings.pixel_dim_y)) / 2.0).max(50.0)
    }

    /// The tolerance, relative to the peak.
    pub fn tolerance(&self) -> f64 {
        self.cache.model.tolerance
    }

    /// Builds the tables for these particles in advance, instead of when they are drawn.
    pub fn prepare(&self, particles: &[Particle]) {
        self.cache.tables(particles.iter().filter(|particle| !self.is_spheroid(particle)));
    }

    /// The expected counts of one particle if its brightness were 1. `None`: its light cannot reach the
    /// sensor.
    pub fn patch(&self, particle: &Particle) -> Option<ExpectedPatch> {
        let image = self.sources(std::slice::from_ref(particle)).remove(0);
        let drawn = self.drawn_particle(particle, &image, 1.0);
        let (DrawnParticle::Sphere(SphereImage { window, .. }) | DrawnParticle::Patch { window, .. }) = drawn;
        image_sum::patch(window, |band| draw::draw(self.instructions, std::iter::once(drawn), band))
    }

    /// The expected counts of one particle with their derivatives: for spheres from the tables, for spheroids
    /// by differences over half a pixel and 1 um. `None`: its light cannot reach the sensor.
    pub fn gradient(&self, particle: &Particle) -> Option<Gradient> {
        if self.is_spheroid(particle) {
            return self.gradient_by_differences(particle);
        }
        let table = self.cache.tables(std::iter::once(particle)).remove(0);
        let window = self.window(particle, &table);
        (window.area() > 0).then(|| self.gradient_of_sphere(particle, &table, window))
    }

    /// The same for a sphere on the pixels of the given window, for fits to a part of its image. The window
    /// may extend beyond the sensor.
    pub fn gradient_within(&self, sphere: &Particle, window: Window) -> Gradient {
        let table = self.cache.tables(std::iter::once(sphere)).remove(0);
        self.gradient_of_sphere(sphere, &table, window)
    }

    fn gradient_of_sphere(&self, particle: &Particle, table: &DepthTable, window: Window) -> Gradient {
        let interpolated = InterpolatedImage::new(table, particle.z_um, 0.5 * particle.d_um);
        Gradient::new(window, particle, self.total(particle), |dx, dy| interpolated.at(dx, dy))
    }

    /// The light of a sphere on pixels at these positions relative to its center (px), as fractions of the
    /// light that it emits toward the lens side. Computed for this depth and diameter, without tables and
    /// without verifying the tolerance: for fits, which draw most images only once.
    pub fn shares(&self, z_um: f64, d_um: f64, places_px: &[[f64; 2]]) -> Vec<f64> {
        let image = self.direct(z_um, d_um, places_px, false);
        places_px.iter().map(|&[x, y]| image.at(x, y)[0]).collect()
    }

    /// The same with the derivatives with respect to the position of the pixel (1/px) and the depth of the
    /// sphere (1/um): value, d/dx, d/dy, d/dz.
    pub fn share_gradients(&self, z_um: f64, d_um: f64, places_px: &[[f64; 2]]) -> Vec<[f64; 4]> {
        let image = self.direct(z_um, d_um, places_px, true);
        places_px.iter().map(|&[x, y]| image.at(x, y)).collect()
    }

    fn direct(&self, z_um: f64, d_um: f64, places_px: &[[f64; 2]], by_z: bool) -> InterpolatedImage {
        let farthest = |axis: usize| places_px.iter().fold(0.0f64, |most, at| most.max(at[axis].abs()));
        let seen = [farthest(0) + 1.0, farthest(1) + 1.0];
        InterpolatedImage::direct(&self.cache.model, z_um, 0.5 * d_um, seen, by_z)
    }

    fn gradient_by_differences(&self, particle: &Particle) -> Option<Gradient> {
        let window = self.spheroid_window(particle);
        if window.area() == 0 {
            return None;
        }
        let surface = spheroid::surface(self.settings(), self.law(), particle);
        let draw = |at: &Particle| self.spheroid(&surface, [at.x_px, at.y_px, at.z_um], window);
        Some(Gradient::by_differences(window, particle, draw))
    }

    /// The light of all particles of one image.
    pub fn light(&self, particles: &[Particle]) -> Light {
        self.draw_all(particles).light(self.settings())
    }

    /// The exposure of [`ExpectedRenderer::light`] by `sensor`, which must have the settings of the renderer;
    /// faster, because the light is not stored.
    pub fn image(&self, particles: &[Particle], sensor: &Sensor, random: ImageStreams<'_>) -> Image {
        self.draw_all(particles).exposed(sensor, random)
    }

    /// Draws all particles of one image.
    fn draw_all(&self, particles: &[Particle]) -> ImageSum<'_> {
        let mut image = ImageSum::new(self.settings(), &self.images);
        for particles in particles.chunks(PARTICLES) {
            checkpoint();
            let sources = self.sources(particles);
            // On every band in the order of rows in the data file.
            image.add(|band| {
                let drawn = particles.iter().zip(&sources);
                let drawn =
                    drawn.map(|(particle, image)| self.drawn_particle(particle, image, particle.c_int));
                draw::draw(self.instructions, drawn, band);
            });
        }
        image
    }

    /// Number of depth tables, their memory in bytes, and the largest estimated error of any of them relative
    /// to the peak.
    pub fn tables(&self) -> (usize, usize, f64) {
        self.cache.state()
    }

    /// Selection of the source points of a spheroid.
    fn law(&self) -> SpheroidLaw {
        self.rays.spheroid_law().unwrap_or_default()
    }

    /// Whether the image of a particle is computed directly. With [`SpheroidLaw::Uniform`] a spheroid of
    /// aspect ratio 1 is a sphere.
    fn is_spheroid(&self, particle: &Particle) -> bool {
        particle.elongated().is_some() || particle.spheroid.is_some() && self.law() == SpheroidLaw::Original
    }

    /// The data from which each particle is drawn.
    fn sources(&self, particles: &[Particle]) -> Vec<ImageSource> {
        let mut tables = self.cache.tables(particles.iter().filter(|p| !self.is_spheroid(p))).into_iter();
        let patches: Vec<Option<ImageSource>> = particles
            .par_iter()
            .map(|particle| {
                self.is_spheroid(particle).then(|| {
                    checkpoint();
                    let window = self.spheroid_window(particle);
                    let surface = spheroid::surface(self.settings(), self.law(), particle);
                    let place = [particle.x_px, particle.y_px, particle.z_um];
                    ImageSource::Patch(window, self.spheroid(&surface, place, window))
                })
            })
            .collect();
        patches
            .into_iter()
            .filter_map(|patch| patch.or_else(|| tables.next().map(ImageSource::Table)))
            .collect()
    }

    fn spheroid(&self, surface: &EmittingSurface, place: [f64; 3], window: Window) -> Vec<f32> {
        if window.area() == 0 {
            return Vec::new();
        }
        spheroid::patch(&self.cache.model, self.settings(), surface, place, window)
    }

    fn spheroid_window(&self, particle: &Particle) -> Window {
        let sensor = (self.settings().pixel_dim_x, self.settings().pixel_dim_y);
        Window::around(particle.x_px, particle.y_px, self.image_extent(particle), sensor)
    }

    fn drawn_particle<'a>(
        &self,
        particle: &Particle,
        image: &'a ImageSource,
        factor: f64,
    ) -> DrawnParticle<'a> {
        match image {
            ImageSource::Patch(window, counts) => {
                DrawnParticle::Patch { window: *window, counts, factor: factor as f32 }
            }
            ImageSource::Table(table) => DrawnParticle::Sphere(SphereImage {
                table,
                window: self.window(particle, table),
                x_px: particle.x_px,
                y_px: particle.y_px,
                z_um: particle.z_um,
                radius_um: 0.5 * particle.d_um,
                light: factor * self.total(particle),
            }),
        }
    }

    /// The light that a sphere emits toward the lens side, in rays.
    fn total(&self, particle: &Particle) -> f64 {
        let points = emission::sphere_points(self.settings(), particle.d_um);
        points as f64 * (f64::from(self.settings().n_rays) + 1.0)
    }

    fn window(&self, particle: &Particle, table: &DepthTable) -> Window {
        let sensor = (self.settings().pixel_dim_x, self.settings().pixel_dim_y);
        Window::around(particle.x_px, particle.y_px, (table.reach_px[0], table.reach_px[1]), sensor)
    }
}

impl Render for ExpectedRenderer {
    fn name(&self) -> &'static str {
        "expected"
    }

    fn needs_tables(&self) -> bool {
        true
    }

    fn missing_tables(&self, particles: &[Particle]) -> usize {
        self.cache.missing(particles.iter().filter(|particle| !self.is_spheroid(particle)))
    }

    fn prepare(&self, particles: &[&[Particle]]) {
        let spheres = particles.iter().copied().flatten().filter(|particle| !self.is_spheroid(particle));
        self.cache.tables(spheres);
    }

    fn description(&self) -> Description {
        Description {
            method: "computes what rays from each particle through the lens give on average (model: M. Rossi, Meas. Sci. \
                     Technol. 31, 017003, 2020)",
            ..self.rays.description()
        }
    }

    fn spheroid_law(&self) -> Option<SpheroidLaw> {
        self.rays.spheroid_law()
    }

    fn warning(&self) -> Option<String> {
        let Settings { n_rays, numerical_aperture, .. } = self.settings();
        let excess = emission::aperture_excess(*n_rays, *numerical_aperture);
        (excess.abs() > LARGEST_EXCESS).then(|| {
            format!(
                "n_rays = {n_rays} is so few for NA {numerical_aperture} that expected images, the limit of many rays, are not the mean of \
                 ray images: these have {:+.1} % of light and a pattern",
                100.0 * excess
            )
        })
    }

    fn light(&self, particles: &[Particle], _: &Streams, _: Purpose, _: u32) -> Light {
        ExpectedRenderer::light(self, particles)
    }

    fn image(&self, particles: &[Particle], sensor: &Sensor, random: ImageStreams<'_>) -> Image {
        ExpectedRenderer::image(self, particles, sensor, random)
    }

    fn settings(&self) -> &Settings {
        self.rays.settings()
    }

    fn check(&self, particle: &Particle) -> Result<Option<String>, Error> {
        let warning = self.rays.check(particle)?;
        if self.is_spheroid(particle) {
            return Ok(warning);
        }
        limits::check_cells(self.settings(), particle, self.cache.cells(particle))?;
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

    fn shortfall(&self) -> Option<String> {
        let ((_, _, error), tolerance) = (self.tables(), self.tolerance());
        (error > tolerance).then(|| {
            format!("expected images err by up to {error:.1e} of their peaks, more than the tolerance of {tolerance:.1e}")
        })
    }

    fn image_extent(&self, particle: &Particle) -> (f64, f64) {
        self.rays.image_extent(particle)
    }

    fn patch_window(&self, particle: &Particle) -> Window {
        if self.is_spheroid(particle) {
            return self.spheroid_window(particle);
        }
        let table = self.cache.tables(std::iter::once(particle)).remove(0);
        self.window(particle, &table)
    }

    fn reaches_sensor(&self, particle: &Particle) -> bool {
        self.rays.reaches_sensor(particle)
    }

    fn gradient(&self, particle: &Particle) -> Option<Gradient> {
        ExpectedRenderer::gradient(self, particle)
    }

    fn gradient_within(&self, sphere: &Particle, window: Window) -> Option<Gradient> {
        Some(ExpectedRenderer::gradient_within(self, sphere, window))
    }

    fn mean_patch(&self, particle: &Particle) -> Option<ExpectedPatch> {
        Some(self.patch(particle)?.scaled(particle.c_int))
    }
}
