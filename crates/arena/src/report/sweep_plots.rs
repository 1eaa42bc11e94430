//! Scores against the parameters of a sweep.
//!
//! Each score has a figure for each parameter: with a panel for each combination of the parameters beyond the second, and in
//! a panel at most six lines, one for each tracker and value of the second parameter. Parameters whose values are not numbers
//! have a place for each value, without lines. Scores of one tracker on cases with the same values are repetitions: the line
//! is their mean, the bar their standard deviation, and each repetition is a faint dot. A score without repetitions has its
//! own 95 % interval as bar.

use std::collections::{BTreeMap, BTreeSet};

use maud::Markup;
use serde_json::Value;

use super::figure::figure_of;
use super::leaderboard::{Entry, axis_text, order_of_axes, short_key};
use super::plots::{ACROSS, Across, AxisLabels, MOST_LINES, Series, is_logarithmic, panels};
use scoring::evaluate::Score;
use scoring::evaluate::statistics::{Errors, Interval};
use scoring::ranking::SCORES;
use storage::error::Result;

/// Panels of a figure, one below the other.
const MOST_PANELS: usize = 4;

type Scored<'a> = &'a (Entry, Score);

/// A value of a result, and its interval.
type Reading = dyn Fn(Scored<'_>) -> (Option<f64>, Interval);

/// What is drawn over a parameter.
struct Quantity {
    /// Name and unit.
    title: String,
    /// What the bars are, if they are not 95 % intervals.
    bars: Option<&'static str>,
    of: Box<Reading>,
}

/// Plots of every score over each parameter; `px_per_um_s` turns velocities of the sweep into displacements (px).
pub(super) fn axis_plots(scores: &[(Entry, Score)], px_per_um_s: Option<f64>) -> Result<Vec<Markup>> {
    let all: Vec<Scored<'_>> = scores.iter().collect();
    let keys: BTreeSet<&str> = all.iter().flat_map(|s| s.0.axes.keys()).map(String::as_str).collect();
    let values: BTreeMap<&str, Vec<String>> = keys.iter().map(|key| (*key, texts(key, &all))).collect();
    let mut plots = Vec::new();
    // The parameter with the most values is the one that the sweep is for.
    let mut axes: Vec<&str> = keys.iter().copied().collect();
    axes.sort_by_key(|axis| std::cmp::Reverse(values[axis].len()));
    for axis in axes {
        let varied = values.iter().filter(|(other, values)| **other != axis && values.len() > 1);
        let mut others: Vec<&str> = varied.map(|(other, _)| *other).collect();
        // The parameter of the lines is the one with the most values.
        others.sort_by_key(|other| std::cmp::Reverse(values[other].len()));
        let Some(x) = Parameter::of(axis, &all, &values[axis], px_per_um_s) else { continue };
        let sweep = Sweep { all: &all, x, others, keys: &keys, values: &values };
        if let Some(component) = sweep.x.component {
            plots.extend(sweep.bias_over_a_period(component)?);
        }
        for quantity in quantities(sweep.x.component) {
            plots.extend(sweep.figures(&quantity)?);
        }
    }
    Ok(plots)
}

/// The quantities in the order of their figures: errors of displacements begin with the bias along `component`.
fn quantities(component: Option<usize>) -> Vec<Quantity> {
    // The bias along `component` is drawn with the random error.
    let is_other = move |name: &str| component != Some(0) || name != "bias_u_px";
    type Plain = fn(&Score) -> Option<f64>;
    // A few outliers decide about a root mean square: what they do not decide is beside it.
    let robust: [(&str, &str, Plain); 5] = [
        ("rmse_xy_px", "median error xy, px", |s| s.detection.as_ref()?.p50_xy_px),
        ("sigma_z_over_h", "share of outliers (GDPT)", |s| s.gdpt.as_ref()?.rate_outlier),
        ("rms_nodes_px", "median error of u, px", |s| s.field.as_ref()?.main.u.median_abs_px),
        ("rms_nodes_px", "median error of v, px", |s| s.field.as_ref()?.main.v.median_abs_px),
        ("rms_nodes_px", "share of outliers", |s| s.field.as_ref()?.main.outlier_fraction),
    ];
    let quantity = |title: String, of: Box<Reading>| Quantity { title, bars: None, of };
    let shown = SCORES.iter().enumerate().filter(move |(_, def)| def.is_headline && is_other(def.name));
    let scores = shown.flat_map(move |(index, def)| {
        let score = quantity(def.title(), Box::new(move |s| s.0.score(index)));
        let beside = robust.into_iter().filter(|(name, ..)| *name == def.name);
        let beside =
            beside.map(|(_, title, of)| quantity(title.to_owned(), Box::new(move |s| (of(&s.1), None))));
        std::iter::once(score).chain(beside).collect::<Vec<_>>()
    });
    let bias = component.map(|k| Quantity {
        title: ["bias of u, px", "bias of v, px"][k].to_owned(),
        bars: Some("random errors"),
        of: Box::new(move |s| biased(&s.1, k)),
    });
    bias.into_iter().chain(scores).collect()
}

/// Bias of a component of the displacement, and the same with the random error on both sides.
fn biased(score: &Score, component: usize) -> (Option<f64>, Interval) {
    let of = score.field.as_ref().map(|field| if component == 0 { &field.main.u } else { &field.main.v });
    let ends = of.and_then(|of| Some((of.bias_px?, of.random_px?)));
    (of.and_then(|of| of.bias_px), ends.map(|(bias, random)| [bias - random, bias + random]))
}

/// A parameter of the sweep along the horizontal axis.
struct Parameter {
    label: String,
    key: String,
    /// Which number of a value places it, times a factor; `None` for values that are not numbers.
    number: Option<(usize, f64)>,
    /// Values that are not numbers, with their names.
    names: Vec<(String, String)>,
    /// The component of a displacement (px) that the numbers are.
    component: Option<usize>,
}

impl Parameter {
    fn of(key: &str, all: &[Scored<'_>], texts: &[String], px_per_um_s: Option<f64>) -> Option<Self> {
        let values = order_of_axes(all.iter().filter_map(|s| s.0.axes.get_key_value(key)));
        let (_, stem, first, _) = values.first()?;
        let has_form =
            values.iter().all(|(_, s, n, _)| s == stem && n.len() == first.len()) && !first.is_empty();
        let differs = |nth: &usize| values.iter().any(|(_, _, numbers, _)| numbers[*nth] != first[*nth]);
        let different: Vec<usize> = (0..if has_form { first.len() } else { 0 }).filter(differs).collect();
        let nth = match different[..] {
            [] if has_form => Some(0),
            [nth] => Some(nth),
            _ => None,
        };
        let words = words(key);
        let is_vector = first.len() > 1;
        let velocity = px_per_um_s.filter(|_| words == "velocity, um/s");
        let component = nth.filter(|nth| is_vector && velocity.is_some() && *nth < 2);
        let label = match component {
            Some(k) => format!("displacement along {}, px", ['x', 'y'][k]),
            None => match nth.filter(|_| is_vector && first.len() == 3) {
                Some(k) => {
                    let (name, unit) = words.split_once(", ").unwrap_or((&words, ""));
                    let separator = if unit.is_empty() { "" } else { ", " };
                    format!("{name} along {}{separator}{unit}", ["x", "y", "z"][k])
                }
                None => words,
            },
        };
        let mut names: Vec<(String, String)> = Vec::new();
        if nth.is_none() {
            names = texts.iter().map(|text| (text.clone(), short_value(text, texts))).collect();
        }
        let factor = component.and(velocity).unwrap_or(1.0);
        Some(Parameter { label, key: key.to_owned(), number: nth.map(|nth| (nth, factor)), names, component })
    }

    /// Where the value of a score is along the axis.
    fn place(&self, s: Scored<'_>) -> Option<f64> {
        let value = s.0.axes.get_key_value(&self.key)?;
        match self.number {
            Some((nth, factor)) => {
                order_of_axes(std::iter::once(value)).pop()?.2.get(nth).map(|v| v * factor)
            }
            None => {
                let text = axis_text(value.1);
                self.names.iter().position(|(value, _)| *value == text).map(|k| k as f64)
            }
        }
    }
}

/// The name of a key in the words of the field, with its unit.
fn words(key: &str) -> String {
    for (end, words) in [
        ("number.count", "particles in view"),
        ("number.ppp", "particles per pixel"),
        ("number.n_s", "source density N_S"),
        ("c_int.normal.sd", "standard deviation of the brightness"),
        ("background_noise", "background noise, counts"),
        ("background_mean", "background, counts"),
        ("cyl_focal_length", "focal length of the cylindrical lens, um"),
        ("optics.cylinder", "cylindrical lens"),
        ("shear.rate_per_s", "shear rate, 1/s"),
    ] {
        if key.ends_with(end) {
            return words.to_owned();
        }
    }
    let last = key.rsplit('.').next().unwrap_or(key);
    let unit = scenario::spec::schema().find(key).and_then(|entry| entry.words("x-unit").map(str::to_owned));
    let Some(unit) = unit else { return last.replace('_', " ") };
    let ending = format!("_{}", unit.replace('/', "_"));
    format!("{}, {unit}", last.strip_suffix(&ending).unwrap_or(last).replace('_', " "))
}

/// The values of a parameter, in their order.
fn texts(key: &str, all: &[Scored<'_>]) -> Vec<String> {
    let mut values: Vec<_> = all.iter().filter_map(|s| s.0.axes.get_key_value(key)).collect();
    values.sort_by(|a, b| {
        let [a, b] = [*a, *b].map(|value| order_of_axes(std::iter::once(value)));
        a.partial_cmp(&b).unwrap_or(std::cmp::Ordering::Equal)
    });
    let mut texts: Vec<String> = values.into_iter().map(|(_, value)| axis_text(value)).collect();
    texts.dedup();
    texts
}

/// Part of a value in words: `to_sensor_mm: 70` as `to sensor 70 mm`.
fn in_words(part: &str) -> String {
    let Some((key, value)) = part.split_once(':') else {
        return if part == "None" { "none".to_owned() } else { part.replace('_', " ") };
    };
    let (name, unit) = match key.rsplit_once('_') {
        Some((name, unit @ ("um" | "mm" | "px" | "deg" | "s"))) => (name, unit),
        _ => (key, ""),
    };
    format!("{} {} {unit}", name.replace('_', " "), value.trim()).trim_end().to_owned()
}

/// The parts of a value that not all values have.
fn short_value(text: &str, all: &[String]) -> String {
    if text.contains('[') {
        return text.to_owned();
    }
    let parts = |text: &str| -> Vec<String> {
        text.split(['(', ')', ','])
            .map(|part| part.trim().to_owned())
            .filter(|part| !part.is_empty())
            .collect()
    };
    // `lens(...)` and `None` share nothing: what those with several parts share is left out.
    let alike: Vec<_> = all.iter().map(|other| parts(other)).filter(|parts| parts.len() > 1).collect();
    let is_own = |part: &String| {
        parts(text).len() < 2 || alike.len() < 2 || alike.iter().any(|other| !other.contains(part))
    };
    let own: Vec<String> = parts(text).into_iter().filter(is_own).collect();
    // `count(2)` is clear as it is.
    let is_whole = own.len() > 1 && own.len() == parts(text).len() && !text.contains(':');
    if own.is_empty() || is_whole {
        return text.to_owned();
    }
    own.iter().map(|part| in_words(part)).collect::<Vec<_>>().join(", ")
}

/// The scores over one of the parameters.
struct Sweep<'a> {
    all: &'a [Scored<'a>],
    x: Parameter,
    /// The other parameters that vary: the first one distinguishes lines, the rest panels.
    others: Vec<&'a str>,
    keys: &'a BTreeSet<&'a str>,
    /// The values of each parameter.
    values: &'a BTreeMap<&'a str, Vec<String>>,
}

/// The scores of a line: at each place of the axis, all repetitions.
type Line<'a> = Vec<(f64, Vec<Scored<'a>>)>;

