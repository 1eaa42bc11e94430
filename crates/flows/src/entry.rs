//! The interface between a field and the registry: its entry, and the parameters from which it is built.

use crate::params::Parameter;
use crate::{Axis, Result, VelocityField};

/// An entry of the registry.
#[derive(Debug, Clone, Copy)]
pub struct FieldEntry {
    /// Its name in scenarios.
    pub name: &'static str,
    /// The velocity in one line.
    pub formula: &'static str,
    /// Its parameters. A composition also takes one or more inner fields, which are not listed here.
    pub parameters: &'static [Parameter],
    /// Reference for the formula.
    pub source: &'static str,
    /// The plane of its plot in the gallery.
    pub plane: PlotPlane,
    /// Builds the field with default parameters, or an example of a composition.
    pub make: FieldConstructor,
    /// Named instances with parameters that select other branches of the formula, for tests and as examples.
    pub variants: &'static [(&'static str, FieldConstructor)],
}

/// A function that builds a field; `Err` if its parameters are out of range.
pub type FieldConstructor = fn() -> Result<Box<dyn VelocityField>>;

/// A plane of the default scene in which a field is plotted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlotPlane {
    /// The axis normal to it.
    pub across: Axis,
    /// Its coordinate on that axis, um.
    pub at_um: f64,
}

impl PlotPlane {
    /// The image plane in the middle of the channel.
    pub const XY: PlotPlane = PlotPlane { across: Axis::Z, at_um: -30.0 };
    /// The plane along the channel and through its depth.
    pub const XZ: PlotPlane = PlotPlane { across: Axis::Y, at_um: 0.0 };
    /// The cross-section of the channel.
    pub const YZ: PlotPlane = PlotPlane { across: Axis::X, at_um: 0.0 };
}

/// The depth range of a scenario, from which omitted parameters are derived: walls are at its ends, centers
/// in its middle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthRange {
    /// Its lower end in z (toward the lens), um.
    pub floor_um: f64,
    /// Its upper end in z (away from the lens), um.
    pub ceiling_um: f64,
}

impl DepthRange {
    pub(crate) fn walls(self) -> [f64; 2] {
        [self.floor_um, self.ceiling_um]
    }

    pub(crate) fn floor(self) -> [f64; 3] {
        [0.0, 0.0, self.floor_um]
    }

    pub(crate) fn middle(self) -> [f64; 3] {
        [0.0, 0.0, 0.5 * (self.floor_um + self.ceiling_um)]
    }
}

/// The parameters of a field that has a formula of its own, with its entry in the registry. Implemented in
/// the file of each field; [`for_each_field!`](crate::for_each_field) lists the implementations.
pub trait FieldParameters: Default {
    /// Its entry in the registry.
    const ENTRY: FieldEntry;

    /// Derives the parameters that are not given from the depth range.
    fn fill_defaults(&mut self, _depths: DepthRange) {}

    /// The seed of the field's own random numbers; `None` if it draws none.
    fn seed(&mut self) -> Option<&mut u64> {
        None
    }

    /// Builds the field.
    fn build(&self) -> Result<Box<dyn VelocityField>>;
}
