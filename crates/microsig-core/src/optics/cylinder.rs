//! The thin cylindrical lens that makes images astigmatic, Rossi 2020, eq. (9).

use super::Ray;

/// A paraxial cylindrical lens with power along image columns (x) only.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CylindricalLens {
    /// Focal length, um, not zero; negative for a diverging lens.
    pub focal_length: f64,
}

impl CylindricalLens {
    /// The ray behind the lens: p_x changes by -q_x / f_cyl, nothing else does.
    pub fn refract(&self, ray: Ray) -> Ray {
        Ray { p_x: ray.p_x - ray.q_x / self.focal_length, ..ray }
    }
}
