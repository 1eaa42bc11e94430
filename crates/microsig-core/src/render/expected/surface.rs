//! The shining part of a particle's surface, as points of equal weight.

use crate::emission::{self, Point};

/// Source points in internal axes, um, and their centroid.
#[derive(Debug, Clone)]
pub(super) struct Surface {
    pub(super) points: Vec<Point>,
    pub(super) centroid: Point,
    /// The farthest that a point lies from the particle's centre, um.
    pub(super) radius_um: f64,
    /// Half its smallest extent, um.
    pub(super) least_radius_um: f64,
    /// Whether the surface is its own mirror image in e2 and in e3.
    pub(super) mirrored: bool,
}

impl Surface {
    /// A sphere by `n` points. The far hemisphere's points are turned to the near one (`emission`), so they are even in
    /// area over the hemisphere toward the lens: by Archimedes, even in depth.
    pub(super) fn sphere(radius_um: f64, n: usize) -> Surface {
        // A point has no size.
        let n = if radius_um == 0.0 { 1 } else { n };
        let points = (0..n)
            .map(|k| {
                let depth = (k as f64 + 0.5) / n as f64;
                let (sine, cosine) = libm::sincos(emission::golden_azimuth(k));
                let offset = radius_um * libm::sqrt(1.0 - depth * depth);
                [-radius_um * depth, offset * cosine, offset * sine]
            })
            .collect();
        Surface {
            points,
            centroid: [-0.5 * radius_um, 0.0, 0.0],
            radius_um,
            least_radius_um: radius_um,
            mirrored: true,
        }
    }

    /// Any points, of a particle with this smallest half extent.
    pub(super) fn new(points: Vec<Point>, least_radius_um: f64) -> Surface {
        let n = points.len().max(1) as f64;
        let mut centroid = [0.0; 3];
        let mut radius2 = 0.0f64;
        for point in &points {
            (0..3).for_each(|axis| centroid[axis] += point[axis] / n);
            radius2 = radius2.max(point.iter().map(|e| e * e).sum());
        }
        Surface { points, centroid, radius_um: libm::sqrt(radius2), least_radius_um, mirrored: false }
    }

    /// Distance squared, across the optical axis, of the centroid from the point of the lens at `q` and this azimuth.
    #[inline(always)]
    pub(super) fn offset2(&self, q: f64, [cosine, sine]: [f64; 2]) -> f64 {
        let (x, y) = (q * cosine - self.centroid[1], q * sine - self.centroid[2]);
        x * x + y * y
    }
}
