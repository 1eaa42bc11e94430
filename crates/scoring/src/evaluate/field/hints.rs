//! Detects probable mistakes of convention in a field: units, direction of the axes, origin of the positions.

use super::true_field::{TrueField, TrueFields};
use super::vectors::{ComparedVector, INLIER_PX};
use crate::evaluate::hint::Hint;
use crate::evaluate::statistics::median;
use crate::results::{Field, FlowVector, LENGTHS, Origin, Position, Reversal};
use storage::advice::{Advice, option};
use storage::dataset::RecordingFacts;

/// Smallest number of vectors for which hints are given.
const FEWEST: usize = 10;

/// Probable mistakes, each with the RMS error it would have without the mistake.
pub(super) fn hints(
    field: &Field,
    compared: &[ComparedVector],
    truth: &TrueFields,
    facts: &RecordingFacts,
) -> Vec<Hint> {
    let vectors = &field.vectors;
    if vectors.is_empty() {
        let what = "the result is empty: no vector is scored; was it written to another file?";
        return vec![Hint::new(what, "")];
    }
    let Some((_, grid)) = truth.fields.first() else { return Vec::new() };
    let mut hints: Vec<Hint> = other_reading(field, grid, facts).into_iter().collect();
    if compared.len() < FEWEST {
        return hints;
    }
    hints.extend(no_better_than_zeros(compared).filter(|_| hints.is_empty()));
    // Splines between the nodes suffice for gradients.
    let Some((shift, sure)) = offset(compared, grid) else { return hints };
    let rms = |all: &[ComparedVector]| {
        (all.iter().map(|c| c.endpoint().powi(2)).sum::<f64>() / all.len() as f64).sqrt()
    };
    let moved = |by: [f64; 2]| -> Vec<ComparedVector> {
        let place = |at: Position| Position { x_px: at.x_px + by[0], y_px: at.y_px + by[1], ..at };
        let valid: Vec<FlowVector> =
            (vectors.iter().filter(|v| v.flag == 0)).map(|v| FlowVector { at: place(v.at), ..*v }).collect();
        let truth = truth.at(&valid).into_iter().next().unwrap_or_default();
        (valid.into_iter().zip(truth))
            .filter_map(|(measured, truth)| Some(ComparedVector { measured, truth: truth? }))
            .filter(|c| c.endpoint() < INLIER_PX)
            .collect()
    };
    let inliers: Vec<ComparedVector> =
        compared.iter().copied().filter(|c| c.endpoint() < INLIER_PX).collect();
    let before = rms(&inliers);
    let shifted = |by: [f64; 2]| {
        let [x, y] = [0, 1].map(|axis| significant(field.placement.asked_px[axis] + by[axis]));
        option("shift_px").of(format!("{x} {y}"))
    };
    for by in [-1.0, -0.5, 0.5, 1.0] {
        // Every axis that the gradients determine must agree, and at least one shift must be significant.
        let agrees = (0..2).all(|k| sure[k].is_none_or(|sigma| (shift[k] - by).abs() < 0.15 + 2.0 * sigma));
        let is_seen = (0..2).any(|k| sure[k].is_some_and(|sigma| shift[k].abs() > 5.0 * sigma));
        if !(agrees && is_seen) {
            continue;
        }
        let after = rms(&moved([by; 2]));
        if after < before {
            let origins = [(0.0, Origin::Center1), (0.5, Origin::Corner0), (1.0, Origin::Center0)];
            let shift_px = field.placement.shift_px[0] + by;
            let name = origins
                .iter()
                .find(|(shift, _)| (shift - shift_px).abs() < 1e-9)
                .map(|(_, origin)| option("origin").is(origin.names()[0]));
            let detail = format!(
                "The flow gradients indicate ({:+.2}, {:+.2}) px; the RMS end-point error of inliers would be {after:.4} \
                 instead of {before:.4} px",
                shift[0], shift[1]
            );
            let hint = Hint::new(format!("positions off by {by:+} px?"), &detail);
            let hint = hint.with_options(&[name.unwrap_or_else(|| shifted([by; 2]))]);
            hints.push(Hint { rms_px: Some(after), rms_px_now: Some(before), ..hint });
        }
    }
    let is_far = (0..2).any(|k| sure[k].is_some_and(|sigma| shift[k].abs() > (5.0 * sigma).max(0.3)));
    if hints.is_empty() && field.placement.is_calibrated && is_far {
        let by = shift.map(|by| (100.0 * by).round() / 100.0);
        let after = rms(&moved(by));
        let detail = format!(
            "The flow gradients indicate ({:+.2}, {:+.2}) px; the RMS end-point error of inliers would be {after:.4} instead \
             of {before:.4} px",
            by[0], by[1]
        );
        let hint =
            Hint::new("do positions have an origin of their own?", &detail).with_options(&[shifted(by)]);
        hints.push(Hint { rms_px: Some(after), rms_px_now: Some(before), ..hint });
    }
    hints
}

