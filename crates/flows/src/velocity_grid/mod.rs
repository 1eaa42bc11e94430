//! Velocities on a regular grid, and the readers of files that hold them: NumPy arrays, CSV, VTK
//! (images and rectilinear grids, legacy or XML).
//!
//! Readers take any `Read`, not a path. An array is rejected before allocation if its header declares more
//! than [`MAX_NODES`] nodes.

mod csv;
mod npy;
mod vtk;
mod vtk_xml;

use crate::error::{Error, ParameterCheck, Result};
use glam::DVec3;
use microsig_core::problem::Problem;

const CHECK: ParameterCheck = ParameterCheck("grid");

/// Maximum number of nodes, summed over all times.
pub const MAX_NODES: usize = 50_000_000;

/// Velocities at the nodes of a regular grid, at one or more times.
#[derive(Debug, Clone, PartialEq)]
pub struct VelocityGrid {
    origin: DVec3,
    spacing: DVec3,
    counts: [usize; 3],
    times_s: Vec<f64>,
    velocities: Vec<DVec3>,
}

/// Positions and times of the nodes of a `.npy` file, which stores only values.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(default)]
pub struct GridGeometry {
    /// Position of the first node (x, y, z).
    pub origin_um: [f64; 3],
    /// Node spacing along x, y and z, um.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub spacing_um: [f64; 3],
    /// Increasing times of the stored fields, s; empty for a single field.
    pub times_s: Vec<f64>,
}

impl Default for GridGeometry {
    /// The default channel from its corner, with a spacing of 10 um.
    fn default() -> Self {
        GridGeometry { origin_um: [-240.0, -120.0, -80.0], spacing_um: [10.0; 3], times_s: Vec::new() }
    }
}

impl VelocityGrid {
    /// A grid of `counts` nodes along x, y and z, starting at `origin` (um) with `spacing` (um, > 0), at
    /// increasing times (s), with the velocities (um/s, finite) of all nodes: x varies fastest, then y, z and
    /// time. `Err` if the numbers do not match or a value is out of range.
    pub fn new(
        origin: DVec3,
        spacing: DVec3,
        counts: [usize; 3],
        times_s: Vec<f64>,
        velocities: Vec<DVec3>,
    ) -> Result<Self> {
        CHECK.finite_vector("origin_um", origin)?;
        for axis in 0..3 {
            CHECK.positive("spacing_um", spacing[axis])?;
        }
        for (i, t) in times_s.iter().enumerate() {
            CHECK.finite("times_s", *t)?;
            if i > 0 && *t <= times_s[i - 1] {
                return Err(CHECK.fault("times_s", t, &format!("a time after {}", times_s[i - 1])));
            }
        }
        let nodes = nodes(&counts, times_s.len())?;
        if velocities.len() != nodes {
            let allowed = format!("{nodes}: {counts:?} nodes at {} times", times_s.len());
            return Err(CHECK.fault("number of velocities", velocities.len(), &allowed));
        }
        if let Some(at) = velocities.iter().position(|u| !u.is_finite()) {
            let (i, rest) = (at % counts[0], at / counts[0]);
            let (j, k) = (rest % counts[1], rest / counts[1] % counts[2]);
            let value = format!("{} at node ({i}, {j}, {k})", velocities[at]);
            return Err(CHECK.fault("velocity", value, "three finite numbers"));
        }
        Ok(VelocityGrid { origin, spacing, counts, times_s, velocities })
    }

    /// A grid whose spacing may be negative: the nodes are then sorted.
    fn oriented(
        origin: DVec3,
        spacing: DVec3,
        counts: [usize; 3],
        mut velocities: Vec<DVec3>,
    ) -> Result<Self> {
        let ([nx, ny, nz], mut first) = (counts, origin);
        if velocities.len() == nodes(&counts, 1)? && spacing.min_element() < 0.0 {
            let at = |n: usize, k: usize, axis: usize| if spacing[axis] < 0.0 { n - 1 - k } else { k };
            let node =
                |n: usize| at(nx, n % nx, 0) + nx * (at(ny, n / nx % ny, 1) + ny * at(nz, n / nx / ny, 2));
            velocities = (0..velocities.len()).map(|n| velocities[node(n)]).collect();
            for axis in 0..3 {
                first[axis] += spacing[axis].min(0.0) * (counts[axis] - 1) as f64;
            }
        }
        VelocityGrid::new(first, spacing.abs(), counts, vec![0.0], velocities)
    }