/// A figure: panels with their titles, each with the same lines.
struct Layout<'a> {
    lines: Vec<String>,
    panels: Vec<(String, Vec<Line<'a>>)>,
}

impl<'a> Layout<'a> {
    /// The panels with the series of each line.
    fn drawn(&self, series: impl Fn(&str, &Line<'a>) -> Series) -> Vec<(String, Vec<Series>)> {
        let of_panel = |(title, lines): &(String, Vec<Line<'a>>)| {
            (title.clone(), self.lines.iter().zip(lines).map(|(name, line)| series(name, line)).collect())
        };
        self.panels.iter().map(of_panel).collect()
    }
}

impl<'a> Sweep<'a> {
    /// Name and value of a parameter of a score.
    fn text(&self, key: &str, s: Scored<'_>) -> String {
        let value = axis_text(s.0.axes.get(key).unwrap_or(&Value::Null));
        let value = short_value(&value, &self.values[key]);
        let named = words(key);
        if self.keys.iter().any(|other| *other != key && words(other) == named) {
            return format!("{} = {value}", short_key(key, self.keys).replace('_', " "));
        }
        match named.split_once(", ") {
            Some((name, unit)) if value.parse::<f64>().is_ok() => format!("{name} = {value} {unit}"),
            _ => format!("{named} = {value}"),
        }
    }

