//! Every field of the registry against its claimed properties, in one table of fields x checks.
//!
//! Where a check does not apply to a field, the table gives the reason. `cargo test -p microsig-flows --test
//! all conformance:: -- --nocapture` prints it.
#![expect(clippy::print_stdout, reason = "the table of fields x checks, for `--nocapture`")]

use flows::fields::{RotatedParams, Transform, TranslatedParams};
use flows::integrate::{Tolerance, advance, integrate};
use flows::registry::{ENTRIES, FieldConstructor};
use flows::{Region, VelocityField, field};
use glam::{DMat3, DVec3};
use rayon::prelude::*;

/// Time between frames, s.
const DT_S: f64 = 0.005;
const UM_PER_PX: f64 = 0.645;

/// A field under test.
struct Case {
    name: &'static str,
    variant: &'static str,
    make: FieldConstructor,
    field: Box<dyn VelocityField>,
    /// Positions in the fluid (um), and times (s).
    samples: Vec<(DVec3, f64)>,
    /// Largest element of the gradient at the samples, 1/s.
    gradient: f64,
    /// Maximum speed at the samples, um/s.
    speed: f64,
}

/// [`integrate`], or NaN, which fails every check.
fn follow(field: &dyn VelocityField, x: DVec3, t0: f64, t1: f64, tolerance: Tolerance) -> DVec3 {
    integrate(field, x, t0, t1, tolerance).unwrap_or(DVec3::NAN)
}

/// Result of a check: a value and its limit, or the reason why it does not apply.
type Finding = Result<(f64, f64), &'static str>;

impl Case {
    fn new(name: &'static str, variant: &'static str, make: FieldConstructor) -> Case {
        let field = make().unwrap();
        let fluid = |x: DVec3, t: f64| has_fluid(field.as_ref(), name, x, t);
        let samples: Vec<_> = all_samples().filter(|(x, t)| fluid(*x, *t)).collect();
        let gradient = worst(samples.iter().map(|(x, t)| size(&field.gradient(*x, *t))));
        let speed = worst(samples.iter().map(|(x, t)| field.velocity(*x, *t).length()));
        Case { name, variant, make, field, samples, gradient, speed }
    }

    fn title(&self) -> String {
        if self.variant.is_empty() {
            self.name.to_owned()
        } else {
            format!("{}: {}", self.name, self.variant)
        }
    }

    fn over_samples(&self, value: impl Fn(DVec3, f64) -> f64) -> f64 {
        worst(self.samples.iter().map(|(x, t)| value(*x, *t)))
    }
}

fn cases() -> Vec<Case> {
    let all = ENTRIES.iter().flat_map(|entry| {
        let variants = entry.variants.iter().map(|(variant, make)| (entry.name, *variant, *make));
        std::iter::once((entry.name, "", entry.make)).chain(variants)
    });
    all.map(|(name, variant, make)| Case::new(name, variant, make)).collect()
}

/// The view of the default sensor and channel without a layer at the walls that is thicker than the stencil
/// of the differences.
fn view() -> Region {
    Region::new(DVec3::new(-240.0, -117.0, -79.0), DVec3::new(240.0, 117.0, 19.0)).unwrap()
}

/// Points that cover the view evenly, and times.
fn all_samples() -> impl Iterator<Item = (DVec3, f64)> {
    // A quasi-random sequence: multiples of rationally independent numbers.
    (0..200).map(f64::from).map(|i| {
        let unit = DVec3::new(i * 0.819_172 % 1.0, i * 0.671_044 % 1.0, i * 0.549_700 % 1.0);
        (view().at(unit), i * DT_S)
    })
}

/// Whether a point is in the fluid, at least a micrometer from any wall, and stays there on the path of one
/// frame.
fn has_fluid(field: &dyn VelocityField, name: &str, x: DVec3, t: f64) -> bool {
    let clear = |t: f64| field.wall(x, t).is_none_or(|wall| wall.clearance_um >= 1.0);
    clear(t)
        && match name {
            // The surface descends; tracers are deposited at the contact line.
            "coffee_ring" => clear(t + 0.01) && x.truncate().length_squared() < 0.94 * 40_000.0,
            // A micrometer from the edge of the data, where the gradient is discontinuous.
            "gridded" => x.x > -239.0,
            _ => true,
        }
}

