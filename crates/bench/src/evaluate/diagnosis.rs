//! What looks like a mistake of conventions rather than of a tracker: origin, first frame, axes.

use super::cloud::side_by_side;
use super::detection::{Detection, error};
use super::gate::Gate;
use super::matching::{Cost, optimal};
use super::neighbours::near;
use super::truth::{Scored, Truth};
use crate::error::Result;
use crate::results::{Points, Position, Row};

/// Frames that hypotheses are tried on.
const FRAMES: usize = 50;

/// Points that they are tried on.
const POINTS: usize = 20_000;

/// The first frames of truth and result, on which other conventions are tried.
#[derive(Debug, Clone)]
pub struct Diagnosis<'a> {
    truth: Truth,
    rows: &'a [Row],
    /// The first frame that is not tried.
    end: u32,
    /// Whether no frame is left out.
    is_whole: bool,
    gate: Gate,
    flat: bool,
    border_px: f64,
}

/// How good a result is.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Quality {
    f1: f64,
    /// Root mean square distance in the image plane, px.
    rms_px: f64,
}

impl<'a> Diagnosis<'a> {
    /// Prepares for a result that is scored with these options.
    pub fn new(truth: &Truth, result: &'a Points, gate: &Gate, flat: bool, border_px: f64) -> Self {
        let mut sizes = std::collections::BTreeMap::<u32, usize>::new();
        truth.rows.iter().for_each(|row| *sizes.entry(row.frame).or_default() += 1);
        for row in &result.rows {
            sizes.entry(row.frame).and_modify(|n| *n += 1);
        }
        let (mut end, mut points) = (0, 0);
        for (i, (frame, n)) in sizes.iter().enumerate() {
            points += n;
            if i > 0 && (i == FRAMES || points > 2 * POINTS) {
                break;
            }
            end = frame.saturating_add(1);
        }
        let is_whole = truth.rows.iter().chain(&result.rows).all(|row| row.frame < end);
        Diagnosis {
            truth: truth.before(end),
            rows: &result.rows,
            end,
            is_whole,
            gate: *gate,
            flat,
            border_px,
        }
    }

    /// Warnings about a result, from its scores and from trying other conventions.
    ///
    /// # Errors
    /// A gate that is too wide.
    pub fn warnings(&self, score: &Detection) -> Result<Vec<String>> {
        let mut warnings: Vec<String> = origin(score).into_iter().collect();
        let is_empty = self.truth.rows.is_empty() || self.rows.is_empty();
        if is_empty {
            return Ok(warnings);
        }
        let now = match (score.f1, score.rmse_xy_px) {
            (Some(f1), Some(rms_px)) if self.is_whole => Quality { f1, rms_px },
            _ => self.quality(&|row| Some(*row))?,
        };
        let mut tried = |what: &str, convention: &dyn Fn(&Row) -> Option<Row>| {
            let other = self.quality(convention)?;
            // Better by far, or as good with far smaller errors.
            let is_as_good = other.f1 > now.f1 - 0.02 && other.f1 > 0.5;
            if other.f1 > now.f1 + 0.1 || (is_as_good && other.rms_px < 0.5 * now.rms_px) {
                let sample = if self.is_whole { "" } else { " (on a sample of frames)" };
                warnings.push(format!("{what} F1 would be {:.3} instead of {:.3}{sample}", other.f1, now.f1));
            }
            Ok::<(), crate::Error>(())
        };
        for (shift, base) in [(1i64, "one less"), (-1, "one more")] {
            tried(&format!("frames off by one? With --frame-base {base} than now"), &|row| {
                let frame = u32::try_from(i64::from(row.frame) + shift).ok()?;
                Some(Row { frame, ..*row })
            })?;
        }
        if now.f1 < 0.5 {
            let moved = |row: &Row, at: Position| Some(Row { at, ..*row });
            tried("axes swapped? With x and y exchanged", &|row| {
                moved(row, Position { x_px: row.at.y_px, y_px: row.at.x_px, ..row.at })
            })?;
            if let Some((_, height)) = self.truth.facts.sensor_px {
                tried("y upward? With --y up", &|row| {
                    moved(row, Position { y_px: height + 1.0 - row.at.y_px, ..row.at })
                })?;
            }
        }
        Ok(warnings)
    }

