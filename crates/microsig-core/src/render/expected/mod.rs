//! Images in the limit of infinitely many rays: without ray noise, and with derivatives with respect to the
//! particle position.
//!
//! The model is `rays` with isotropic directions and, for spheres, infinitely many source points,
//! times (n_rays + 1)/n_rays (the excess of the spiral over isotropic emission): a particle emits
//! (n_rays + 1) rays from each source point toward the lens side, and a pixel receives its fraction of them.
//! With few rays (n_rays NA below about 15) the mean of ray images differs, because their directions are
//! fixed up to a rotation (`emission::aperture_excess`).
//!
//! Images of spheres depend only on depth, diameter and pixel position relative to the particle. They come
//! from tables (`depth_table`), which are verified during construction (`build`). With a cylindrical lens
//! images have two mirror symmetries: a quadrant is computed by an integral over the aperture
//! (`aperture_integral`, `subaperture`) and drawn from a spline over it (`draw_quadrant`). With a spherical
//! lens images are round: they are computed as light within a radius (`encircled`), integrated over square
//! pixels (`pixel_integral`), and drawn from a quadrant too if few nodes are sufficient, or along the radius
//! (`draw_radial`) if rims are sharp or rings large. The image of a spheroid is computed by the aperture
//! integral, directly and without tables (`spheroid`).

mod accumulator;
mod aperture_integral;
mod build;
mod depth_table;
mod direct;
mod draw;
mod draw_quadrant;
mod draw_radial;
mod encircled;
mod limits;
mod model;
mod pixel_integral;
mod pupil;
mod radial_layout;
mod spheroid;
mod subaperture;
mod surface;

use super::instructions::InstructionSet;
use super::interface::{Description, Render, Traits};
pub use super::patch::ExpectedPatch;
use super::patch::Window;
use super::rays::{LARGEST_EXCESS, RayRenderer};
use super::refinement::TableSpan;
use super::store::Context;
pub use super::tabled::TOLERANCES;
use super::tabled::{self, ImageModel, Source, TabledRenderer};
use super::tables::TableRanges;
use crate::emission::{self, SpheroidLaw};
use crate::error::Error;
use crate::optics::OpticalSystem;
use crate::particle::Particle;
use crate::settings::Settings;
use depth_table::{DepthTable, PlaneLayout};
use direct::DirectImage;
use limits::KnownCells;
use model::Model;
use pupil::Pupil;
use subaperture::Buffers;

/// Default tolerance of an image: the root mean square error over all sub-pixel positions, relative to the
/// peak of the image. At single positions, next to kinks of the image, the error may be up to four times as
/// large.
///
/// 0.3 % of the peak is the standard error of the mean of 100 ray images with 1000 rays in the brightest
/// pixel; the error of tables is usually half the tolerance.
pub const DEFAULT_TOLERANCE: f64 = 3e-3;

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
pub type ExpectedRenderer = TabledRenderer<Rays>;

/// Images in the limit of infinitely many rays.
#[derive(Debug)]
pub struct Rays {
    rays: RayRenderer,
    law: SpheroidLaw,
    model: Model,
    ranges: TableRanges,
    cells: KnownCells,
}

impl ExpectedRenderer {
    /// A renderer for these settings, with this tolerance (see [`DEFAULT_TOLERANCE`]). Errors:
    /// [`Error::Malformed`] if a setting is out of range, [`Error::Unsupported`] for a tolerance outside
    /// [`TOLERANCES`].
    pub fn new(settings: &Settings, law: SpheroidLaw, tolerance: f64) -> Result<Self, Error> {
        Self::on(InstructionSet::best(), settings, law, tolerance)
    }

    /// The same using the given instruction set; all give the same images.
    pub fn on(
        instructions: InstructionSet,
        settings: &Settings,
        law: SpheroidLaw,
        tolerance: f64,
    ) -> Result<Self, Error> {
        tabled::check_tolerance(tolerance)?;
        let rays = RayRenderer::new(settings, law)?;
        let pupil = Pupil { system: OpticalSystem::new(settings), pixel_size: settings.pixel_size };
        limits::check_cylinder(settings, &pupil)?;
        let [x, y] = tabled::farthest_px(settings);
        let farthest_px =
            if pupil.system.cylinder.is_some() { [x, y] } else { [libm::sqrt(x * x + y * y); 2] };
        let buffers = Buffers::default();
        let (meridians, reach_steps) = (1.0, pupil::REACH_STEPS);
        let model = Model { pupil, tolerance, farthest_px, instructions, meridians, reach_steps, buffers };
        // Over the depth range of a table the edge of an image moves by about 4 px; over its size range the
        // geometric image changes by 2 px.
        let ranges = TableRanges::up_to(4.0 / model.edge_px_per_um(), 2.0 / model.px_per_um());
        let rays = Rays { rays, law, model, ranges, cells: KnownCells::default() };
        Ok(TabledRenderer::of(rays, instructions))
    }