/// Whether the stencil of the differences crosses a surface where the gradient is discontinuous.
fn is_near_jump(case: &Case, x: DVec3) -> bool {
    match (case.name, case.variant) {
        ("rankine", _) => (x.truncate().length() - 40.0).abs() < 0.2,
        // Cell faces, every 10 um.
        ("gridded", "trilinear") => (x / 10.0 - (x / 10.0).round()).abs().min_element() < 0.02,
        _ => false,
    }
}

/// The maximum of the values, 0 if there are none; NaN counts as infinity.
fn worst(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, |worst, value| if value.is_nan() { f64::INFINITY } else { worst.max(value) })
}

/// Largest element of a matrix by magnitude.
fn size(matrix: &DMat3) -> f64 {
    worst((0..3).map(|i| matrix.col(i).abs().max_element()))
}

fn trace(matrix: &DMat3) -> f64 {
    (0..3).map(|i| matrix.col(i)[i]).sum()
}

fn divergence(case: &Case) -> Finding {
    if !case.field.is_divergence_free() {
        return Err("has divergence");
    }
    if case.gradient == 0.0 {
        return Ok((0.0, 1e-8));
    }
    // The terms of the trace cancel up to rounding.
    Ok((case.over_samples(|x, t| trace(&case.field.gradient(x, t)).abs()) / case.gradient, 1e-8))
}

/// A divergence-free field that does not claim to be one would be skipped by the tests of uniform clouds.
fn claimed_divergence(case: &Case) -> Finding {
    if case.field.is_divergence_free() {
        return Err("claims none");
    }
    let found = case.over_samples(|x, t| trace(&case.field.gradient(x, t)).abs());
    // Sources have divergence in their cores only, which the samples may miss.
    let core = trace(&case.field.gradient(DVec3::new(3.0, 2.0, -28.0), 0.0)).abs();
    Ok((if found.max(core) > 1e-3 { 0.0 } else { f64::INFINITY }, 0.0))
}

fn gradient(case: &Case) -> Finding {
    let reference = case.gradient.max(1e-3);
    let field = case.field.as_ref();
    Ok((
        case.over_samples(|x, t| {
            if is_near_jump(case, x) {
                return 0.0;
            }
            let (formula, numeric) = (field.gradient(x, t), field::differences(field, x, t));
            size(&(formula - numeric)) / reference
        }),
        1e-6,
    ))
}

fn steadiness(case: &Case) -> Finding {
    if !case.field.is_steady() {
        return Err("unsteady");
    }
    Ok((
        case.over_samples(|x, t| (case.field.velocity(x, t) - case.field.velocity(x, t + 0.37)).length()),
        0.0,
    ))
}

fn closed_form(case: &Case) -> Finding {
    let (x, t) = case.samples[0];
    if case.field.flow_map(x, t, t + DT_S).is_none() {
        return Err("none known");
    }
    Ok((
        case.over_samples(|x, t| {
            let Some(closed) = case.field.flow_map(x, t, t + DT_S) else { return f64::INFINITY };
            let integrated = follow(case.field.as_ref(), x, t, t + DT_S, Tolerance::default());
            (closed - integrated).length()
        }),
        1e-8,
    ))
}

fn half_steps(case: &Case) -> Finding {
    let (x, t) = case.samples[0];
    if case.field.flow_map(x, t, t + DT_S).is_none() {
        return Err("no closed form");
    }
    let map = |x, t0, t1| case.field.flow_map(x, t0, t1).unwrap_or(DVec3::NAN);
    // Flow maps form a group. Rounding errors are a few times 1e-11 um (the rounding of 300 um), and 1e-10 um for
    // Womersley's series at Wo = 40.
    Ok((
        case.over_samples(|x, t| {
            let half = map(x, t, t + 0.5 * DT_S);
            (map(half, t + 0.5 * DT_S, t + DT_S) - map(x, t, t + DT_S)).length()
        }),
        1e-10,
    ))
}

/// Over 100 frames by numerical integration, also where a closed form is known.
fn invariant(case: &Case) -> Finding {
    let (x, t) = case.samples[0];
    if case.field.invariant(x, t).is_none() {
        return Err("none known");
    }
    let field = case.field.as_ref();
    let value = |x, t| field.invariant(x, t).unwrap_or(f64::NAN);
    let greatest = worst(case.samples.iter().map(|(x, t)| value(*x, *t).abs()));
    let paths = case.samples.iter().step_by(5).map(|(x, t)| {
        let mut at = *x;
        for frame in 0..100 {
            let t = t + DT_S * f64::from(frame);
            at = follow(field, at, t, t + DT_S, Tolerance::default());
        }
        let (first, last) = (value(*x, *t), value(at, t + 100.0 * DT_S));
        // Samples may be almost at a zero of the invariant: there the error is relative to a hundredth of its
        // maximum.
        (last - first).abs() / first.abs().max(1e-2 * greatest)
    });
    Ok((worst(paths), 1e-8))
}

