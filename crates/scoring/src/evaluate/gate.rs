//! Gates: which result points may be matched to which particles.
//!
//! A pair is admissible iff D < 1, strictly, where D is the distance in units of the gate:
//! - radial: sqrt(dx^2 + dy^2) / eps_xy,
//! - ellipsoid: sqrt((dx^2 + dy^2) / eps_xy^2 + dz^2 / eps_z^2),
//! - box: max(|dx| / eps_xy, |dy| / eps_xy, |dz| / eps_z).
//!
//! Other programs include the boundary (TrackEval, DefocusTracker): see [`Edge`].

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::track_set::Position;

/// Shape of a gate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Shape {
    /// Distance in the image plane; depth is ignored.
    Radial,
    /// Distance in all three dimensions, each in units of its gate.
    Ellipsoid,
    /// The largest of the three components.
    Box,
}

/// Whether a pair exactly at the gate is admissible.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Edge {
    /// Not admissible: the rule of microsig and of the ISBI and LPT challenges.
    Open,
    /// Admissible, as in DefocusTracker and TrackEval.
    Closed,
}

/// A matching gate: its shape, size and boundary rule.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Gate {
    /// Shape of the gate.
    pub shape: Shape,
    /// Radius or half width in the image plane.
    #[schemars(range(min = 0.0))]
    pub xy_px: f64,
    /// Half height along z; null (infinite) if depth is ignored.
    #[serde(serialize_with = "finite", deserialize_with = "super::statistics::or_infinite")]
    #[schemars(with = "Option<f64>")]
    pub z_um: f64,
    /// Whether a pair exactly at the gate is admissible.
    pub edge: Edge,
}

fn finite<S: serde::Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    value.is_finite().then_some(*value).serialize(serializer)
}

impl std::fmt::Display for Gate {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.shape {
            Shape::Radial => write!(f, "radial {} px", self.xy_px),
            Shape::Ellipsoid => write!(f, "ellipsoid {} px, {} um", self.xy_px, self.z_um),
            Shape::Box => write!(f, "box {} px, {} um", self.xy_px, self.z_um),
        }
    }
}

impl Gate {
    /// A circle in the image plane of this radius, px, with an open boundary.
    pub fn radial(xy_px: f64) -> Self {
        Gate { shape: Shape::Radial, xy_px, z_um: f64::INFINITY, edge: Edge::Open }
    }

    /// An ellipsoid of these semi-axes, px and um, with an open boundary.
    pub fn ellipsoid(xy_px: f64, z_um: f64) -> Self {
        Gate { shape: Shape::Ellipsoid, xy_px, z_um, edge: Edge::Open }
    }

    /// The same gate with an open or closed boundary.
    pub fn with_edge(self, edge: Edge) -> Self {
        Gate { edge, ..self }
    }

    /// Squared distance D^2 of a pair in units of the gate.
    pub fn squared(&self, a: &Position, b: &Position) -> f64 {
        let (dx, dy, dz) = (b.x_px - a.x_px, b.y_px - a.y_px, b.z_um - a.z_um);
        let (xy2, z2) = (self.xy_px * self.xy_px, self.z_um * self.z_um);
        match self.shape {
            Shape::Radial => (dx * dx + dy * dy) / xy2,
            // If both semi-axes are equal, a single division: a pair exactly on the boundary then gives
            // exactly 1.
            Shape::Ellipsoid if self.xy_px == self.z_um => (dx * dx + dy * dy + dz * dz) / xy2,
            Shape::Ellipsoid => (dx * dx + dy * dy) / xy2 + dz * dz / z2,
            Shape::Box => (dx * dx / xy2).max(dy * dy / xy2).max(dz * dz / z2),
        }
    }

    /// Whether a pair with this D^2 is admissible.
    pub fn admits(&self, squared: f64) -> bool {
        match self.edge {
            Edge::Open => squared < 1.0,
            // TrackEval and DefocusTracker tolerate rounding errors at the boundary.
            Edge::Closed => squared <= 1.0 + 1e-12,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_boundary_is_out_unless_closed() {
        let (a, b) =
            (Position { x_px: 1.0, y_px: 2.0, z_um: 5.0 }, Position { x_px: 4.0, y_px: 6.0, z_um: 5.0 });
        for gate in [Gate::radial(5.0), Gate::ellipsoid(5.0, 5.0), Gate::ellipsoid(5.0, 1.0)] {
            assert!(!gate.admits(gate.squared(&a, &b)));
            assert!(gate.with_edge(Edge::Closed).admits(gate.squared(&a, &b)));
        }
        let high = Position { z_um: 8.0, ..b };
        assert!(Gate::radial(6.0).admits(Gate::radial(6.0).squared(&a, &high)));
        assert!(!Gate::ellipsoid(6.0, 3.0).admits(Gate::ellipsoid(6.0, 3.0).squared(&a, &high)));
        let cuboid = Gate { shape: Shape::Box, ..Gate::ellipsoid(4.5, 3.5) };
        assert!(cuboid.admits(cuboid.squared(&a, &high)));
    }
}
