//! Registry entries of the compositions, with example instances.

use super::{
    MirroredParams, ModulatedParams, MovingParams, RotatedParams, ScaledParams, Sum, Transform,
    TranslatedParams,
};
use crate::fields::prelude::*;
use crate::fields::{
    DoubleGyreParams, HillParams, LambOseenParams, PoiseuilleParams, TaylorGreenParams, ToroidalDropParams,
};

fn sum(fields: Vec<Box<dyn VelocityField>>) -> Result<Box<dyn VelocityField>> {
    Ok(Box::new(Sum::new(fields)?))
}

/// The channel flow of the default scene, as a component of compositions.
fn channel() -> Result<Box<dyn VelocityField>> {
    PoiseuilleParams::default().build()
}

/// An off-center vortex, as a component of compositions.
pub(in crate::fields) fn vortex(viscosity_um2_s: f64) -> Result<Box<dyn VelocityField>> {
    let center_um = [20.0, -10.0];
    LambOseenParams { viscosity_um2_s, center_um, ..Default::default() }.build()
}

pub(crate) const SUM: FieldEntry = FieldEntry {
    name: "sum",
    formula: "u = SUM f_i(x, t)",
    parameters: &[],
    source: "composition",
    plane: PlotPlane::XY,
    make: || sum(vec![channel()?, vortex(0.0)?]),
    variants: &[
        ("one", || sum(vec![vortex(1e3)?])),
        ("three", || sum(vec![channel()?, vortex(1e3)?, HillParams::default().build()?])),
    ],
};

pub(crate) const SCALED: FieldEntry = FieldEntry {
    name: "scaled",
    formula: "u = a f(c + (x - c)/L, t)",
    parameters: ScaledParams::PARAMETERS,
    source: "composition",
    plane: PlotPlane::XY,
    make: || {
        ScaledParams { velocity_factor: 0.5, length_factor: 1.5, center_um: [10.0, 0.0, -30.0] }
            .apply(vortex(0.0)?)
    },
    variants: &[
        ("decaying", || ScaledParams { velocity_factor: -0.5, ..Default::default() }.apply(vortex(1e3)?)),
        ("alike", || {
            ScaledParams { velocity_factor: 0.5, length_factor: 0.5, ..Default::default() }
                .apply(vortex(1e3)?)
        }),
    ],
};

pub(crate) const TRANSLATED: FieldEntry = FieldEntry {
    name: "translated",
    formula: "u = f(x - d, t)",
    parameters: TranslatedParams::PARAMETERS,
    source: "composition",
    plane: PlotPlane::XY,
    make: || TranslatedParams { offset_um: [60.0, -40.0, 5.0] }.apply(vortex(1e3)?),
    variants: &[("moving hill", || {
        TranslatedParams { offset_um: [60.0, -40.0, 5.0] }
            .apply(HillParams { moving: true, ..Default::default() }.build()?)
    })],
};

pub(crate) const ROTATED: FieldEntry = FieldEntry {
    name: "rotated",
    formula: "u = R f(c + R^T (x - c), t)",
    parameters: RotatedParams::PARAMETERS,
    source: "composition",
    plane: PlotPlane::XY,
    make: || {
        RotatedParams { axis: [1.0, 2.0, 2.0], angle_rad: 0.7, center_um: [0.0, 0.0, -30.0] }
            .apply(vortex(1e3)?)
    },
    variants: &[("gyre", || {
        RotatedParams { angle_rad: -1.1, ..Default::default() }.apply(DoubleGyreParams::default().build()?)
    })],
};

pub(crate) const MOVING: FieldEntry = FieldEntry {
    name: "moving",
    formula: "u = V + f(x - V t, t)",
    parameters: MovingParams::PARAMETERS,
    source: "composition",
    plane: PlotPlane::XY,
    make: || MovingParams { velocity_um_s: [300.0, -100.0, 50.0] }.apply(vortex(1e3)?),
    variants: &[("cells", || {
        MovingParams { velocity_um_s: [300.0, -100.0, 50.0] }.apply(TaylorGreenParams::default().build()?)
    })],
};

pub(crate) const MODULATED: FieldEntry = FieldEntry {
    name: "modulated",
    formula: "u = (m + a cos(2 pi f t + p)) f(x, t)",
    parameters: ModulatedParams::PARAMETERS,
    source: "composition",
    plane: PlotPlane::XY,
    make: || {
        ModulatedParams { mean: 0.3, amplitude: 0.7, frequency_hz: 30.0, phase_rad: 0.5 }.apply(vortex(0.0)?)
    },
    variants: &[("decaying", || {
        ModulatedParams { mean: 0.0, amplitude: 1.0, ..Default::default() }.apply(vortex(1e3)?)
    })],
};

pub(crate) const MIRRORED: FieldEntry = FieldEntry {
    name: "mirrored",
    formula: "u = M f(M x, t)",
    parameters: MirroredParams::PARAMETERS,
    source: "composition",
    plane: PlotPlane::XY,
    make: || MirroredParams { axis: Axis::X, at_um: 25.0 }.apply(vortex(1e3)?),
    variants: &[("drop", || {
        MirroredParams { axis: Axis::Y, at_um: 10.0 }.apply(ToroidalDropParams::default().build()?)
    })],
};
