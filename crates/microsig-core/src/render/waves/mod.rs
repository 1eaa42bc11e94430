//! Particle images by wave optics: diffraction at the aperture of MicroSIG's lens or of a corrected one.
//!
//! Scalar Fourier optics with the pupil function of the lens (`pupil`); for short wavelengths the image
//! approaches that of `expected`. A particle is a sum of coherent modes (`bead`, `modes`). The image of each
//! mode is a Hankel transform for a round pupil (`hankel`), a matrix Fourier transform of a quadrant with a
//! cylindrical lens (`quadrant`), and one over discs for any other pupil (`general`). The sum is integrated
//! over square pixels (`pixel`).
//!
//! Not modeled: polarization (docs/model.md compares with vectorial theory), dispersion, losses.
//!
//! Sources: Goodman, Introduction to Fourier Optics; Born and Wolf, Principles of Optics, ch. 8 and 9;
//! Collins 1970 (JOSA 60, 1168); Wolf 1982 (JOSA 72, 343); Gibson and Lanni 1991 (JOSA A 8, 1601); Noll 1976
//! (JOSA 66, 207); Soummer et al. 2007 (Opt. Express 15, 15935).

mod band;
mod bead;
mod bessel;
mod build;
mod cache;
mod cylinder;
mod direct;
mod draw;
mod general;
mod hankel;
mod interpolation;
mod layout;
mod matrix;
mod model;
mod modes;
mod options;
mod pixel;
mod pupil;
mod quadrant;
mod quadrature;
mod sources;
mod spheroid;
mod table;
mod zernike;

use std::sync::Arc;

use super::expected::TOLERANCES;
use super::gradient::Gradient;
use super::image_sum::{self, ImageSum, SphereImage};
use super::instructions::InstructionSet;
use super::interface::{Description, ImageStreams, Render};
use super::patch::{ExpectedPatch, Window};
use super::rays::RayRenderer;
use crate::cancel::checkpoint;
use crate::emission::SpheroidLaw;
use crate::error::Error;
use crate::particle::Particle;
use crate::pool::BufferPool;
use crate::sensor::{Image, Light, Sensor};
use crate::settings::Settings;
use crate::stream::{Purpose, Streams};
use cache::TableCache;
pub use cylinder::Cylinder;
pub use direct::SingleImages;
use general::{Disc, Obstacles};
use model::Model;
pub use options::{Emission, Layers, Lens, Mask, Pinhole, PupilFunction, WaveOptics};
use pupil::Pupil;
use sources::Source;
use table::{Interpolated, Table};
use zernike::Aberration;

/// Number of sources after which those gathered are drawn, which bounds the tables held at a time.
const SOURCES: usize = 1024;

/// Path differences over the pupil in paraxial focus, waves, above which an objective is not used as
/// designed.
const MANY_WAVES: f64 = 10.0;

/// Largest sine of the angle to the axis at which light is followed geometrically, to tell how far it
/// reaches.
const LARGEST_SINE: f64 = 0.99;

/// There is a warning if less than this fraction of the accepted light lands on the sensor.
const MIN_NEAR: f64 = 0.5;

/// Renders particles by wave optics; deterministic, without ray noise.
///
/// # The diffracted image of one particle
/// ```
/// use microsig_core::render::waves::{WaveOptics, WavesRenderer};
/// use microsig_core::{Particle, Settings};
///
/// let renderer = WavesRenderer::new(&Settings::setting1(), &WaveOptics::new(0.52), 1e-3)?;
/// let patch = renderer.patch(&Particle::sphere(100.3, 80.0, -12.0, 2.0)).expect("it lies on the sensor");
/// let peak = patch.counts.iter().copied().fold(0.0, f64::max);
/// assert!(peak > 1000.0 && peak < 1300.0, "a diffraction-limited image, near the sharpest");
/// # Ok::<(), microsig_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct WavesRenderer {
    settings: Settings,
    optics: WaveOptics,
    /// Checks of settings and particles that all renderers share.
    rays: RayRenderer,
    cache: Arc<TableCache>,
    /// Working memory, kept from image to image.
    images: BufferPool<Vec<f32>>,
}

