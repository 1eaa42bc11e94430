//! Plots of particle scores.

use maud::Markup;

use super::figure::{claimed, error_map, figure, figure_of, histogram, names};
use super::plots::{AxisLabels, Marks, Series, Style, classes, lines, sensor};
use scoring::evaluate::crlb::{BoundBin, Crlb};
use scoring::evaluate::curves::{Bin, Curve, NEIGHBOR_PX};
use scoring::evaluate::detection::{error, per_frame};
use scoring::evaluate::lpt::LENGTHS;
use scoring::evaluate::matching::NONE;
use scoring::evaluate::motion::VelocitySource;
use scoring::evaluate::statistics::Errors;
use scoring::evaluate::{Particles, Score};
use storage::error::Result;

/// One quantity of a curve at the centers of its closed bins.
fn line(name: &str, curve: &Curve, value: impl Fn(&Bin) -> Option<f64>) -> Series {
    Series::new(name, closed(curve).map(|b| (middle(b), value(b).unwrap_or(f64::NAN))).collect())
}

/// RMS errors with error bars of one standard error, rms / sqrt(2 n) for normal errors.
fn rms_line(name: &str, curve: &Curve, value: impl Fn(&Bin) -> Option<f64>) -> Series {
    let bars = closed(curve).map(|b| {
        let (rms, n) = (value(b).unwrap_or(f64::NAN), b.tp as f64);
        let half = rms / (2.0 * n).sqrt();
        ((rms - half).max(0.0), rms + half)
    });
    line(name, curve, &value).with_bars(bars.collect())
}

/// Recall with the 68 % binomial interval of Wilson (J. Am. Stat. Assoc. 22, 1927).
fn recall_line(curve: &Curve) -> Series {
    let bars = closed(curve).map(|b| {
        let (p, n) = (b.recall.unwrap_or(f64::NAN), b.n_true as f64);
        let center = (p + 0.5 / n) / (1.0 + 1.0 / n);
        let half = (p * (1.0 - p) / n + 0.25 / (n * n)).sqrt() / (1.0 + 1.0 / n);
        (center - half, center + half)
    });
    line("recall", curve, |b| b.recall).with_bars(bars.collect())
}

fn closed(curve: &Curve) -> impl Iterator<Item = &Bin> {
    curve.bins.iter().filter(|b| b.to.is_finite())
}

fn middle(bin: &Bin) -> f64 {
    f64::midpoint(bin.from, bin.to)
}

/// Axis label of a curve.
pub(super) fn axis(against: &str) -> &str {
    match against {
        "z_um" => "depth z, um",
        NEIGHBOR_PX => "distance to the nearest neighbor, px",
        "snr" => "signal-to-noise ratio",
        "overlap" => "overlap",
        other => other,
    }
}

/// All plots of particle scores. `with_true_positions`: including those that show true positions.
pub(super) fn plots(score: &Score, of: &Particles, with_true_positions: bool) -> Result<Vec<Markup>> {
    let mut plots = Vec::new();
    if with_true_positions {
        plots.extend(depths(of)?);
        plots.extend(profile(score, of)?);
    }
    for curve in &score.curves {
        plots.extend(curve_plots(score, curve, of.depth)?);
    }
    if with_true_positions {
        // Extreme errors belong to single particles.
        plots.extend(histograms(of)?);
    }
    let claims = score.uncertainty.iter().flat_map(|c| [("x, px", &c.x), ("y, px", &c.y), ("z, um", &c.z)]);
    for (axis, of) in claims {
        plots.extend(of.as_ref().map(|u| claimed(axis, u)).transpose()?);
    }
    if let Some(lpt) = &score.lpt {
        let labels = AxisLabels { x: "points per track", y: "tracks", title: "Track lengths" };
        let svg = classes(&labels, &LENGTHS, [&lpt.true_lengths, &lpt.lengths])?;
        plots.push(figure_of(svg, &["truth", "result"], "Lengths of true and measured tracks."));
    }
    if with_true_positions {
        plots.extend(error_over_sensor(of)?);
        plots.extend(frames(of)?);
    }
    Ok(plots)
}