fn there_and_back(case: &Case) -> Finding {
    let field = case.field.as_ref();
    Ok((
        case.over_samples(|x, t| {
            let there = advance(field, x, t, t + DT_S).unwrap_or(DVec3::NAN);
            (advance(field, there, t + DT_S, t).unwrap_or(DVec3::NAN) - x).length()
        }),
        1e-7,
    ))
}

/// In px of the default scene.
fn displacement(case: &Case) -> Finding {
    let tight = Tolerance { relative: 1e-12, absolute_um: 1e-12 };
    let field = case.field.as_ref();
    Ok((
        case.over_samples(|x, t| {
            let exact = follow(field, x, t, t + DT_S, tight);
            (advance(field, x, t, t + DT_S).unwrap_or(DVec3::NAN) - exact).length() / UM_PER_PX
        }),
        1e-6,
    ))
}

/// A translated and rotated field gives, at translated and rotated positions, the translated and rotated
/// result.
fn placement(case: &Case) -> Finding {
    let (params, offset) = (
        RotatedParams { axis: [1.0, -2.0, 3.0], angle_rad: 0.8, center_um: [30.0, 0.0, 0.0] },
        DVec3::new(50.0, -20.0, 7.0),
    );
    let turned = params.apply((case.make)().unwrap()).unwrap();
    let placed = TranslatedParams { offset_um: offset.to_array() }.apply(turned).unwrap();
    // Rodrigues' formula; the code under test uses a quaternion.
    let (axis, center) = (DVec3::from_array(params.axis).normalize(), DVec3::from_array(params.center_um));
    let (sin, cos) = libm::sincos(params.angle_rad);
    let turn = |v: DVec3| v * cos + axis.cross(v) * sin + axis * (axis.dot(v) * (1.0 - cos));
    let place = |x: DVec3| center + turn(x - center) + offset;
    let field = case.field.as_ref();
    Ok((
        case.over_samples(|x, t| {
            let speed = (placed.velocity(place(x), t) - turn(field.velocity(x, t))).length();
            let dx = DVec3::new(0.3, 0.5, -0.2);
            let stretch =
                (placed.gradient(place(x), t) * turn(dx) - turn(field.gradient(x, t) * dx)).length();
            let end = advance(placed.as_ref(), place(x), t, t + DT_S).unwrap_or(DVec3::NAN);
            let path = (end - place(advance(field, x, t, t + DT_S).unwrap_or(DVec3::NAN))).length();
            let kept = match (placed.invariant(place(x), t), field.invariant(x, t)) {
                (Some(a), Some(b)) => (a - b).abs() / b.abs().max(1.0),
                (None, None) => 0.0,
                _ => f64::INFINITY,
            };
            // Rounding errors of coordinates are amplified by gradients; a path may be integrated in
            // different steps, to 1e-7 um.
            (speed / case.speed.max(1.0)).max(stretch / case.gradient.max(1.0)).max(0.1 * path).max(kept)
        }),
        1e-8,
    ))
}

fn speed_bound(case: &Case) -> Finding {
    let field = case.field.as_ref();
    let boxes = [DVec3::new(20.0, 10.0, 5.0), DVec3::new(100.0, 80.0, 60.0)];
    Ok((
        case.over_samples(|x, t| {
            worst(boxes.iter().map(|size| {
                let boxed = Region::new(x, x + *size).unwrap();
                let bound = field.max_speed(&boxed, t, t + DT_S);
                let mirrored = field.max_speed(&boxed, t + DT_S, t);
                let inside = all_samples().take(50).map(|(y, _)| {
                    let unit = (y - view().min()) / view().size();
                    field.velocity(boxed.at(unit), t + DT_S * unit.x).length()
                });
                let excess = worst(inside) - bound;
                if mirrored == bound { excess.max(0.0) } else { f64::INFINITY }
            }))
        }),
        0.0,
    ))
}

/// Positions in the fluid are not changed by `confine`, bit for bit: seeding relies on this.
fn confinement(case: &Case) -> Finding {
    Ok((case.over_samples(|x, t| (case.field.confine(x, t, 0.5) - x).length()), 0.0))
}