impl WavesRenderer {
    /// A renderer for these settings. `tolerance`: the largest error of an image due to tables, as a fraction
    /// of its peak.
    ///
    /// # Errors
    /// [`Error::Malformed`] if a setting or option is out of range, [`Error::Unsupported`] for settings that
    /// this renderer does not support and for a tolerance outside [`TOLERANCES`].
    pub fn new(settings: &Settings, optics: &WaveOptics, tolerance: f64) -> Result<Self, Error> {
        Self::on(InstructionSet::best(), settings, optics, tolerance)
    }

    /// [`WavesRenderer::new`] with a given instruction set; all give the same images.
    ///
    /// # Errors
    /// As for [`WavesRenderer::new`].
    pub fn on(
        instructions: InstructionSet,
        settings: &Settings,
        optics: &WaveOptics,
        tolerance: f64,
    ) -> Result<Self, Error> {
        if !TOLERANCES.contains(&tolerance) {
            return Err(Error::Unsupported(format!(
                "tolerance = {tolerance}: expected {} to {}, a fraction of an image's peak",
                TOLERANCES.start(),
                TOLERANCES.end()
            )));
        }
        settings.validate_immersed(optics.lens.largest_aperture(optics.layers.as_ref()))?;
        optics.validate(settings)?;
        // The directions that an aplanatic lens accepts, in the medium: MicroSIG's aperture is for air.
        let numerical_aperture = match (optics.lens, &optics.layers) {
            (Lens::Aplanatic, Some(layers)) => (settings.numerical_aperture / layers.n_s).min(LARGEST_SINE),
            _ => settings.numerical_aperture,
        };
        let rays =
            RayRenderer::new(&Settings { numerical_aperture, ..settings.clone() }, SpheroidLaw::Original)?;
        let pupil = Pupil::new(settings, optics.lens, optics.layers).behind(optics.cylinder, settings);
        let [_, bx] = pupil.across();
        if bx == 0.0 {
            return Err(Error::Unsupported(format!(
                "cyl_focal_length = {}: this cylindrical lens focuses all light of a point into a line on the sensor, \
                 at any wavelength; use any other focal length",
                settings.cyl_focal_length
            )));
        }
        let margin = Self::margin(settings);
        let farthest_px = [settings.pixel_dim_x, settings.pixel_dim_y].map(|size| f64::from(size) + margin);
        let obstacles = obstacles(optics, pupil.has_cylinder());
        let inner_um = match optics.pupil.mask {
            Mask::Annulus { inner } => pupil.q(inner * pupil.radius()),
            Mask::Open | Mask::Pinholes(_) => 0.0,
        };
        let model = Model {
            pixel_um: settings.pixel_size,
            emission: optics.emission,
            wavelength_um: optics.wavelength_um,
            bandwidth_um: optics.bandwidth_um,
            obstacles,
            inner_um,
            tolerance,
            share: build::SHARE * tolerance,
            instructions,
            pupil,
        };
        Ok(WavesRenderer {
            settings: settings.clone(),
            optics: optics.clone(),
            rays,
            cache: Arc::new(TableCache::new(model, farthest_px)),
            images: BufferPool::default(),
        })
    }

    /// Maximum distance (px) from the sensor of a particle whose light falls on it.
    fn margin(settings: &Settings) -> f64 {
        (f64::from(settings.pixel_dim_x.max(settings.pixel_dim_y)) / 2.0).max(50.0)
    }

    /// The light and the optics.
    pub fn optics(&self) -> &WaveOptics {
        &self.optics
    }

    /// Largest error of an image due to tables, as a fraction of its peak.
    pub fn tolerance(&self) -> f64 {
        self.model().tolerance
    }

    /// Radius of the first dark ring of the aberration-free image of a point in focus, px: 0.61 lambda M /
    /// (NA pixel_size).
    pub fn airy_radius_px(&self) -> f64 {
        self.optics.airy_radius_px(&self.settings)
    }