/// Recall and errors as functions of one property.
fn curve_plots(score: &Score, curve: &Curve, depth: bool) -> Result<Vec<Markup>> {
    let x = axis(&curve.against);
    let labels = AxisLabels { x, y: "recall", title: "Recall" };
    let caption = format!("Fraction of particles found, against {x}; bars are 68 % intervals.");
    let mut plots = vec![figure(lines(&labels, &[recall_line(curve)])?, &caption)];
    let bound = score.crlb.as_ref().filter(|_| curve.against == "z_um");
    let bound = |name: &str, value: fn(&BoundBin) -> Option<f64>| {
        let points = |b: &Crlb| b.bins.iter().map(|b| (b.z_um, value(b).unwrap_or(f64::NAN))).collect();
        bound.map(|b| Series::new(name, points(b)).drawn(Style::Line))
    };
    let labels = AxisLabels { x, y: "error, px", title: "Error in the image plane" };
    let mut series = vec![
        rms_line("RMS x", curve, |b| b.rms_x_px),
        rms_line("RMS y", curve, |b| b.rms_y_px),
        line("bias x", curve, |b| b.bias_x_px),
        line("bias y", curve, |b| b.bias_y_px),
    ];
    series.extend(bound("Cramer-Rao bound x", |b| b.crlb_x_px));
    series.extend(bound("Cramer-Rao bound y", |b| b.crlb_y_px));
    let caption = format!("RMS error with its standard error, and bias, in the image plane, against {x}.");
    plots.push(figure_of(lines(&labels, &series)?, &names(&series), &caption));
    if depth {
        let labels = AxisLabels { x, y: "error, um", title: "Error in depth" };
        let mut series =
            vec![rms_line("RMS z", curve, |b| b.rms_z_um), line("bias z", curve, |b| b.bias_z_um)];
        series.extend(bound("Cramer-Rao bound", |b| b.crlb_z_um));
        let caption = format!("RMS error with its standard error, and bias, in depth, against {x}.");
        plots.push(figure_of(lines(&labels, &series)?, &names(&series), &caption));
    }
    Ok(plots)
}

/// Maximum number of points drawn.
const POINTS: usize = 2000;

/// Measured depth against true depth.
fn depths(of: &Particles) -> Result<Option<Markup>> {
    let (t, r) = (&of.scored.truth, &of.scored.result);
    let pairs: Vec<(f64, f64)> =
        of.matching.pairs().map(|(i, j)| (t.points[i].at.z_um, r.points[j].at.z_um)).collect();
    if !of.depth || pairs.is_empty() {
        return Ok(None);
    }
    let ends = pairs.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |e, p| (e.0.min(p.0), e.1.max(p.0)));
    let n = pairs.len();
    let shown = pairs.into_iter().step_by(n.div_ceil(POINTS)).collect();
    let series = [
        Series::new("matched particles", shown).drawn(Style::Dots),
        Series::new("z found = z true", vec![(ends.0, ends.0), (ends.1, ends.1)]).drawn(Style::Line),
    ];
    let labels = AxisLabels { x: "z true, um", y: "z found, um", title: "Measured against true depth" };
    Ok(Some(figure_of(lines(&labels, &series)?, &names(&series), "Measured depth against true depth.")))
}

/// Velocity along x as a function of depth: mean of the truth, and mean and standard deviation of the result,
/// in bins of true depth.
fn profile(score: &Score, of: &Particles) -> Result<Option<Markup>> {
    const BINS: usize = 20;
    let t = &of.scored.truth;
    if !of.depth || of.true_u_um_s.is_empty() {
        return Ok(None);
    }
    let mut bins = vec![(Vec::new(), Vec::new(), Vec::new()); BINS];
    let z = || t.points.iter().map(|p| p.at.z_um);
    let (low, high) = z().fold((f64::INFINITY, f64::NEG_INFINITY), |e, z| (e.0.min(z), e.1.max(z)));
    for (i, j) in of.matching.pairs() {
        let (p, found) = (&t.points[i], of.found_u_um_s[j]);
        let bin = (((p.at.z_um - low) / (high - low) * BINS as f64) as usize).min(BINS - 1);
        if found.is_finite() {
            bins[bin].0.push(p.at.z_um);
            bins[bin].1.push(of.true_u_um_s[p.source as usize]);
            bins[bin].2.push(found);
        }
    }
    bins.retain(|b| !b.0.is_empty());
    let of_bin = |values: &Vec<f64>| {
        let e = Errors::of(values.iter().copied());
        (e.bias.unwrap_or(f64::NAN), e.random.unwrap_or(f64::NAN))
    };
    /// Depths, true and measured velocities of a bin.
    type Bin = (Vec<f64>, Vec<f64>, Vec<f64>);
    let at = |values: fn(&Bin) -> &Vec<f64>| -> Vec<(f64, f64)> {
        bins.iter().map(|b| (of_bin(&b.0).0, of_bin(values(b)).0)).collect()
    };
    let scatter = bins.iter().map(|b| of_bin(&b.2)).map(|(mean, std)| (mean - std, mean + std)).collect();
    let series = [
        Series::new("result", at(|b| &b.2)).with_bars(scatter),
        Series::new("truth", at(|b| &b.1)).drawn(Style::Line),
    ];
    if !series.iter().any(Series::has_points) {
        return Ok(None);
    }
    let labels = AxisLabels { x: "true depth z, um", y: "velocity u, um/s", title: "Velocity profile" };
    let from = match score.lpt.as_ref().and_then(|l| l.motion.velocity_from) {
        Some(VelocitySource::Result) => "as reported by the result",
        Some(VelocitySource::Both) => {
            "as reported by the result or, where it reports none, from differences of positions"
        }
        Some(VelocitySource::Positions) | None => "from differences of positions",
    };
    let caption = format!(
        "Velocity along x over depth, {from}: means in bins of depth; bars are the standard deviation in a bin."
    );
    Ok(Some(figure_of(lines(&labels, &series)?, &names(&series), &caption)))
}

