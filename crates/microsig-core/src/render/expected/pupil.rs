//! The view of a particle through one point of the lens.
//!
//! The landing position of a ray depends on the point of the lens and on its two slopes there. For a fixed
//! point of the lens, the landing position is approximated by a quadratic in the slopes over the small range
//! that a particle covers; the slopes are computed exactly from the source point, so that perspective (larger
//! magnification of nearer source points) is fully included. Spherical aberration and coma are included in
//! the coefficients of each lens point, which are computed from exact rays.

use crate::optics::{self, OpticalSystem, Ray};

/// The view of a particle through one point of the lens. Positions on the sensor are in px (columns, rows),
/// relative to the center of the particle image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PupilView {
    /// The point of the lens, um.
    pub(super) q: [f64; 2],
    /// Distance from the particle center to the lens, um.
    distance: f64,
    /// Landing position of the ray from the particle center, px.
    pub(super) landing: [f64; 2],
    /// Derivatives of the landing position with respect to the slopes along columns and along rows, px.
    pub(super) by_slope: [[f64; 2]; 2],
    /// Second derivatives with respect to the slopes: columns-columns, columns-rows, rows-rows, px.
    curvature: [[f64; 2]; 3],
}

impl PupilView {
    /// Landing position (px) of the ray from a source point; (e1, e2, e3) is its offset in the axes of
    /// `optics`, um.
    #[inline(always)]
    pub(super) fn place(&self, [e1, e2, e3]: [f64; 3]) -> [f64; 2] {
        let [q_x, q_y] = self.q;
        let per = 1.0 / (self.distance + e1);
        let u = (q_x - e2) * per - q_x / self.distance;
        let v = (q_y - e3) * per - q_y / self.distance;
        let along = |axis: usize| {
            let [xx, xy, yy] = [self.curvature[0][axis], self.curvature[1][axis], self.curvature[2][axis]];
            let linear = self.by_slope[0][axis] * u + self.by_slope[1][axis] * v;
            self.landing[axis] + linear + (0.5 * (xx * u * u + yy * v * v) + xy * u * v)
        };
        [along(0), along(1)]
    }

    /// Derivatives of the landing position with respect to e1, e2 and e3, px/um.
    fn by_offset(&self) -> [[f64; 2]; 3] {
        let per = 1.0 / self.distance;
        let [along_x, along_y] = self.by_slope;
        let by_e1 = [0, 1].map(|i| -(self.q[0] * along_x[i] + self.q[1] * along_y[i]) * per * per);
        [by_e1, along_x.map(|d| -d * per), along_y.map(|d| -d * per)]
    }

    /// Largest change of the landing position along columns per displacement of the source point, px/um.
    pub(super) fn slope(&self) -> f64 {
        let [by_e1, by_e2, by_e3] = self.by_offset();
        by_e1[0].abs() + by_e2[0].abs() + by_e3[1].abs()
    }
}

/// Number of steps of [`Pupil::reach`] for tables and fits.
pub(super) const REACH_STEPS: u32 = 64;

/// The optical system and the pixel size of the sensor.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pupil {
    pub(super) system: OpticalSystem,
    pub(super) pixel_size: f64,
}

impl Pupil {
    /// The view through the point `q` of the lens (um) at depth `z_um`, for source points within `radius_um`
    /// of the center. `None`: the ray is lost.
    pub(super) fn view(&self, z_um: f64, radius_um: f64, q: [f64; 2]) -> Option<PupilView> {
        let distance = self.distance(z_um);
        if distance <= 0.0 {
            return None;
        }
        // Differences over the extent of the particle include the mean effect of higher orders.
        let step = (0.6 * radius_um).max(0.05) / distance;
        let slopes = q.map(|q| q / distance);
        let landing = self.landing_of(q, slopes)?;
        let at = |u: f64, v: f64| self.landing_of(q, [slopes[0] + u * step, slopes[1] + v * step]);
        let (right, left, down, up) = (at(1.0, 0.0)?, at(-1.0, 0.0)?, at(0.0, 1.0)?, at(0.0, -1.0)?);
        let first = |high: [f64; 2], low: [f64; 2]| [0, 1].map(|i| (high[i] - low[i]) / (2.0 * step));
        let second = |high: [f64; 2], low: [f64; 2]| {
            [0, 1].map(|i| (high[i] + low[i] - 2.0 * landing[i]) / (step * step))
        };
        // Near total internal reflection a corner may be lost; its term is small compared with the others.
        let corners = [at(1.0, 1.0), at(-1.0, -1.0), at(1.0, -1.0), at(-1.0, 1.0)];
        let mixed = if let [Some(a), Some(b), Some(c), Some(d)] = corners {
            [0, 1].map(|i| (a[i] + b[i] - c[i] - d[i]) / (4.0 * step * step))
        } else {
            [0.0; 2]
        };
        Some(PupilView {
            q,
            distance,
            landing,
            by_slope: [first(right, left), first(down, up)],
            curvature: [second(right, left), mixed, second(down, up)],
        })
    }

