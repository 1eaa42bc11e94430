//! Registry entry of gridded velocities.

use super::{Gridded, Interpolation, sampled};
use crate::fields::composition::vortex;
use crate::fields::prelude::*;
use crate::params::{Parameter, range_of};

pub(crate) const ENTRY: FieldEntry = FieldEntry {
    name: "gridded",
    formula: "u = SUM c_ijk B_i(x) B_j(y) B_k(z), cubic B-splines or linear, linear in time",
    parameters: &[
        Parameter::new(
            "interpolation",
            "Interpolation::Tricubic",
            None,
            "tricubic or trilinear",
            "Interpolation between the nodes.",
        ),
        Parameter::new(
            "periodic",
            "[false, false, false]",
            None,
            "true or false",
            "Whether the data are periodic along x, y and z.",
        ),
        Parameter::new(
            "origin_um",
            "[-240.0, -120.0, -80.0]",
            range_of!(finite),
            "",
            "For a `.npy` file, in the key `geometry`: position of the first node, um.",
        ),
        Parameter::new(
            "spacing_um",
            "[10.0, 10.0, 10.0]",
            range_of!(> 0),
            "",
            "For a `.npy` file, in `geometry`: node spacing along x, y and z, um.",
        ),
        Parameter::new(
            "times_s",
            "[]",
            range_of!(finite),
            "increasing",
            "For a `.npy` file, in `geometry`: times of the stored fields, s.",
        ),
    ],
    source: "de Boor, A Practical Guide to Splines, IX and XIII",
    plane: PlotPlane::XY,
    make: || example(Interpolation::Tricubic),
    variants: &[("trilinear", || example(Interpolation::Trilinear))],
};

/// Example: a grid of samples of a vortex.
fn example(interpolation: Interpolation) -> Result<Box<dyn VelocityField>> {
    let grid = sampled(vortex(0.0)?.as_ref())?;
    Ok(Box::new(Gridded::new(&grid, interpolation, [false; 3])?))
}