/// Ratio of the speed bound over the view to the maximum speed at the samples; only printed.
fn slack(case: &Case) -> Finding {
    Ok((case.field.max_speed(&view(), 0.0, 1.0) / case.speed.max(1e-300), f64::INFINITY))
}

/// A boundary condition at a wall.
enum Condition {
    /// The velocity equals the wall velocity, um/s.
    NoSlip(DVec3),
    /// The velocity along this normal is zero.
    NoFlux(DVec3),
}

/// Points on circles of a radius about an axis through a center, at the given cosines of latitude, just
/// outside or inside.
fn sphere(center: DVec3, radius: f64) -> Vec<(DVec3, DVec3)> {
    (0..60)
        .map(f64::from)
        .map(|i| {
            let cos = 2.0 * (i * 0.618_034 % 1.0) - 1.0;
            let (s, c) = libm::sincos(i * 2.4);
            let sin = (1.0 - cos * cos).sqrt();
            let normal = DVec3::new(sin * c, sin * s, cos);
            (center + normal * radius, normal)
        })
        .collect()
}

fn walls(case: &Case) -> Finding {
    use Condition::{NoFlux, NoSlip};
    const INSIDE: f64 = 1.0 - 1e-14;
    let rest = |points: Vec<DVec3>| points.into_iter().map(|x| (x, NoSlip(DVec3::ZERO))).collect::<Vec<_>>();
    // Points on floor and ceiling, and on side walls at a distance of `width`.
    let plates: Vec<DVec3> =
        all_samples().take(40).flat_map(|(x, _)| [x.with_z(-80.0), x.with_z(20.0)]).collect();
    let sides = |half: f64| -> Vec<DVec3> {
        all_samples().take(40).flat_map(|(x, _)| [x.with_y(-half), x.with_y(half)]).collect()
    };
    let tube = || {
        sphere(DVec3::ZERO, 1.0).into_iter().map(|(_, n)| {
            let n = DVec3::new(0.0, n.y, n.z).normalize_or(DVec3::Y);
            DVec3::new(7.0, 0.0, -30.0) + n * (50.0 * INSIDE)
        })
    };
    let pillar = |radius: f64| {
        sphere(DVec3::new(0.0, 0.0, -30.0), 1.0).into_iter().map(move |(_, n)| {
            let n = n.with_z(0.0).normalize_or(DVec3::X);
            (n * (radius / INSIDE) + DVec3::Z * -30.0, n)
        })
    };
    let conditions: Vec<(DVec3, Condition)> = match (case.name, case.variant) {
        ("poiseuille", _) => rest(plates),
        ("womersley", "" | "plane Wo 5") => rest(plates),
        ("electro_osmotic", "thick layer") => rest(plates),
        ("electro_osmotic", _) => plates.into_iter().map(|x| (x, NoFlux(DVec3::Z))).collect(),
        ("couette_poiseuille", _) => plates
            .into_iter()
            .map(|x| (x, NoSlip(if x.z > 0.0 { DVec3::X * 1290.0 } else { DVec3::ZERO })))
            .collect(),
        ("duct", "") => rest(plates.into_iter().chain(sides(100.0)).collect()),
        ("duct", _) => rest(plates.into_iter().chain(sides(30.0)).collect()),
        ("tube", _) | ("womersley", _) => rest(tube().collect()),
        ("hele_shaw", _) => {
            rest(plates).into_iter().chain(pillar(60.0).map(|(x, n)| (x, NoFlux(n)))).collect()
        }
        ("source", "hele_shaw") => rest(plates),
        ("stokes_sphere", _) => {
            rest(sphere(DVec3::new(0.0, 0.0, -30.0), 30.0 / INSIDE).into_iter().map(|(x, _)| x).collect())
        }
        ("stokes_cylinder", _) => rest(pillar(30.0).map(|(x, _)| x).collect()),
        ("hill", "") => {
            sphere(DVec3::new(0.0, 0.0, -30.0), 40.0).into_iter().map(|(x, n)| (x, NoFlux(n))).collect()
        }
        ("toroidal_drop", _) => {
            let floor = rest(plates.into_iter().map(|x| x.with_z(-80.0)).collect());
            let surface = all_samples().filter(|(x, _)| x.truncate().length() < 195.0).map(|(x, _)| {
                let share = 1.0 - x.truncate().length_squared() / 40_000.0;
                let slope = x.truncate() * (2.0 * 60.0 / 40_000.0);
                (x.with_z(-80.0 + 60.0 * share), NoFlux(slope.extend(1.0).normalize()))
            });
            floor.into_iter().chain(surface).collect()
        }
        ("coffee_ring", _) => rest(plates.into_iter().map(|x| x.with_z(-80.0)).collect()),
        ("rayleigh_streaming", _) => {
            let sides = sides(118.0).into_iter().map(|x| (x, NoFlux(DVec3::Y)));
            plates.into_iter().map(|x| (x, NoFlux(DVec3::Z))).chain(sides).collect()
        }
        ("acoustophoresis", _) => sides(118.0).into_iter().map(|x| (x, NoFlux(DVec3::Y))).collect(),
        ("double_gyre", _) => {
            let ends = all_samples().take(40).flat_map(|(x, _)| [x.with_x(-236.0), x.with_x(236.0)]);
            let ends = ends.map(|x| (x, NoFlux(DVec3::X)));
            sides(118.0).into_iter().map(|x| (x, NoFlux(DVec3::Y))).chain(ends).collect()
        }
        ("cellular", "") => sides(75.0).into_iter().map(|x| (x, NoFlux(DVec3::Y))).collect(),
        ("taylor_green", _) => sides(100.0).into_iter().map(|x| (x, NoFlux(DVec3::Y))).collect(),
        _ => return Err("has no walls"),
    };
    let speed = case.speed;
    let value = worst(conditions.into_iter().enumerate().map(|(i, (x, condition))| {
        let u = case.field.velocity(x, DT_S * i as f64 / 7.0);
        match condition {
            NoSlip(wall) => (u - wall).length() / speed,
            NoFlux(normal) => u.dot(normal).abs() / speed,
        }
    }));
    // The truncation error of the duct's series is 3e-8 at the side walls; elsewhere there are rounding
    // errors only, amplified by 1e4 at a Womersley number of 40.
    Ok((value, if case.name == "duct" { 1e-7 } else { 1e-10 }))
}

