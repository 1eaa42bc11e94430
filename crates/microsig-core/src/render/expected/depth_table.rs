use serde::{Deserialize, Serialize};

use super::radial_layout::RadialLayout;
use crate::bspline;
use crate::render::depth_table::{self, InterpolatedPlane};
use crate::render::node_layout::NodeLayout;

/// A table of expected images.
pub(super) type DepthTable = depth_table::DepthTable<PlaneLayout>;

/// Layout of the coefficients of a plane.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum PlaneLayout {
    /// Spherical lens: azimuthal orders of a quadratic spline along the radius.
    Radial(RadialLayout),
    /// A cubic spline over one quadrant: always with a cylindrical lens, otherwise if few nodes suffice.
    Quadrant(NodeLayout),
}

impl depth_table::PlaneLayout for PlaneLayout {
    fn sizes(&self) -> [usize; 3] {
        match self {
            PlaneLayout::Radial(rings) => [1, rings.orders, rings.columns],
            PlaneLayout::Quadrant(layout) => layout.sizes(),
        }
    }

    fn at(&self, plane: &InterpolatedPlane, dx: f64, dy: f64) -> [f64; 4] {
        match self {
            PlaneLayout::Radial(rings) => rings.at(plane, dx, dy),
            PlaneLayout::Quadrant(layout) => {
                let [value, by_x, by_y, by_z] = layout.at(plane, [dx.abs(), dy.abs()], bspline::cubic);
                [value, by_x * dx.signum(), by_y * dy.signum(), by_z]
            }
        }
    }
}
