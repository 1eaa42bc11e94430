//! Particle images by wave optics: diffraction at the aperture of MicroSIG's lens or of a corrected one.
//!
//! Scalar Fourier optics with the pupil function of the lens (`pupil`); for short wavelengths the image
//! approaches the image of `expected`. A particle is a sum of coherent modes (`bead`, `modes`). The image of each
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
pub(super) mod bead;
mod bessel;
mod build;
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
mod slices;
mod sources;
pub(super) mod spheroid;
mod zernike;

use super::instructions::InstructionSet;
use super::interface::{Description, Render, Traits};
use super::rays::RayRenderer;
use super::refinement::TableSpan;
use super::shape::SpheroidLight;
use super::store::Context;
use super::tabled::{self, ImageModel, Source, TabledRenderer};
use super::tables::TableRanges;
use crate::emission::{SpheroidLaw, emitted_rays};
use crate::error::Error;
use crate::optics::{FieldComa, FieldOptics, LocalOptics};
use crate::particle::Particle;
use crate::settings::Settings;
use build::TableBuilder;
pub use cylinder::Cylinder;
pub use direct::SingleImages;
use general::{Disc, Obstacles};
use layout::{Layout, Table};
use model::Model;
pub use options::{Emission, Layers, Lens, Mask, Pinhole, PupilFunction, WaveOptics};
use pupil::Pupil;
use zernike::Aberration;

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
pub type WavesRenderer = TabledRenderer<Waves>;

/// Images by wave optics.
#[derive(Debug)]
pub struct Waves {
    settings: Settings,
    optics: WaveOptics,
    /// Checks of settings and particles that all renderers share.
    rays: RayRenderer,
    model: Model,
    /// Maximum distance of pixels from a particle's image along x and y, px.
    farthest_px: [f64; 2],
    ranges: TableRanges,
}

impl WavesRenderer {
    /// A renderer for these settings. `tolerance`: the largest error of an image due to tables, as a fraction
    /// of its peak. Errors: [`Error::Malformed`] if a setting or option is out of range,
    /// [`Error::Unsupported`] for settings that this renderer does not support and for a tolerance outside
    /// [`super::expected::TOLERANCES`].
    pub fn new(settings: &Settings, optics: &WaveOptics, tolerance: f64) -> Result<Self, Error> {
        Self::on(InstructionSet::best(), settings, optics, tolerance)
    }

    /// [`WavesRenderer::new`] with a given instruction set; all give the same images.
    pub fn on(
        instructions: InstructionSet,
        settings: &Settings,
        optics: &WaveOptics,
        tolerance: f64,
    ) -> Result<Self, Error> {
        tabled::check_tolerance(tolerance)?;
        settings.validate_immersed(optics.lens.largest_aperture(optics.layers.as_ref()))?;
        optics.validate(settings)?;
        // The directions that an aplanatic lens accepts, in the medium: MicroSIG's aperture is for air.
        let numerical_aperture = match (optics.lens, &optics.layers) {
            (Lens::Aplanatic, Some(layers)) => (settings.numerical_aperture / layers.n_s).min(LARGEST_SINE),
            _ => settings.numerical_aperture,
        };
        let rays =
            RayRenderer::new(&Settings { numerical_aperture, ..settings.clone() }, SpheroidLaw::Original)?;
        let pupil = Pupil::new(settings, optics.lens, optics.layers)
            .behind(optics.cylinder, settings)
            .transmitting(optics.pupil.transmission);
        let [_, bx] = pupil.across();
        if bx == 0.0 {
            return Err(Error::Unsupported(format!(
                "cyl_focal_length = {}: this cylindrical lens focuses all light of a point into a line on the sensor, \
                 at any wavelength; use any other focal length",
                settings.cyl_focal_length
            )));
        }
        let center = optics.field.has_aberrations().then(|| optics.field.at([0.0; 2]));
        let obstacles =
            obstacles(optics, pupil.has_cylinder(), center.as_ref().map(|local| (local, [0.0; 2])));
        let inner_um = match optics.pupil.mask {
            Mask::Annulus { inner } => pupil.q(inner * pupil.radius()),
            Mask::Open | Mask::Pinholes(_) => 0.0,
        };
        let model = Model {
            pixel_um: settings.pixel_size,
            emission: optics.emission,
            wavelength_um: optics.wavelength_um,
            bandwidth_um: optics.bandwidth_um,
            blur_px: optics.blur_um * settings.magnification / settings.pixel_size,
            obstacles,
            inner_um,
            tolerance,
            share: build::SHARE * tolerance,
            kernels: None,
            instructions,
            pupil,
        };
        let objective = model.pupil.system.objective;
        let px_per_um = objective.image_distance / objective.object_distance_0 / model.pixel_um;
        // For a wide aperture, light from near the rim lands far away.
        let slope = (model.pupil.radius() / objective.object_distance_0).min(0.3);
        let waves = Waves {
            settings: settings.clone(),
            optics: optics.clone(),
            rays,
            farthest_px: tabled::farthest_px(settings),
            // Within a table, the edge of an image moves by about 8 px, and sizes of images differ by 2 px.
            // A part of the depths in which images are displaced against coma or not must not be wide.
            ranges: TableRanges::up_to(
                if optics.field.coma == FieldComa::default() { 8.0 } else { 4.0 } / (px_per_um * slope),
                2.0 / px_per_um,
            ),
            model,
        };
        Ok(TabledRenderer::of(waves, instructions))
    }

