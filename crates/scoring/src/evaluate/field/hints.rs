//! Detects probable mistakes of convention in a field: units, direction of the axes, origin of the positions.

use super::compared::{ComparedVector, INLIER_PX};
use super::true_field::{TrueField, TrueFields};
use crate::evaluate::hint::Hint;
use crate::evaluate::statistics::quantile;
use crate::results::{Field, FlowVector, LENGTHS, Origin, Position, Reversal};
use dataset::RecordingFacts;
use storage::advice::{Named, option};

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
    let moved = |by: f64| -> Vec<ComparedVector> {
        let valid: Vec<FlowVector> = (vectors.iter().filter(|v| v.flag == 0))
            .map(|v| FlowVector { at: Position { x_px: v.at.x_px + by, y_px: v.at.y_px + by, ..v.at }, ..*v })
            .collect();
        let truth = truth.at(&valid).into_iter().next().unwrap_or_default();
        (valid.into_iter().zip(truth))
            .filter_map(|(measured, truth)| Some(ComparedVector { measured, truth: truth? }))
            .filter(|c| c.endpoint() < INLIER_PX)
            .collect()
    };
    for by in [-1.0, -0.5, 0.5, 1.0] {
        // Every axis that the gradients determine must agree, and at least one shift must be significant.
        let agrees = (0..2).all(|k| sure[k].is_none_or(|sigma| (shift[k] - by).abs() < 0.15 + 2.0 * sigma));
        let is_seen = (0..2).any(|k| sure[k].is_some_and(|sigma| shift[k].abs() > 5.0 * sigma));
        if !(agrees && is_seen) {
            continue;
        }
        let inliers: Vec<ComparedVector> =
            compared.iter().copied().filter(|c| c.endpoint() < INLIER_PX).collect();
        let (before, after) = (rms(&inliers), rms(&moved(by)));
        if after < before {
            let origins = [(0.0, Origin::Center1), (0.5, Origin::Corner0), (1.0, Origin::Center0)];
            let shift_px = field.placement.shift_px[0] + by;
            let name = origins
                .iter()
                .find(|(shift, _)| (shift - shift_px).abs() < 1e-9)
                .map(|(_, origin)| origin.names()[0]);
            let detail = format!(
                "The flow gradients indicate ({:+.2}, {:+.2}) px; the RMS end-point error of inliers would be {after:.4} \
                 instead of {before:.4} px",
                shift[0], shift[1]
            );
            let hint = Hint::new(format!("positions off by {by:+} px?"), &detail);
            let hint = name.map_or(hint.clone(), |name| hint.with_options(&[option("origin").is(name)]));
            hints.push(Hint { rms_px: Some(after), rms_px_now: Some(before), ..hint });
        }
    }
    hints
}

/// Another reading of the values of a field.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Reading {
    /// Index of the unit of positions in [`LENGTHS`]; `None` for px.
    at: Option<usize>,
    /// The same for displacements.
    moved: Option<usize>,
    /// Whether displacements are per s.
    is_per_s: bool,
    axes: Axes,
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

impl Reading {
    /// All readings, those with fewer changes first.
    fn all() -> Vec<Self> {
        let lengths = || [None].into_iter().chain((0..LENGTHS.len()).map(Some));
        let mut all = Vec::new();
        for axes in [Axes::Kept, Axes::Y, Axes::V, Axes::X, Axes::Both] {
            for (at, moved) in lengths().flat_map(|at| lengths().map(move |moved| (at, moved))) {
                all.extend([false, true].map(|is_per_s| Reading { at, moved, is_per_s, axes }));
            }
        }
        all.sort_by_key(Reading::changes);
        all
    }

    fn changes(&self) -> usize {
        let units = usize::from(self.at.is_some()) + usize::from(self.moved != self.at);
        units + usize::from(self.is_per_s) + usize::from(self.axes != Axes::Kept)
    }

    /// px per unit of positions and displacements; `None` if the facts of the dataset do not tell.
    fn factors(&self, facts: &RecordingFacts) -> Option<[f64; 2]> {
        let px = |unit: Option<usize>| unit.map_or(Some(1.0), |k| Some(LENGTHS[k].1 / facts.um_per_px?));
        let time = if self.is_per_s { facts.dt_s? } else { 1.0 };
        Some([px(self.at)?, px(self.moved)? * time])
    }

    /// RMS end-point error of the valid ones of `vectors`, and the share of them that has a truth; `None` if
    /// a size of the image is needed and unknown.
    fn rms_px(
        &self,
        vectors: &[&FlowVector],
        (field, sum_px): (&Field, Option<f64>),
        grid: &TrueField,
        facts: &RecordingFacts,
    ) -> Option<(f64, f64)> {
        let [length, moved] = self.factors(facts)?;
        let shift = field.placement.shift_px;
        let scaled = |axis: usize, at: f64| (at - shift[axis]) * length + shift[axis];
        let sum_y = match self.axes {
            Axes::Y | Axes::Both if self.at.is_some() => {
                // The sum of positions in the file, or that of the image, which has no other scale.
                let is_grid = field.placement.reversal == Reversal::Grid;
                sum_px.map(|sum| if is_grid { (sum - 2.0 * shift[1]) * length + 2.0 * shift[1] } else { sum })
            }
            _ => sum_px,
        };
        let sum_x = facts.sensor_px.map(|(width, _)| field.placement.reversed_px(0, width));
        let (is_x, is_y) =
            (matches!(self.axes, Axes::X | Axes::Both), matches!(self.axes, Axes::Y | Axes::Both));
        let reverse = |at: f64, is_reversed: bool, sum: Option<f64>| {
            if is_reversed { sum.map(|sum| sum - at) } else { Some(at) }
        };
        let (mut n, mut squares) = (0.0, 0.0);
        for v in vectors {
            let at = Position {
                x_px: reverse(scaled(0, v.at.x_px), is_x, sum_x)?,
                y_px: reverse(scaled(1, v.at.y_px), is_y, sum_y)?,
                ..v.at
            };
            let sign = |is_reversed: bool| if is_reversed { -moved } else { moved };
            let [u, w] = [v.moved[0] * sign(is_x), v.moved[1] * sign(is_y || self.axes == Axes::V)];
            if let Some([x, y, _]) = grid.at(&FlowVector { at, ..**v }) {
                (n, squares) = (n + 1.0, squares + (u - x).powi(2) + (w - y).powi(2));
            }
        }
        Some(((squares / n).sqrt(), n / vectors.len() as f64))
    }

