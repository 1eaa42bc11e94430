//! Detects probable mistakes of convention in a result: origin, first frame, axes, units; and a result that
//! matches no more particles than points at random positions would.

use super::detection::{Detection, error};
use super::gate::Gate;
use super::hint::Hint;
use super::matching::{Cost, optimal};
use super::neighbors::neighbor_pairs;
use super::statistics::quantile;
use super::track_set::side_by_side;
use super::truth::{Region, ScoredPoints, TrueParticles};
use crate::results::{Points, Position, TrackRow};
use storage::error::Result;

/// Maximum number of frames on which other conventions are tried.
const FRAMES: usize = 50;

/// Another convention is suspected if it reduces the RMS error below this fraction.
const FAR_SMALLER: f64 = 0.5;

/// Approximate maximum number of points (of truth and of result) on which other conventions are tried.
const POINTS: usize = 20_000;

/// The first frames of truth and result, on which other conventions are tried.
#[derive(Debug, Clone)]
pub struct ConventionCheck<'a> {
    truth: TrueParticles,
    rows: &'a [TrackRow],
    /// The first frame beyond the sample.
    end: u32,
    /// Whether the sample is the whole result.
    is_whole: bool,
    /// Whether the result has no row at all.
    is_empty: bool,
    gate: Gate,
    flat: bool,
    region: Region,
}

/// The hint for a result without rows.
const NOTHING: &str = "the result is empty: every particle counts as missed, and errors are undefined; was it written to another file?";

/// A result with a higher F1 is not compared with points at random positions.
const HARDLY_CHANCE: f64 = 0.8;

/// Scores by which conventions are compared.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Quality {
    matches: f64,
    f1: f64,
    /// Root mean square distance in the image plane, px.
    rms_px: f64,
    /// Root mean square error of z, um.
    rms_z_um: f64,
}

/// An alternative convention: maps a row as it was read to the row it would be under that convention; `None`
/// if its frame would be negative.
type Convention<'a> = Box<dyn Fn(&TrackRow) -> Option<TrackRow> + 'a>;

/// A probable mistake: a question, how the result would be read without it, and that reading.
type Suspect<'a> = (String, String, Convention<'a>);

impl<'a> ConventionCheck<'a> {
    /// Takes a sample of frames from truth and result; the arguments are those the result is scored with.
    pub fn new(truth: &TrueParticles, result: &'a Points, gate: &Gate, flat: bool, region: Region) -> Self {
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
        ConventionCheck {
            truth: truth.before(end),
            rows: &result.rows,
            end,
            is_whole,
            is_empty: result.rows.is_empty() && result.n_nan == 0,
            gate: *gate,
            flat,
            region,
        }
    }

    /// Probable mistakes: from each family of conventions the one that would score best, if it is much better
    /// than the result as read.
    ///
    /// # Errors
    /// A gate that is too wide.
    pub fn hints(&self, score: &Detection) -> Result<Vec<Hint>> {
        if self.truth.rows.is_empty() {
            return Ok(Vec::new());
        }
        if self.is_empty {
            return Ok(vec![Hint::new(NOTHING, "")]);
        }
        if self.rows.is_empty() {
            return Ok(Vec::new());
        }
        let now = match (score.f1, score.rmse_xy_px) {
            (Some(f1), Some(rms_px)) if self.is_whole => {
                let matches = score.tp as f64;
                Quality { matches, f1, rms_px, rms_z_um: score.rmse_z_um.unwrap_or(0.0) }
            }
            _ => self.quality(&|row| Some(*row))?,
        };
        let mut hints = Vec::new();
        let bias = score.bias_x_px.zip(score.bias_y_px);
        for family in [self.frames(), self.axes(), self.lengths()] {
            hints.extend(self.best(family, now, false, FAR_SMALLER)?);
        }
        // A bias of almost exactly 0.5 or 1 px along both axes is suspicious regardless of the random error.
        let is = |size: f64| bias.is_some_and(|(x, y)| [x, y].iter().all(|b| (b.abs() - size).abs() <= 0.1));
        let share = if is(0.5) || is(1.0) { 1.0 } else { FAR_SMALLER };
        hints.extend(self.best(self.origins(bias), now, false, share)?);
        if !self.flat
            && let Some(depths) = self.depths()?
        {
            hints.extend(self.best(vec![depths], now, true, FAR_SMALLER)?);
        }
        hints.sort_by(|a, b| b.f1.partial_cmp(&a.f1).unwrap_or(std::cmp::Ordering::Equal));
        if hints.is_empty() && now.f1 < HARDLY_CHANCE {
            hints.extend(self.chance(now)?);
        }
        Ok(hints)
    }