/// Another reading of the values of a field.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Reading {
    /// Index of the unit of positions in [`LENGTHS`]; `None` for the result's.
    at: Option<usize>,
    axes: Axes,
    /// Factor of displacements.
    moved: f64,
}

/// What is reversed.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Axes {
    Kept,
    /// y of positions and displacements.
    Y,
    /// v alone.
    V,
    /// x of positions and displacements.
    X,
    /// x and y.
    Both,
}

/// A field with what its readings need.
struct Readings<'a> {
    field: &'a Field,
    grid: &'a TrueField,
    facts: &'a RecordingFacts,
    /// Sum of y and reversed y, px.
    sum_px: Option<f64>,
}

impl Readings<'_> {
    /// px per unit of positions.
    fn px(&self, at: Option<usize>) -> Option<f64> {
        at.map_or(Some(1.0), |k| Some(LENGTHS[k].1 / self.facts.um_per_px?))
    }

    /// RMS end-point error of vectors, of which at least half are where there is a truth; and the factor of
    /// displacements with the least error.
    fn rms_px(&self, reading: Reading, vectors: &[&FlowVector]) -> Option<(f64, f64)> {
        let (length, axes) = (self.px(reading.at)?, reading.axes);
        let placement = &self.field.placement;
        let shift = placement.shift_px;
        let scaled = |axis: usize, at: f64| (at - shift[axis]) * length + shift[axis];
        // Within the grid, the sum has the scale of positions.
        let is_grid = placement.reversal == Reversal::Grid;
        let sum_y = self.sum_px.map(|sum| if is_grid { scaled(1, sum - shift[1]) + shift[1] } else { sum });
        let sum_x = self.facts.sensor_px.map(|(width, _)| placement.reversed_px(0, width));
        let (is_x, is_y) = (matches!(axes, Axes::X | Axes::Both), matches!(axes, Axes::Y | Axes::Both));
        let reversed = |at: f64, is: bool, sum: Option<f64>| if is { Some(sum? - at) } else { Some(at) };
        let sign = |is_reversed: bool| if is_reversed { -1.0 } else { 1.0 };
        let [mut n, mut squares, mut product, mut truth] = [0.0; 4];
        for v in vectors {
            let x_px = reversed(scaled(0, v.at.x_px), is_x, sum_x)?;
            let y_px = reversed(scaled(1, v.at.y_px), is_y, sum_y)?;
            let at = Position { x_px, y_px, ..v.at };
            let (u, w) = (v.moved[0] * sign(is_x), v.moved[1] * sign(is_y || axes == Axes::V));
            if let Some([x, y, _]) = self.grid.at(&FlowVector { at, ..**v }) {
                n += 1.0;
                squares += u * u + w * w;
                product += u * x + w * y;
                truth += x * x + y * y;
            }
        }
        let k = reading.moved;
        let rms = ((k * k * squares - 2.0 * k * product + truth).max(0.0) / n).sqrt();
        (2.0 * n >= vectors.len() as f64).then_some((rms, product / squares))
    }

    /// Unit and time of displacements that have the factor of a reading.
    fn known(&self, reading: Reading) -> Option<(Option<usize>, &'static str, f64)> {
        let units = [reading.at, None].into_iter().chain((0..LENGTHS.len()).map(Some));
        let times = [Some(("", 1.0)), self.facts.dt_s.map(|dt_s| ("/s", dt_s))];
        units.flat_map(|unit| times.map(|time| (unit, time))).find_map(|(unit, time)| {
            let (per, s) = time?;
            ((self.px(unit)? * s / reading.moved - 1.0).abs() < 0.02).then_some((unit, per, s))
        })
    }

    /// The question, changes to the file, and the options that read it so.
    fn words(&self, reading: Reading) -> (String, Vec<String>, Vec<Advice>) {
        let placement = &self.field.placement;
        let (length, dt_s) = (self.px(reading.at).unwrap_or(1.0), self.facts.dt_s);
        let (mut asked, mut changes, mut options) = (Vec::new(), Vec::new(), Vec::new());
        let known = self.known(reading);
        let name = |unit: Option<usize>| unit.map_or("px", |k| LENGTHS[k].0);
        if reading.at.is_some() || reading.moved != 1.0 {
            // Otherwise the time between frames is another one.
            let (unit, per, s) = known.unwrap_or((reading.at, "/s", reading.moved / length));
            let um = self.facts.um_per_px.filter(|_| reading.at.is_some());
            if placement.is_stated && placement.is_per_s && reading.at.is_none() {
                asked.push("u and v for another time between frames".to_owned());
                options.push(option("dt_s").of(significant(reading.moved * dt_s.unwrap_or(1.0))));
            } else {
                let positions =
                    reading.at.map_or(String::new(), |at| format!("x and y in {}, ", LENGTHS[at].0));
                asked.push(format!("{positions}u and v in {}{per}", name(unit)));
                if placement.is_stated || unit != reading.at {
                    changes.push(format!("multiply x and y by {length} and u and v by {}", reading.moved));
                } else {
                    options.extend(um.map(|um| option("um_per_px").of(um)));
                    let s = if known.is_some() { s } else { significant(s) };
                    options.extend((per == "/s").then(|| option("dt_s").of(s)));
                }
            }
        }
        let y = if placement.is_y_up { "down" } else { "up" };
        asked.extend(match reading.axes {
            Axes::Kept => None,
            Axes::Y => Some(format!("y grows {y}ward")),
            Axes::V => Some("v has the wrong sign".to_owned()),
            Axes::X => Some("x grows to the left".to_owned()),
            Axes::Both => Some(format!("x grows to the left and y {y}ward")),
        });
        match reading.axes {
            Axes::V => changes.push("write v with the other sign".to_owned()),
            Axes::X | Axes::Both => changes.push("write x and u to the right".to_owned()),
            Axes::Kept | Axes::Y => {}
        }
        options.extend(matches!(reading.axes, Axes::Y | Axes::Both).then(|| option("y").is(y)));
        (format!("{}?", asked.join("; ")), changes, options)
    }
}

