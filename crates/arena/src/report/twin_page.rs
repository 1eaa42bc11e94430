//! A recording and its digital twin side by side: scores of trackers on both, as numbers, a sentence and a page.

use std::collections::BTreeMap;

use maud::html;
use serde::Serialize;

use super::figure::{figure_of, names};
use super::page::document;
use super::plots::{AxisLabels, Series, lines};
use super::table::{number, signed};
use super::tiles;
use scoring::evaluate::Evaluation;
use scoring::evaluate::detection::error;
use scoring::evaluate::matching::NONE;
use scoring::evaluate::planes::{Plane, PlanePoint};
use scoring::evaluate::statistics::{Interval, intervals, quantile, ratio};
use scoring::evaluate::track_set::Point;
use storage::error::Result;

/// Number of bins over depth, if there are more heights, and over the distance from the middle of the image.
const DEPTH_BINS: usize = 16;
const RADIUS_BINS: usize = 6;

/// Side of the squares in which points without a track are taken to be of the same particle, px.
const PLACE_PX: f64 = 4.0;

/// The scores of a tracker; of the recording `None` if nothing is known of it.
#[derive(Debug)]
pub struct OnBoth {
    /// Name of the tracker.
    pub tracker: String,
    /// On the recording.
    pub recorded: Option<Evaluation>,
    /// Mean number of points in a frame of the recording; `None` if the tracker did not run on it.
    pub found_per_frame: Option<f64>,
    /// On the twin.
    pub twin: Evaluation,
}

/// What a page says besides scores.
#[derive(Debug)]
pub struct TwinAbout {
    /// Name of the recording.
    pub recording: String,
    /// How the twin was made, and what it does not show: a paragraph each.
    pub notes: Vec<String>,
    /// Depth in focus, um.
    pub focus_um: f64,
    /// Points nearer to the focus than this, whose images hardly depend on depth, are left out where it says so, um.
    pub near_um: f64,
    /// Frames: their titles, and squares of counts above the background, recorded and of the twin, with their edge, px.
    pub frames: Vec<(String, usize, [Vec<f32>; 2])>,
}

/// Scores of the particles of a recording, or of those far from focus.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct TwinScore {
    /// Number of particles in all frames, and of those that were found.
    pub n: usize,
    /// See `n`.
    pub found: usize,
    /// found / n; `None` where positions are not known.
    pub recall: Option<f64>,
    /// 95 % interval.
    pub interval_recall: Interval,
    /// Mean error of z of those found, um.
    pub bias_z_um: Option<f64>,
    /// 95 % interval.
    pub interval_bias_z_um: Interval,
    /// Root mean square error, um.
    pub rms_z_um: Option<f64>,
    /// 95 % interval.
    pub interval_rms_z_um: Interval,
    /// Median and 68 % quantile of the size of the error, um.
    pub p50_z_um: Option<f64>,
    /// See `p50_z_um`.
    pub p68_z_um: Option<f64>,
}

/// Scores on both.
#[derive(Debug, Clone, Serialize)]
pub struct TrackerScores {
    /// Name of the tracker.
    pub tracker: String,
    /// What it achieves, as a sentence.
    pub sentence: String,
    /// Gate within which a point is found.
    pub gate: String,
    /// Mean numbers of points in a frame, of the recording and the twin.
    pub points_per_frame: [Option<f64>; 2],
    /// All particles of the recording; `None` if nothing is known.
    pub recorded: Option<TwinScore>,
    /// All particles of the twin.
    pub twin: TwinScore,
    /// Those far from focus.
    pub recorded_far: Option<TwinScore>,
    /// See `recorded_far`.
    pub twin_far: TwinScore,
}

/// A particle in a frame; `error_um`: if it was found.
#[derive(Clone, Copy)]
struct Seen {
    unit: (i64, i64),
    z_um: f64,
    radius_px: f64,
    error_um: Option<f64>,
}

/// The particles of a recording, and whether those that were not found are among them.
struct Compared {
    seen: Vec<Seen>,
    has_positions: bool,
}

