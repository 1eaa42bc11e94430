//! Detects probable mistakes of convention in a result: origin, first frame, axes, units; and a result that
//! matches no more particles than points at random positions would.
//!
//! A convention for which there is an option is tried as the option reads the file: positions are converted back
//! to the file's and read again.

use super::detection::{Detection, error};
use super::gate::Gate;
use super::hint::Hint;
use super::matching::{Cost, optimal};
use super::neighbors::neighbor_pairs;
use super::statistics::median;
use super::track_set::side_by_side;
use super::truth::{Region, ScoredPoints, TrueParticles};
use crate::results::{Conventions, Converter, LengthUnit, Origin, PARTICLES, Points, Position, TrackRow};
use storage::advice::{Advice, flag, option};
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
    /// How the result was read.
    read_as: Conventions,
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
/// if that would be refused.
type Convention<'a> = Box<dyn Fn(&TrackRow) -> Option<TrackRow> + 'a>;

/// A probable mistake: a question, how the result would be read without it, that reading, and its options.
struct Suspect<'a> {
    question: String,
    how: String,
    convention: Convention<'a>,
    options: Vec<Advice>,
    /// The conventions that the options state; as now without options.
    read_as: Conventions,
}

/// F1 within which conventions count as equally good, and the one with the smallest errors is the best.
const SAME_F1: f64 = 0.02;