    /// Largest difference of optical paths over the pupil for a point on the axis at depth `z_um`, waves,
    /// without the cylindrical lens.
    pub fn path_difference_waves(&self, z_um: f64) -> f64 {
        self.model().pupil.own_spread(z_um) / self.optics.wavelength_um
    }

    fn model(&self) -> &Model {
        &self.cache.model
    }

    /// Builds the tables for these particles in advance.
    pub fn prepare(&self, particles: &[Particle]) {
        self.cache.tables(self.tabled(particles.iter()).iter());
    }

    /// The counts of one particle; `None` if none of its light can fall on the sensor.
    pub fn patch(&self, particle: &Particle) -> Option<ExpectedPatch> {
        let sources = self.sources(particle, 1.0);
        self.drawn(&sources, self.windows(&sources))
    }

    /// The pixels on which light of the sources falls.
    fn windows(&self, sources: &[Source]) -> Window {
        let tables = self.tables_of(sources);
        let windows = sources.iter().zip(&tables).map(|(source, table)| self.window(&source.at, table));
        windows.fold(Window::default(), Window::joined)
    }

    /// The sources on a window that contains theirs.
    fn drawn(&self, sources: &[Source], window: Window) -> Option<ExpectedPatch> {
        let tables = self.tables_of(sources);
        image_sum::patch(window, |band| {
            let spheres = sources.iter().zip(&tables).map(|(source, table)| self.sphere(source, table));
            draw::draw(self.model().instructions, spheres, band);
        })
    }

    /// The counts of one particle with their derivatives: for spheres from the tables, for spheroids by
    /// differences. `None` if none of its light can fall on the sensor.
    pub fn gradient(&self, particle: &Particle) -> Option<Gradient> {
        if particle.elongated().is_some() {
            return self.gradient_by_differences(particle);
        }
        let table = self.cache.tables(std::iter::once(particle)).remove(0);
        let window = self.window(particle, &table);
        if window.area() == 0 {
            return None;
        }
        Some(self.gradient_on(particle, &table, window))
    }

    /// The same for a sphere on the pixels of the given window, for fits to a part of an image. The window
    /// may extend beyond the sensor.
    pub fn gradient_within(&self, particle: &Particle, window: Window) -> Gradient {
        let table = self.cache.tables(std::iter::once(particle)).remove(0);
        self.gradient_on(particle, &table, window)
    }

    fn gradient_on(&self, particle: &Particle, table: &Table, window: Window) -> Gradient {
        let interpolated = Interpolated::new(table, particle.z_um, 0.5 * particle.d_um);
        Gradient::new(window, particle, self.total(particle), |dx, dy| interpolated.at(dx, dy))
    }

    /// Sums the light of all particles of one image.
    pub fn light(&self, particles: &[Particle]) -> Light {
        self.draw_all(particles).light(&self.settings)
    }

    /// Renders all particles of one image.
    fn draw_all(&self, particles: &[Particle]) -> ImageSum<'_> {
        let mut image = ImageSum::new(&self.settings, &self.images);
        let mut sources = Vec::new();
        for particle in particles {
            sources.extend(self.sources(particle, particle.c_int));
            if sources.len() >= SOURCES {
                self.add(&sources, &mut image);
                sources.clear();
            }
        }
        self.add(&sources, &mut image);
        image
    }

    fn add(&self, sources: &[Source], image: &mut ImageSum<'_>) {
        checkpoint();
        let tables = self.tables_of(sources);
        let order = by_depth(sources, &tables);
        image.add(|band| {
            let spheres = order.iter().map(|&at| self.sphere(&sources[at], &tables[at]));
            draw::draw(self.model().instructions, spheres, band);
        });
    }

    fn tables_of(&self, sources: &[Source]) -> Vec<Arc<Table>> {
        self.cache.tables(sources.iter().map(|source| &source.at))
    }

    /// Number of tables, their memory in bytes, and their largest error as a fraction of an image's peak.
    pub fn tables(&self) -> (usize, usize, f64) {
        self.cache.state()
    }

    fn sphere<'a>(&self, Source { at, light }: &Source, table: &'a Table) -> SphereImage<'a, Table> {
        SphereImage {
            table,
            window: self.window(at, table),
            x_px: at.x_px,
            y_px: at.y_px,
            z_um: at.z_um,
            radius_um: 0.5 * at.d_um,
            light: *light,
        }
    }

    fn window(&self, particle: &Particle, table: &Table) -> Window {
        let sensor = (self.settings.pixel_dim_x, self.settings.pixel_dim_y);
        let [x, y] = table.reach(particle.z_um);
        Window::around(particle.x_px, particle.y_px, (x, y), sensor)
    }
}

