//! The grid of `truth/field.csv`: the nodes of the displacement field and the definitions of its columns.

use microsig_core::problem::Problems;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The true displacement field.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TruthGrid {
    /// On a grid centered in the image; an unsteady flow is written for every pair, by default on a coarser
    /// grid.
    Grid(FieldGrid),
    /// No displacement field.
    None,
}

/// Nodes and definitions. The defaults depend on the flow: an unsteady field is written for every pair, so
/// its default grid is coarser.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct FieldGrid {
    /// Distance between nodes along x and y.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.1, max = 1e5), extend("x-default" = "16; 32 if the flow is unsteady"))]
    pub spacing_px: Option<f64>,
    /// Depths of the nodes.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-default" = "even(5); even(1) if the flow is unsteady"))]
    pub planes: Option<Planes>,
    /// Weight of each depth in the depth-weighted displacement.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-default" = "peak_squared; none if the flow is unsteady"))]
    pub weighting: Option<Weighting>,
    /// Side of a square window; an additional column contains the central displacement averaged over this
    /// window.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1e-3, max = 1e5), example = 32.0)]
    pub window_px: Option<f64>,
    /// Whether to write also the backward displacement, which ends at the node.
    pub backward: bool,
}

/// Depths of the grid.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Planes {
    /// The centers of N equal slices of the depth range, and the center of the range itself.
    Even(#[schemars(range(min = 1, max = MAX_PLANES), example = 5)] u32),
    /// These physical depths.
    AtUm(
        #[schemars(
            length(min = 1, max = MAX_PLANES),
            inner(range(min = -1e6, max = 1e6)),
            extend("x-unit" = "um"),
            example = vec![-30.0, 0.0]
        )]
        Vec<f64>,
    ),
}

/// Weight of a depth in the correlation of images that contain particles at all depths.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Weighting {
    /// Square of the peak of a particle image at that depth.
    PeakSquared,
    /// Curvature of a particle image's autocorrelation at its peak.
    Curvature,
    /// No depth-weighted displacement.
    None,
}

/// Maximum numbers of nodes in a plane and of planes.
const MAX_NODES: f64 = 1e7;
const MAX_PLANES: u32 = 1000;

impl FieldGrid {
    /// Fills in defaults, then checks the grid.
    fn fill(&mut self, steady: bool, size_px: (u32, u32), problems: &mut Problems) {
        let spacing = *self.spacing_px.get_or_insert(if steady { 16.0 } else { 32.0 });
        let nodes = f64::from(size_px.0) * f64::from(size_px.1) / (spacing * spacing);
        if nodes > MAX_NODES {
            problems.value("truth_grid.grid.spacing_px", spacing, "at most 10 million nodes");
        }
        self.planes.get_or_insert(Planes::Even(if steady { 5 } else { 1 }));
        self.weighting.get_or_insert(if steady { Weighting::PeakSquared } else { Weighting::None });
    }
}

impl TruthGrid {
    /// The default; `steady` is `None` for recorded tracks, which have no field.
    pub(super) fn of(steady: Option<bool>) -> Self {
        if steady.is_some() { TruthGrid::Grid(FieldGrid::default()) } else { TruthGrid::None }
    }

    /// Fills in defaults, then checks the grid.
    pub(super) fn fill(&mut self, steady: Option<bool>, size_px: (u32, u32), problems: &mut Problems) {
        let TruthGrid::Grid(grid) = self else { return };
        match steady {
            Some(steady) => grid.fill(steady, size_px, problems),
            None => {
                problems.value("truth_grid", "grid", "none, as recorded tracks have no displacement field")
            }
        }
    }

