//! The path of a ray from a particle to the sensor, Rossi 2020, eqs. (2)-(9), in f64.
//!
//! ```text
//!   particle --- a + e1 ---> spherical lens --- b/3 ---> cylindrical lens --- 2b/3 ---> sensor
//! ```
//!
//! A ray is its position on a plane and its two slopes. The model is centered on each particle (no field
//! dependence). Its axes are e1 along the optical axis, pointing away from the lens, and e2 and e3 along
//! image columns and rows, inverted as by the lens: a point at the lab offset (dx, dy, dz) from the
//! particle's center has (e1, e2, e3) = (dz, -dx, -dy).

mod field;
mod meridional;
mod objective;
mod refraction;

pub use field::{ChiefRay, FieldAstigmatism, FieldComa, FieldOptics, FocusSurface, LocalOptics, Vignetting};
pub use objective::Objective;
pub use refraction::{CylindricalLens, refract, useful_radius};

use crate::settings::Settings;
use meridional::{Landings, RAYS};

/// A ray: its position (um) in a plane normal to the optical axis, and its slopes (dimensionless).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Position along image columns, um.
    pub q_x: f64,
    /// Position along image rows, um.
    pub q_y: f64,
    /// Slope along image columns.
    pub p_x: f64,
    /// Slope along image rows.
    pub p_y: f64,
}

impl Ray {
    /// The ray after free propagation over `distance` (um) along the axis (eq. 2).
    pub fn travel(self, distance: f64) -> Ray {
        Ray { q_x: self.q_x + distance * self.p_x, q_y: self.q_y + distance * self.p_y, ..self }
    }
}

/// The objective and the optional cylindrical lens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OpticalSystem {
    /// The spherical lens.
    pub objective: Objective,
    /// The cylindrical lens that makes the image astigmatic; `None` for a spherical system.
    pub cylinder: Option<CylindricalLens>,
}

impl OpticalSystem {
    /// The optical system of these settings.
    pub fn new(settings: &Settings) -> Self {
        OpticalSystem {
            objective: Objective::new(settings),
            cylinder: (settings.cyl_focal_length != 0.0)
                .then_some(CylindricalLens { focal_length: settings.cyl_focal_length }),
        }
    }

    /// Traces a ray from a source point to the sensor and returns its position there, um from the center of
    /// the particle image. `distance` is the axial distance from the point to the lens, um.
    ///
    /// `None`: the ray misses the aperture or is lost at one of the faces.
    pub fn trace(&self, start: Ray, distance: f64) -> Option<(f64, f64)> {
        let objective = &self.objective;
        let at_lens = start.travel(distance);
        if at_lens.q_x * at_lens.q_x + at_lens.q_y * at_lens.q_y
            > objective.aperture_radius * objective.aperture_radius
        {
            return None;
        }
        let image_distance = objective.image_distance;
        let behind = objective.refract(at_lens)?;
        let at_sensor = match self.cylinder {
            None => behind.travel(image_distance),
            // The paper places the cylinder at 2/3 of the image distance, its program at 2/3 of it before the
            // sensor. The program is followed.
            Some(cylinder) => {
                cylinder.refract(behind.travel(image_distance / 3.0)).travel(2.0 * image_distance / 3.0)
            }
        };
        Some((at_sensor.q_x, at_sensor.q_y))
    }

    /// Half width and half height (um on the sensor) of the image of a point at depth `z_um` (um): the
    /// largest distances from the axis at which rays through a grid of aperture positions land.
    ///
    /// This is an estimate, not a bound; the renderers check it against the rays they trace.
    pub fn image_extent(&self, z_um: f64) -> (f64, f64) {
        let distance = self.objective.object_distance(z_um);
        let radius = self.objective.aperture_radius;
        // Sufficient to locate the edge of a caustic within 1 %.
        let slopes = std::array::from_fn(|i| radius * (i + 1) as f64 / RAYS as f64 / distance);
        let farthest = |along_columns| {
            let landings = Landings { system: self, along_columns, distance, slopes };
            pulp::Arch::new().dispatch(landings).into_iter().fold(0.0, f64::max)
        };
        // The extremes are in the two meridional fans, along the columns and along the rows.
        let height = farthest(false);
        (if self.cylinder.is_some() { farthest(true) } else { height }, height)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A paraxial ray lands at the position given by the paraxial magnification.
    #[test]
    fn paraxial_magnification_is_m() {
        for settings in [Settings::setting1(), Settings::setting2()] {
            let system = OpticalSystem::new(&settings);
            let offset = 1e-3;
            let ray = Ray { q_x: offset, q_y: 0.0, p_x: 0.0, p_y: 0.0 };
            let (x, _) = system.trace(ray, system.objective.object_distance(0.0)).unwrap();
            // The image is inverted; third-order terms are (offset / f)^2, about 1e-11.
            assert!(
                (x / offset + settings.magnification).abs() < 1e-8 * settings.magnification,
                "{}",
                x / offset
            );
        }
    }

    /// Eq. (4) adapts the lens to the index n_m of the medium so that its focal length remains f.
    #[test]
    fn the_focal_length_does_not_depend_on_the_medium() {
        for ri_medium in [1.0, 1.33, 1.45] {
            let settings = Settings { ri_medium, ..Settings::setting1() };
            let objective = Objective::new(&settings);
            let height = 1e-3;
            let behind = objective.refract(Ray { q_x: height, q_y: 0.0, p_x: 0.0, p_y: 0.0 }).unwrap();
            assert!((-height / behind.p_x - 350.0).abs() < 1e-6, "{}", -height / behind.p_x);
        }
    }

    /// Marginal rays are refracted too strongly and cross the axis in front of the paraxial image.
    #[test]
    fn the_lens_has_spherical_aberration() {
        let system = OpticalSystem::new(&Settings::setting1());
        let distance = system.objective.object_distance(0.0);
        let slope = 0.99 * system.objective.aperture_radius / distance;
        let (x, _) = system.trace(Ray { q_x: 0.0, q_y: 0.0, p_x: slope, p_y: 0.0 }, distance).unwrap();
        assert!(x < -1.0, "a marginal ray from the paraxial object plane lands {x} um beyond the axis");
    }

    #[test]
    fn rays_outside_the_aperture_are_lost() {
        let system = OpticalSystem::new(&Settings::setting1());
        let distance = system.objective.object_distance(0.0);
        let slope = 1.01 * system.objective.aperture_radius / distance;
        assert_eq!(system.trace(Ray { q_x: 0.0, q_y: 0.0, p_x: slope, p_y: 0.0 }, distance), None);
    }
}