/// The sources in an order in which neighbors use the same planes of the same tables, which then stay in the
/// processor's cache.
fn by_depth(sources: &[Source], tables: &[Arc<Table>]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..sources.len()).collect();
    order.sort_by(|&a, &b| {
        let key = |at: usize| [tables[at].radii[0], sources[at].at.z_um];
        let ([radius_a, z_a], [radius_b, z_b]) = (key(a), key(b));
        radius_a.total_cmp(&radius_b).then(z_a.total_cmp(&z_b)).then(a.cmp(&b))
    });
    order
}

/// Mask, aberrations and rotated cylinder, if they break the pupil's mirror symmetries; `None` otherwise.
fn obstacles(optics: &WaveOptics, cylinder: bool) -> Option<Obstacles> {
    let disc = |r: f64, open: bool| Disc { x: 0.0, y: 0.0, r, open };
    let discs = match &optics.pupil.mask {
        Mask::Open => vec![disc(1.0, true)],
        Mask::Annulus { inner } if *inner > 0.0 => vec![disc(1.0, true), disc(*inner, false)],
        Mask::Annulus { .. } => vec![disc(1.0, true)],
        Mask::Pinholes(holes) => {
            holes.iter().map(|&Pinhole { x, y, r }| Disc { x, y, r, open: true }).collect()
        }
    };
    let in_um = optics.pupil.zernike.iter().map(|&(j, waves)| (j, waves * optics.wavelength_um));
    let aberration = Aberration::new(&in_um.collect::<Vec<_>>());
    let turn = optics.cyl_angle_deg.to_radians();
    let round_mask = !matches!(optics.pupil.mask, Mask::Pinholes(_));
    // The transform of a quadrant does not support an annulus.
    let simple = round_mask && (discs.len() == 1 || !cylinder);
    (!simple || turn != 0.0 || !aberration.is_none()).then_some(Obstacles { discs, aberration, turn })
}