    fn layouts(&self, has: impl Fn(Scored<'_>) -> bool) -> Vec<Layout<'a>> {
        let drawn: Vec<Scored<'a>> = self.all.iter().copied().filter(|s| has(s)).collect();
        let (line_keys, panel_keys) = self.others.split_at(self.others.len().min(1));
        let name = |keys: &[&str], has_tracker: bool, s: Scored<'a>| {
            let own = keys.iter().map(|key| self.text(key, s));
            let tracker = has_tracker.then(|| s.0.tracker.clone());
            tracker.into_iter().chain(own).collect::<Vec<_>>().join(", ")
        };
        // In the order of trackers, then of values.
        let names = |keys: &[&str], has_tracker: bool| {
            let order = |s: Scored<'a>| {
                let of = |key: &&str| order_of_axes(s.0.axes.get_key_value(*key).into_iter());
                (s.0.tracker.as_str(), keys.iter().map(of).collect::<Vec<_>>())
            };
            let mut sorted = drawn.clone();
            sorted.sort_by(|a, b| order(a).partial_cmp(&order(b)).unwrap_or(std::cmp::Ordering::Equal));
            let mut names: Vec<String> = Vec::new();
            for name in sorted.into_iter().map(|s| name(keys, has_tracker, s)) {
                if !names.contains(&name) {
                    names.push(name);
                }
            }
            names
        };
        // Too many lines: a panel for each tracker.
        let are_split = !line_keys.is_empty() && names(line_keys, true).len() > MOST_LINES;
        let (lines, titles) = (names(line_keys, !are_split), names(panel_keys, are_split));
        let line = |title: &String, of: &String| -> Line<'a> {
            let is_own = |s: &Scored<'a>| {
                name(panel_keys, are_split, s) == *title && name(line_keys, !are_split, s) == *of
            };
            let own = drawn.iter().copied().filter(is_own);
            let mut placed: Vec<(f64, Scored<'a>)> =
                own.filter_map(|s| Some((self.x.place(s)?, s))).collect();
            placed.sort_by(|a, b| a.0.total_cmp(&b.0));
            let same = placed.chunk_by(|a, b| a.0.total_cmp(&b.0).is_eq());
            same.map(|same| (same[0].0, same.iter().map(|p| p.1).collect())).collect()
        };
        let mut layouts = Vec::new();
        for lines in lines.chunks(MOST_LINES) {
            layouts.extend(titles.chunks(MOST_PANELS).map(|titles| {
                Layout {
                    lines: lines.to_vec(),
                    panels: titles
                        .iter()
                        .map(|title| (title.clone(), lines.iter().map(|of| line(title, of)).collect()))
                        .collect(),
                }
            }));
        }
        layouts
    }