/// The end of a hint for which there is no option.
const IN_THE_FILE: &str = "; change the file, there is no option";

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
            read_as: result.read_as.completed(&truth.facts),
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
        let read_as = self.read_as;
        for family in [self.frames(read_as)?, self.axes()?, self.lengths(read_as, now)?] {
            hints.extend(self.best(family, now, false, FAR_SMALLER)?);
        }
        // A bias of almost exactly 0.5 or 1 px along both axes is suspicious regardless of the random error.
        let is = |size: f64| bias.is_some_and(|(x, y)| [x, y].iter().all(|b| (b.abs() - size).abs() <= 0.1));
        let share = if is(0.5) || is(1.0) { 1.0 } else { FAR_SMALLER };
        hints.extend(self.best(self.origins(read_as, bias)?, now, false, share)?);
        if !self.flat
            && let Some(depths) = self.depths()?
        {
            hints.extend(self.best(vec![depths], now, true, FAR_SMALLER)?);
        }
        if hints.is_empty() && now.f1 < HARDLY_CHANCE {
            hints.extend(self.best(self.pairs(now)?, now, false, FAR_SMALLER)?);
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
            let at_random = self.quality(&|row| {
                let x_px = wrapped(row.at.x_px, low[0], high[0] - low[0], across);
                let y_px = wrapped(row.at.y_px, low[1], high[1] - low[1], down);
                Some(TrackRow { at: Position { x_px, y_px, ..row.at }, ..*row })
            })?;
            sum += at_random.matches;
            squares += at_random.matches.powi(2);
        }
        let mean = sum / 8.0;
        // Points of a track match together, so the variance may exceed a Poisson process's.
        let variance = (squares / 8.0 - mean * mean).max(mean).max(0.1);
        if now.matches > mean + 3.0 * variance.sqrt() {
            return Ok(None);
        }
        let n = self.rows.iter().filter(|row| row.frame < self.end).count();
        let detail = format!(
            "{} of {n} points match a particle, no more than at random positions ({mean:.1}); the option shows a shift in the image",
            now.matches
        );
        let question =
            "is this the result of another dataset, or does it use another origin, unit or first frame?";
        let mut hint = Hint::new(question, &detail).with_options(&[flag("auto_offset")]);
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
        let mut better = Vec::new();
        for suspect in family {
            let other = self.quality(&suspect.convention)?;
            let is_as_good = other.f1 > now.f1 - SAME_F1 && other.f1 > 0.5;
            let has_smaller_errors = match of_depth {
                true => other.rms_z_um < share * now.rms_z_um,
                false => other.rms_px < share * now.rms_px,
            };
            if other.f1 > now.f1 + 0.1 || (is_as_good && has_smaller_errors) {
                better.push((other, suspect));
            }
        }
        let highest = better.iter().map(|(q, _)| q.f1).fold(0.0, f64::max);
        let errors = |q: &Quality| if of_depth { q.rms_z_um } else { q.rms_px };
        let best = better
            .into_iter()
            .filter(|(q, _)| q.f1 >= highest - SAME_F1)
            .min_by(|(a, _), (b, _)| errors(a).total_cmp(&errors(b)));
        Ok(best.map(|(other, Suspect { question, how, options, .. })| {
            let sample = if self.is_whole { "" } else { " (on a sample of frames)" };
            let shown = |v: f64| if v.is_finite() { format!("{v:.3}") } else { "-".to_owned() };
            let errors = match of_depth {
                true => format!("RMS z {} instead of {} um", shown(other.rms_z_um), shown(now.rms_z_um)),
                false => format!("RMS xy {} instead of {} px", shown(other.rms_px), shown(now.rms_px)),
            };
            let detail =
                format!("{how} F1 would be {:.3} instead of {:.3}, {errors}{sample}", other.f1, now.f1);
            let hint = match options.as_slice() {
                [] => Hint::new(question, &(detail + IN_THE_FILE)),
                options => Hint::new(question, &detail).with_options(options),
            };
            Hint {
                f1: Some(other.f1),
                f1_now: Some(now.f1),
                rms_px: Some(other.rms_px).filter(|v| v.is_finite()),
                rms_px_now: Some(now.rms_px).filter(|v| v.is_finite()),
                sampled: !self.is_whole,
                ..hint
            }
        }))
    }

    /// A suspect that is read as these options say.
    fn with_options(
        &self,
        question: String,
        how: String,
        read_as: Conventions,
        options: Vec<Advice>,
    ) -> Result<Suspect<'_>> {
        let (now, other) = (Converter::new(PARTICLES, &self.read_as)?, Converter::new(PARTICLES, &read_as)?);
        let convention: Convention<'_> = Box::new(move |row| {
            let (frame, [x, y, z]) = now.unconverted(row);
            let at = other.position(x, y, z).ok()??;
            Some(TrackRow { frame: other.frame(frame).ok()?, at, ..*row })
        });
        Ok(Suspect { question, how, convention, options, read_as })
    }

    /// A suspect that changes positions only, for which there is no option.
    fn placed<'b>(
        &self,
        question: &str,
        how: &str,
        place: impl Fn(&Position) -> Position + 'b,
    ) -> Suspect<'b> {
        let convention: Convention<'b> = Box::new(move |row| Some(TrackRow { at: place(&row.at), ..*row }));
        let (question, how) = (question.to_owned(), how.to_owned());
        Suspect { question, how, convention, options: Vec::new(), read_as: self.read_as }
    }

    /// Two mistakes of which none alone explains the errors: y or the first frame, and y, the unit or the origin.
    fn pairs(&self, now: Quality) -> Result<Vec<Suspect<'_>>> {
        let mut pairs = Vec::new();
        let (frames, reversed) = (self.frames(self.read_as)?, self.reversed(self.read_as)?);
        for (k, first) in reversed.into_iter().chain(frames).enumerate() {
            let mut others = self.lengths(first.read_as, now)?;
            others.extend(self.origins(first.read_as, None)?);
            others.extend(self.reversed(first.read_as)?.filter(|_| k > 0));
            for second in others {
                pairs.push(Suspect {
                    question: format!("{} {}", first.question, second.question),
                    how: format!("{}; {}", first.how, second.how),
                    options: [first.options.clone(), second.options].concat(),
                    ..second
                });
            }
        }
        Ok(pairs)
    }

    /// Another first frame: off by one, or such that the first or last frames of truth and result are the same.
    fn frames(&self, from: Conventions) -> Result<Vec<Suspect<'_>>> {
        let ends = |rows: &[TrackRow]| {
            let frames = || rows.iter().map(|row| i64::from(row.frame));
            frames().min().zip(frames().max())
        };
        let Some(((first, last), (true_first, true_last))) = ends(self.rows).zip(ends(&self.truth.rows))
        else {
            return Ok(Vec::new());
        };
        let mut family = Vec::new();
        for by in [1, -1, first - true_first, last - true_last] {
            // Frames before the first one would be refused.
            if by == 0 || by > first {
                continue;
            }
            let base = from.frame_base.unwrap_or(PARTICLES.frame_base) + by;
            let amount = if by.abs() == 1 { "one".to_owned() } else { by.abs().to_string() };
            family.push(self.with_options(
                format!("frames off by {amount}?"),
                format!("With {base} as the number of the first frame"),
                Conventions { frame_base: Some(base), ..from },
                vec![option("frame_base").of(base)],
            )?);
        }
        Ok(family)
    }

    /// Another position of the first pixel's center.
    fn origins(&self, from: Conventions, bias: Option<(f64, f64)>) -> Result<Vec<Suspect<'_>>> {
        let bias = bias.map_or(String::new(), |(x, y)| format!("bias is ({x:+.3}, {y:+.3}) px; "));
        let how = |by: f64| format!("{bias}with x and y moved by {by:+} px");
        let question = "origin mismatch?".to_owned();
        let mut family = Vec::new();
        let shift = |origin: Origin| origin.shift_px(&from).map(|shift| shift[0]);
        let now = shift(from.origin.unwrap_or(PARTICLES.origin))?;
        for by in [-1.0, -0.5, 0.5, 1.0] {
            let origins = [Origin::Center0, Origin::Corner0, Origin::Center1];
            let origin =
                origins.into_iter().find(|origin| shift(*origin).is_ok_and(|other| other - now == by));
            let shift_px = from.shift_px.map(|shift| shift + by);
            let (read_as, named) = match origin {
                Some(origin) => {
                    let named = option("origin").is(origin.names()[0]);
                    (Conventions { origin: Some(origin), ..from }, named)
                }
                None => {
                    let [x, y] = shift_px;
                    (Conventions { shift_px, ..from }, option("shift_px").of(format!("{x} {y}")))
                }
            };
            family.push(self.with_options(question.clone(), how(by), read_as, vec![named])?);
        }
        Ok(family)
    }

    /// Axes swapped or reversed.
    fn axes(&self) -> Result<Vec<Suspect<'_>>> {
        let swapped = |at: &Position| Position { x_px: at.y_px, y_px: at.x_px, ..*at };
        let mut family = vec![self.placed("axes swapped?", "With x and y exchanged", swapped)];
        if let Some((width, height)) = self.truth.facts.sensor_px {
            let (x_px, y_px) =
                (move |at: &Position| width + 1.0 - at.x_px, move |at: &Position| height + 1.0 - at.y_px);
            family.extend(self.reversed(self.read_as)?);
            let reversed = move |at: &Position| Position { x_px: x_px(at), ..*at };
            family.push(self.placed("x from the right?", "With x reversed", reversed));
            let turned = move |at: &Position| Position { x_px: x_px(at), y_px: y_px(at), ..*at };
            family.push(self.placed("image turned by 180 degrees?", "With x and y reversed", turned));
        }
        Ok(family)
    }

    /// y in the other direction, if the size of the image is known.
    fn reversed(&self, from: Conventions) -> Result<Option<Suspect<'_>>> {
        let is_up = from.y_up == Some(true);
        let (question, way) = if is_up { ("y downward?", "down") } else { ("y upward?", "up") };
        let read_as = Conventions { y_up: Some(!is_up), ..from };
        let suspect = || {
            let options = vec![option("y").is(way)];
            self.with_options(question.to_owned(), "With y reversed".to_owned(), read_as, options)
        };
        self.truth.facts.sensor_px.map(|_| suspect()).transpose()
    }

    /// x and y in another unit, from any origin; none for a result that is right in most places.
    fn lengths(&self, from: Conventions, now: Quality) -> Result<Vec<Suspect<'_>>> {
        let Some(um_per_px) = self.truth.facts.um_per_px.filter(|_| now.f1 < HARDLY_CHANCE) else {
            return Ok(Vec::new());
        };
        let mut family = Vec::new();
        let read_now = from.unit.unwrap_or(PARTICLES.unit);
        for unit in LengthUnit::all().filter(|unit| *unit != read_now) {
            for origin in Origin::ALL {
                let read_as = Conventions { unit: Some(unit), origin: Some(origin), ..from };
                let Ok([x0, y0]) = origin.shift_px(&read_as) else { continue };
                let scale = unit.um().map_or(1.0, |um| um / um_per_px);
                let mut options = vec![option("unit").is(unit.symbol())];
                if from.origin.unwrap_or(PARTICLES.origin) != origin {
                    options.push(option("origin").is(origin.names()[0]));
                }
                family.push(self.with_options(
                    format!("x and y in {}?", unit.symbol()),
                    format!("With x_px = x {scale:.6} + {x0}, y_px = y {scale:.6} + {y0}"),
                    read_as,
                    options,
                )?);
            }
        }
        Ok(family)
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
            () if near(1e-3) => ("z in nm?", 1e-3, median_offset(&pairs, 1e-3)),
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
        let place = move |at: &Position| Position { z_um: a * at.z_um + b, ..*at };
        Ok(Some(self.placed(question, &format!("With z_um = {sum}"), place)))
    }

    /// The shift of the whole result, px, and F1 without it, as reported by `--auto-offset`. `None` if no
    /// result point is near a true one.
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