/// A number with six digits.
fn significant(value: f64) -> f64 {
    format!("{value:.5e}").parse().unwrap_or(value)
}

/// The reading in other units or with reversed axes that fits much better than the result's, if any.
fn other_reading(field: &Field, grid: &TrueField, facts: &RecordingFacts) -> Option<Hint> {
    /// Number of vectors for which all readings are tried.
    const SAMPLE: usize = 2000;
    let valid: Vec<&FlowVector> = field.vectors.iter().filter(|v| v.flag == 0).collect();
    if valid.len() < FEWEST {
        return None;
    }
    let sum_px = field.placement.sum_px(&field.vectors, facts.sensor_px.map(|(_, height)| height));
    let readings = Readings { field, grid, facts, sum_px };
    let sample: Vec<&FlowVector> = valid.iter().copied().step_by(valid.len().div_ceil(SAMPLE)).collect();
    let now = Reading { at: None, axes: Axes::Kept, moved: 1.0 };
    // A field within two pixels is in another unit, whatever its error.
    let range = |of: fn(&Position) -> f64| {
        let values = || valid.iter().map(|v| of(&v.at));
        values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min)
    };
    let is_tiny = range(|at| at.x_px) < 2.0 && range(|at| at.y_px) < 2.0;
    let before = readings.rms_px(now, &valid).map(|(rms, _)| rms).filter(|_| !is_tiny);
    let mut best: Option<(usize, Reading, f64)> = None;
    for at in [None].into_iter().chain((0..LENGTHS.len()).map(Some)).filter(|at| !(at.is_none() && is_tiny)) {
        for axes in [Axes::Kept, Axes::Y, Axes::V, Axes::X, Axes::Both] {
            let kept = Reading { at, axes, moved: 1.0 };
            let Some((rms, k)) = readings.rms_px(kept, &sample) else { continue };
            // Damped displacements are not in another unit.
            let scaled = (k > 0.0 && !(0.4..2.5).contains(&k)).then_some(Reading { moved: k, ..kept });
            let scaled = scaled.and_then(|scaled| Some((scaled, readings.rms_px(scaled, &sample)?.0)));
            for (reading, rms) in [(kept, rms)].into_iter().chain(scaled) {
                let changes = usize::from(at.is_some())
                    + usize::from(axes != Axes::Kept)
                    + usize::from(reading.moved != 1.0);
                // More changes need a clearly smaller error; of equal ones, y upward comes before x to the left.
                let is_better = best.is_none_or(|(fewer, _, least)| {
                    least - rms > 1e-3 && (rms < 0.5 * least || (changes <= fewer && rms < 0.9 * least))
                });
                if is_better {
                    best = Some((changes, reading, rms));
                }
            }
        }
    }
    let (_, mut reading, _) = best.filter(|(_, reading, _)| *reading != now)?;
    let (question, changes, options) = readings.words(reading);
    // The factor that the options have.
    if let Some((unit, _, s)) = readings.known(reading).filter(|_| reading.moved != 1.0) {
        reading.moved = readings.px(unit)? * s;
    }
    let (after, _) = readings.rms_px(reading, &valid)?;
    let size = valid.iter().filter_map(|v| grid.at(v)).map(|[u, v, _]| u * u + v * v).sum::<f64>();
    let zeros = (size / valid.len() as f64).sqrt();
    // Without a fit it is another dataset.
    if before.is_some_and(|before| after > 0.5 * before) || (zeros > 0.0 && after > zeros) {
        return None;
    }
    let instead = before.map(|before| format!(" instead of {before:.3}")).unwrap_or_default();
    let changes = changes.iter().map(|change| format!("; {change}")).collect::<String>();
    let hint =
        Hint::new(question, &format!("The RMS end-point error would be {after:.3}{instead} px{changes}"));
    let hint = if options.is_empty() { hint } else { hint.with_options(&options) };
    Some(Hint { rms_px: Some(after), rms_px_now: before, ..hint })
}

