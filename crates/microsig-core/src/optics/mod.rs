//! The path of a ray from a particle to the sensor, Rossi 2020, eqs. (2)-(9), in f64.
//!
//! ```text
//!   particle --- a + e1 ---> spherical lens --- b/3 ---> cylindrical lens --- 2b/3 ---> sensor
//! ```
//!
//! A ray is its position on a plane and its two slopes. The model is centred on each particle (no field
//! dependence); its axes are e1 along the light's line, pointing away from the lens, e2 along image columns and e3
//! along image rows, the latter two before the lens inverts them: a point at the lab offset (dx, dy, dz) from the
//! particle's centre has (e1, e2, e3) = (dz, -dx, -dy).

mod cylinder;
mod meridional;
mod objective;
mod refraction;

pub use cylinder::CylindricalLens;
pub use objective::Objective;
pub use refraction::refract;

use crate::settings::Settings;
use meridional::{Landings, RAYS};

/// Position on a plane across the optical axis, um, and slopes (dimensionless).
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
    /// The ray after a free path of this length along the axis, um (eq. 2).
    pub fn travel(self, distance: f64) -> Ray {
        Ray { q_x: self.q_x + distance * self.p_x, q_y: self.q_y + distance * self.p_y, ..self }
    }
}

/// Objective and, if there is one, cylindrical lens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OpticalSystem {
    /// The spherical lens.
    pub objective: Objective,
    /// The lens that makes the image astigmatic.
    pub cylinder: Option<CylindricalLens>,
}

impl OpticalSystem {
    /// The system that these settings describe.
    pub fn new(settings: &Settings) -> Self {
        OpticalSystem {
            objective: Objective::new(settings),
            cylinder: (settings.cyl_focal_length != 0.0)
                .then_some(CylindricalLens { focal_length: settings.cyl_focal_length }),
        }
    }

    /// Follows a ray from a source point to the sensor and gives its position there, um from the particle's image
    /// centre. `distance` is the path from the point to the lens along the axis, um.
    ///
    /// `None`: the ray passes beside the lens or is lost at one of its faces.
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
            // The paper puts the cylinder at 2/3 of the way; its program 2/3 before the sensor. We follow the program.
            Some(cylinder) => {
                cylinder.refract(behind.travel(image_distance / 3.0)).travel(2.0 * image_distance / 3.0)
            }
        };
        Some((at_sensor.q_x, at_sensor.q_y))
    }

    /// Half width and half height of the image of a point at depth `z_um`, um on the sensor: the farthest that rays
    /// through a grid of aperture positions land from the axis.
    ///
    /// A working estimate (the renderers check it against the rays they trace), not a bound.
    pub fn image_extent(&self, z_um: f64) -> (f64, f64) {
        let distance = self.objective.object_distance(z_um);
        let radius = self.objective.aperture_radius;
        // Enough to find the edge of a caustic within 1 %.
        let slopes = std::array::from_fn(|i| radius * (i + 1) as f64 / RAYS as f64 / distance);
        let farthest = |along_columns| {
            let landings = Landings { system: self, along_columns, distance, slopes };
            pulp::Arch::new().dispatch(landings).into_iter().fold(0.0, f64::max)
        };
        // The two meridional fans hold the extremes: along the columns and along the rows.
        let height = farthest(false);
        (if self.cylinder.is_some() { farthest(true) } else { height }, height)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A paraxial ray meets the sensor at the paraxial magnification: the transfer of the thin lens, and nothing else.
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

    /// With a medium of index n_m, eq. (4) shapes the lens so that its focal length stays f.
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

    /// Rays near the rim are bent too much: they cross the axis in front of the paraxial image.
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