    /// A hint if the result matches no more particles than it would at random positions.
    ///
    /// Its points are shifted across the image, around its edges, so that their number, clusters, tracks and
    /// depths stay the same.
    fn chance(&self, now: Quality) -> Result<Option<Hint>> {
        // The eight shifts by thirds of the image.
        let shifts = (1..9).map(|k| [f64::from(k / 3), f64::from(k % 3)].map(|part| part / 3.0));
        let [low, high] = self.extent();
        let wrapped = |v: f64, low: f64, size: f64, part: f64| low + (v - low + part * size).rem_euclid(size);
        let (mut sum, mut squares) = (0.0, 0.0);
        for [across, down] in shifts {
            let at_random = self.quality(&placed(move |at| Position {
                x_px: wrapped(at.x_px, low[0], high[0] - low[0], across),
                y_px: wrapped(at.y_px, low[1], high[1] - low[1], down),
                ..*at
            }))?;
            sum += at_random.matches;
            squares += at_random.matches.powi(2);
        }
        let mean = sum / 8.0;
        // Points of a track match together, so the variance may exceed that of a Poisson process.
        let variance = (squares / 8.0 - mean * mean).max(mean).max(0.1);
        if now.matches > mean + 3.0 * variance.sqrt() {
            return Ok(None);
        }
        let n = self.rows.iter().filter(|row| row.frame < self.end).count();
        let detail = format!(
            "{} of {n} points match a particle, no more than at random positions ({mean:.1}); an estimated offset would show a \
             shift in the image",
            now.matches
        );
        let question =
            "is this the result of another dataset, or does it use another origin, unit or first frame?";
        let mut hint = Hint::new(question, &detail);
        (hint.f1_now, hint.sampled) = (Some(now.f1), !self.is_whole);
        Ok(Some(hint))
    }

    /// The corners of the image, or of the truth if its size is unknown, px.
    fn extent(&self) -> [[f64; 2]; 2] {
        if let Some((width, height)) = self.truth.facts.sensor_px {
            return [[0.5; 2], [width + 0.5, height + 0.5]];
        }
        let mut ends = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
        for row in &self.truth.rows {
            for (k, v) in [row.at.x_px, row.at.y_px].into_iter().enumerate() {
                (ends[0][k], ends[1][k]) = (ends[0][k].min(v - 0.5), ends[1][k].max(v + 0.5));
            }
        }
        ends
    }

    /// The best of these conventions, if its F1 is higher by 0.1, or if its F1 is similar and its RMS error
    /// is below `share` times the present one.
    fn best(
        &self,
        family: Vec<Suspect<'_>>,
        now: Quality,
        of_depth: bool,
        share: f64,
    ) -> Result<Option<Hint>> {
        let mut best: Option<(Quality, [String; 2])> = None;
        for (question, how, convention) in family {
            let other = self.quality(&convention)?;
            let is_as_good = other.f1 > now.f1 - 0.02 && other.f1 > 0.5;
            let has_smaller_errors = match of_depth {
                true => other.rms_z_um < share * now.rms_z_um,
                false => other.rms_px < share * now.rms_px,
            };
            let is_better = other.f1 > now.f1 + 0.1 || (is_as_good && has_smaller_errors);
            let rank = |q: &Quality| (q.f1 * 1e3).round() - q.rms_px.min(100.0) / 1e3;
            if is_better && best.as_ref().is_none_or(|(b, _)| rank(b) < rank(&other)) {
                best = Some((other, [question, how]));
            }
        }
        Ok(best.map(|(other, [question, how])| {
            let sample = if self.is_whole { "" } else { " (on a sample of frames)" };
            let shown = |v: f64| if v.is_finite() { format!("{v:.3}") } else { "-".to_owned() };
            let errors = match of_depth {
                true => format!("RMS z {} instead of {} um", shown(other.rms_z_um), shown(now.rms_z_um)),
                false => format!("RMS xy {} instead of {} px", shown(other.rms_px), shown(now.rms_px)),
            };
            let detail =
                format!("{how} F1 would be {:.3} instead of {:.3}, {errors}{sample}", other.f1, now.f1);
            Hint {
                f1: Some(other.f1),
                f1_now: Some(now.f1),
                rms_px: Some(other.rms_px).filter(|v| v.is_finite()),
                rms_px_now: Some(now.rms_px).filter(|v| v.is_finite()),
                sampled: !self.is_whole,
                ..Hint::new(question, &detail)
            }
        }))
    }