    /// The question, changes to the file, and the options that read it so.
    fn words(&self, field: &Field, facts: &RecordingFacts) -> (String, Vec<String>, Vec<Named>) {
        let unit = |k: Option<usize>| k.map_or("px", |k| LENGTHS[k].0);
        let per = if self.is_per_s { "/s" } else { "" };
        let (mut asked, mut changes, mut options) = (Vec::new(), Vec::new(), Vec::new());
        if self.at.is_some() || self.moved.is_some() || self.is_per_s {
            asked.push(match self.at {
                None => format!("u and v in {}{per}", unit(self.moved)),
                at => format!("x and y in {}, u and v in {}{per}", unit(at), unit(self.moved)),
            });
            let (um, dt) = (facts.um_per_px.unwrap_or(1.0), facts.dt_s.unwrap_or(1.0));
            let has_options = !field.placement.is_stated && self.at == self.moved;
            let um_is_used = self.at.is_some() || self.moved.is_some();
            if has_options {
                options.extend(um_is_used.then(|| option("um_per_px").of(um)));
                options.extend(self.is_per_s.then(|| option("dt_s").of(dt)));
            } else if let Some([length, moved]) = self.factors(facts) {
                changes.push(format!("multiply x and y by {length} and u and v by {moved}"));
            }
        }
        let y = if field.placement.is_y_up { "down" } else { "up" };
        asked.extend(match self.axes {
            Axes::Kept => None,
            Axes::Y => Some(format!("y grows {y}ward")),
            Axes::V => Some("v has the wrong sign".to_owned()),
            Axes::X => Some("x grows to the left".to_owned()),
            Axes::Both => Some(format!("x grows to the left and y {y}ward")),
        });
        match self.axes {
            Axes::V => changes.push("write v with the other sign".to_owned()),
            Axes::X | Axes::Both => changes.push("write x and u to the right".to_owned()),
            Axes::Kept | Axes::Y => {}
        }
        options.extend(matches!(self.axes, Axes::Y | Axes::Both).then(|| option("y").is(y)));
        (format!("{}?", asked.join("; ")), changes, options)
    }
}

/// The reading in other units or with reversed axes that fits much better than that of the result, if any.
fn other_reading(field: &Field, grid: &TrueField, facts: &RecordingFacts) -> Option<Hint> {
    /// Number of vectors for which all readings are tried.
    const SAMPLE: usize = 2000;
    let valid: Vec<&FlowVector> = field.vectors.iter().filter(|v| v.flag == 0).collect();
    if valid.len() < FEWEST {
        return None;
    }
    let height = facts.sensor_px.map(|(_, height)| height);
    let of = (field, field.placement.sum_px(&field.vectors, height));
    let sample: Vec<&FlowVector> = valid.iter().copied().step_by(valid.len().div_ceil(SAMPLE)).collect();
    let now = Reading { at: None, moved: None, is_per_s: false, axes: Axes::Kept };
    // A field within two pixels is in another unit, whatever its error.
    let range = |of: fn(&Position) -> f64| {
        let values = || valid.iter().map(|v| of(&v.at));
        values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min)
    };
    let is_tiny = range(|at| at.x_px) < 2.0 && range(|at| at.y_px) < 2.0;
    // Fewer than half of the vectors in the image tell nothing.
    let error = |reading: &Reading, vectors: &[&FlowVector]| {
        let (rms, share) = reading.rms_px(vectors, of, grid, facts)?;
        (share >= 0.5 && !(reading.at.is_none() && is_tiny)).then_some(rms)
    };
    let mut best: Option<(Reading, f64)> = None;
    for reading in Reading::all() {
        let Some(rms) = error(&reading, &sample) else { continue };
        // More changes need a clearly smaller error.
        if best.is_none_or(|(_, least)| rms < 0.5 * least) {
            best = Some((reading, rms));
        }
    }
    let (reading, _) = best.filter(|(reading, _)| *reading != now)?;
    let (after, before) = (error(&reading, &valid)?, error(&now, &valid));
    let spread = (valid.iter().filter_map(|v| grid.at(v)).map(|[u, v, _]| u * u + v * v).sum::<f64>()
        / valid.len() as f64)
        .sqrt();
    // No better than zeros: another dataset.
    if before.is_none() && spread > 0.0 && after > 2.0 * spread
        || before.is_some_and(|before| after > 0.5 * before)
    {
        return None;
    }
    let (question, changes, options) = reading.words(field, facts);
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
    /// Errors below this are those of noise in small displacements, px.
    const LARGE_PX: f64 = 0.5;
    let median = |of: &dyn Fn(&ComparedVector) -> f64| {
        let mut values: Vec<f64> = compared.iter().map(of).filter(|v| v.is_finite()).collect();
        values.sort_unstable_by(f64::total_cmp);
        quantile(&values, 0.5)
    };
    let (error, moved) = (median(&|c| c.endpoint())?, median(&|c| c.truth[0].hypot(c.truth[1]))?);
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
