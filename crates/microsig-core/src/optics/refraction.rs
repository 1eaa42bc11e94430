//! Snell's law in vector form.

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
}
