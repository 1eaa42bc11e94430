//! Detects probable mistakes of convention in a field: sign of v, origin of the positions.

use super::compared::{ComparedVector, INLIER_PX};
use super::true_field::{TrueField, TrueFields};
use crate::evaluate::hint::Hint;
use crate::evaluate::statistics::quantile;
use crate::results::{FlowVector, Position};

/// Smallest number of vectors for which hints are given.
const FEWEST: usize = 10;

/// Probable mistakes, each with the RMS error it would have without the mistake.
pub(super) fn hints(vectors: &[FlowVector], compared: &[ComparedVector], truth: &TrueFields) -> Vec<Hint> {
    if vectors.is_empty() {
        let what = "the result is empty: no vector is scored; was it written to another file?";
        return vec![Hint::new(what, "")];
    }
    if compared.len() < FEWEST {
        return Vec::new();
    }
    let rms = |all: &[ComparedVector]| {
        (all.iter().map(|c| c.endpoint().powi(2)).sum::<f64>() / all.len() as f64).sqrt()
    };
    let now = rms(compared);
    let flipped: Vec<ComparedVector> = compared
        .iter()
        .map(|c| {
            let [u, v, w] = c.measured.moved;
            ComparedVector { measured: FlowVector { moved: [u, -v, w], ..c.measured }, ..*c }
        })
        .collect();
    let mut hints = Vec::new();
    if rms(&flipped) < 0.5 * now {
        let detail = format!(
            "y may grow upward in the result; with y upward the RMS end-point error would be {:.3} instead of {now:.3} px",
            rms(&flipped)
        );
        let hint = Hint::new("v has the wrong sign?", &detail);
        hints.push(Hint { rms_px: Some(rms(&flipped)), rms_px_now: Some(now), ..hint });
    }
    hints.extend(no_better_than_zeros(compared).filter(|_| hints.is_empty()));
    // Splines between the nodes suffice for gradients.
    let shift = truth.fields.first().and_then(|(_, grid)| offset(compared, grid));
    let Some((shift, sure)) = shift else { return hints };
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
            let option = match by {
                0.5 => "; origin corner0 is right for a single pass of OpenPIV",
                1.0 => "; origin center0",
                _ => "",
            };
            let detail = format!(
                "The flow gradients indicate ({:+.2}, {:+.2}) px{option}: the RMS end-point error of inliers would be {after:.4} \
                 instead of {before:.4} px",
                shift[0], shift[1]
            );
            let hint = Hint::new(format!("positions off by {by:+} px?"), &detail);
            hints.push(Hint { rms_px: Some(after), rms_px_now: Some(before), ..hint });
        }
    }
    hints
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
