//! Refraction: Snell's law in vector form, the thin cylindrical lens that makes images astigmatic (Rossi 2020, eq. (9)), and the
//! part of the aperture whose light can reach the sensor.

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

/// The direction of a ray behind an interface.
///
/// `direction` and `normal` are unit vectors, the normal pointing to the side of the refracted ray;
/// `index_ratio` is the index before over the index behind. `None`: total internal reflection, or an angle of
/// incidence above 90 degrees.
pub fn refract(direction: [f64; 3], normal: [f64; 3], index_ratio: f64) -> Option<[f64; 3]> {
    let cosine = direction[0] * normal[0] + direction[1] * normal[1] + direction[2] * normal[2];
    let squared = 1.0 - index_ratio * index_ratio * (1.0 - cosine * cosine);
    if cosine <= 0.0 || squared < 0.0 {
        return None;
    }
    let along_normal = libm::sqrt(squared) - index_ratio * cosine;
    Some([
        index_ratio * direction[0] + along_normal * normal[0],
        index_ratio * direction[1] + along_normal * normal[1],
        index_ratio * direction[2] + along_normal * normal[2],
    ])
}

/// The radius in the lens plane beyond which `misses` is true, in the unit of `aperture`: up to `steps` radii
/// are tested from the rim inward until one does not miss. `margin` steps are added because only discrete
/// radii are tested; the result is at most `aperture`.
pub fn useful_radius(aperture: f64, steps: u32, margin: u32, misses: impl Fn(f64) -> bool) -> f64 {
    let step = aperture / f64::from(steps);
    let missing = (0..steps).take_while(|&i| misses(aperture - f64::from(i) * step)).count();
    (aperture - step * (missing as f64 - f64::from(margin))).min(aperture)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sines_follow_the_indices() {
        let angle: f64 = 0.5;
        let (sine, cosine) = libm::sincos(angle);
        let refracted = refract([cosine, sine, 0.0], [1.0, 0.0, 0.0], 1.0 / 1.5).unwrap();
        assert!((refracted[1] - sine / 1.5).abs() < 1e-15);
        let length = refracted.iter().map(|c| c * c).sum::<f64>();
        assert!((length - 1.0).abs() < 1e-15);
    }

    #[test]
    fn beyond_the_critical_angle_nothing_passes() {
        let grazing = |angle: f64| {
            let (sine, cosine) = libm::sincos(angle);
            refract([cosine, sine, 0.0], [1.0, 0.0, 0.0], 1.5)
        };
        let critical = libm::asin(1.0 / 1.5);
        assert!(grazing(critical - 1e-6).is_some());
        assert!(grazing(critical + 1e-6).is_none());
        assert!(grazing(2.0).is_none());
    }

    #[test]
    fn the_margin_is_kept_and_the_aperture_not_exceeded() {
        assert_eq!(useful_radius(8.0, 8, 1, |q| q > 4.5), 5.0);
        assert_eq!(useful_radius(8.0, 8, 2, |_| false), 8.0);
        assert_eq!(useful_radius(8.0, 8, 2, |_| true), 2.0);
    }
}