    /// Position of the first node, um.
    pub fn origin_um(&self) -> DVec3 {
        self.origin
    }

    /// Node spacing along x, y and z, um.
    pub fn spacing_um(&self) -> DVec3 {
        self.spacing
    }

    /// Number of nodes along x, y and z.
    pub fn counts(&self) -> [usize; 3] {
        self.counts
    }

    /// The times of the stored fields, s.
    pub fn times_s(&self) -> &[f64] {
        &self.times_s
    }

    /// The velocities, um/s: x varies fastest, then y, z and time.
    pub fn velocities(&self) -> &[DVec3] {
        &self.velocities
    }
}

fn fault(format: &'static str, line: Option<usize>, found: String, expected: &str) -> Error {
    Error::Data { format, line, problem: Problem::value("", found, expected).into() }
}

/// First value and step of equidistant coordinates; the step of a single one is 1.
fn even_axis(axis: usize, at: &[f64]) -> Result<(f64, f64)> {
    let [first, .., last] = at else { return Ok((at.first().copied().unwrap_or(0.0), 1.0)) };
    let step = (last - first) / (at.len() - 1) as f64;
    let place = |k: usize| first + step * k as f64;
    // Tolerance for coordinates in single precision.
    match at.iter().enumerate().find(|(k, x)| (place(*k) - **x).abs() > 1e-4 * step.abs()) {
        None => Ok((*first, step)),
        Some((k, x)) => {
            let name = ["x", "y", "z"][axis];
            let found = format!("{name} = {x} um at node {k} where equal steps give {}", place(k));
            Err(fault("vtk", None, found, "equal steps; resample the grid (docs/flow.md)"))
        }
    }
}

/// Index of the array of velocities among the vectors: the one named `array`, or the only one.
fn select(names: &[&str], array: Option<&str>, has_cells: bool) -> Result<usize> {
    let all = names.join(", ");
    match (array, names) {
        (Some(array), names) => names
            .iter()
            .position(|name| *name == array)
            .ok_or_else(|| fault("vtk", None, format!("vectors {all}"), &format!("the array {array:?}"))),
        (None, [_]) => Ok(0),
        (None, []) if has_cells => {
            let expected = "those of points (cell_data_to_point_data() of PyVista converts them)";
            Err(fault("vtk", None, "velocities of cells".to_owned(), expected))
        }
        (None, []) => {
            Err(fault("vtk", None, "no vectors of points".to_owned(), "an array with three components"))
        }
        (None, _) => {
            let found = format!("several arrays of vectors ({all})");
            Err(fault("vtk", None, found, "the key `array` with the name of the velocity"))
        }
    }
}

/// The total number of nodes over all times; `Err` if it is 0 or above [`MAX_NODES`].
fn nodes(counts: &[usize; 3], layers: usize) -> Result<usize> {
    let product = counts.iter().chain([&layers]).try_fold(1_usize, |product, n| product.checked_mul(*n));
    match product {
        Some(number @ 1..=MAX_NODES) => Ok(number),
        _ => Err(CHECK.fault("nodes", format!("{counts:?} at {layers} times"), "1 to 50000000 in total")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 3 x 2 x 2 nodes, for the tests of the readers.
    pub(super) fn small() -> VelocityGrid {
        let velocities = (0..12).map(|n| DVec3::new(f64::from(n), -0.5, 2.0 * f64::from(n))).collect();
        VelocityGrid::new(
            DVec3::new(1.0, 2.0, 3.0),
            DVec3::new(0.5, 1.0, 2.0),
            [3, 2, 2],
            vec![0.0],
            velocities,
        )
        .unwrap()
    }
}
