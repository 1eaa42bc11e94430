//! Rays in a plane through the optical axis, vectorized.
//!
//! The arithmetic of [`OpticalSystem::trace`] without the terms that are zero in a meridional plane,
//! so that the landing points are bit-identical, which a test checks. The loops are plain, and the compiler
//! vectorizes them.

use super::{Objective, OpticalSystem};

/// Rays traced per call.
pub(super) const RAYS: usize = 16;

/// Distances from the axis at which rays from a point on the axis with these slopes land on the sensor.
pub(super) struct Landings<'a> {
    pub(super) system: &'a OpticalSystem,
    /// Whether the plane contains x (the image columns), in which the cylindrical lens has its power.
    pub(super) along_columns: bool,
    /// Distance from the point to the lens, um.
    pub(super) distance: f64,
    pub(super) slopes: [f64; RAYS],
}

impl pulp::WithSimd for Landings<'_> {
    /// Distances, um; 0 for rays that are lost.
    type Output = [f64; RAYS];

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> [f64; RAYS] {
        let Objective { image_distance, aperture_radius, face_radius, index_ratio, .. } =
            self.system.objective;
        let outward = 1.0 / index_ratio;
        let mut landed = [0.0; RAYS];
        let mut behind = [[0.0; RAYS]; 2];
        let (heights, slopes) = behind.split_at_mut(1);
        let (heights, slopes) = (&mut heights[0], &mut slopes[0]);
        let mut arrives = [false; RAYS];
        for i in 0..RAYS {
            let p = self.slopes[i];
            let q = self.distance * p;
            let length = (1.0 + p * p).sqrt();
            let (d0, d1) = (1.0 / length, p / length);
            let length = (face_radius * face_radius + q * q).sqrt();
            let (n0, n1) = (face_radius / length, q / length);

            let cosine = d0 * n0 - d1 * n1;
            let squared = 1.0 - index_ratio * index_ratio * (1.0 - cosine * cosine);
            let enters = cosine > 0.0 && squared >= 0.0;
            let along = squared.sqrt() - index_ratio * cosine;
            let (d0, d1) = (index_ratio * d0 + along * n0, index_ratio * d1 - along * n1);

            let cosine = d0 * n0 + d1 * n1;
            let squared = 1.0 - outward * outward * (1.0 - cosine * cosine);
            let leaves = cosine > 0.0 && squared >= 0.0;
            let along = squared.sqrt() - outward * cosine;
            let (d0, d1) = (outward * d0 + along * n0, outward * d1 + along * n1);

            heights[i] = q;
            slopes[i] = d1 / d0;
            arrives[i] = q * q <= aperture_radius * aperture_radius && enters && leaves && d0 > 0.0;
        }
        let cylinder = self.system.cylinder.filter(|_| self.along_columns);
        for i in 0..RAYS {
            let (q, p) = (heights[i], slopes[i]);
            let x = match (cylinder, self.system.cylinder) {
                (Some(cylinder), _) => {
                    let q = q + image_distance / 3.0 * p;
                    q + 2.0 * image_distance / 3.0 * (p - q / cylinder.focal_length)
                }
                (None, Some(_)) => (q + image_distance / 3.0 * p) + 2.0 * image_distance / 3.0 * p,
                (None, None) => q + image_distance * p,
            };
            landed[i] = if arrives[i] { x.abs() } else { 0.0 };
        }
        landed
    }
}

#[cfg(test)]
mod tests {
    use super::super::Ray;
    use super::*;
    use crate::settings::Settings;

    #[test]
    fn rays_land_where_they_do_one_by_one() {
        let (mut landed, mut lost) = (0, 0);
        for settings in [Settings::setting1(), Settings::setting1a(), Settings::setting2()] {
            let system = OpticalSystem::new(&settings);
            for step in 0..200 {
                let distance = system.objective.object_distance(f64::from(step) - 120.0);
                let widest = 1.02 * system.objective.aperture_radius / distance;
                let slopes = std::array::from_fn(|i| widest * (i + 1) as f64 / RAYS as f64);
                for along_columns in [false, true] {
                    let landings = Landings { system: &system, along_columns, distance, slopes };
                    let found = pulp::Arch::new().dispatch(landings);
                    for (p, found) in slopes.into_iter().zip(found) {
                        let ray = Ray { q_x: 0.0, q_y: 0.0, p_x: 0.0, p_y: 0.0 };
                        let ray = if along_columns { Ray { p_x: p, ..ray } } else { Ray { p_y: p, ..ray } };
                        let place = system.trace(ray, distance);
                        let expected = place.map(|(x, y)| if along_columns { x.abs() } else { y.abs() });
                        assert_eq!(found.to_bits(), expected.unwrap_or(0.0).to_bits(), "{distance} {p}");
                        landed += u32::from(expected.is_some());
                        lost += u32::from(expected.is_none());
                    }
                }
            }
        }
        assert!(landed > 1000 && lost > 100, "{landed} {lost}");
    }
}
