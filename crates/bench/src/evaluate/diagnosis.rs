//! What looks like a mistake of conventions rather than of a tracker: origin, first frame, axes.

use super::cloud::{Cloud, Loose, Point, Position};
use super::detection::{Detection, error};
use super::gate::Gate;
use super::matching::{Cost, optimal};
use super::neighbours::near;
use super::truth::Truth;
use crate::error::Result;

/// Frames that hypotheses are tried on.
const FRAMES: usize = 50;

/// Points that they are tried on.
const POINTS: usize = 20_000;

/// Warnings about a result, from its scores and from trying other conventions on some of its frames.
///
/// # Errors
/// A gate that is too wide.
pub fn warnings(
    truth: &Truth,
    clouds: (&Cloud, &Cloud),
    score: &Detection,
    gate: &Gate,
) -> Result<Vec<String>> {
    let mut warnings = Vec::new();
    if let (Some(x), Some(y)) = (score.bias_x_px, score.bias_y_px) {
        for size in [0.5, 1.0] {
            if (x.abs() - size).abs() <= 0.1 && (y.abs() - size).abs() <= 0.1 {
                warnings.push(format!(
                    "origin mismatch? bias is ({x:+.3}, {y:+.3}) px; --origin tells where the first pixel's centre is"
                ));
            }
        }
    }
    let (t, r) = (sample(clouds.0), sample(clouds.1));
    if t.is_empty() || r.is_empty() {
        return Ok(warnings);
    }
    let whole = t.len() == clouds.0.len() && r.len() == clouds.1.len();
    let (f1, rms) = match (score.f1, score.rmse_xy_px) {
        (Some(f1), Some(rms)) if whole => (f1, rms),
        _ => quality(&t, &r, gate)?,
    };
    let mut tried = |what: String, other: Vec<Loose>| {
        let (other_f1, other_rms) = quality(&t, &Cloud::new(other), gate)?;
        // Better by far, or as good with far smaller errors.
        if other_f1 > f1 + 0.1 || (other_f1 > f1 - 0.02 && other_f1 > 0.5 && other_rms < 0.5 * rms) {
            warnings
                .push(format!("{what} F1 would be {other_f1:.3} instead of {f1:.3} (on a sample of frames)"));
        }
        Ok::<(), crate::Error>(())
    };
    for (shift, base) in [(1i64, -1), (-1, 1)] {
        let moved = |p: &Point| {
            let frame = u32::try_from(i64::from(p.frame) + shift).ok()?;
            Some(Loose { frame, ..loose(p) })
        };
        let what = format!(
            "frames off by one? With --frame-base {} than now",
            if base > 0 { "one more" } else { "one less" }
        );
        tried(what, r.points.iter().filter_map(moved).collect())?;
    }
    if f1 < 0.5 {
        let swapped = |p: &Point| {
            let at = Position { x_px: p.at.y_px, y_px: p.at.x_px, ..p.at };
            Loose { at, ..loose(p) }
        };
        tried("axes swapped? With x and y exchanged".to_owned(), r.points.iter().map(swapped).collect())?;
        if let Some((_, height)) = truth.facts.sensor_px {
            let flipped = |p: &Point| {
                let at = Position { y_px: height + 1.0 - p.at.y_px, ..p.at };
                Loose { at, ..loose(p) }
            };
            tried("y upward? With --y up".to_owned(), r.points.iter().map(flipped).collect())?;
        }
    }
    Ok(warnings)
}

/// The shift of the whole result, px, and F1 without it: what `--auto-offset` reports. `None` if nothing is near.
///
/// # Errors
/// A gate that is too wide.
pub fn offset(clouds: (&Cloud, &Cloud), gate: &Gate) -> Result<Option<([f64; 2], f64)>> {
    const REACH_PX: f64 = 12.0;
    const CELLS: usize = 48;
    let (t, r) = (sample(clouds.0), sample(clouds.1));
    let wide = Gate::radial(REACH_PX);
    // Right pairs share one difference, wrong ones spread evenly: the fullest cell holds the shift.
    let mut differences = Vec::new();
    for (_, a, b) in super::cloud::side_by_side(&t, &r) {
        let (a, b) = (&t.points[a], &r.points[b]);
        differences.extend(near(a, b, &wide, 1.0).iter().map(|n| {
            let (p, q) = (&a[n.truth as usize].at, &b[n.result as usize].at);
            [q.x_px - p.x_px, q.y_px - p.y_px]
        }));
    }
    let cell = |v: f64| (((v + REACH_PX) / (2.0 * REACH_PX) * CELLS as f64) as usize).min(CELLS - 1);
    let mut counts = vec![0u32; CELLS * CELLS];
    differences.iter().for_each(|d| counts[cell(d[1]) * CELLS + cell(d[0])] += 1);
    let Some(fullest) = (0..counts.len()).rev().max_by_key(|&i| counts[i]).filter(|&i| counts[i] > 0) else {
        return Ok(None);
    };
    let centre = |k: usize| (k as f64 + 0.5) * 2.0 * REACH_PX / CELLS as f64 - REACH_PX;
    let mut shift = [centre(fullest % CELLS), centre(fullest / CELLS)];
    for _ in 0..3 {
        let close: Vec<&[f64; 2]> = differences
            .iter()
            .filter(|d| (d[0] - shift[0]).abs() < 0.75 && (d[1] - shift[1]).abs() < 0.75)
            .collect();
        let n = close.len().max(1) as f64;
        shift = [0, 1].map(|k| close.iter().map(|d| d[k]).sum::<f64>() / n);
    }
    let moved = |p: &Point| {
        let at = Position { x_px: p.at.x_px - shift[0], y_px: p.at.y_px - shift[1], ..p.at };
        Loose { at, ..loose(p) }
    };
    let (f1, _) = quality(&t, &Cloud::new(r.points.iter().map(moved).collect()), gate)?;
    Ok(Some((shift, f1)))
}

/// F1 and the root mean square distance in the image plane.
fn quality(truth: &Cloud, result: &Cloud, gate: &Gate) -> Result<(f64, f64)> {
    let matching = optimal(truth, result, gate, Cost::Squares)?;
    let errors: Vec<[f64; 3]> = matching.pairs().map(|p| error(truth, result, p)).collect();
    let n = errors.len() as f64;
    let squares: f64 = errors.iter().map(|e| e[0] * e[0] + e[1] * e[1]).sum();
    let f1 = 2.0 * n / (truth.len() + result.len()).max(1) as f64;
    Ok((f1, if n > 0.0 { (squares / n).sqrt() } else { f64::INFINITY }))
}

/// The first frames of a cloud.
fn sample(cloud: &Cloud) -> Cloud {
    let mut end = 0;
    for (_, range) in cloud.frames.iter().take(FRAMES) {
        if end > 0 && range.end > POINTS {
            break;
        }
        end = range.end;
    }
    Cloud::new(cloud.points[..end].iter().map(loose).collect())
}

fn loose(p: &Point) -> Loose {
    Loose { frame: p.frame, track: Some((i64::from(p.track), 0)), at: p.at, source: p.source }
}
