//! What is drawn from tables: spheres, and the emitters of spheroids, which are spheres of diameter 0.

use glam::{DMat2, DVec2, DVec3};

use super::Waves;
use super::spheroid::{self, MANY_EMITTERS, MAX_EMITTERS};
use crate::emission::emitted_rays;
use crate::error::{Error, shown};
use crate::particle::{Particle, Spheroid};
use crate::render::refinement::TableSpan;
use crate::render::tabled::Source;

/// Radius of a sphere times the largest wave number across the optical axis, above which its modes take
/// seconds: the extent of its image is then derived from a sphere of this size.
const LARGEST_RIM_PHASE: f64 = 30.0;

impl Waves {
    /// Refuses spheroids that cannot be drawn; a warning about those that take long.
    pub(super) fn check_spheroid(&self, d_um: f64, spheroid: &Spheroid) -> Result<Option<String>, Error> {
        let model = &self.model;
        if model.pupil.has_coma() {
            return Err(Error::Unsupported(
                "it is a spheroid, which waves draw with lens: aplanatic only (rays and expected draw them with MicroSIG's lens)"
                    .to_owned(),
            ));
        }
        let emitters = spheroid::number(0.5 * d_um, spheroid, model.emission, model.k_sine());
        let size = || format!("d_p = {} um and e_p = {}", shown(d_um), shown(spheroid.e_p));
        if emitters > MAX_EMITTERS {
            return Err(Error::Unsupported(format!(
                "it is a spheroid so large, {}, that waves need {emitters:.2e} emitters; at most {MAX_EMITTERS:.0e} are possible",
                size()
            )));
        }
        Ok((emitters > MANY_EMITTERS).then(|| {
            format!(
                "waves draw a spheroid as large as {} as {emitters:.1e} emitters, which takes seconds",
                size()
            )
        }))
    }

    /// A warning about a sphere whose tables take long.
    pub(super) fn slow_sphere(&self, d_um: f64) -> Option<String> {
        self.is_large(0.5 * d_um).then(|| {
            format!(
                "waves need seconds, or minutes, for the tables of spheres as large as d_p = {} um, many times the resolution of {:.2} um",
                shown(d_um),
                0.61 * self.optics.wavelength_um / self.settings.numerical_aperture
            )
        })
    }

    /// Whether a sphere has very many modes.
    fn is_large(&self, radius_um: f64) -> bool {
        self.model.k_sine() * radius_um > LARGEST_RIM_PHASE
    }

    /// The emitters of a spheroid, each with its share of `light`.
    pub(super) fn emitters<'a>(
        &'a self,
        particle: &'a Particle,
        spheroid: &Spheroid,
        light: f64,
    ) -> impl Iterator<Item = Source> + use<'a> {
        let model = &self.model;
        let magnification = self.magnification();
        let source = move |(offset_um, share): (DVec3, f64)| {
            let shift = magnification * offset_um.truncate();
            let (x_px, y_px) = (particle.x_px + shift.x, particle.y_px + shift.y);
            let at = Particle::sphere(x_px, y_px, particle.z_um + offset_um.z, 0.0);
            Source { at, light: light * share, is_direct: false }
        };
        let emitters = spheroid::emitters(0.5 * particle.d_um, spheroid, model.emission, model.k_sine());
        emitters.into_iter().map(source)
    }

    /// Displacement in the image for a displacement in x and y, px/um.
    pub(super) fn magnification(&self) -> DMat2 {
        // Images are inverted; the cylindrical lens has axes of its own.
        let along = self.model.pupil.magnifications().map(|m| -m / self.settings.pixel_size);
        let turn = DMat2::from_angle(self.optics.cyl_angle_deg.to_radians());
        turn * DMat2::from_diagonal(DVec2::from_array(along)) * turn.transpose()
    }

    /// Points at the depths of the tables that a spheroid needs.
    pub(super) fn depths(&self, particle: &Particle, spheroid: &Spheroid) -> impl Iterator<Item = Particle> {
        let [half_um, ..] = spheroid::half_extents(0.5 * particle.d_um, spheroid);
        let scale = self.depth_scale([particle.x_px, particle.y_px]);
        let (z_um, step_um) = (particle.z_um * scale, self.ranges.length_um);
        let steps = libm::ceil(2.0 * half_um / step_um) as usize;
        let depths = (0..=steps).map(move |i| z_um + (i as f64 * step_um - half_um).min(half_um));
        depths.map(|z_um| Particle::sphere(0.0, 0.0, z_um, 0.0))
    }

    /// The light of a particle that the aperture accepts, in rays.
    pub(super) fn accepted(&self, particle: &Particle) -> f64 {
        // Of the lens that draws spheroids, the same at any depth.
        let radius_um = if particle.elongated().is_some() { 0.0 } else { 0.5 * particle.d_um };
        emitted_rays(&self.settings, particle) * self.model.accepted(particle.z_um, radius_um)
    }

    /// Distance within which the emitters of a spheroid are from its center in the image, px.
    pub(super) fn half_image_px(&self, particle: &Particle, spheroid: &Spheroid) -> f64 {
        let [_, right, down] = spheroid::half_extents(0.5 * particle.d_um, spheroid);
        self.magnified_px(libm::hypot(right, down))
    }

    /// Distance within which the images of points at this distance from a particle's center are, px.
    fn magnified_px(&self, distance_um: f64) -> f64 {
        let [along, across] = self.model.pupil.magnifications().map(f64::abs);
        along.max(across) * distance_um / self.settings.pixel_size
    }

    /// Half width and half height of a particle's image, px.
    pub(super) fn drawn_extent_px(&self, particle: &Particle) -> [f64; 2] {
        let radius_um = 0.5 * particle.d_um;
        let (drawn_um, half_um, half_px) = match &particle.elongated() {
            Some(spheroid) => {
                (0.0, spheroid::half_extents(radius_um, spheroid)[0], self.half_image_px(particle, spheroid))
            }
            None => {
                let drawn_um = radius_um.min(LARGEST_RIM_PHASE / self.model.k_sine());
                let rest_um = radius_um - drawn_um;
                (drawn_um, rest_um, self.magnified_px(rest_um))
            }
        };
        let depths = if half_um > 0.0 { vec![-half_um, 0.0, half_um] } else { vec![0.0] };
        let ends = depths.iter().map(|dz| self.extent_of_sphere_px(particle.z_um + dz, drawn_um));
        ends.fold([0.0; 2], |largest, end| [0, 1].map(|axis| end[axis].max(largest[axis])))
            .map(|px| px + half_px)
    }

    /// Half width and half height of a sphere's image, px, without building its table.
    fn extent_of_sphere_px(&self, z_um: f64, radius_um: f64) -> [f64; 2] {
        let builder = self.builder(TableSpan::single(z_um, radius_um), self.has_coma());
        // Without tables, the extents of a scenario would take as long as its images.
        let edges = if self.model.kernels.is_some() { builder.faint_edges() } else { builder.extent() };
        edges.map(|edge| edge as f64)
    }
}