    /// The light and the optics.
    pub fn optics(&self) -> &WaveOptics {
        &self.model.optics
    }

    /// Radius of the first dark ring of the aberration-free image of a point in focus, px: 0.61 lambda M /
    /// (NA pixel_size).
    pub fn airy_radius_px(&self) -> f64 {
        self.model.optics.airy_radius_px(&self.model.settings)
    }

    /// Largest difference of optical paths over the pupil for a point on the axis at depth `z_um`, waves,
    /// without the cylindrical lens.
    pub fn path_difference_waves(&self, z_um: f64) -> f64 {
        self.model.path_difference_waves(z_um)
    }
}

impl Waves {
    fn path_difference_waves(&self, z_um: f64) -> f64 {
        self.model.pupil.own_spread(z_um) / self.optics.wavelength_um
    }

    fn has_coma(&self) -> bool {
        self.optics.field.coma != FieldComa::default()
    }

    fn builder(&self, span: TableSpan, tilted: bool) -> TableBuilder<'_> {
        TableBuilder {
            model: &self.model,
            span,
            farthest_px: self.farthest_px,
            field: self.optics.field.has_aberrations().then_some(self),
            tilted,
        }
    }

    /// The model of images at a position in the image, px; `tilted`: displaced, as tables have them.
    fn model_at(&self, [x_px, y_px]: [f64; 2], tilted: bool) -> Model {
        let model = self.model.with_share(self.model.share, 1.0);
        let place = FieldOptics::place(&self.settings, x_px, y_px);
        let local = self.optics.field.at(place);
        let tilt = if tilted { tilt(&local) } else { [0.0; 2] };
        let cylinder = model.pupil.has_cylinder();
        Model { obstacles: obstacles(&self.optics, cylinder, Some((&local, tilt))), ..model }
    }

    /// The factor between depths in tables and of particles at a position in the image, px: where
    /// vignetting narrows the pupil, images grow more slowly with depth.
    fn depth_scale(&self, [x_px, y_px]: [f64; 2]) -> f64 {
        let [[xx, _], [_, yy]] = self.optics.field.at(FieldOptics::place(&self.settings, x_px, y_px)).squeeze;
        0.5 * (xx + yy)
    }

    /// Depth at which the image of a sphere is found in tables over the field. Polynomials over the field need
    /// fewer places if images do not grow from place to place; vignetting makes them smaller.
    fn in_table(&self, at: Particle) -> Particle {
        match self.optics.field.has_aberrations() {
            true => Particle { z_um: at.z_um * self.depth_scale([at.x_px, at.y_px]), ..at },
            false => at,
        }
    }

    /// Where it is found in tables that move images of defocused spheres back, whose rims coma moves.
    fn tilted(&self, at: &Particle) -> Particle {
        let local = self.optics.field.at(FieldOptics::place(&self.settings, at.x_px, at.y_px));
        let pupil = &self.model.pupil;
        let per_wave = 2.0 * self.optics.wavelength_um / (pupil.radius() * self.settings.pixel_size);
        let [x, y] = tilt(&local).map(|waves| waves * per_wave);
        let (sine, cosine) = libm::sincos(self.optics.cyl_angle_deg.to_radians());
        let [_, bx] = pupil.across();
        let (u, v) = (bx * (x * cosine + y * sine), pupil.b() * (y * cosine - x * sine));
        Particle { x_px: at.x_px - (u * cosine - v * sine), y_px: at.y_px - (u * sine + v * cosine), ..*at }
    }

    /// Half the distance of the two images whose difference is a derivative with respect to depth, um.
    fn depth_step_um(&self) -> f64 {
        let na = self.settings.numerical_aperture;
        direct::STEP_DEPTHS * self.optics.wavelength_um / (na * na)
    }

    /// Half width and half height of the geometric image of a particle, px.
    fn rim_px(&self, particle: &Particle) -> (f64, f64) {
        let longest = particle.spheroid.map_or(1.0, |spheroid| spheroid.e_p.max(1.0));
        self.model.rim_px(particle.z_um, 0.5 * particle.d_um * longest).into()
    }

    /// Width and height of the field of view, px.
    fn size_px(&self) -> [f64; 2] {
        [self.settings.pixel_dim_x, self.settings.pixel_dim_y].map(f64::from)
    }
}