    fn figures(&self, quantity: &Quantity) -> Result<Vec<Markup>> {
        let layouts = self.layouts(|s| (quantity.of)(s).0.is_some());
        layouts.iter().map(|layout| self.figure(layout, quantity)).collect()
    }

    /// A score over the axis.
    fn figure(&self, layout: &Layout<'_>, quantity: &Quantity) -> Result<Markup> {
        let points = || layout.panels.iter().flat_map(|panel| panel.1.iter().flatten());
        let counts = points().map(|(_, same)| same.len());
        let (least, most) = counts.fold((usize::MAX, 0), |(a, b), n| (a.min(n), b.max(n)));
        let drawn = layout.drawn(|name, line| series(name, line, quantity, most > 1));
        let mut at: Vec<f64> = points().map(|point| point.0).collect();
        at.sort_unstable_by(f64::total_cmp);
        at.dedup();
        let is_log = self.x.names.is_empty() && is_logarithmic(&at);
        let names: Vec<&str> = self.x.names.iter().map(|name| name.1.as_str()).collect();
        let across = if !names.is_empty() {
            Across::Names(&names)
        } else if is_log {
            Across::Log(at.iter().copied().step_by(at.len().div_ceil(ACROSS)).collect())
        } else {
            Across::Linear
        };
        let (x, y) = (&self.x.label, &quantity.title);
        let mut caption = format!("{y} against {x}{}", if is_log { " (logarithmic)" } else { "" });
        if most > 1 {
            let n = if least == most { format!("{most}") } else { format!("{least} to {most}") };
            caption += &format!(
                ": mean of {n} repetitions, each of them a dot; bars are their standard deviation (divisor n - 1)"
            );
        } else if drawn.iter().flat_map(|panel| &panel.1).any(|s| s.bars.iter().any(|bar| bar.0.is_finite()))
        {
            caption += &format!("; bars are {}", quantity.bars.unwrap_or("95 % intervals"));
        }
        shown(AxisLabels { x, y, title: y }, &drawn, &across, &caption)
    }

