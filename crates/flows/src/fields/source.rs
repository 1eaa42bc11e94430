//! Sources and sinks: a line along z, a point, or a hole in a Hele-Shaw cell.
//!
//! The velocity is radial. Outside a core of radius c it is U (c / r)^(n-1), n = 2 for a line and 3 for a
//! point, so that the flow rate is 2 pi c U per unit length or 4 pi c^2 U (Batchelor, An Introduction to
//! Fluid Dynamics, section 2.5). Inside it is U r / c: the divergence is uniform in the core and zero
//! outside. In a Hele-Shaw cell the line source is multiplied by the parabola 6 s (1 - s) of the relative
//! height s, and U is the mean over the depth.
//!
//! Outside the core, r^n grows at the rate n c^(n-1) U; inside, r grows exponentially. In a sink (U < 0)
//! tracers approach the center asymptotically and accumulate in the core; a drain ([`crate::Body::Drain`])
//! that covers the core removes them.

use super::plates::Plates;
use super::prelude::*;

/// Shapes of a source.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SourceShape {
    /// A line along z.
    Line,
    /// A point.
    Point,
    /// A line along z between two plates.
    HeleShaw,
}

params! {
    /// Parameters of [`Source`].
    SourceParams("source") {
        /// A line along z, a point, or a line between two plates.
        shape: SourceShape = SourceShape::Line, [one of], "line, point or hele_shaw";
        /// Radial speed at the edge of the core, um/s; negative: a sink.
        core_speed_um_s: f64 = 1290.0, [finite];
        /// Radius of the core, um.
        core_radius_um: f64 = 20.0, [> 0];
        /// The center, um; only a point source uses z.
        #[alias = "centre_um"]
        #[otherwise = "mid-depth"]
        center_um: Option<[f64; 3]> = None, [finite];
        /// z of floor and ceiling of the Hele-Shaw cell, um.
        #[otherwise = "the depth range"]
        walls_z_um: Option<[f64; 2]> = None, [finite], "floor below ceiling";
    }
}

entry! {
    SourceParams => Source::new, XY;
    "u_r = U (c/r)^(n-1) outside the core, U r/c inside; n = 2 line, 3 point; hele_shaw: times 6 s (1 - s)";
    "Batchelor, An Introduction to Fluid Dynamics, 2.5";
    [
        ("sink", || Self { core_speed_um_s: -1290.0, ..Default::default() }.build()),
        ("point", || {
            Self { shape: SourceShape::Point, core_radius_um: 40.0, ..Default::default() }.build()
        }),
        ("hele_shaw", || Self { shape: SourceShape::HeleShaw, ..Default::default() }.build()),
    ];
    center_um: middle;
    walls_z_um: walls;
}

/// A source or sink.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Source {
    center: DVec3,
    speed: f64,
    core: f64,
    point: bool,
    plates: Option<Plates>,
}

impl Source {
    /// The source of these parameters.
    pub fn new(params: &SourceParams) -> Result<Self> {
        let params = params.checked()?;
        let plates = match params.shape {
            SourceShape::HeleShaw => Some(Plates::new(SourceParams::CHECK, params.walls_z_um)?),
            SourceShape::Line | SourceShape::Point => None,
        };
        Ok(Source {
            center: DVec3::from_array(params.center_um.unwrap_or(MID_DEPTH)),
            speed: params.core_speed_um_s,
            core: params.core_radius_um,
            point: params.shape == SourceShape::Point,
            plates,
        })
    }

    /// The vector (um) from the center or axis to `x`.
    fn arm(&self, x: DVec3) -> DVec3 {
        let arm = x - self.center;
        if self.point { arm } else { arm.with_z(0.0) }
    }

    /// r^n / (n c^(n-1)) (um), which grows at the rate U outside the core.
    fn volume(&self, r: f64) -> f64 {
        if self.point { r * r * r / (3.0 * self.core * self.core) } else { r * r / (2.0 * self.core) }
    }