/// Tilt (Noll's terms 2 and 3, waves rms) that keeps the rim of a defocused image in place under coma: its
/// mean slope cancels the mean slope of coma, sqrt(8) (6 rho^2 - 2), at rho^2 = 0.8.
fn tilt(local: &LocalOptics) -> [f64; 2] {
    local.coma.map(|waves| -2.8 * std::f64::consts::SQRT_2 * waves)
}

/// Mask, aberrations, vignetting and rotated cylinder, if they break the pupil's mirror symmetries; `None`
/// otherwise. `place`: the optics at a place of a field where they vary, and tilt (Noll's terms 2 and 3, waves
/// rms); there, no pupil is taken to have symmetries.
fn obstacles(
    optics: &WaveOptics,
    cylinder: bool,
    place: Option<(&LocalOptics, [f64; 2])>,
) -> Option<Obstacles> {
    let disc = |r: f64, open: bool| Disc { x: 0.0, y: 0.0, r, open };
    let discs = match &optics.pupil.mask {
        Mask::Open => vec![disc(1.0, true)],
        Mask::Annulus { inner } if *inner > 0.0 => vec![disc(1.0, true), disc(*inner, false)],
        Mask::Annulus { .. } => vec![disc(1.0, true)],
        Mask::Pinholes(holes) => {
            holes.iter().map(|&Pinhole { x, y, r }| Disc { x, y, r, open: true }).collect()
        }
    };
    let place_terms = place.into_iter().flat_map(|(local, tilt)| {
        let terms = [([8, 7], local.coma), ([6, 5], local.astigmatism), ([2, 3], tilt)];
        terms.into_iter().flat_map(|(indices, waves)| indices.into_iter().zip(waves))
    });
    let in_um = optics.pupil.zernike.iter().copied().chain(place_terms);
    let in_um = in_um.map(|(j, waves)| (j, waves * optics.wavelength_um));
    let aberration = Aberration::new(&in_um.collect::<Vec<_>>());
    let turn = optics.cyl_angle_deg.to_radians();
    let round_mask = !matches!(optics.pupil.mask, Mask::Pinholes(_));
    // The transform of a quadrant does not support an annulus.
    let simple = round_mask && (discs.len() == 1 || !cylinder) && place.is_none();
    let squeeze = place.map_or([[1.0, 0.0], [0.0, 1.0]], |(local, _)| local.squeeze);
    (!simple || turn != 0.0 || !aberration.is_none()).then_some(Obstacles {
        discs,
        aberration,
        turn,
        squeeze,
    })
}

impl ImageModel for Waves {
    type Layout = Layout;
    type Pen = draw::Pen;

    const IMAGES: &'static str = "images by wave optics";

    fn traits(&self) -> Traits {
        Traits {
            name: "waves",
            depends_on_depth: true,
            has_ray_noise: false,
            is_diffracted: true,
            is_round: self.model.is_round(),
            spheroid_law: None,
        }
    }

