//! The objective as one infinitely thin spherical lens with exact refraction, Rossi 2020, eqs. (3)-(8).
//!
//! Both faces are in the same plane, so a ray is refracted twice at the same (q_x, q_y). The slope of a face
//! is q/R, as for a parabola and in the original program; the slope of a sphere would give a substantially
//! different image.

use super::{Ray, refract};
use crate::settings::Settings;

/// A thin lens with its aperture and its distances from the object plane and the sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Objective {
    /// Distance from the paraxial object plane (z = 0) to the lens, um: f (1 + 1/M).
    pub object_distance_0: f64,
    /// Distance from the lens to the sensor, um: b = f (M + 1).
    pub image_distance: f64,
    /// Radius of the aperture in the lens plane, um: tan(asin NA) f (1 + 1/M), whatever the index of the
    /// medium.
    pub aperture_radius: f64,
    /// Radius of curvature of both faces, um: R = 2 (n_l/n_m - 1) f (eq. 4).
    pub face_radius: f64,
    /// Refractive index ratio n_m / n_l.
    pub index_ratio: f64,
}

impl Objective {
    /// The objective of these settings.
    pub fn new(settings: &Settings) -> Self {
        let (f, m) = (settings.focal_length, settings.magnification);
        let object_distance_0 = f * (1.0 + 1.0 / m);
        Objective {
            object_distance_0,
            image_distance: f * (m + 1.0),
            aperture_radius: libm::tan(libm::asin(settings.numerical_aperture)) * object_distance_0,
            face_radius: 2.0 * (settings.ri_lens / settings.ri_medium - 1.0) * f,
            index_ratio: settings.ri_medium / settings.ri_lens,
        }
    }

    /// Distance from the plane at depth `z_um` to the lens, um: a = z + f (1 + 1/M).
    pub fn object_distance(&self, z_um: f64) -> f64 {
        z_um + self.object_distance_0
    }

    /// Refraction at the two faces; the position in the lens plane is unchanged.
    ///
    /// `None`: total internal reflection, or incidence on a face from behind.
    pub fn refract(&self, ray: Ray) -> Option<Ray> {
        let Ray { q_x, q_y, p_x, p_y } = ray;
        let incident = normalize([1.0, p_x, p_y]);
        let first_face = normalize([self.face_radius, -q_x, -q_y]);
        let second_face = normalize([self.face_radius, q_x, q_y]);
        let inside = refract(incident, first_face, self.index_ratio)?;
        let behind = refract(inside, second_face, 1.0 / self.index_ratio)?;
        (behind[0] > 0.0).then(|| Ray { q_x, q_y, p_x: behind[1] / behind[0], p_y: behind[2] / behind[0] })
    }
}

fn normalize(v: [f64; 3]) -> [f64; 3] {
    let length = libm::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    [v[0] / length, v[1] / length, v[2] / length]
}