    /// Landing position (px) of the ray from a source point (offset in um) through the point `q` of the lens
    /// (um).
    pub(super) fn landing(&self, z_um: f64, [e1, e2, e3]: [f64; 3], q: [f64; 2]) -> Option<[f64; 2]> {
        let distance = self.distance(z_um) + e1;
        if distance <= 0.0 {
            return None;
        }
        self.landing_of(q, [(q[0] - e2) / distance, (q[1] - e3) / distance])
    }

    /// Landing position (px) of a ray with these slopes at the point `q` of the lens (um).
    fn landing_of(&self, q: [f64; 2], [p_x, p_y]: [f64; 2]) -> Option<[f64; 2]> {
        let (x, y) = self.system.trace(Ray { q_x: q[0], q_y: q[1], p_x, p_y }, 0.0)?;
        Some([x / self.pixel_size, y / self.pixel_size])
    }

    /// Radius (um) in the lens plane beyond which no light of a particle of radius `radius_um` lands within
    /// `farthest_px` of the image center along the two axes; at most the aperture's.
    pub(super) fn useful_radius(&self, z_um: f64, radius_um: f64, farthest_px: [f64; 2]) -> f64 {
        let misses = |q: f64| {
            let axes = [[q, 0.0], [0.0, q]].map(|point| self.view(z_um, radius_um, point));
            let [Some(along_x), Some(along_y)] = axes else { return true };
            // Rays through a circle in the lens plane land on an ellipse with these semi-axes.
            let beside = |axis: usize, view: &PupilView| {
                let nearest = view.landing[axis].abs() - radius_um * view.slope();
                farthest_px[axis] / nearest.max(f64::MIN_POSITIVE)
            };
            if self.system.cylinder.is_none() {
                return beside(0, &along_x) < 1.0;
            }
            let (x, y) = (beside(0, &along_x), beside(1, &along_y));
            x * x + y * y < 1.0
        };
        optics::useful_radius(self.aperture(), 256, 1, misses)
    }

    /// Largest distances (px) along the two axes at which light of a particle lands from the center of its
    /// image; `steps`: from the axis to the rim.
    pub(super) fn reach(&self, z_um: f64, radius_um: f64, steps: u32) -> [f64; 2] {
        let mut reach = [0.0f64; 2];
        // Without a cylindrical lens, both axes of the lens are the same.
        let axes = if self.system.cylinder.is_none() { 1 } else { 2 };
        for i in 0..=steps {
            let q = self.aperture() * f64::from(i) / f64::from(steps);
            for point in [[q, 0.0], [0.0, q]].into_iter().take(axes) {
                let Some(view) = self.view(z_um, radius_um, point) else { continue };
                for axis in 0..2 {
                    let slope2 = view.by_offset().iter().map(|d| d[axis] * d[axis]).sum::<f64>();
                    reach[axis] = reach[axis].max(view.landing[axis].abs() + radius_um * libm::sqrt(slope2));
                }
            }
        }
        if self.system.cylinder.is_none() { [reach[0].max(reach[1]); 2] } else { reach }
    }

    /// Diameter of the geometric image of a particle at this depth, px, without blur.
    pub(super) fn image_px(&self, z_um: f64, radius_um: f64) -> f64 {
        2.0 * radius_um * self.system.objective.image_distance / self.distance(z_um) / self.pixel_size
    }

    /// Distance from the plane at this depth to the lens, um.
    pub(super) fn distance(&self, z_um: f64) -> f64 {
        self.system.objective.object_distance(z_um)
    }

    /// The largest radius used in the lens plane, um: just inside the aperture, so that no ray is lost by
    /// rounding.
    pub(super) fn aperture(&self) -> f64 {
        self.system.objective.aperture_radius * (1.0 - 1e-9)
    }
}

/// The fraction, per unit area of a plane (1/um^2), of light emitted isotropically into a half space by a
/// point at `distance` (um) in front of the plane, at the squared in-plane offset `offset2` (um^2): cos / (2
/// pi r^2).
#[inline(always)]
pub(super) fn density(distance: f64, offset2: f64) -> f64 {
    let r2 = distance * distance + offset2;
    distance / (r2 * r2.sqrt() * (2.0 * std::f64::consts::PI))
}