    /// The light of a sphere on pixels at these positions relative to its center (px), as fractions of the
    /// light that it emits toward the lens side. Computed for this depth and diameter, without tables and
    /// without verifying the tolerance: for fits, which draw most images only once.
    pub fn shares(&self, z_um: f64, d_um: f64, places_px: &[[f64; 2]]) -> Vec<f64> {
        let image = self.direct(z_um, d_um, places_px, false);
        places_px.iter().map(|&place| image.at(place)[0]).collect()
    }

    /// The same with the derivatives with respect to the position of the pixel (1/px) and the depth of the
    /// sphere (1/um): value, d/dx, d/dy, d/dz.
    pub fn share_gradients(&self, z_um: f64, d_um: f64, places_px: &[[f64; 2]]) -> Vec<[f64; 4]> {
        let image = self.direct(z_um, d_um, places_px, true);
        places_px.iter().map(|&place| image.at(place)).collect()
    }

    fn direct(&self, z_um: f64, d_um: f64, places_px: &[[f64; 2]], by_z: bool) -> DirectImage {
        let farthest = |axis: usize| places_px.iter().fold(0.0f64, |most, at| most.max(at[axis].abs()));
        let seen = [farthest(0) + 1.0, farthest(1) + 1.0];
        DirectImage::new(&self.model.model, z_um, 0.5 * d_um, seen, by_z)
    }
}

impl Rays {
    /// Whether the image of a particle is computed directly. With [`SpheroidLaw::Uniform`] a spheroid of
    /// aspect ratio 1 is a sphere.
    fn is_spheroid(&self, particle: &Particle) -> bool {
        particle.elongated().is_some() || particle.spheroid.is_some() && self.law == SpheroidLaw::Original
    }
}

impl ImageModel for Rays {
    type Layout = PlaneLayout;
    type Pen = draw::Pen;

    const IMAGES: &'static str = "expected images";

    fn traits(&self) -> Traits {
        Traits { name: "expected", has_ray_noise: false, ..self.rays.traits() }
    }

    fn settings(&self) -> &Settings {
        self.rays.settings()
    }

    fn description(&self) -> Description {
        Description {
            method: "computes what rays from each particle through the lens give on average (model: M. Rossi, Meas. Sci. \
                     Technol. 31, 017003, 2020)",
            ..self.rays.description()
        }
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

    fn tolerance(&self) -> f64 {
        self.model.tolerance
    }

    fn rays(&self) -> &RayRenderer {
        &self.rays
    }

    fn check(&self, particle: &Particle) -> Result<Option<String>, Error> {
        let warning = self.rays.check(particle)?;
        if !self.is_spheroid(particle) {
            let cells = self.cells.of(&self.model, &self.ranges, particle);
            limits::check_cells(self.settings(), particle, cells)?;
        }
        Ok(warning)
    }

    fn spread_px(&self, particle: &Particle) -> Option<f64> {
        (!self.is_spheroid(particle)).then_some(0.0)
    }

    fn extent_px(&self, particle: &Particle) -> (f64, f64) {
        self.rays.image_extent(particle)
    }

    fn accepted_light(&self, particle: &Particle) -> Option<f64> {
        self.rays.accepted_light(particle)
    }

    fn sources(&self, particle: &Particle, factor: f64, out: &mut Vec<Source>) {
        let is_direct = self.is_spheroid(particle);
        // Those drawn directly are in rays.
        let rays = if is_direct { 1.0 } else { emission::emitted_rays(self.settings(), particle) };
        out.push(Source { at: *particle, light: factor * rays, is_direct });
    }

    fn table_spheres(&self, particle: &Particle, out: &mut Vec<Particle>) {
        out.extend((!self.is_spheroid(particle)).then_some(*particle));
    }

    fn direct(&self, particle: &Particle, window: Window) -> Vec<f32> {
        spheroid::patch(&self.model, self.settings(), self.law, particle, window)
    }

    fn ranges(&self) -> &TableRanges {
        &self.ranges
    }

    fn parameters(&self) -> String {
        self.model.parameters()
    }

    fn without_tables(&mut self, _: &Context) {
        (self.model.meridians, self.model.reach_steps) = (direct::MERIDIANS, direct::REACH_STEPS);
    }

    fn single(&self, sphere: &Particle, with_derivative: bool) -> DepthTable {
        direct::single(&self.model, self.settings(), sphere, with_derivative)
    }

    fn build(&self, span: TableSpan) -> DepthTable {
        build::table(&self.model, span)
    }
}