    /// First frame off by one.
    fn frames(&self) -> Vec<Suspect<'_>> {
        let moved = |by: i64, base: &str| {
            let how = format!("With the number of the first frame {base} by one");
            let convention: Convention<'_> = Box::new(move |row| {
                let frame = u32::try_from(i64::from(row.frame) + by).ok()?;
                Some(TrackRow { frame, ..*row })
            });
            ("frames off by one?".to_owned(), how, convention)
        };
        vec![moved(1, "decreased"), moved(-1, "increased")]
    }

    /// Another position of the first pixel's center.
    fn origins(&self, bias: Option<(f64, f64)>) -> Vec<Suspect<'_>> {
        let bias = bias.map_or(String::new(), |(x, y)| format!("bias is ({x:+.3}, {y:+.3}) px; "));
        let shifted = |by: f64| {
            let how = format!(
                "{bias}the origin is the position of the first pixel's center; with x and y moved by {by:+} px"
            );
            (
                "origin mismatch?".to_owned(),
                how,
                placed(move |at| Position { x_px: at.x_px + by, y_px: at.y_px + by, ..*at }),
            )
        };
        [-1.0, -0.5, 0.5, 1.0].map(shifted).into()
    }

    /// Axes swapped or reversed.
    fn axes(&self) -> Vec<Suspect<'_>> {
        let mut family = vec![(
            "axes swapped?".to_owned(),
            "With x and y exchanged".to_owned(),
            placed(|at| Position { x_px: at.y_px, y_px: at.x_px, ..*at }),
        )];
        if let Some((width, height)) = self.truth.facts.sensor_px {
            family.push((
                "y upward?".to_owned(),
                "With y reversed".to_owned(),
                placed(move |at| Position { y_px: height + 1.0 - at.y_px, ..*at }),
            ));
            family.push((
                "x from the right?".to_owned(),
                "With x reversed".to_owned(),
                placed(move |at| Position { x_px: width + 1.0 - at.x_px, ..*at }),
            ));
            family.push((
                "image turned by 180 degrees?".to_owned(),
                "With x and y reversed".to_owned(),
                placed(move |at| Position {
                    x_px: width + 1.0 - at.x_px,
                    y_px: height + 1.0 - at.y_px,
                    ..*at
                }),
            ));
        }
        family
    }

    /// x and y in um, mm or m, from the first pixel or from the image center.
    fn lengths(&self) -> Vec<Suspect<'_>> {
        let Some(um_per_px) = self.truth.facts.um_per_px else { return Vec::new() };
        let mut family = Vec::new();
        for (unit, um) in [("um", 1.0), ("mm", 1e3), ("m", 1e6)] {
            let scale = um / um_per_px;
            let mut origins = vec![("from the first pixel's center at 0", [1.0, 1.0])];
            if let Some((width, height)) = self.truth.facts.sensor_px {
                origins.push(("from the middle of the image", [0.5 * (width + 1.0), 0.5 * (height + 1.0)]));
            }
            for (origin, [x0, y0]) in origins {
                family.push((
                    format!("x and y in {unit}?"),
                    format!("With x_px = x {scale:.6} + {x0}, y_px = y {scale:.6} + {y0} ({origin})"),
                    placed(move |at| Position {
                        x_px: at.x_px * scale + x0,
                        y_px: at.y_px * scale + y0,
                        ..*at
                    }),
                ));
            }
        }
        family
    }

    /// z with another sign, origin or unit: a line fitted to true against measured depths of particles
    /// matched only in the image plane. `None` if there are too few, or no line fits.
    fn depths(&self) -> Result<Option<Suspect<'_>>> {
        const FEWEST: usize = 10;
        let ScoredPoints { truth, result, .. } =
            self.scored_by(&Gate::radial(self.gate.xy_px), &|row| Some(*row))?;
        let matching = optimal(&truth, &result, &Gate::radial(self.gate.xy_px), Cost::Squares)?;
        let pairs: Vec<[f64; 2]> =
            matching.pairs().map(|(t, r)| [result.points[r].at.z_um, truth.points[t].at.z_um]).collect();
        if pairs.len() < FEWEST {
            return Ok(None);
        }
        let Some((a, b)) = robust_line(&pairs) else { return Ok(None) };
        let h = self.truth.facts.depth_h_um();
        let near = |value: f64| (a / value - 1.0).abs() < 0.05;
        let (question, a, b) = match () {
            () if near(1.0) => ("z from another origin?", 1.0, median_offset(&pairs, 1.0)),
            () if near(-1.0) => ("z with the other sign?", -1.0, median_offset(&pairs, -1.0)),
            () if near(1e3) => ("z in mm?", 1e3, median_offset(&pairs, 1e3)),
            () if near(-1e3) => ("z in mm with the other sign?", -1e3, median_offset(&pairs, -1e3)),
            () if near(1e6) => ("z in m?", 1e6, median_offset(&pairs, 1e6)),
            () if h.is_some_and(&near) => ("z as a fraction of the depth range?", a, b),
            () if (0.1..=10.0).contains(&a.abs()) => ("z scaled (refraction, or a depth factor)?", a, b),
            // Depths of chance matches are unrelated: the line is flat, and moves all points to the mean depth.
            () => return Ok(None),
        };
        let small = 1e-3 * h.unwrap_or(0.0);
        let sum = match (a == 1.0, b.abs() > small) {
            (true, _) => format!("z {b:+.3}"),
            (false, true) => format!("{a:.4} z {b:+.3}"),
            (false, false) => format!("{a:.4} z"),
        };
        let b = if a != 1.0 && b.abs() <= small { 0.0 } else { b };
        Ok(Some((
            question.to_owned(),
            format!("With z_um = {sum}"),
            placed(move |at| Position { z_um: a * at.z_um + b, ..*at }),
        )))
    }

    /// The shift of the whole result, px, and F1 without it, as reported by `--auto-offset`. `None` if no
    /// result point is near a true one.
    ///
    /// # Errors
    /// A gate that is too wide.
    pub fn offset(&self) -> Result<Option<([f64; 2], f64)>> {
        let Some(shift) = self.commonest_difference()? else { return Ok(None) };
        let without = self.quality(&|row| {
            let at = Position { x_px: row.at.x_px - shift[0], y_px: row.at.y_px - shift[1], ..row.at };
            Some(TrackRow { at, ..*row })
        })?;
        Ok(Some((shift, without.f1)))
    }

    /// The most frequent displacement from a nearby true particle to a result point, px.
    fn commonest_difference(&self) -> Result<Option<[f64; 2]>> {
        const REACH_PX: f64 = 12.0;
        const CELLS: usize = 48;
        let ScoredPoints { truth, result, .. } = self.scored(&|row| Some(*row))?;
        let wide = Gate::radial(REACH_PX);
        // Correct pairs share one difference, wrong pairs are spread uniformly: the fullest cell of the
        // histogram is the shift.
        let mut differences = Vec::new();
        for (_, a, b) in side_by_side(&truth, &result) {
            let (a, b) = (&truth.points[a], &result.points[b]);
            differences.extend(neighbor_pairs(a, b, &wide, 1.0).iter().map(|n| {
                let (p, q) = (&a[n.truth as usize].at, &b[n.result as usize].at);
                [q.x_px - p.x_px, q.y_px - p.y_px]
            }));
        }
        let cell = |v: f64| (((v + REACH_PX) / (2.0 * REACH_PX) * CELLS as f64) as usize).min(CELLS - 1);
        let mut counts = vec![0u32; CELLS * CELLS];
        differences.iter().for_each(|d| counts[cell(d[1]) * CELLS + cell(d[0])] += 1);
        let fullest = (0..counts.len()).rev().max_by_key(|&i| counts[i]).filter(|&i| counts[i] > 0);
        let Some(fullest) = fullest else { return Ok(None) };
        let center = |k: usize| (k as f64 + 0.5) * 2.0 * REACH_PX / CELLS as f64 - REACH_PX;
        let mut shift = [center(fullest % CELLS), center(fullest / CELLS)];
        for _ in 0..3 {
            let is_close = |d: &&[f64; 2]| (d[0] - shift[0]).abs() < 0.75 && (d[1] - shift[1]).abs() < 0.75;
            let close: Vec<&[f64; 2]> = differences.iter().filter(is_close).collect();
            let n = close.len().max(1) as f64;
            shift = [0, 1].map(|k| close.iter().map(|d| d[k]).sum::<f64>() / n);
        }
        Ok(Some(shift))
    }

    /// Scores of the result under another convention.
    fn quality(&self, convention: &dyn Fn(&TrackRow) -> Option<TrackRow>) -> Result<Quality> {
        let ScoredPoints { truth, result, .. } = self.scored(convention)?;
        let matching = optimal(&truth, &result, &self.gate, Cost::Squares)?;
        let errors: Vec<[f64; 3]> = matching.pairs().map(|p| error(&truth, &result, p)).collect();
        let n = errors.len() as f64;
        let squares: f64 = errors.iter().map(|e| e[0] * e[0] + e[1] * e[1]).sum();
        let of_depth: f64 = errors.iter().map(|e| e[2] * e[2]).sum();
        let f1 = 2.0 * n / (truth.len() + result.len()).max(1) as f64;
        let root = |sum: f64| if n > 0.0 { (sum / n).sqrt() } else { f64::INFINITY };
        Ok(Quality { matches: n, f1, rms_px: root(squares), rms_z_um: root(of_depth) })
    }

    /// The points that would be scored: under another convention, other points are assigned to unscored
    /// particles.
    fn scored(&self, convention: &dyn Fn(&TrackRow) -> Option<TrackRow>) -> Result<ScoredPoints> {
        self.scored_by(&self.gate, convention)
    }

    fn scored_by(
        &self,
        gate: &Gate,
        convention: &dyn Fn(&TrackRow) -> Option<TrackRow>,
    ) -> Result<ScoredPoints> {
        let rows = self.rows.iter().filter_map(convention).filter(|row| row.frame < self.end).collect();
        let points = Points { rows, ..Points::default() };
        self.truth.scored(&points, gate, self.flat, self.region)
    }
}

/// A convention that changes positions only.
fn placed<'a>(place: impl Fn(&Position) -> Position + 'a) -> Convention<'a> {
    Box::new(move |row| Some(TrackRow { at: place(&row.at), ..*row }))
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    quantile(&values, 0.5)
}

/// Median of y - a x.
fn median_offset(pairs: &[[f64; 2]], a: f64) -> f64 {
    median(pairs.iter().map(|[x, y]| y - a * x).collect()).unwrap_or(0.0)
}

/// Slope and offset of y against x by a Theil-Sen estimator (median of slopes between distant points, then
/// median of the residuals), which is robust against false matches. `None` if x does not vary.
fn robust_line(pairs: &[[f64; 2]]) -> Option<(f64, f64)> {
    let mut sorted = pairs.to_vec();
    sorted.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let half = sorted.len() / 2;
    let slopes = sorted.iter().zip(&sorted[half..]).filter(|(p, q)| q[0] > p[0]);
    let a = median(slopes.map(|(p, q)| (q[1] - p[1]) / (q[0] - p[0])).collect())?;
    a.is_finite().then(|| (a, median_offset(pairs, a)))
}