impl Compared {
    fn of(evaluation: &Evaluation) -> Self {
        let radius = |x: f64, y: f64, sensor: Option<(f64, f64)>| {
            sensor.map_or(f64::NAN, |(w, h)| (x - 0.5 * (w + 1.0)).hypot(y - 0.5 * (h + 1.0)))
        };
        let gate_um = evaluation.score.planes.as_ref().map_or(f64::INFINITY, |planes| planes.gate_z_um);
        let planes = Plane::fit(&evaluation.plane_points, gate_um);
        if let Some(of) = evaluation.particles.as_ref() {
            let (truth, result) = (&of.scored.truth, &of.scored.result);
            // The tilt and the exact height of a slide are not known.
            let shift_um = |point: &Point| {
                let plane = planes.iter().find(|plane| plane.height_um == point.at.z_um);
                plane.map_or(0.0, |plane| plane.error_um(point.at.x_px, point.at.y_px))
            };
            let seen =
                truth.points.iter().zip(&of.matching.result_for).enumerate().map(|(i, (point, j))| Seen {
                    unit: (i64::from(point.track), -1),
                    z_um: point.at.z_um,
                    radius_px: radius(point.at.x_px, point.at.y_px, of.sensor_px),
                    error_um: (*j != NONE)
                        .then(|| error(truth, result, (i, *j as usize))[2] - shift_um(point)),
                });
            return Compared { seen: seen.collect(), has_positions: true };
        }
        let distance = |point: &PlanePoint| {
            let plane = planes.iter().find(|plane| plane.height_um == point.height_um);
            point.error_um - plane.map_or(0.0, |plane| plane.error_um(point.x_px, point.y_px))
        };
        let within = evaluation.plane_points.iter().filter(|point| distance(point).abs() < gate_um);
        let place = |px: f64| (px / PLACE_PX).round() as i64;
        let seen = within.map(|point| Seen {
            unit: (place(point.x_px), place(point.y_px)),
            z_um: point.height_um,
            radius_px: radius(point.x_px, point.y_px, evaluation.sensor_px),
            error_um: Some(distance(point)),
        });
        Compared { seen: seen.collect(), has_positions: false }
    }

    fn score(&self, of: impl Fn(&Seen) -> bool) -> TwinScore {
        let mut units = BTreeMap::<(i64, i64), [f64; 4]>::new();
        let mut sizes = Vec::new();
        for seen in self.seen.iter().filter(|seen| of(seen)) {
            let sums = units.entry(seen.unit).or_default();
            sums[0] += 1.0;
            if let Some(error) = seen.error_um {
                sums[1] += 1.0;
                sums[2] += error;
                sums[3] += error * error;
                sizes.push(error.abs());
            }
        }
        sizes.sort_by(f64::total_cmp);
        let statistics = |s: &[f64; 4]| {
            let recall = ratio(s[1], s[0]).filter(|_| self.has_positions);
            [recall, ratio(s[2], s[1]), ratio(s[3], s[1]).map(f64::sqrt)]
        };
        let units: Vec<[f64; 4]> = units.into_values().collect();
        let sums = units.iter().fold([0.0; 4], |mut sums, unit| {
            sums.iter_mut().zip(unit).for_each(|(sum, more)| *sum += more);
            sums
        });
        let [recall, bias_z_um, rms_z_um] = statistics(&sums);
        let [interval_recall, interval_bias_z_um, interval_rms_z_um] = intervals(&units, 0, statistics);
        TwinScore {
            n: sums[0] as usize,
            found: sums[1] as usize,
            recall,
            interval_recall,
            bias_z_um,
            interval_bias_z_um,
            rms_z_um,
            interval_rms_z_um,
            p50_z_um: quantile(&sizes, 0.5),
            p68_z_um: quantile(&sizes, 0.68),
        }
    }
}

/// A value with half its 95 % interval.
fn with_interval(value: Option<f64>, interval: Interval, factor: f64, digits: usize) -> String {
    let Some(value) = value else { return "?".to_owned() };
    let half =
        interval.map_or(String::new(), |[low, high]| format!(" +- {:.digits$}", 0.5 * factor * (high - low)));
    format!("{:.digits$}{half}", factor * value)
}

fn sentence(tracker: &str, recorded: Option<&TwinScore>, twin: &TwinScore) -> String {
    let percent = |of: &TwinScore| {
        let text = with_interval(of.recall, of.interval_recall, 100.0, 0);
        text.split_once(" +- ").map_or(format!("{text} %"), |(value, half)| format!("{value} % +- {half}"))
    };
    let rms =
        |of: &TwinScore| match with_interval(of.rms_z_um, of.interval_rms_z_um, 1.0, 2).split_once(" +- ") {
            Some((value, half)) => format!("{value} um +- {half}"),
            None => format!("{} um", number(of.rms_z_um)),
        };
    let known = match recorded {
        None => "; nothing is known of the particles of the recording".to_owned(),
        Some(of) if of.recall.is_none() => format!(
            "; on the recording, of which only heights of planes are known, points near their plane have {}",
            rms(of)
        ),
        Some(of) => format!("; on the recording, where it is known, {} at {}", percent(of), rms(of)),
    };
    format!(
        "{tracker} finds {} of the particles at {} (RMS error of z) here{known}",
        percent(twin),
        rms(twin)
    )
}

