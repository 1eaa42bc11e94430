//! The planes of the tables of images by wave optics: coefficients of a quintic spline through the light on
//! pixels.

use serde::{Deserialize, Serialize};

use crate::bspline;
use crate::render::depth_table::{DepthTable, InterpolatedPlane, PlaneLayout};
use crate::render::node_layout::NodeLayout;

/// A table of images by wave optics.
pub(super) type Table = DepthTable<Layout>;

/// Nodes of a plane.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Layout {
    pub(super) nodes: NodeLayout,
    /// Half width and half height of the computed area, px.
    pub(super) edge_px: [usize; 2],
    /// Whether images are displaced against coma ([`super::tilt`]).
    pub(super) tilted: bool,
}

impl PlaneLayout for Layout {
    fn sizes(&self) -> [usize; 3] {
        self.nodes.sizes()
    }

    fn at(&self, plane: &InterpolatedPlane, dx: f64, dy: f64) -> [f64; 4] {
        self.nodes.at(plane, [dx, dy], bspline::quintic)
    }
}
