//! The gap between two parallel plates and a direction along them, shared by the plane channel flows.

use super::prelude::*;

/// Two plates normal to z.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Plates {
    pub(super) floor: f64,
    pub(super) ceiling: f64,
    pub(super) depth: f64,
}

impl Plates {
    pub(super) fn new(check: ParameterCheck, walls_z_um: Option<[f64; 2]>) -> Result<Self> {
        let [floor, ceiling] = check.increasing("walls_z_um", walls_z_um.unwrap_or(CHANNEL))?;
        Ok(Plates { floor, ceiling, depth: check.positive("walls_z_um distance", ceiling - floor)? })
    }

    /// Height above the floor as a fraction of the depth: 0 at the floor, 1 at the ceiling, not clamped.
    pub(super) fn height<S: Real>(&self, z: S) -> S {
        (z - self.floor) / self.depth
    }

    /// The nearer of the two plates.
    pub(super) fn wall(&self, x: DVec3) -> Wall {
        Wall::between(Axis::Z, self.floor, self.ceiling, x)
    }

    /// z of the mid-plane, um.
    pub(super) fn middle(&self) -> f64 {
        self.floor + 0.5 * self.depth
    }

    /// 6 s (1 - s) at the relative height s, the parabola with mean 1; 0 beyond the plates.
    pub(super) fn parabola<S: Real>(&self, z: S) -> S {
        let s = self.height(z);
        if inside(s.value()) { s * (-s + 1.0) * 6.0 } else { S::constant(0.0) }
    }

    /// The range of relative heights in a box, clamped to 0..1.
    pub(super) fn heights(&self, region: &Region) -> (f64, f64) {
        (self.height(region.min().z).clamp(0.0, 1.0), self.height(region.max().z).clamp(0.0, 1.0))
    }

    /// The maximum of [`Plates::parabola`] in a box.
    pub(super) fn greatest_parabola(&self, region: &Region) -> f64 {
        let (low, high) = self.heights(region);
        let s = 0.5_f64.clamp(low, high);
        6.0 * s * (1.0 - s)
    }
}

/// Whether a relative height is between the plates, inclusive.
pub(super) fn inside(height: f64) -> bool {
    (0.0..=1.0).contains(&height)
}

/// The unit vector at an angle (rad) from image x toward image y.
pub(super) fn direction(direction_rad: f64) -> DVec3 {
    let (sin, cos) = libm::sincos(direction_rad);
    DVec3::new(cos, sin, 0.0)
}

pub(super) fn along<S: Real>(direction: DVec3, speed: S) -> [S; 3] {
    [speed * direction.x, speed * direction.y, speed * direction.z]
}
