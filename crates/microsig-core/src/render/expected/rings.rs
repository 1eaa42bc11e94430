//! How a round image lies among its nodes.
//!
//! Nodes stand at equal steps along the radius. The steps of a block grow with depth as the rim does, evenly, so that
//! edges keep their places among the nodes from plane to plane.

use super::pixel::AZIMUTHS;

/// Nodes per px in the middle of a block.
const PER_PX: f64 = 16.0;

/// The most that steps may grow over a block, as a share.
const MOST_GROWTH: f64 = 0.4;

/// Nodes along the radius, for each order of the azimuth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rings {
    middle_um: f64,
    /// Growth of steps by depth, 1/um.
    growth: f64,
    per_px: f64,
    pub(super) columns: usize,
    /// Orders of the azimuth: f0(r) + f4(r) cos 4 psi + ...
    pub(super) orders: usize,
}

impl Rings {
    /// Nodes for a range of depths; `reach` says how far images reach, px, and those farther than `farthest_px` are not seen.
    pub(super) fn new(start_um: f64, length_um: f64, farthest_px: f64, reach: impl Fn(f64) -> f64) -> Rings {
        let middle_um = start_um + 0.5 * length_um;
        let grown = (reach(start_um + length_um) - reach(start_um)) / reach(middle_um);
        let growth = grown.clamp(-MOST_GROWTH, MOST_GROWTH) / length_um;
        let mut rings = Rings { middle_um, growth, per_px: PER_PX, columns: 0, orders: AZIMUTHS };
        for i in 0..9 {
            let z_um = start_um + length_um * f64::from(i) / 8.0;
            // Behind the last pixel there is room for the spline to end.
            let seen = reach(z_um).min(farthest_px + 2.0);
            rings.columns = rings.columns.max(libm::ceil(seen * rings.per_px(z_um)) as usize + 2);
        }
        rings
    }

    /// Twice as many nodes per px.
    pub(super) fn finer(self) -> Rings {
        Rings { per_px: 2.0 * self.per_px, columns: 2 * self.columns, ..self }
    }

    /// With so many orders of the azimuth.
    pub(super) fn of_orders(self, orders: usize) -> Rings {
        Rings { orders, ..self }
    }

    fn steps(&self, z_um: f64) -> f64 {
        1.0 + self.growth * (z_um - self.middle_um)
    }

    /// Nodes per px at this depth.
    pub(super) fn per_px(&self, z_um: f64) -> f64 {
        self.per_px / self.steps(z_um)
    }

    /// Its derivative by depth, over itself: 1/um.
    pub(super) fn per_px_by_z(&self, z_um: f64) -> f64 {
        -self.growth / self.steps(z_um)
    }

    /// Numbers of a plane.
    pub(super) fn length(&self) -> usize {
        self.orders * self.columns
    }
}
