//! The emitting part of a particle's surface, as points of equal weight.

use crate::emission::{self, Point};

/// Source points in internal axes, um, and their centroid.
#[derive(Debug, Clone)]
pub(super) struct EmittingSurface {
    pub(super) points: Vec<Point>,
    pub(super) centroid: Point,
    /// Largest distance of a point from the particle center, um.
    pub(super) radius_um: f64,
    /// Half the smallest extent of the particle, um.
    pub(super) least_radius_um: f64,
    /// Whether the surface is mirror-symmetric in e2 and in e3.
    pub(super) mirrored: bool,
}

impl EmittingSurface {
    /// A sphere of `n` points. The points of the far hemisphere are rotated to the near one (`emission`), so
    /// they are uniform in area over the hemisphere facing the lens: by Archimedes' theorem, uniform in
    /// depth.
    pub(super) fn sphere(radius_um: f64, n: usize) -> EmittingSurface {
        // A particle of radius 0 is a single point.
        let n = if radius_um == 0.0 { 1 } else { n };
        let points = (0..n)
            .map(|k| {
                let depth = (k as f64 + 0.5) / n as f64;
                let (sine, cosine) = libm::sincos(emission::golden_azimuth(k));
                let offset = radius_um * libm::sqrt(1.0 - depth * depth);
                [-radius_um * depth, offset * cosine, offset * sine]
            })
            .collect();
        EmittingSurface {
            points,
            centroid: [-0.5 * radius_um, 0.0, 0.0],
            radius_um,
            least_radius_um: radius_um,
            mirrored: true,
        }
    }

    /// The surface with the given points of a particle whose smallest half extent is `least_radius_um`.
    pub(super) fn new(points: Vec<Point>, least_radius_um: f64) -> EmittingSurface {
        let n = points.len().max(1) as f64;
        let mut centroid = [0.0; 3];
        let mut radius2 = 0.0f64;
        for point in &points {
            (0..3).for_each(|axis| centroid[axis] += point[axis] / n);
            radius2 = radius2.max(point.iter().map(|e| e * e).sum());
        }
        EmittingSurface { points, centroid, radius_um: libm::sqrt(radius2), least_radius_um, mirrored: false }
    }

    /// Squared lateral distance (um^2) of the centroid from the point of the lens at the radius `q` (um) and
    /// this azimuth (cosine, sine).
    #[inline(always)]
    pub(super) fn offset2(&self, q: f64, [cosine, sine]: [f64; 2]) -> f64 {
        let (x, y) = (q * cosine - self.centroid[1], q * sine - self.centroid[2]);
        x * x + y * y
    }
}