    /// The bias of a displacement against its fraction of a pixel, over one period.
    fn bias_over_a_period(&self, component: usize) -> Result<Vec<Markup>> {
        let layouts = self.layouts(|s| biased(&s.1, component).0.is_some());
        let of_line = |name: &str, line: &Line<'_>| {
            // Thousandths of a pixel, with bias and random error.
            let mut at: BTreeMap<i64, Vec<[f64; 2]>> = BTreeMap::new();
            for (x, same) in line {
                let thousandth = (1000.0 * (x - x.floor())).round() as i64 % 1000;
                let of = same.iter().filter_map(|s| match biased(&s.1, component) {
                    (Some(bias), Some([low, _])) => Some([bias, bias - low]),
                    _ => None,
                });
                at.entry(thousandth).or_default().extend(of);
            }
            at.extend(at.get(&0).cloned().map(|whole| (1000, whole)));
            let mut drawn = Series::new(name, Vec::new());
            for (thousandth, all) in at.into_iter().filter(|(_, all)| !all.is_empty()) {
                let x = thousandth as f64 / 1000.0;
                let n = all.len() as f64;
                let bias = all.iter().map(|v| v[0]).sum::<f64>() / n;
                let random = (all.iter().map(|v| v[1] * v[1]).sum::<f64>() / n).sqrt();
                drawn.points.push((x, bias));
                drawn.bars.push((bias - random, bias + random));
                drawn.singles.extend(all.iter().filter(|_| n > 1.0).map(|v| (x, v[0])));
            }
            drawn
        };
        let figure = |layout: &Layout<'_>| {
            let y = ["bias of u, px", "bias of v, px"][component];
            let labels = AxisLabels { x: "fractional displacement, px", y, title: y };
            let caption = "bias against the fractional displacement, which shows peak locking: displacements that differ by whole \
                           pixels are faint dots, their mean a line; bars are random errors";
            shown(labels, &layout.drawn(of_line), &Across::Linear, caption)
        };
        layouts.iter().map(figure).collect()
    }
}

/// Panels with their legend and caption.
fn shown(
    labels: AxisLabels<'_>,
    drawn: &[(String, Vec<Series>)],
    across: &Across<'_>,
    caption: &str,
) -> Result<Markup> {
    let svg = panels(&labels, drawn, across)?;
    // A line may have points in some panels only.
    let has_points = |k: usize| drawn.iter().any(|panel| panel.1[k].has_points());
    let lines = drawn.first().map_or(&[][..], |panel| &panel.1).iter().enumerate();
    let legend: Vec<&str> =
        lines.map(|(k, line)| if has_points(k) { line.name.as_str() } else { "" }).collect();
    let mut caption = format!("{caption}.");
    caption[..1].make_ascii_uppercase();
    Ok(figure_of(svg, &legend, &caption))
}