    fn settings(&self) -> &Settings {
        &self.settings
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

    fn warning(&self) -> Option<String> {
        let na = self.settings.numerical_aperture;
        let scalar = self.optics.scalar_warning(na);
        let Settings { pixel_dim_x, pixel_dim_y, pixel_size, .. } = self.settings;
        let radius_um = 0.5 * libm::hypot(f64::from(pixel_dim_x), f64::from(pixel_dim_y)) * pixel_size;
        let near = self.model.pupil.share_within(0.0, radius_um);
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

    fn tolerance(&self) -> f64 {
        self.model.tolerance
    }

    fn rays(&self) -> &RayRenderer {
        &self.rays
    }

    fn check(&self, particle: &Particle) -> Result<Option<String>, Error> {
        let (near_um, slow) = match &particle.elongated() {
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
        // A corrected lens is nowhere near.
        if self.optics.lens == Lens::Microsig {
            self.rays.check_depth(particle)?;
        }
        Ok(slow)
    }

    fn spread_px(&self, particle: &Particle) -> Option<f64> {
        Some(particle.elongated().map_or(0.0, |shape| self.half_image_px(particle, &shape)))
    }

    fn extent_px(&self, particle: &Particle) -> (f64, f64) {
        // The extents of a particle that is not drawn, since it is too large, would take as long as its
        // image.
        match tabled::check(self, particle) {
            Ok(_) => self.drawn_extent_px(particle).into(),
            Err(_) if self.optics.lens == Lens::Microsig => self.rays.image_extent(particle),
            Err(_) => self.rim_px(particle),
        }
    }

    fn reaches_sensor(&self, particle: &Particle) -> bool {
        let by_lens = || self.rays.check_depth(particle).is_ok() && self.rays.reaches_sensor(particle);
        let window = || tabled::window(&self.settings, particle, self.rim_px(particle));
        match self.optics.lens {
            Lens::Microsig => self.rays.reaches_sensor(particle),
            // MicroSIG's lens makes smaller images of particles far behind the focal plane.
            Lens::Aplanatic => {
                self.settings.is_on_sensor(particle.x_px, particle.y_px) || by_lens() || window().area() > 0
            }
        }
    }

    fn accepted_light(&self, particle: &Particle) -> Option<f64> {
        Some(self.accepted(particle))
    }

    fn sources(&self, particle: &Particle, factor: f64, out: &mut Vec<Source>) {
        let light = factor * emitted_rays(&self.settings, particle);
        match particle.elongated() {
            None => out.push(Source { at: self.in_table(*particle), light, is_direct: false }),
            Some(spheroid) => {
                let emitters = self.emitters(particle, &spheroid, light);
                out.extend(emitters.map(|emitter| Source { at: self.in_table(emitter.at), ..emitter }));
            }
        }
    }

    fn table_spheres(&self, particle: &Particle, out: &mut Vec<Particle>) {
        match particle.elongated() {
            None => out.push(self.in_table(*particle)),
            Some(spheroid) => out.extend(self.depths(particle, &spheroid)),
        }
    }

    fn spheroid_light(&self, spheroid: &Particle) -> Option<SpheroidLight> {
        let e_p = spheroid.spheroid?.e_p;
        (!self.model.pupil.has_coma()).then(|| SpheroidLight {
            light: emitted_rays(&self.settings, spheroid),
            emission: self.model.emission,
            rim_phase: self.model.k_sine() * 0.5 * spheroid.d_um * e_p.max(1.0),
            magnification: self.magnification(),
        })
    }

    /// Neighbors use the same planes of the same tables, which then stay in the processor's cache.
    fn arrange(&self, sources: &mut [Source]) {
        let smallest = |source: &Source| self.ranges.key(&source.at).1;
        sources.sort_by(|a, b| smallest(a).cmp(&smallest(b)).then(a.at.z_um.total_cmp(&b.at.z_um)));
    }

    fn depth_scale(&self, particle: &Particle) -> f64 {
        Waves::depth_scale(self, [particle.x_px, particle.y_px])
    }

    fn ranges(&self) -> &TableRanges {
        &self.ranges
    }

    fn parameters(&self) -> String {
        let field = &self.optics.field;
        if !field.has_aberrations() {
            return self.model.parameters();
        }
        format!(
            "{} {field:?} {:?} {:?}",
            self.model.parameters(),
            self.settings.magnification,
            self.size_px()
        )
    }

    fn cut_parameters(&self) -> Option<String> {
        Some(format!("{:?}", self.farthest_px))
    }

    fn is_cut(&self, layout: &Layout) -> bool {
        (0..2).any(|axis| layout.edge_px[axis] >= libm::ceil(self.farthest_px[axis]) as usize)
    }

    fn placed(&self, at: &Particle, layout: &Layout) -> Particle {
        if layout.tilted { self.tilted(at) } else { *at }
    }

    fn without_tables(&mut self, context: &Context) {
        self.model.kernels = Some(context.kernels.clone());
        // Without verification, more modes are needed.
        self.model.share *= 0.25;
    }

    fn single(&self, sphere: &Particle, with_derivative: bool) -> Table {
        let at_px = [sphere.x_px, sphere.y_px];
        let local = self.optics.field.has_aberrations().then(|| self.model_at(at_px, false));
        let scale = if local.is_some() { self.depth_scale(at_px) } else { 1.0 };
        let span = TableSpan::single(sphere.z_um / scale, 0.5 * sphere.d_um);
        let builder = TableBuilder {
            model: local.as_ref().unwrap_or(&self.model),
            span,
            farthest_px: self.farthest_px,
            field: None,
            tilted: false,
        };
        builder.single(scale, with_derivative.then(|| self.depth_step_um()), |edge_px| {
            let [x, y] = edge_px.map(|px| px as f64);
            tabled::window(&self.settings, sphere, (x, y)).area() > 0
        })
    }

    /// With images displaced against coma, unless they deviate less without: in focus, coma hardly moves them.
    fn build(&self, span: TableSpan) -> Table {
        let table = self.builder(span, self.has_coma()).table();
        if !self.has_coma() || table.error <= self.model.tolerance {
            return table;
        }
        let still = self.builder(span, false).table();
        if still.error < table.error { still } else { table }
    }
}

#[cfg(test)]
mod tests;
