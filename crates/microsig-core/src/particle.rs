//! A tracer particle as input of the image generator.

/// A spherical or spheroidal tracer particle in MicroSIG's coordinates.
///
/// `x_px` and `y_px` are image coordinates (the center of the top-left pixel is (1, 1), y points down);
/// `z_um` is the depth, zero in the paraxial object plane and positive away from the lens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Particle {
    /// Horizontal image coordinate of the center, px.
    pub x_px: f64,
    /// Vertical image coordinate of the center, px, downward.
    pub y_px: f64,
    /// Depth, um, positive away from the lens.
    pub z_um: f64,
    /// Diameter (equatorial diameter of a spheroid), um, > 0.
    pub d_um: f64,
    /// Shape and orientation; `None` is a sphere.
    pub spheroid: Option<Spheroid>,
    /// Factor on the particle's brightness, >= 0.
    pub c_int: f64,
}

impl Particle {
    /// A sphere of unit brightness.
    pub fn sphere(x_px: f64, y_px: f64, z_um: f64, d_um: f64) -> Self {
        Particle { x_px, y_px, z_um, d_um, spheroid: None, c_int: 1.0 }
    }

    /// The shape, if it is not round: `None` for spheres, those given as spheroids of aspect ratio 1
    /// included.
    pub fn elongated(&self) -> Option<Spheroid> {
        self.spheroid.filter(|spheroid| spheroid.e_p != 1.0)
    }
}

/// Aspect ratio and orientation of a spheroid (axes in `emission`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spheroid {
    /// Aspect ratio: polar over equatorial diameter; > 1 prolate, < 1 oblate.
    pub e_p: f64,
    /// Angle alpha of MicroSIG's data file, rad.
    pub alpha_rad: f64,
    /// Angle beta of MicroSIG's data file, rad.
    pub beta_rad: f64,
}

impl Spheroid {
    /// The symmetry axis in lab coordinates (x right, y down, z away from the lens), a unit vector up to
    /// sign.
    ///
    /// At alpha = beta = 0 the axis lies along image y, not along the optical axis.
    pub fn axis(&self) -> [f64; 3] {
        let (sin_a, cos_a) = libm::sincos(self.alpha_rad);
        let (sin_b, cos_b) = libm::sincos(self.beta_rad);
        [sin_a * sin_b, cos_b, -cos_a * sin_b]
    }

    /// The spheroid of aspect ratio `e_p` whose axis points along `n` (lab coordinates, any length > 0).
    pub fn from_axis(e_p: f64, n: [f64; 3]) -> Self {
        let length = libm::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
        let beta_rad = libm::acos((n[1] / length).clamp(-1.0, 1.0));
        Spheroid { e_p, alpha_rad: libm::atan2(n[0], -n[2]), beta_rad }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_and_axis_are_inverse_to_each_other() {
        for n in [[0.6, 0.64, 0.48], [0.0, 1.0, 0.0], [-0.6, -0.64, 0.48], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]] {
            let back = Spheroid::from_axis(3.0, n).axis();
            for i in 0..3 {
                assert!((back[i] - n[i]).abs() < 1e-15, "{n:?} became {back:?}");
            }
        }
    }
}
