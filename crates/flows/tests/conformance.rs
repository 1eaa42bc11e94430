//! Every field against what it claims, in one table: fields x checks.
#![expect(clippy::print_stdout, reason = "the table of fields x checks, for `--nocapture`")]

use flows::fields::{LambOseen, Linear, Poiseuille};
use flows::integrate::{Tolerance, advance, integrate};
use flows::{Axis, Region, VelocityField, field};
use glam::{DMat3, DVec2, DVec3};

/// Time between frames, s.
const DT_S: f64 = 0.005;

/// Every field, in the placement of the default channel; about 10 px (6.45 um) or less a frame.
fn fields() -> Vec<(&'static str, Box<dyn VelocityField>)> {
    let center = DVec3::new(20.0, -10.0, -30.0);
    let oblique =
        DMat3::from_cols(DVec3::new(3.0, 1.0, -2.0), DVec3::new(-4.0, -5.0, 0.5), DVec3::new(0.3, 2.0, 2.0));
    let vortex = |nu: f64| LambOseen::from_max_speed(DVec2::new(20.0, -10.0), 1290.0, 40.0, nu);
    vec![
        ("uniform", Box::new(Linear::uniform(DVec3::new(1290.0, -200.0, 30.0)).unwrap())),
        ("shear", Box::new(Linear::shear(12.9, Axis::X, Axis::Z, DVec3::new(0.0, 0.0, -80.0)).unwrap())),
        ("rotation", Box::new(Linear::rotation(DVec3::new(1.0, 2.0, 8.0), center).unwrap())),
        ("planar strain", Box::new(Linear::planar_strain(10.0, center).unwrap())),
        ("uniaxial strain", Box::new(Linear::uniaxial_strain(10.0, Axis::Z, center).unwrap())),
        ("dilatation", Box::new(Linear::dilatation(5.0, center).unwrap())),
        ("oblique linear", Box::new(Linear::new(DVec3::new(300.0, 0.0, 50.0), oblique, center).unwrap())),
        ("poiseuille", Box::new(Poiseuille::new(1290.0, -80.0, 20.0, 0.3).unwrap())),
        ("lamb-oseen steady", Box::new(vortex(0.0).unwrap())),
        ("lamb-oseen slow", Box::new(vortex(1e3).unwrap())),
        ("lamb-oseen in water", Box::new(vortex(1e6).unwrap())),
    ]
}

/// The view of the default sensor and channel, walls left out by more than the reach of the differences.
fn view() -> Region {
    Region::new(DVec3::new(-240.0, -118.0, -79.0), DVec3::new(240.0, 118.0, 19.0)).unwrap()
}

/// Points that fill the view evenly, and times.
fn samples() -> impl Iterator<Item = (DVec3, f64)> {
    // Multiples of irrational numbers that are not related.
    (0..200).map(f64::from).map(|i| {
        let unit = DVec3::new(i * 0.819_172 % 1.0, i * 0.671_044 % 1.0, i * 0.549_700 % 1.0);
        (view().at(unit), i * DT_S)
    })
}

/// The greatest of the values, and 0 of none; a NaN counts as infinite.
fn worst(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, |worst, value| if value.is_nan() { f64::INFINITY } else { worst.max(value) })
}

/// Largest element of a matrix by magnitude.
fn size(matrix: &DMat3) -> f64 {
    (0..3).map(|i| matrix.col(i).abs().max_element()).fold(0.0, f64::max)
}

/// Checks that every field at every sample gives a value of at most `limit`, and prints the table.
fn check(what: &str, limit: f64, value: impl Fn(&dyn VelocityField, DVec3, f64) -> f64) {
    let mut failed = Vec::new();
    for (name, field) in fields() {
        let value = worst(samples().map(|(x, t)| value(field.as_ref(), x, t)));
        println!("{name:>22}  {what}  {value:.1e} (limit {limit:.0e})");
        if value > limit {
            failed.push(format!("{name}: {what} {value:e} > {limit:e}"));
        }
    }
    assert!(failed.is_empty(), "{failed:#?}");
}

#[test]
fn gradients_agree_with_differences() {
    // Differences round to 1e-16 |u| / h = 3e-12 1/s for 1290 um/s; gradients are about 10 1/s and the smallest
    // length, the core of 40 um, truncates at 1e-13 of them. The margin is for samples where the gradient is small.
    check("gradient against differences, 1/s", 1e-9, |field, x, t| {
        size(&(field.gradient(x, t) - field::differences(field, x, t)))
    });
}