/// Median of y - a x.
fn median_offset(pairs: &[[f64; 2]], a: f64) -> f64 {
    median(pairs.iter().map(|[x, y]| y - a * x)).unwrap_or(0.0)
}

/// Slope and offset of y against x by a Theil-Sen estimator (median of slopes between distant points, then
/// median of the residuals), which is robust against false matches. `None` if x does not vary.
fn robust_line(pairs: &[[f64; 2]]) -> Option<(f64, f64)> {
    let mut sorted = pairs.to_vec();
    sorted.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let half = sorted.len() / 2;
    let slopes = sorted.iter().zip(&sorted[half..]).filter(|(p, q)| q[0] > p[0]);
    let a = median(slopes.map(|(p, q)| (q[1] - p[1]) / (q[0] - p[0])))?;
    a.is_finite().then(|| (a, median_offset(pairs, a)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::{EvaluateOptions, Score, particles};
    use crate::results::{Source, TrackerResult};
    use clap::{Args, FromArgMatches};
    use storage::dataset::RecordingFacts;

    /// Particles that move by 2 px a frame, at places of no order.
    fn truth() -> TrueParticles {
        let facts = RecordingFacts {
            um_per_px: Some(0.645),
            sensor_px: Some((300.0, 200.0)),
            depth_um: Some((-20.0, 20.0)),
            frames: Some(6),
            ..RecordingFacts::default()
        };
        let row = |track: i64, frame: u32| {
            let k = track as f64;
            let (x, y) = ((k * 0.618_034).fract(), (k * 0.754_878).fract());
            let at = Position {
                x_px: 5.0 + 270.0 * x + 2.0 * f64::from(frame),
                y_px: 5.0 + 190.0 * y,
                z_um: -19.0 + 38.0 * (k * 0.569_84).fract(),
            };
            TrackRow { frame, track, at }
        };
        let rows: Vec<TrackRow> =
            (0..60).flat_map(|track| (0..6).map(move |frame| row(track, frame))).collect();
        TrueParticles {
            facts,
            visible: vec![true; rows.len()],
            has_z: true,
            rows,
            ..TrueParticles::default()
        }
    }

    /// Scores a table of particles, read by these options of the command.
    fn scored(table: &str, options: &str) -> Score {
        let truth = truth();
        let place = tempfile::tempdir().unwrap();
        let file = place.path().join("r.csv");
        std::fs::write(&file, table).unwrap();
        // `--shift` has two values, which the command reads.
        let (options, shift) = options.split_once("--shift ").unwrap_or((options, "0 0"));
        let command = Conventions::augment_args(clap::Command::new("evaluate").no_binary_name(true));
        let parsed =
            Conventions::from_arg_matches(&command.get_matches_from(options.split_whitespace())).unwrap();
        let shift_px = [0, 1].map(|k| shift.split(' ').nth(k).unwrap().parse().unwrap());
        let given = Conventions { shift_px, ..parsed.completed(&truth.facts) };
        let source = Source::File(file.into());
        let format = source.format(&given).unwrap();
        let TrackerResult::Points(points) = source.read(format, &given).unwrap() else { panic!("a field") };
        particles(&truth, &points, &EvaluateOptions::default()).unwrap().score
    }

    /// A table with this header and rows; `place` gives x, y as the file has them.
    fn table(header: &str, base: i64, place: impl Fn(&Position) -> [f64; 2]) -> String {
        let row = |row: &TrackRow| {
            let ([x, y], z) = (place(&row.at), row.at.z_um);
            format!("{},{},{x:?},{y:?},{z:?}\n", i64::from(row.frame) + base, row.track)
        };
        format!("{header}\n{}", truth().rows.iter().map(row).collect::<String>())
    }

    #[test]
    fn the_option_of_a_hint_gives_the_scores_that_the_hint_promises() {
        const TRACKPY: &str = "frame,particle,x,y,z";
        const NAPARI: &str = "t,track_id,x,y,z";
        const OWN: &str = "frame,track,x_px,y_px,z_um";
        let um = |shift: f64, um: f64| move |at: &Position| [(at.x_px - shift) * um, (at.y_px - shift) * um];
        let noisy = |at: &Position| {
            let noise = |v: f64| 0.8 * ((v * 7919.0).fract() - 0.5);
            [at.x_px - 1.0 + noise(at.x_px), at.y_px - 1.0 + noise(at.y_px)]
        };
        let middle = |at: &Position| [(at.x_px - 150.5) * 0.645e-3, (at.y_px - 100.5) * 0.645e-3];
        let up = |at: &Position| [at.x_px - 1.0, 200.0 - at.y_px];
        let cases = [
            ("--unit um", table(TRACKPY, 0, um(1.0, 0.645))),
            ("--unit um", table(NAPARI, 0, um(1.0, 0.645))),
            ("--unit um --origin corner0", table(TRACKPY, 0, um(0.5, 0.645))),
            ("--unit mm", table(NAPARI, 0, um(1.0, 0.645e-3))),
            ("--unit m", table(TRACKPY, 0, um(1.0, 0.645e-6))),
            ("--unit mm --origin middle", table(TRACKPY, 0, middle)),
            ("--unit um --origin center0", table(OWN, 0, um(1.0, 0.645))),
            ("--origin center0", table(OWN, 0, um(1.0, 1.0))),
            ("--origin corner0", table(OWN, 0, um(0.5, 1.0))),
            ("--origin center1", table(TRACKPY, 0, um(0.0, 1.0))),
            ("--origin center0", table(OWN, 0, noisy)),
            ("--y up", table(TRACKPY, 0, up)),
            ("--frame-base 1", table(TRACKPY, 1, um(1.0, 1.0))),
            ("--frame-base 2", table(OWN, 2, um(0.0, 1.0))),
            ("--frame-base 5", table(NAPARI, 5, um(1.0, 1.0))),
            ("--frame-base 1000", table(TRACKPY, 1000, um(1.0, 1.0))),
            ("--shift -1 -1", table(OWN, 0, |at| [at.x_px + 1.0, at.y_px + 1.0])),
            // Two mistakes of which none alone explains the errors.
            (
                "--y up --unit um",
                table(TRACKPY, 0, |at| [(at.x_px - 1.0) * 0.645, (200.0 - at.y_px) * 0.645]),
            ),
            ("--frame-base 7 --unit mm", table(TRACKPY, 7, um(1.0, 0.645e-3))),
            ("--frame-base 5 --y up", table(OWN, 5, |at| [at.x_px, 201.0 - at.y_px])),
        ];
        for (option, text) in cases {
            let hints = scored(&text, "").hints;
            let Some(hint) = hints.first().filter(|hint| hint.option == option) else {
                panic!("{option}: {hints:?}");
            };
            assert!(hint.what.ends_with(&format!("; {option}")), "{hint:?}");
            let argument = hint.clone().in_python().what;
            assert!(argument.ends_with(&hint.argument) && !argument.contains("--"), "{argument}");
            let score = scored(&text, option);
            let found = score.detection.unwrap_or_default();
            assert_eq!((found.f1, score.hints.len()), (hint.f1, 0), "{option}");
            // Positions are converted back and forth, which rounds.
            assert!((found.rmse_xy_px.unwrap() - hint.rms_px.unwrap()).abs() < 1e-9, "{option}: {hint:?}");
        }
        assert_eq!(scored(&table(TRACKPY, 0, um(1.0, 1.0)), "").hints, []);
        // No option does this.
        let swapped = scored(&table(OWN, 0, |at| [at.y_px, at.x_px]), "").hints;
        assert!(swapped[0].what.ends_with("change the file, there is no option"), "{swapped:?}");
    }

    #[test]
    fn a_depth_of_0_in_every_row_is_no_depth() {
        let exact = table("frame,track,x_px,y_px,z_um", 0, |at| [at.x_px, at.y_px]);
        let without = |z: &str| {
            let row = |line: &str| {
                if line.starts_with("frame") {
                    line.to_owned()
                } else {
                    line.rsplit_once(',').unwrap().0.to_owned() + "," + z
                }
            };
            exact.lines().map(row).collect::<Vec<_>>().join("\n")
        };
        for z in ["0", "0.0", "-0"] {
            let score = scored(&without(z), "");
            assert_eq!((score.definitions.dims, score.detection.unwrap().f1), (2, Some(1.0)));
            assert!(
                score.warnings.iter().any(|w| w.starts_with("z is 0 in every row")),
                "{:?}",
                score.warnings
            );
        }
        for text in [exact.clone(), without("3")] {
            let score = scored(&text, "");
            assert_eq!((score.definitions.dims, score.warnings.len()), (3, 0), "{:?}", score.warnings);
        }
    }
}