impl Render for WavesRenderer {
    fn name(&self) -> &'static str {
        "waves"
    }

    fn needs_tables(&self) -> bool {
        true
    }

    fn missing_tables(&self, particles: &[Particle]) -> usize {
        self.cache.missing(self.tabled(particles.iter()).iter())
    }

    fn prepare(&self, particles: &[&[Particle]]) {
        self.cache.tables(self.tabled(particles.iter().copied().flatten()).iter());
    }

    fn description(&self) -> Description {
        let optics = cylinder::lens_phrase(&self.settings, self.optics.cylinder);
        let lens = match self.optics.lens {
            Lens::Microsig => "",
            Lens::Aplanatic => ", corrected (aplanatic)",
        };
        Description {
            optics: format!("{optics}{lens}, light of {} um", self.optics.wavelength_um),
            method: "computes the diffraction of each particle's light at the lens (scalar Fourier optics; lens of the model: \
                     M. Rossi, Meas. Sci. Technol. 31, 017003, 2020)",
        }
    }

    fn spheroid_law(&self) -> Option<SpheroidLaw> {
        None
    }

    fn settings(&self) -> &Settings {
        &self.settings
    }

    fn check(&self, particle: &Particle) -> Result<Option<String>, Error> {
        let shape = particle.elongated();
        let (near_um, slow) = match &shape {
            None => (0.0, self.slow_sphere(particle.d_um)),
            Some(spheroid) => {
                let slow = self.check_spheroid(particle.d_um, spheroid)?;
                (spheroid::half_extents(0.5 * particle.d_um, spheroid)[0], slow)
            }
        };
        if let Some(layers) = &self.optics.layers
            && layers.focus_depth_um + particle.z_um - near_um < 0.0
        {
            return Err(Error::Unsupported(format!(
                "z = {} um: it would lie inside the cover slip, whose inner face is at z = {} um (focus_depth_um)",
                particle.z_um, -layers.focus_depth_um
            )));
        }
        // What it warns of, few source points, does not matter here.
        self.rays.check(particle)?;
        let (settings, margin) = (&self.settings, Self::margin(&self.settings));
        let outside = |at: f64, size: u32| (0.5 - at).max(at - f64::from(size) - 0.5);
        let farthest = outside(particle.x_px, settings.pixel_dim_x)
            .max(outside(particle.y_px, settings.pixel_dim_y))
            + shape.map_or(0.0, |shape| self.half_image_px(particle, &shape));
        if farthest > margin && self.rays.reaches_sensor(particle) {
            return Err(Error::Unsupported(format!(
                "it reaches {farthest:.1} px outside the sensor, and its light falls on it; wave optics supports particles up to {margin} px outside"
            )));
        }
        Ok(slow)
    }

    fn warning(&self) -> Option<String> {
        let na = self.settings.numerical_aperture;
        let scalar = self.optics.scalar_warning(na);
        let Settings { pixel_dim_x, pixel_dim_y, pixel_size, .. } = self.settings;
        let radius_um = 0.5 * libm::hypot(f64::from(pixel_dim_x), f64::from(pixel_dim_y)) * pixel_size;
        let near = self.model().pupil.share_within(0.0, radius_um);
        let lost = (self.optics.lens == Lens::Microsig && near < MIN_NEAR).then(|| {
            format!(
                "only {:.0} % of the light that the aperture accepts at z = 0 lands on the sensor: MicroSIG's lens is not \
                 corrected (lens: aplanatic is)",
                100.0 * near
            )
        });
        let waves = self.path_difference_waves(0.0);
        let aberrated = (self.optics.lens == Lens::Aplanatic && waves > MANY_WAVES).then(|| {
            format!(
                "the layers are so different from those that the objective is designed for (n_i_design, t_g_design_um, ...) that \
                 optical paths differ by {waves:.0} waves over the pupil at z = 0: images are wide, faint and slow to compute"
            )
        });
        let warnings: Vec<String> = [scalar, lost, aberrated].into_iter().flatten().collect();
        (!warnings.is_empty()).then(|| warnings.join("; "))
    }

    fn shortfall(&self) -> Option<String> {
        let ((_, _, error), tolerance) = (self.tables(), self.tolerance());
        (error > tolerance).then(|| {
            format!("errors of images by wave optics are up to {error:.1e} of their peaks, above the tolerance of {tolerance:.1e}")
        })
    }

    fn image_extent(&self, particle: &Particle) -> (f64, f64) {
        // The extents of a particle that is not drawn, since it is too large, would take as long as its
        // image.
        match Render::check(self, particle) {
            Ok(_) => self.extent_px(particle).into(),
            Err(_) => self.rays.image_extent(particle),
        }
    }

    fn patch_window(&self, particle: &Particle) -> Window {
        self.windows(&self.sources(particle, 1.0))
    }

    fn reaches_sensor(&self, particle: &Particle) -> bool {
        self.rays.reaches_sensor(particle)
    }

    fn gradient(&self, particle: &Particle) -> Option<Gradient> {
        WavesRenderer::gradient(self, particle)
    }

    fn gradient_within(&self, sphere: &Particle, window: Window) -> Option<Gradient> {
        Some(WavesRenderer::gradient_within(self, sphere, window))
    }

    fn mean_patch(&self, particle: &Particle) -> Option<ExpectedPatch> {
        Some(self.patch(particle)?.scaled(particle.c_int))
    }

    fn light(&self, particles: &[Particle], _: &Streams, _: Purpose, _: u32) -> Light {
        WavesRenderer::light(self, particles)
    }

    fn image(&self, particles: &[Particle], sensor: &Sensor, random: ImageStreams<'_>) -> Image {
        self.draw_all(particles).exposed(sensor, random)
    }
}

#[cfg(test)]
mod tests;