#[test]
fn divergence_is_zero_where_claimed() {
    // Terms of about 10 1/s cancel to rounding in the formula, to 1e-11 in the differences.
    check("divergence, 1/s", 1e-9, |field, x, t| {
        let trace = |gradient: DMat3| (0..3).map(|i| gradient.col(i)[i]).sum::<f64>();
        let (formula, numeric) = (trace(field.gradient(x, t)), trace(field::differences(field, x, t)));
        if field.is_divergence_free() {
            formula.abs().max(numeric.abs())
        } else {
            // A field that claims too little would hide from the tests of uniform clouds.
            if numeric.abs() > 1.0 { 0.0 } else { f64::INFINITY }
        }
    });
}

#[test]
fn closed_forms_agree_with_the_integrator() {
    // Some steps, each of an error of at most 1e-10 um + 1e-10 of 7 um.
    check("closed form against DOPRI5, um", 1e-8, |field, x, t| {
        let Some(closed) = field.flow_map(x, t, t + DT_S) else { return 0.0 };
        let integrated = integrate(field, x, t, t + DT_S, Tolerance::default()).unwrap();
        (closed - integrated).length()
    });
}

#[test]
fn closed_forms_agree_with_the_integrator_over_long_times() {
    // A hundred frames: 700 um of path, 1e-7 um a step at most, errors partly cancelling.
    check("the same over 100 frames, um", 1e-6, |field, x, t| {
        let Some(closed) = field.flow_map(x, t, t + 100.0 * DT_S) else { return 0.0 };
        let tolerance = Tolerance { relative: 1e-12, absolute_um: 1e-12 };
        // Strained coordinates grow by e^5: errors are compared with the distance.
        let distance = (closed - x).length().max(100.0);
        (closed - integrate(field, x, t, t + 100.0 * DT_S, tolerance).unwrap()).length() / distance * 100.0
    });
}

#[test]
fn every_trajectory_returns() {
    check("forward and back, um", 1e-7, |field, x, t| {
        let there = advance(field, x, t, t + DT_S).unwrap();
        (advance(field, there, t + DT_S, t).unwrap() - x).length()
    });
    check("forward and back by DOPRI5, um", 1e-7, |field, x, t| {
        let there = integrate(field, x, t, t + DT_S, Tolerance::default()).unwrap();
        (integrate(field, there, t + DT_S, t, Tolerance::default()).unwrap() - x).length()
    });
}

#[test]
fn two_half_steps_are_a_whole_one() {
    // The flow map is a group; 1e-11 um is rounding of 300 um with some factors.
    check("two half steps, um", 1e-11, |field, x, t| {
        let Some(whole) = field.flow_map(x, t, t + DT_S) else { return 0.0 };
        let half = field.flow_map(x, t, t + 0.5 * DT_S).unwrap();
        (field.flow_map(half, t + 0.5 * DT_S, t + DT_S).unwrap() - whole).length()
    });
}

#[test]
fn invariants_are_kept_over_100_frames() {
    check("invariant, relative", 1e-8, |field, x, t| {
        let Some(first) = field.invariant(x, t) else { return 0.0 };
        // Samples may lie almost on a zero of the invariant: there relative to a thousandth of its greatest value.
        let greatest = worst(samples().filter_map(|(y, t)| field.invariant(y, t)).map(f64::abs));
        let mut at = x;
        for frame in 0..100 {
            let t = t + DT_S * f64::from(frame);
            at = integrate(field, at, t, t + DT_S, Tolerance::default()).unwrap();
        }
        let last = field.invariant(at, t + 100.0 * DT_S).unwrap();
        (last - first).abs() / first.abs().max(1e-3 * greatest)
    });
}

#[test]
fn no_speed_exceeds_its_bound() {
    check("speed over bound - 1", 0.0, |field, x, t| {
        let boxed = Region::new(x, x + DVec3::new(20.0, 10.0, 5.0)).unwrap();
        let bound = field.max_speed(&boxed, t, t + DT_S);
        let inside = samples().take(50).map(|(y, _)| {
            let unit = (y - view().min()) / view().size();
            field.velocity(boxed.at(unit), t + DT_S * unit.x).length()
        });
        worst(inside) / bound.max(f64::MIN_POSITIVE) - 1.0
    });
}