fn histograms(of: &Particles) -> Result<Vec<Markup>> {
    let (t, r) = (&of.scored.truth, &of.scored.result);
    let errors: Vec<[f64; 3]> = of.matching.pairs().map(|p| error(t, r, p)).collect();
    let mut plots = Vec::new();
    for (k, axis) in ["x, px", "y, px", "z, um"].iter().enumerate().take(if of.depth { 3 } else { 2 }) {
        plots.extend(histogram(&format!("error in {axis}"), "particles", errors.iter().map(|e| e[k]))?);
    }
    Ok(plots)
}

/// Width and height of the images, px; for a bare table, the extent of its points.
fn size_px(of: &Particles) -> (f64, f64) {
    let (t, r) = (&of.scored.truth, &of.scored.result);
    let extent = |value: fn(&scoring::evaluate::track_set::Point) -> f64| {
        t.points.iter().chain(&r.points).map(value).fold(1.0f64, f64::max).ceil()
    };
    of.sensor_px.unwrap_or_else(|| (extent(|p| p.at.x_px), extent(|p| p.at.y_px)))
}

fn error_over_sensor(of: &Particles) -> Result<Option<Markup>> {
    let (t, r) = (&of.scored.truth, &of.scored.result);

    let errors = of.matching.pairs().map(|pair| {
        let ([dx, dy, _], at) = (error(t, r, pair), &t.points[pair.0].at);
        ((at.x_px, at.y_px), (dx * dx + dy * dy).sqrt())
    });
    let caption = "RMS error in the image plane over the sensor; cells without particles are empty.";
    error_map(size_px(of), errors, ("px", caption))
}

/// Maps of the first frame and of those with the most and the fewest misses and ghosts.
fn frames(of: &Particles) -> Result<Vec<Markup>> {
    let (t, r) = (&of.scored.truth, &of.scored.result);
    let mut plots = Vec::new();

    let frames = per_frame(t, r, &of.matching);
    let mistakes = |f: &&scoring::evaluate::detection::FrameCounts| f.counts[1] + f.counts[2];
    let shown = [
        (frames.first(), "The first frame"),
        (frames.iter().rev().max_by_key(mistakes), "The frame with the most misses and ghosts"),
        (frames.iter().min_by_key(mistakes), "The frame with the fewest misses and ghosts"),
    ];
    let mut done = Vec::new();
    for (frame, why) in shown {
        let Some(frame) = frame.filter(|f| !done.contains(&f.frame)) else { continue };
        done.push(frame.frame);
        let place = |p: &scoring::evaluate::track_set::Point| (p.at.x_px, p.at.y_px);
        let of_frame = |cloud: &'_ scoring::evaluate::track_set::TrackSet| {
            cloud.frames.iter().find(|f| f.0 == frame.frame).map_or(0..0, |f| f.1.clone())
        };
        let (mut found, mut missed) = (Vec::new(), Vec::new());
        for i in of_frame(t) {
            let list = if of.matching.result_for[i] == NONE { &mut missed } else { &mut found };
            list.push(place(&t.points[i]));
        }
        let ghosts =
            of_frame(r).filter(|&j| of.matching.truth_for[j] == NONE).map(|j| place(&r.points[j])).collect();
        let [hits, misses, extra] = frame.counts;
        let caption = format!(
            "{why} ({}): {hits} found (rings), {misses} missed (dots), {extra} ghosts (crosses).",
            frame.frame
        );
        let labels = AxisLabels { x: "x, px", y: "y, px", title: why };
        let svg = sensor(&labels, size_px(of), &Marks::Places { found, missed, ghosts })?;
        plots.push(figure(svg, &caption));
    }
    Ok(plots)
}