/// The scores and the page.
pub fn twin_page(about: &TwinAbout, trackers: &[OnBoth]) -> Result<(Vec<TrackerScores>, String)> {
    let is_far = |seen: &Seen| (seen.z_um - about.focus_um).abs() > about.near_um;
    let (mut scores, mut plots) = (Vec::new(), Vec::new());
    for tracker in trackers {
        let twin = Compared::of(&tracker.twin);
        let recorded = tracker.recorded.as_ref().map(Compared::of);
        let all = |of: &Compared| of.score(|_| true);
        let far = |of: &Compared| of.score(is_far);
        let (of_recorded, of_twin) = (recorded.as_ref().map(all), all(&twin));
        let frames = tracker.twin.score.counts.frames.max(1) as f64;
        scores.push(TrackerScores {
            tracker: tracker.tracker.clone(),
            sentence: sentence(&tracker.tracker, of_recorded.as_ref(), &of_twin),
            gate: tracker.twin.score.definitions.gate.as_ref().map_or_else(String::new, ToString::to_string),
            points_per_frame: [
                tracker.found_per_frame,
                Some(tracker.twin.score.counts.n_result as f64 / frames),
            ],
            recorded: of_recorded,
            twin: of_twin,
            recorded_far: recorded.as_ref().map(far),
            twin_far: far(&twin),
        });
        let both: Vec<(&str, &Compared)> =
            recorded.iter().map(|of| ("recorded", of)).chain([("twin", &twin)]).collect();
        plots.push((tracker.tracker.as_str(), curves(&both, about)?));
    }
    let title = format!("{} and its digital twin", about.recording);
    let body = html! {
        h1 { (title) }
        @for score in &scores { p { b { (score.sentence) } } }
        @for note in &about.notes { p.soft { (note) } }
        h2 { "Recorded and twin" }
        div.scroll { table {
            tr { th { "tracker" } th { "images" } th { "recall, %" } th { "points in a frame" } th { "bias of z, um" } th { "RMS error of z, um" }
                th { "50 %, um" } th { "68 %, um" } th { (format!("RMS farther than {:.1} um from focus", about.near_um)) } th { "50 %" } th { "68 %" } }
            @for s in &scores {
                @for (k, images, of, far) in [(0, "recorded", s.recorded.as_ref(), s.recorded_far.as_ref()), (1, "twin", Some(&s.twin), Some(&s.twin_far))] { tr {
                    td { (s.tracker) } td { (images) }
                    @match (of, far) {
                        (Some(of), Some(far)) => {
                            td { (with_interval(of.recall, of.interval_recall, 100.0, 1)) }
                            td { (number(s.points_per_frame[k])) }
                            td { (signed(of.bias_z_um)) }
                            td { (with_interval(of.rms_z_um, of.interval_rms_z_um, 1.0, 3)) }
                            td { (number(of.p50_z_um)) } td { (number(of.p68_z_um)) }
                            td { (with_interval(far.rms_z_um, far.interval_rms_z_um, 1.0, 3)) }
                            td { (number(far.p50_z_um)) } td { (number(far.p68_z_um)) }
                        }
                        _ => { td { "not known" } td { (number(s.points_per_frame[k])) } }
                    }
                } }
            }
        } }
        @for score in scores.iter().take(1) { p.soft { "Found: within the gate (" (score.gate) "); errors are those of found particles. +-: half the 95 % interval, resampling particles." } }
        @for (tracker, plots) in &plots { h2 { (tracker) } div.plots { @for plot in plots { (plot) } } }
        @if !about.frames.is_empty() {
            h2 { "Images" }
            div.scroll { table.windows {
                tr { th {} @for (title, ..) in &about.frames { th { (title) } } }
                @for (k, name) in ["recorded", "twin"].into_iter().enumerate() {
                    tr { td { (name) } @for (_, edge, [recorded, twin]) in &about.frames {
                        td { img alt=(name) style="width: 14rem" src=(tiles::of(*edge, [recorded, twin, recorded], k)?); }
                    } }
                }
            } }
            p.soft { "Square root of the counts above the background, with the same gray scale in a column." }
        }
    };
    Ok((scores, document(&title, &body)))
}