    /// The shift of the whole result, px, and F1 without it: what `--auto-offset` reports. `None` if nothing is near.
    ///
    /// # Errors
    /// A gate that is too wide.
    pub fn offset(&self) -> Result<Option<([f64; 2], f64)>> {
        let Some(shift) = self.commonest_difference()? else { return Ok(None) };
        let without = self.quality(&|row| {
            let at = Position { x_px: row.at.x_px - shift[0], y_px: row.at.y_px - shift[1], ..row.at };
            Some(Row { at, ..*row })
        })?;
        Ok(Some((shift, without.f1)))
    }

    /// By how much most results lie beside true particles, px.
    fn commonest_difference(&self) -> Result<Option<[f64; 2]>> {
        const REACH_PX: f64 = 12.0;
        const CELLS: usize = 48;
        let Scored { truth, result, .. } = self.scored(&|row| Some(*row))?;
        let wide = Gate::radial(REACH_PX);
        // Right pairs share one difference, wrong ones spread evenly: the fullest cell holds the shift.
        let mut differences = Vec::new();
        for (_, a, b) in side_by_side(&truth, &result) {
            let (a, b) = (&truth.points[a], &result.points[b]);
            differences.extend(near(a, b, &wide, 1.0).iter().map(|n| {
                let (p, q) = (&a[n.truth as usize].at, &b[n.result as usize].at);
                [q.x_px - p.x_px, q.y_px - p.y_px]
            }));
        }
        let cell = |v: f64| (((v + REACH_PX) / (2.0 * REACH_PX) * CELLS as f64) as usize).min(CELLS - 1);
        let mut counts = vec![0u32; CELLS * CELLS];
        differences.iter().for_each(|d| counts[cell(d[1]) * CELLS + cell(d[0])] += 1);
        let fullest = (0..counts.len()).rev().max_by_key(|&i| counts[i]).filter(|&i| counts[i] > 0);
        let Some(fullest) = fullest else { return Ok(None) };
        let centre = |k: usize| (k as f64 + 0.5) * 2.0 * REACH_PX / CELLS as f64 - REACH_PX;
        let mut shift = [centre(fullest % CELLS), centre(fullest / CELLS)];
        for _ in 0..3 {
            let is_close = |d: &&[f64; 2]| (d[0] - shift[0]).abs() < 0.75 && (d[1] - shift[1]).abs() < 0.75;
            let close: Vec<&[f64; 2]> = differences.iter().filter(is_close).collect();
            let n = close.len().max(1) as f64;
            shift = [0, 1].map(|k| close.iter().map(|d| d[k]).sum::<f64>() / n);
        }
        Ok(Some(shift))
    }

    /// How good the result would be under another convention.
    fn quality(&self, convention: &dyn Fn(&Row) -> Option<Row>) -> Result<Quality> {
        let Scored { truth, result, .. } = self.scored(convention)?;
        let matching = optimal(&truth, &result, &self.gate, Cost::Squares)?;
        let errors: Vec<[f64; 3]> = matching.pairs().map(|p| error(&truth, &result, p)).collect();
        let n = errors.len() as f64;
        let squares: f64 = errors.iter().map(|e| e[0] * e[0] + e[1] * e[1]).sum();
        let f1 = 2.0 * n / (truth.len() + result.len()).max(1) as f64;
        Ok(Quality { f1, rms_px: if n > 0.0 { (squares / n).sqrt() } else { f64::INFINITY } })
    }

    /// What would be scored: under another convention other points belong to particles that are not.
    fn scored(&self, convention: &dyn Fn(&Row) -> Option<Row>) -> Result<Scored> {
        let rows = self.rows.iter().filter_map(convention).filter(|row| row.frame < self.end).collect();
        let points = Points { rows, ..Points::default() };
        self.truth.scored(&points, &self.gate, self.flat, self.border_px)
    }
}

/// A bias of half a pixel or one along both axes.
fn origin(score: &Detection) -> Option<String> {
    let (x, y) = score.bias_x_px.zip(score.bias_y_px)?;
    let is = |size: f64| (x.abs() - size).abs() <= 0.1 && (y.abs() - size).abs() <= 0.1;
    (is(0.5) || is(1.0)).then(|| {
        format!(
            "origin mismatch? bias is ({x:+.3}, {y:+.3}) px; --origin tells where the first pixel's centre is"
        )
    })
}