    /// The radius (um) that a particle at `r` (um, > 0) reaches when `way` = U dt (um).
    fn radius_after(&self, r: f64, way: f64) -> f64 {
        let edge = self.volume(self.core);
        let outside = |volume: f64| {
            if self.point {
                libm::cbrt(3.0 * self.core * self.core * volume)
            } else {
                libm::sqrt(2.0 * self.core * volume)
            }
        };
        if r >= self.core {
            let left = self.volume(r) - edge + way;
            if left >= 0.0 { outside(edge + left) } else { self.core * libm::exp(left / self.core) }
        } else {
            let left = way - self.core * libm::log(self.core / r);
            if left > 0.0 { outside(edge + left) } else { r * libm::exp(way / self.core) }
        }
    }
}

impl Formula for Source {
    fn formula<S: Real>(&self, x: [S; 3], _t: f64) -> [S; 3] {
        let mut arm: [S; 3] = std::array::from_fn(|i| x[i] - self.center[i]);
        if !self.point {
            arm[2] = S::constant(0.0);
        }
        let r2 = arm[0].squared() + arm[1].squared() + arm[2].squared();
        let growth =
            self.plates.map_or(S::constant(1.0), |plates| plates.parabola(x[2])) * (self.speed / self.core);
        let growth = if r2.value() < self.core * self.core {
            growth
        } else {
            let share = S::constant(self.core * self.core) / r2;
            growth * if self.point { share * share.sqrt() } else { share }
        };
        arm.map(|component| component * growth)
    }
}

impl VelocityField for Source {
    by_formula!();
    facts!(steady);

    fn flow_map(&self, x: DVec3, t0: f64, t1: f64) -> Option<DVec3> {
        let arm = self.arm(x);
        let r = arm.length();
        if r == 0.0 {
            return Some(x);
        }
        let way = self.speed * self.plates.map_or(1.0, |plates| plates.parabola(x.z)) * (t1 - t0);
        Some(x + arm * (self.radius_after(r, way) / r - 1.0))
    }

    fn invariant(&self, x: DVec3, _t: f64) -> Option<f64> {
        // The direction is invariant; its cosine with x.
        let arm = self.arm(x);
        Some(arm.x / arm.length())
    }

    fn wall(&self, x: DVec3, _t: f64) -> Option<Wall> {
        self.plates.map(|plates| plates.wall(x))
    }

    fn walls_same_along(&self) -> [bool; 3] {
        [true, true, self.plates.is_none()]
    }

    fn max_speed(&self, region: &Region, _t0: f64, _t1: f64) -> f64 {
        let height = self.plates.map_or(1.0, |plates| plates.greatest_parabola(region));
        let (low, high) = (self.arm(self.center + region.clearance(self.center)), region.reach(self.center));
        let r = self.core.clamp(low.length(), high.length().max(low.length()));
        let share = if r < self.core {
            r / self.core
        } else {
            let ratio = self.core / r;
            if self.point { ratio * ratio } else { ratio }
        };
        self.speed.abs() * height * share * ROUNDING_MARGIN
    }

    fn step_limit(&self, x: DVec3, _t: f64) -> Option<f64> {
        let way = (self.arm(x).length() - self.core).abs().max(JUMP_STEP * self.core);
        Some(way / (1.5 * self.speed.abs()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn source(shape: SourceShape, speed: f64) -> Source {
        Source::new(&SourceParams { shape, core_speed_um_s: speed, ..Default::default() }).unwrap()
    }

    #[test]
    fn the_flow_rate_is_the_same_through_every_circle_and_sphere() {
        let line = source(SourceShape::Line, 1000.0);
        let point = source(SourceShape::Point, 1000.0);
        let speed = |field: &Source, r: f64| field.velocity(DVec3::new(0.0, r, -30.0), 0.0).y;
        for r in [20.0, 50.0, 400.0] {
            assert!((speed(&line, r) * r / 20_000.0 - 1.0).abs() < 1e-14);
            assert!((speed(&point, r) * r * r / 400_000.0 - 1.0).abs() < 1e-14);
        }
        assert_eq!(speed(&point, 10.0), 500.0);
    }
}
