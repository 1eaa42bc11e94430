//! Registry entries of the compositions, with example instances.

use super::{
    Mirrored, MirroredParams, Modulated, ModulatedParams, Moving, MovingParams, Rotated, RotatedParams,
    Scaled, ScaledParams, Sum, Translated, TranslatedParams,
};
use crate::fields::prelude::*;
use crate::fields::{
    DoubleGyreParams, HillParams, LambOseenParams, PoiseuilleParams, TaylorGreenParams, ToroidalDropParams,
};

fn boxed<F: VelocityField + 'static>(field: Result<F>) -> Result<Box<dyn VelocityField>> {
    Ok(Box::new(field?))
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
    make: || boxed(Sum::new(vec![channel()?, vortex(0.0)?])),
    variants: &[
        ("one", || boxed(Sum::new(vec![vortex(1e3)?]))),
        ("three", || boxed(Sum::new(vec![channel()?, vortex(1e3)?, HillParams::default().build()?]))),
    ],
};

pub(crate) const SCALED: FieldEntry = FieldEntry {
    name: "scaled",
    formula: "u = a f(c + (x - c)/L, t)",
    parameters: ScaledParams::PARAMETERS,
    source: "composition",
    plane: PlotPlane::XY,
    make: || {
        boxed(Scaled::new(
            vortex(0.0)?,
            &ScaledParams { velocity_factor: 0.5, length_factor: 1.5, center_um: [10.0, 0.0, -30.0] },
        ))
    },
    variants: &[
        ("decaying", || {
            boxed(Scaled::new(vortex(1e3)?, &ScaledParams { velocity_factor: -0.5, ..Default::default() }))
        }),
        ("alike", || {
            boxed(Scaled::new(
                vortex(1e3)?,
                &ScaledParams { velocity_factor: 0.5, length_factor: 0.5, ..Default::default() },
            ))
        }),
    ],
};

pub(crate) const TRANSLATED: FieldEntry = FieldEntry {
    name: "translated",
    formula: "u = f(x - d, t)",
    parameters: TranslatedParams::PARAMETERS,
    source: "composition",
    plane: PlotPlane::XY,
    make: || boxed(Translated::new(vortex(1e3)?, &TranslatedParams { offset_um: [60.0, -40.0, 5.0] })),
    variants: &[("moving hill", || {
        boxed(Translated::new(
            HillParams { moving: true, ..Default::default() }.build()?,
            &TranslatedParams { offset_um: [60.0, -40.0, 5.0] },
        ))
    })],
};

pub(crate) const ROTATED: FieldEntry = FieldEntry {
    name: "rotated",
    formula: "u = R f(c + R^T (x - c), t)",
    parameters: RotatedParams::PARAMETERS,
    source: "composition",
    plane: PlotPlane::XY,
    make: || {
        boxed(Rotated::new(
            vortex(1e3)?,
            &RotatedParams { axis: [1.0, 2.0, 2.0], angle_rad: 0.7, center_um: [0.0, 0.0, -30.0] },
        ))
    },
    variants: &[("gyre", || {
        boxed(Rotated::new(
            DoubleGyreParams::default().build()?,
            &RotatedParams { angle_rad: -1.1, ..Default::default() },
        ))
    })],
};

pub(crate) const MOVING: FieldEntry = FieldEntry {
    name: "moving",
    formula: "u = V + f(x - V t, t)",
    parameters: MovingParams::PARAMETERS,
    source: "composition",
    plane: PlotPlane::XY,
    make: || boxed(Moving::new(vortex(1e3)?, &MovingParams { velocity_um_s: [300.0, -100.0, 50.0] })),
    variants: &[("cells", || {
        boxed(Moving::new(
            TaylorGreenParams::default().build()?,
            &MovingParams { velocity_um_s: [300.0, -100.0, 50.0] },
        ))
    })],
};

pub(crate) const MODULATED: FieldEntry = FieldEntry {
    name: "modulated",
    formula: "u = (m + a cos(2 pi f t + p)) f(x, t)",
    parameters: ModulatedParams::PARAMETERS,
    source: "composition",
    plane: PlotPlane::XY,
    make: || {
        boxed(Modulated::new(
            vortex(0.0)?,
            &ModulatedParams { mean: 0.3, amplitude: 0.7, frequency_hz: 30.0, phase_rad: 0.5 },
        ))
    },
    variants: &[("decaying", || {
        boxed(Modulated::new(
            vortex(1e3)?,
            &ModulatedParams { mean: 0.0, amplitude: 1.0, ..Default::default() },
        ))
    })],
};

pub(crate) const MIRRORED: FieldEntry = FieldEntry {
    name: "mirrored",
    formula: "u = M f(M x, t)",
    parameters: MirroredParams::PARAMETERS,
    source: "composition",
    plane: PlotPlane::XY,
    make: || boxed(Mirrored::new(vortex(1e3)?, &MirroredParams { axis: Axis::X, at_um: 25.0 })),
    variants: &[("drop", || {
        boxed(Mirrored::new(
            ToroidalDropParams::default().build()?,
            &MirroredParams { axis: Axis::Y, at_um: 10.0 },
        ))
    })],
};