/// A hint if zero displacements would have smaller errors. It compares medians, because outliers alone make
/// any field worse.
fn no_better_than_zeros(compared: &[ComparedVector]) -> Option<Hint> {
    /// Errors below this are noise in small displacements, px.
    const LARGE_PX: f64 = 0.5;
    let of = |value: fn(&ComparedVector) -> f64| median(compared.iter().map(value).filter(|v| v.is_finite()));
    let (error, moved) = (of(|c| c.endpoint())?, of(|c| c.truth[0].hypot(c.truth[1]))?);
    let question = "is this the result of another dataset, is it in another unit, or are its image pairs in another order?";
    let detail = format!(
        "The median error of {error:.2} px is no smaller than that of zero displacements ({moved:.2} px)"
    );
    (error > LARGE_PX && error >= 0.98 * moved).then(|| Hint::new(question, &detail))
}

/// Estimated shift of the positions along x and y, px, with its standard errors; `None` for an axis along
/// which the flow does not vary.
///
/// A vector measured at x + d but reported at x has the error e = G d, where G is the gradient of the true
/// field; d is fitted by least squares over inliers.
fn offset(compared: &[ComparedVector], grid: &TrueField) -> Option<([f64; 2], [Option<f64>; 2])> {
    const STEP_PX: f64 = 1.0;
    // Normal equations of both components: sums of G^T G and G^T e.
    let (mut m, mut b, mut equations) = ([[0.0; 2]; 2], [0.0; 2], Vec::new());
    for c in compared.iter().filter(|c| c.measured.flag == 0 && c.endpoint() < INLIER_PX) {
        let at = |dx: f64, dy: f64| {
            let at =
                Position { x_px: c.measured.at.x_px + dx, y_px: c.measured.at.y_px + dy, ..c.measured.at };
            grid.at(&FlowVector { at, ..c.measured })
        };
        let Some((right, left)) = at(STEP_PX, 0.0).zip(at(-STEP_PX, 0.0)) else { continue };
        let Some((below, above)) = at(0.0, STEP_PX).zip(at(0.0, -STEP_PX)) else { continue };
        for (k, e) in c.error().into_iter().enumerate() {
            let slope = [(right[k] - left[k]) / (2.0 * STEP_PX), (below[k] - above[k]) / (2.0 * STEP_PX)];
            for i in 0..2 {
                b[i] += slope[i] * e;
                (0..2).for_each(|j| m[i][j] += slope[i] * slope[j]);
            }
            equations.push((slope, e));
        }
    }
    if equations.len() < 2 * FEWEST {
        return None;
    }
    let n = equations.len() as f64;
    // An axis along which RMS gradients are below 1e-4 px per px does not determine the shift.
    let varies = [0, 1].map(|k| m[k][k] > 1e-8 * n);
    let d = match varies {
        [true, true] => {
            let determinant = m[0][0] * m[1][1] - m[0][1] * m[1][0];
            if determinant < 1e-6 * m[0][0] * m[1][1] {
                return None;
            }
            [(b[0] * m[1][1] - b[1] * m[0][1]) / determinant, (b[1] * m[0][0] - b[0] * m[1][0]) / determinant]
        }
        [true, false] => [b[0] / m[0][0], 0.0],
        [false, true] => [0.0, b[1] / m[1][1]],
        [false, false] => return None,
    };
    let squares: f64 =
        equations.iter().map(|(slope, e)| (e - slope[0] * d[0] - slope[1] * d[1]).powi(2)).sum();
    let variance = squares / (n - 2.0);
    let sigma = [0, 1].map(|k| varies[k].then(|| (variance / m[k][k]).sqrt()));
    Some((d, sigma))
}