fn series(name: &str, line: &Line<'_>, quantity: &Quantity, has_repetitions: bool) -> Series {
    const NONE: (f64, f64) = (f64::NAN, f64::NAN);
    let mut drawn = Series::new(name, Vec::new());
    for (x, same) in line {
        let values: Vec<f64> = same.iter().filter_map(|s| (quantity.of)(s).0).collect();
        let of = Errors::of(values.iter().copied());
        let mean = of.bias.unwrap_or(f64::NAN);
        drawn.points.push((*x, mean));
        if has_repetitions {
            drawn.singles.extend(values.iter().map(|v| (*x, *v)));
            let n = values.len() as f64;
            let deviation = of.random.filter(|_| n > 1.0).map(|random| random * (n / (n - 1.0)).sqrt());
            drawn.bars.push(deviation.map_or(NONE, |d| (mean - d, mean + d)));
        } else {
            let ends = same.iter().find_map(|s| (quantity.of)(s).1);
            drawn.bars.push(ends.map_or(NONE, |[low, high]| (low, high)));
        }
    }
    drawn
}

#[cfg(test)]
mod tests {
    use scoring::evaluate::field::FieldScore;
    use serde_json::json;

    use super::*;

    fn scored(tracker: &str, f1: f64, axes: &[(&str, Value)]) -> (Entry, Score) {
        let mut entry = Entry::default();
        // F1 is the first score.
        (entry.tracker, entry.scores) = (tracker.to_owned(), vec![(Some(f1), None)]);
        entry.axes = axes.iter().map(|(axis, value)| ((*axis).to_owned(), value.clone())).collect();
        (entry, Score::default())
    }

    /// The figures over all parameters, as text.
    fn pages(scores: &[(Entry, Score)]) -> Vec<String> {
        axis_plots(scores, Some(0.005 / 0.645)).unwrap().into_iter().map(Markup::into_string).collect()
    }

    #[test]
    fn repetitions_are_a_mean_with_its_standard_deviation() {
        let of = |x: f64, f1: f64| scored("ncc", f1, &[("a.x", x.into())]);
        let scores = [of(1.0, 0.9), of(1.0, 0.7), of(20.0, 0.4), of(20.0, 0.6), of(3.0, 0.5)];
        let [page] = &pages(&scores)[..] else { panic!("not one figure") };
        assert!(
            page.contains("F1 against x (logarithmic): mean of 1 to 2 repetitions")
                && page.contains("deviation"),
            "{page}"
        );
        assert_eq!(page.matches("opacity=\"0.35\"").count(), 5, "faint dots");
        let quantity = &quantities(None)[0];
        let all: Vec<Scored<'_>> = scores.iter().collect();
        let line = vec![(1.0, all[..2].to_vec()), (3.0, all[4..].to_vec())];
        let drawn = series("", &line, quantity, true);
        // The standard deviation of two values is their distance over the square root of 2.
        assert!((drawn.bars[0].1 - 0.8 - 0.1 * 2f64.sqrt()).abs() < 1e-12 && drawn.bars[1].0.is_nan());
    }

    #[test]
    fn a_score_without_repetitions_has_its_interval() {
        let mut scores = [1.0, 2.0].map(|x: f64| scored("ncc", 0.5, &[("x", x.into())]));
        for (entry, _) in &mut scores {
            entry.scores[0].1 = Some([0.4, 0.6]);
        }
        assert!(pages(&scores)[0].contains("F1 against x; bars are 95 % intervals."));
    }

    #[test]
    fn values_that_are_no_numbers_are_categories() {
        let lens = |mm: &str| json!(format!("lens(focal_length_mm: 1000, to_sensor_mm: {mm})"));
        let values = [json!("None"), lens("70"), lens("115")];
        let scores = values.map(|value| scored("ncc", 0.5, &[("optics.cylinder", value)]));
        let page = pages(&scores).concat();
        assert!(page.contains("F1 against cylindrical lens"), "{page}");
        let place = |name: &str| page.lines().position(|line| line.trim() == name).unwrap();
        assert!(["none", "to sensor 70 mm", "to sensor 115"].map(place).is_sorted(), "{page}");
        let is_curve = |line: &str| line.contains("<polyline") && line.contains("stroke-width=\"2\"");
        assert!(!page.contains("focal length 1000") && !page.lines().any(is_curve), "dots without lines");
    }

