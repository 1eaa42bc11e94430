//! Every composition of every field against its own formula, and its trajectories against the integrator.
#![expect(clippy::print_stdout, reason = "the worst values, for `--nocapture`")]

use flows::fields::{
    MirroredParams, ModulatedParams, MovingParams, RotatedParams, ScaledParams, Sum, Transform,
    TranslatedParams,
};
use flows::integrate::{Tolerance, advance, integrate};
use flows::registry::{ENTRIES, FieldConstructor};
use flows::{Axis, VelocityField};
use glam::DVec3;
use rayon::prelude::*;

const DT_S: f64 = 0.005;

type Inner = Box<dyn VelocityField>;
/// The velocity that the formula gives for an inner field.
type Formula = fn(&dyn VelocityField, DVec3, f64) -> DVec3;

const CENTER: DVec3 = DVec3::new(10.0, -5.0, -30.0);
const AXIS: DVec3 = DVec3::new(1.0, -2.0, 3.0);
const DRIFT: DVec3 = DVec3::new(300.0, -100.0, 50.0);

/// Rodrigues' formula; the code under test uses a quaternion.
fn turn(v: DVec3, angle: f64) -> DVec3 {
    let (sin, cos) = libm::sincos(angle);
    let axis = AXIS.normalize();
    v * cos + axis.cross(v) * sin + axis * (axis.dot(v) * (1.0 - cos))
}

fn factor(t: f64) -> f64 {
    0.3 + 0.7 * libm::cos(2.0 * std::f64::consts::PI * 30.0 * t + 0.5)
}

/// Name, the composition, its formula.
type Case = (&'static str, fn(Inner) -> Inner, Formula);

fn compositions() -> [Case; 7] {
    [
        (
            "sum",
            |f| Box::new(Sum::new(vec![f, (ENTRIES[0].make)().unwrap()]).unwrap()),
            |f, x, t| f.velocity(x, t) + DVec3::X * 1290.0,
        ),
        (
            "scaled",
            |f| {
                let center_um = CENTER.to_array();
                ScaledParams { velocity_factor: -0.5, length_factor: 1.5, center_um }.apply(f).unwrap()
            },
            |f, x, t| f.velocity(CENTER + (x - CENTER) / 1.5, t) * -0.5,
        ),
        (
            "translated",
            |f| TranslatedParams { offset_um: CENTER.to_array() }.apply(f).unwrap(),
            |f, x, t| f.velocity(x - CENTER, t),
        ),
        (
            "rotated",
            |f| {
                let (axis, center_um) = (AXIS.to_array(), CENTER.to_array());
                RotatedParams { axis, angle_rad: 0.8, center_um }.apply(f).unwrap()
            },
            |f, x, t| turn(f.velocity(CENTER + turn(x - CENTER, -0.8), t), 0.8),
        ),
        (
            "moving",
            |f| MovingParams { velocity_um_s: DRIFT.to_array() }.apply(f).unwrap(),
            |f, x, t| DRIFT + f.velocity(x - DRIFT * t, t),
        ),
        (
            "modulated",
            |f| {
                let params =
                    ModulatedParams { mean: 0.3, amplitude: 0.7, frequency_hz: 30.0, phase_rad: 0.5 };
                params.apply(f).unwrap()
            },
            |f, x, t| f.velocity(x, t) * factor(t),
        ),
        (
            "mirrored",
            |f| MirroredParams { axis: Axis::Y, at_um: 10.0 }.apply(f).unwrap(),
            |f, x, t| {
                let u = f.velocity(DVec3::new(x.x, 20.0 - x.y, x.z), t);
                DVec3::new(u.x, -u.y, u.z)
            },
        ),
    ]
}

/// Positions in the middle of the view, away from the surfaces of drops, and times.
fn samples() -> impl Iterator<Item = (DVec3, f64)> {
    (0..24).map(f64::from).map(|i| {
        let unit = DVec3::new(i * 0.819_172 % 1.0, i * 0.671_044 % 1.0, i * 0.549_700 % 1.0) - 0.5;
        (unit * DVec3::new(200.0, 150.0, 60.0) + DVec3::Z * -40.0, i * DT_S)
    })
}

#[test]
fn compositions_of_all_fields_are_what_their_formulas_say() {
    let mut inner: Vec<(&str, FieldConstructor)> = Vec::new();
    for entry in ENTRIES {
        inner.push((entry.name, entry.make));
        inner.extend(entry.variants.iter().map(|(_, make)| (entry.name, *make)));
    }
    let compositions = compositions();
    let worst: Vec<(f64, f64)> = inner
        .par_iter()
        .map(|(name, make)| {
            let field = make().unwrap();
            let speed = samples().map(|(x, t)| field.velocity(x, t).length()).fold(1.0, f64::max);
            let (mut off, mut astray) = (0.0_f64, 0.0_f64);
            for (composition, make_composed, formula) in &compositions {
                let composed = make_composed(make().unwrap());
                for (x, t) in samples() {
                    let error = (composed.velocity(x, t) - formula(field.as_ref(), x, t)).length() / speed;
                    // Rounding errors of coordinates of 300 um over the length scales of the fields, a few
                    // um.
                    assert!(error < 1e-11, "{composition} of {name} at {x}: {error:e}");
                    off = off.max(error);
                    // The drying drop is singular at its contact line, which compositions move into the view.
                    if *name == "coffee_ring" || composed.flow_map(x, t, t + DT_S).is_none() {
                        continue;
                    }
                    let closed = advance(composed.as_ref(), x, t, t + DT_S).unwrap();
                    let tight = Tolerance { relative: 1e-12, absolute_um: 1e-12 };
                    let exact = integrate(composed.as_ref(), x, t, t + DT_S, tight).unwrap();
                    let error = (closed - exact).length();
                    assert!(error < 1e-8, "{composition} of {name} at {x}: {error:e} um");
                    astray = astray.max(error);
                }
            }
            (off, astray)
        })
        .collect();
    let greatest = |f: fn(&(f64, f64)) -> f64| worst.iter().map(f).fold(0.0, f64::max);
    println!(
        "{} compositions of {} fields: velocities within {:.1e} of the greatest, closed trajectories within {:.1e} um",
        compositions.len(),
        inner.len(),
        greatest(|w| w.0),
        greatest(|w| w.1)
    );
}