    /// The nodes over an image of `size_px` and a range of physical depths (um); `None` without a grid.
    pub fn nodes(&self, size_px: (u32, u32), depth_um: (f64, f64)) -> Option<Nodes> {
        let TruthGrid::Grid(grid) = self else { return None };
        let spacing = grid.spacing_px?;
        // As many as fit, symmetric about the middle of the image.
        let axis = |size: u32| {
            let n = (f64::from(size) / spacing).floor().max(1.0);
            let first = 0.5 * (f64::from(size) + 1.0) - 0.5 * (n - 1.0) * spacing;
            (0..n as u32).map(|k| first + f64::from(k) * spacing).collect()
        };
        let mut planes_um: Vec<f64> = match grid.planes.as_ref()? {
            Planes::AtUm(depths) => depths.clone(),
            Planes::Even(n) => {
                let slice = (depth_um.1 - depth_um.0) / f64::from(*n);
                let middle = f64::midpoint(depth_um.0, depth_um.1);
                let middles = (0..*n).map(|k| depth_um.0 + (f64::from(k) + 0.5) * slice);
                // If `n` is odd, its middle plane equals the middle of the range up to rounding.
                let others = middles.enumerate().filter(|(k, _)| n % 2 == 0 || *k as u32 != n / 2);
                others.map(|(_, z)| z).chain([middle]).collect()
            }
        };
        planes_um.sort_unstable_by(f64::total_cmp);
        planes_um.dedup();
        Some(Nodes {
            x_px: axis(size_px.0),
            y_px: axis(size_px.1),
            planes_um,
            weighting: grid.weighting.unwrap_or(Weighting::None),
            window_px: grid.window_px,
            backward: grid.backward,
        })
    }
}

/// The nodes of a grid and the quantities written at them.
#[derive(Debug, Clone, PartialEq)]
pub struct Nodes {
    /// x coordinates of the nodes, px.
    pub x_px: Vec<f64>,
    /// y coordinates of the nodes, px.
    pub y_px: Vec<f64>,
    /// Physical depths of the nodes, um, ascending.
    pub planes_um: Vec<f64>,
    /// Weight of each depth in the depth-weighted displacement.
    pub weighting: Weighting,
    /// Side of the averaging window, px.
    pub window_px: Option<f64>,
    /// Whether backward displacements are written.
    pub backward: bool,
}

/// Optional columns and files of the truth.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct TruthColumns {
    /// Whether to write the velocity gradient at each particle: nine columns of `truth/tracks.csv`, which
    /// nearly double its size.
    pub gradient: bool,
    /// Whether to write boxes and masks of particle images for detectors, `truth/boxes.csv`.
    pub boxes: bool,
    /// Threshold of boxes and masks: fraction of the noise-free peak of a particle image above which pixels
    /// belong to it.
    #[schemars(range(min = 0.001, max = 0.9))]
    pub box_share: f64,
}

impl Default for TruthColumns {
    fn default() -> Self {
        TruthColumns { gradient: false, boxes: false, box_share: 0.1 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn nodes(spacing_px: f64, planes: Planes) -> Nodes {
        let grid = FieldGrid { spacing_px: Some(spacing_px), planes: Some(planes), ..FieldGrid::default() };
        TruthGrid::Grid(grid).nodes((752, 366), (-80.0, 20.0)).unwrap()
    }

    #[test]
    fn the_grid_lies_in_the_middle_of_the_image() {
        let grid = nodes(16.0, Planes::Even(5));
        assert_eq!((grid.x_px.len(), grid.y_px.len()), (47, 22));
        assert_eq!((grid.x_px[0], grid.x_px[46]), (8.5, 744.5));
        assert_eq!(grid.y_px[0] + grid.y_px[21], 367.0);
        assert_eq!(nodes(1000.0, Planes::Even(1)).x_px, [376.5]);
    }

    #[test]
    fn planes_are_the_middles_of_slices_and_the_middle_of_all() {
        assert_eq!(nodes(16.0, Planes::Even(5)).planes_um, [-70.0, -50.0, -30.0, -10.0, 10.0]);
        assert_eq!(nodes(16.0, Planes::Even(2)).planes_um, [-55.0, -30.0, -5.0]);
        assert_eq!(nodes(16.0, Planes::Even(1)).planes_um, [-30.0]);
        assert_eq!(nodes(16.0, Planes::AtUm(vec![3.0, -12.0])).planes_um, [-12.0, 3.0]);
    }
}