    #[test]
    fn a_panel_has_at_most_six_lines_and_further_parameters_have_panels() {
        let mut scores = Vec::new();
        for (tracker, x) in ["mle", "ncc"].into_iter().flat_map(|t| [1.0, 2.0].map(|x| (t, x))) {
            for (noise, count) in [0, 100, 20, 400].into_iter().flat_map(|n| [5, 9].map(|c| (n, c))) {
                let axes = [
                    ("x", x.into()),
                    ("optics.background_noise", noise.into()),
                    ("particles.number.count", count.into()),
                    ("timing.pairs.count", 2.into()),
                ];
                scores.push(scored(tracker, 0.5, &axes));
            }
        }
        let page = &pages(&scores).into_iter().find(|page| page.contains("F1 against x.")).unwrap();
        // Four values of the noise with two trackers would be eight lines: each tracker has its panels.
        let titles = [
            "mle, particles in view = 5",
            "mle, particles in view = 9",
            "ncc, particles in view = 5",
            "ncc, particles in view = 9",
        ];
        for title in titles {
            assert!(page.lines().any(|line| line.trim() == title), "{title} is no title in {page}");
        }
        let legend: Vec<_> = page.match_indices("background noise = ").map(|(at, _)| at).collect();
        assert_eq!(legend.len(), 4, "one legend: {page}");
        let named = ["noise = 0 counts<", "noise = 20 counts<", "noise = 100 counts<", "noise = 400 counts<"]
            .map(|name| page.find(name).unwrap());
        assert!(named.is_sorted(), "in the order of their numbers");
        // A parameter with one value is not named.
        assert!(!page.contains("pairs.count = 2"));
    }

    #[test]
    fn a_logarithmic_axis_has_ticks_at_its_values() {
        let scores = [4.0, 16.0, 64.0, 256.0].map(|x: f64| scored("ncc", 0.5, &[("x", x.into())]));
        let page = &pages(&scores)[0];
        assert!(page.contains("F1 against x (logarithmic)."));
        for tick in ["4", "16", "64", "256"] {
            assert!(page.lines().any(|line| line.trim() == tick), "{tick} is no tick");
        }
    }

    /// 129 um/s are 1 px from frame to frame.
    #[test]
    fn the_bias_of_displacements_is_shown_first_and_over_one_period() {
        let of = |velocity: &str, bias: f64| {
            let key = "motion.flow.field.uniform.velocity_um_s";
            let (entry, mut score) = scored("piv", 0.5, &[(key, velocity.into())]);
            let mut field = FieldScore::default();
            (field.main.u.bias_px, field.main.u.random_px) = (Some(bias), Some(0.01));
            score.field = Some(field);
            (entry, score)
        };
        let scores = [of("(0.0, 0, 0)", 0.0), of("(32.25, 0, 0)", 0.03), of("(161.25, 0, 0)", 0.05)];
        let found = pages(&scores);
        assert!(
            found[0].contains("fractional displacement, px") && found[0].contains("bias of u, px"),
            "{}",
            found[0]
        );
        assert!(
            found[1].contains("Bias of u, px against displacement along x, px; bars are random errors."),
            "{}",
            found[1]
        );
        for tick in ["0.2", "1"] {
            assert!(found[0].lines().any(|line| line.trim() == tick), "{tick} is no tick of {}", found[0]);
        }
        // 0.25 and 1.25 px are one point with two faint dots.
        assert_eq!(found[0].matches("opacity=\"0.35\"").count(), 2, "{}", found[0]);
    }

    #[test]
    fn parameters_are_named_in_the_words_of_the_field() {
        for (key, expected) in [
            ("motion.flow.field.sinusoid.wavelength_um", "wavelength, um"),
            ("optics.background_noise", "background noise, counts"),
            ("particles.number.ppp", "particles per pixel"),
            ("motion.flow.field.uniform.velocity_um_s", "velocity, um/s"),
            ("x", "x"),
        ] {
            assert_eq!(words(key), expected);
        }
        let z = [(0.0, 0.1), (3.0, 0.2)].map(|(w, f1): (f64, f64)| {
            scored("piv", f1, &[("u.velocity_um_s", format!("(0, 0, {w})").into())])
        });
        assert!(pages(&z).concat().contains("F1 against velocity um s along z"), "{}", pages(&z).concat());
    }
}