type Check = fn(&Case) -> Finding;

/// Column titles and checks.
const CHECKS: &[(&str, Check)] = &[
    ("div u / |G|", divergence),
    ("div if claimed", claimed_divergence),
    ("grad", gradient),
    ("steady", steadiness),
    ("closed, um", closed_form),
    ("halves, um", half_steps),
    ("invariant", invariant),
    ("walls", walls),
    ("back, um", there_and_back),
    ("step, px", displacement),
    ("placed", placement),
    ("> max_speed", speed_bound),
    ("held, um", confinement),
    ("slack", slack),
];

#[test]
fn every_field_keeps_every_promise() {
    let cases = cases();
    assert!(cases.iter().all(|case| case.samples.len() >= 20), "too little fluid in the view");
    let rows: Vec<Vec<Finding>> =
        cases.par_iter().map(|case| CHECKS.iter().map(|(_, check)| check(case)).collect()).collect();
    print!("{:>27}", "");
    for (title, _) in CHECKS {
        print!("{title:>15}");
    }
    println!();
    let mut failed = Vec::new();
    for (case, row) in cases.iter().zip(&rows) {
        print!("{:>27}", case.title());
        for ((title, _), finding) in CHECKS.iter().zip(row) {
            match finding {
                Err(reason) => print!("{reason:>15}"),
                Ok((value, limit)) => {
                    print!("{value:>15.1e}");
                    if value > limit {
                        failed.push(format!("{}: {title} = {value:e} > {limit:e}", case.title()));
                    }
                }
            }
        }
        println!();
    }
    println!("{} fields with {} variants", ENTRIES.len(), cases.len() - ENTRIES.len());
    assert!(failed.is_empty(), "{failed:#?}");
}

#[test]
fn closed_forms_hold_over_long_times() {
    // 100 frames: a path of 700 um with errors of 1e-10 um and more per step, which partly cancel.
    let tolerance = Tolerance { relative: 1e-12, absolute_um: 1e-12 };
    for case in cases() {
        let value = worst(case.samples.iter().step_by(4).filter_map(|(x, t)| {
            let end = t + 100.0 * DT_S;
            let closed = case.field.flow_map(*x, *t, end)?;
            let exact = follow(case.field.as_ref(), *x, *t, end, tolerance);
            // Coordinates grow by e^5 in strain: errors are relative to the distance.
            Some((closed - exact).length() / (exact - *x).length().max(100.0) * 100.0)
        }));
        assert!(value < 1e-6, "{}: {value:e}", case.title());
    }
}