/// Recall and errors over depth, and errors over the distance from the middle of the image.
fn curves(both: &[(&str, &Compared)], about: &TwinAbout) -> Result<Vec<maud::Markup>> {
    let all = || both.iter().flat_map(|(_, of)| &of.seen);
    let mut heights: Vec<f64> = all().map(|seen| seen.z_um).collect();
    heights.sort_by(f64::total_cmp);
    heights.dedup();
    let (Some(low), Some(high)) = (heights.first().copied(), heights.last().copied()) else {
        return Ok(Vec::new());
    };
    let equal = |low: f64, high: f64, n: usize| -> Vec<f64> {
        (0..=n).map(|k| low + (high - low) * (1.0 + 1e-9) * k as f64 / n as f64).collect()
    };
    let depths = match heights.len() {
        n if n > DEPTH_BINS => equal(low, high + 1e-9, DEPTH_BINS),
        _ => {
            let between = heights.windows(2).map(|pair| f64::midpoint(pair[0], pair[1]));
            std::iter::once(low - 0.5).chain(between).chain([high + 0.5]).collect()
        }
    };
    let farthest = all().map(|seen| seen.radius_px).fold(0.0, f64::max);
    let radii = equal(0.0, farthest + 1e-9, RADIUS_BINS);
    let z = |seen: &Seen| seen.z_um;
    let is_far = |seen: &Seen| (seen.z_um - about.focus_um).abs() > about.near_um;
    let mut plots = Vec::new();
    let mut plot = |y: &str, x: &str, series: Vec<Series>, caption: &str| -> Result<()> {
        if series.iter().any(Series::has_points) {
            let svg = lines(&AxisLabels { x, y, title: y }, &series)?;
            plots.push(figure_of(svg, &names(&series), &format!("{caption}; bars: 95 % intervals.")));
        }
        Ok(())
    };
    type Value = fn(&TwinScore) -> (Option<f64>, Interval);
    let recall: Value = |of| (of.recall, of.interval_recall);
    let bias: Value = |of| (of.bias_z_um, of.interval_bias_z_um);
    let rms: Value = |of| (of.rms_z_um, of.interval_rms_z_um);
    let over_depth = |value: Value| series(both, &depths, z, |_| true, value);
    let over_radius = |value: Value| series(both, &radii, |seen| seen.radius_px, is_far, value);
    plot("recall", "z, um", over_depth(recall), "Share of particles that are found")?;
    plot("bias of z, um", "z, um", over_depth(bias), "Mean error of depth")?;
    plot("RMS error of z, um", "z, um", over_depth(rms), "RMS error of depth")?;
    let away = "distance from the middle of the image, px";
    let far = format!("of particles farther than {:.1} um from focus", about.near_um);
    plot("bias of z, um", away, over_radius(bias), &format!("Mean error of depth, {far}"))?;
    plot("RMS error of z, um", away, over_radius(rms), &format!("RMS error of depth, {far}"))?;
    Ok(plots)
}

fn series(
    both: &[(&str, &Compared)],
    edges: &[f64],
    by: impl Fn(&Seen) -> f64,
    of: impl Fn(&Seen) -> bool,
    value: impl Fn(&TwinScore) -> (Option<f64>, Interval),
) -> Vec<Series> {
    let one = |(name, compared): &(&str, &Compared)| {
        let (mut points, mut bars) = (Vec::new(), Vec::new());
        for pair in edges.windows(2) {
            let score = compared.score(|seen| of(seen) && (pair[0]..pair[1]).contains(&by(seen)));
            // The curves of few points show their noise.
            let (value, interval) = if score.n >= 5 { value(&score) } else { (None, None) };
            points.push((f64::midpoint(pair[0], pair[1]), value.unwrap_or(f64::NAN)));
            bars.push(interval.map_or((f64::NAN, f64::NAN), |[low, high]| (low, high)));
        }
        Series::new(*name, points).with_bars(bars)
    };
    both.iter().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sentence_states_recall_and_error_with_intervals() {
        let seen = |k: i64| Seen {
            unit: (k % 50, 0),
            z_um: 10.0,
            radius_px: 3.0,
            error_um: (k % 10 != 3).then_some(if k % 4 < 2 { 0.3 } else { -0.3 }),
        };
        let twin = Compared { seen: (0..500).map(seen).collect(), has_positions: true };
        let score = twin.score(|_| true);
        assert_eq!((score.n, score.found, score.recall), (500, 450, Some(0.9)));
        let of_planes = Compared {
            seen: twin.seen.iter().filter(|s| s.error_um.is_some()).copied().collect(),
            has_positions: false,
        };
        let said = sentence("ncc", Some(&of_planes.score(|_| true)), &score);
        assert!(said.starts_with("ncc finds 90 % +- ") && said.contains("at 0.30 um +- 0.00"), "{said}");
        assert!(said.contains("only heights of planes are known"), "{said}");
        assert!(sentence("x", None, &score).ends_with("nothing is known of the particles of the recording"));
        assert_eq!(twin.score(|seen| seen.z_um < 0.0).recall, None);
    }
}
