//! Scores against the parameters of a sweep.
//!
//! Scores of one tracker on cases with the same values are repetitions: the line is their mean, the bar their
//! standard deviation, and each repetition is a faint dot. A score without repetitions has its own 95 %
//! interval as bar.

use std::cmp::Ordering;
use std::collections::BTreeSet;

use maud::{Markup, html};

use super::figure::{figure_by_group, names};
use super::leaderboard::{Entry, axis_text, order_of_axes, short_key};
use super::log_axis::is_logarithmic;
use super::plots::{AxisLabels, Series, lines, lines_over_log};
use scoring::evaluate::statistics::Errors;
use scoring::ranking::SCORES;
use storage::error::Result;

/// Plots of every score over each parameter, with a line for each tracker and each combination of the other
/// parameters; a parameter that is not plotted is named.
pub(super) fn axis_plots(entries: &[&Entry]) -> Result<Vec<Markup>> {
    let mut axes: Vec<&str> = entries.iter().flat_map(|e| e.axes.keys().map(String::as_str)).collect();
    axes.sort_unstable();
    axes.dedup();
    let mut plots = Vec::new();
    for axis in axes {
        let Some(numbers) = numbers_of(axis, entries) else {
            let why = "its values are not numbers, or differ in more than one number";
            plots.push(html! { p { "There is no plot over " code { (axis) } ": " (why) "." } });
            continue;
        };
        let on_axis = lines_over(axis, entries, numbers.nth);
        for (index, def) in SCORES.iter().enumerate().filter(|(_, def)| def.is_headline) {
            plots.extend(plot(&numbers.label, &on_axis, &def.title(), index)?);
        }
    }
    Ok(plots)
}

/// The scores of a tracker over an axis.
struct Line<'a> {
    tracker: &'a str,
    /// Values on the other axes.
    fixed: String,
    /// Values on the axis in ascending order, each with its repetitions.
    points: Vec<(f64, Vec<&'a Entry>)>,
}

/// The number in the values of an axis that places them.
struct PlacingNumber {
    nth: usize,
    label: String,
}

/// The number in which values of an axis differ: the value itself, or a component of a vector as in `(12.9, 0, 0)`;
/// `None` if the values differ in several numbers or in words.
fn numbers_of(axis: &str, entries: &[&Entry]) -> Option<PlacingNumber> {
    let values = order_of_axes(entries.iter().filter_map(|e| e.axes.get_key_value(axis)));
    let (_, stem, first, _) = values.first()?;
    let same_form = values.iter().all(|(_, s, n, _)| s == stem && n.len() == first.len());
    let differs = |nth: &usize| values.iter().any(|(_, _, numbers, _)| numbers[*nth] != first[*nth]);
    if !same_form || first.is_empty() {
        return None;
    }
    let different: Vec<usize> = (0..first.len()).filter(differs).collect();
    let nth = match different[..] {
        [] => 0,
        [nth] => nth,
        _ => return None,
    };
    let label = if first.len() == 1 {
        axis.to_owned()
    } else {
        format!("{axis}, number {} of {}", nth + 1, first.len())
    };
    Some(PlacingNumber { nth, label })
}

fn lines_over<'a>(axis: &str, entries: &[&'a Entry], nth: usize) -> Vec<Line<'a>> {
    let keys: BTreeSet<&str> = entries.iter().flat_map(|e| e.axes.keys().map(String::as_str)).collect();
    let number = |e: &Entry| order_of_axes(e.axes.get_key_value(axis).into_iter()).pop()?.2.get(nth).copied();
    let mut placed: Vec<(f64, &Entry)> = entries.iter().filter_map(|e| Some((number(e)?, *e))).collect();
    let others = |e: &'a Entry| order_of_axes(e.axes.iter().filter(|(other, _)| *other != axis));
    placed.sort_by(|a, b| {
        let by_others = || others(a.1).partial_cmp(&others(b.1)).unwrap_or(Ordering::Equal);
        a.1.tracker.cmp(&b.1.tracker).then_with(by_others).then_with(|| a.0.total_cmp(&b.0))
    });
    let same_line =
        |a: &(f64, &'a Entry), b: &(f64, &'a Entry)| a.1.tracker == b.1.tracker && others(a.1) == others(b.1);
    let of_line = |line: &[(f64, &'a Entry)]| {
        let (_, first) = line[0];
        let fixed = first.axes.iter().filter(|(other, _)| *other != axis);
        let fixed = fixed.map(|(other, v)| format!("{} = {}", short_key(other, &keys), axis_text(v)));
        let fixed = fixed.collect::<Vec<_>>().join(", ");
        let points = line.chunk_by(|a, b| a.0.total_cmp(&b.0).is_eq());
        let points = points.map(|same| (same[0].0, same.iter().map(|p| p.1).collect())).collect();
        Line { tracker: &first.tracker, fixed, points }
    };
    placed.chunk_by(same_line).map(of_line).collect()
}

/// A score over an axis; `None` if no case has it.
fn plot(x: &str, on_axis: &[Line<'_>], y: &str, index: usize) -> Result<Option<Markup>> {
    // Minimum and maximum number of repetitions of the points.
    let counts = on_axis.iter().flat_map(|line| &line.points);
    let counts = counts.map(|(_, same)| same.iter().filter(|e| e.score(index).0.is_some()).count());
    let (least, most) = counts.filter(|n| *n > 0).fold((usize::MAX, 0), |(a, b), n| (a.min(n), b.max(n)));
    let mut series: Vec<Series> = on_axis.iter().map(|line| series(line, index, most > 1)).collect();
    let mut trackers: Vec<&str> = on_axis.iter().map(|line| line.tracker).collect();
    let mut drawn = series.iter().map(Series::has_points);
    trackers.retain(|_| drawn.next() == Some(true));
    series.retain(Series::has_points);
    if series.is_empty() {
        return Ok(None);
    }
    let mut at: Vec<f64> = on_axis.iter().flat_map(|line| line.points.iter().map(|p| p.0)).collect();
    at.sort_unstable_by(f64::total_cmp);
    at.dedup();
    let (labels, is_log) = (AxisLabels { x, y, title: y }, is_logarithmic(&at));
    let svg = if is_log { lines_over_log(&labels, &series, &at) } else { lines(&labels, &series) }?;
    let mut caption = format!("{y} against {x}{}", if is_log { " (logarithmic)" } else { "" });
    if most > 1 {
        let n = if least == most { format!("{most}") } else { format!("{least} to {most}") };
        caption += &format!(
            ": mean of {n} repetitions, each of them a dot; bars are their standard deviation (divisor n - 1)"
        );
    } else if series.iter().any(|s| s.bars.iter().any(|bar| bar.0.is_finite())) {
        caption += "; bars are 95 % intervals";
    }
    caption += ".";
    caption[..1].make_ascii_uppercase();
    Ok(Some(figure_by_group(svg, &trackers, &names(&series), &caption)))
}

fn series(line: &Line<'_>, index: usize, has_repetitions: bool) -> Series {
    const NONE: (f64, f64) = (f64::NAN, f64::NAN);
    let mut drawn = Series::new(&line.fixed, Vec::new());
    for (x, same) in &line.points {
        let values: Vec<f64> = same.iter().filter_map(|e| e.score(index).0).collect();
        let of = Errors::of(values.iter().copied());
        let mean = of.bias.unwrap_or(f64::NAN);
        drawn.points.push((*x, mean));
        if has_repetitions {
            drawn.singles.extend(values.iter().map(|v| (*x, *v)));
            let n = values.len() as f64;
            let deviation = of.random.filter(|_| n > 1.0).map(|random| random * (n / (n - 1.0)).sqrt());
            drawn.bars.push(deviation.map_or(NONE, |d| (mean - d, mean + d)));
        } else {
            let ends = same.iter().find_map(|e| e.score(index).1);
            drawn.bars.push(ends.map_or(NONE, |[low, high]| (low, high)));
        }
    }
    drawn
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::*;

    fn entry(tracker: &str, f1: f64, axes: &[(&str, Value)]) -> Entry {
        let mut entry = Entry::default();
        // F1 is the first score.
        (entry.tracker, entry.scores) = (tracker.to_owned(), vec![(Some(f1), None)]);
        entry.axes = axes.iter().map(|(axis, value)| ((*axis).to_owned(), value.clone())).collect();
        entry
    }

    #[test]
    fn repetitions_are_a_mean_with_its_standard_deviation() {
        let of = |x: f64, f1: f64| entry("ncc", f1, &[("a.x", x.into())]);
        let entries = [of(1.0, 0.9), of(1.0, 0.7), of(20.0, 0.4), of(20.0, 0.6), of(3.0, 0.5)];
        let entries: Vec<&Entry> = entries.iter().collect();
        let on_axis = lines_over("a.x", &entries, 0);
        let [line] = &on_axis[..] else { panic!("{} lines", on_axis.len()) };
        let drawn = series(line, 0, true);
        // One point for each value, so that no line connects repetitions.
        let expected = [(1.0, 0.8, 0.1), (3.0, 0.5, f64::NAN), (20.0, 0.5, 0.1)];
        assert_eq!((drawn.points.len(), drawn.bars.len(), drawn.singles.len()), (3, 3, 5));
        for ((point, bar), (x, mean, half)) in drawn.points.iter().zip(&drawn.bars).zip(expected) {
            // The standard deviation of two values is their distance over the square root of 2; up to
            // rounding.
            let half = half * 2f64.sqrt();
            assert!((point.0, (point.1 - mean).abs() < 1e-12) == (x, true), "{point:?}");
            assert!(half.is_nan() && bar.0.is_nan() || (bar.1 - mean - half).abs() < 1e-12, "{bar:?}");
        }
        let page = plot("a.x", &on_axis, "F1", 0).unwrap().unwrap().into_string();
        assert!(
            page.contains("F1 against a.x (logarithmic): mean of 1 to 2 repetitions")
                && page.contains("deviation")
        );
        assert_eq!(page.matches("opacity=\"0.35\"").count(), 5, "faint dots");
    }

    #[test]
    fn a_score_without_repetitions_has_its_interval() {
        let mut entries = [1.0, 2.0].map(|x: f64| entry("ncc", 0.5, &[("x", x.into())]));
        for entry in &mut entries {
            entry.scores[0].1 = Some([0.4, 0.6]);
        }
        let on_axis = lines_over("x", &entries.iter().collect::<Vec<_>>(), 0);
        let drawn = series(&on_axis[0], 0, false);
        assert_eq!((drawn.bars, drawn.singles.len()), (vec![(0.4, 0.6); 2], 0));
        let page = plot("x", &on_axis, "F1", 0).unwrap().unwrap().into_string();
        assert!(page.contains("F1 against x; bars are 95 % intervals."), "{page}");
    }

    #[test]
    fn lines_are_in_the_order_of_numbers() {
        let values = [100.0, 20.0, 400.0, 0.0];
        let of = |noise: f64| entry("ncc", 0.5, &[("o.noise", noise.into()), ("n.count", 16.0.into())]);
        let entries = values.map(of);
        let on_axis = lines_over("n.count", &entries.iter().collect::<Vec<_>>(), 0);
        let fixed: Vec<&str> = on_axis.iter().map(|line| line.fixed.as_str()).collect();
        assert_eq!(fixed, ["noise = 0", "noise = 20", "noise = 100", "noise = 400"]);
    }

    #[test]
    fn a_legend_names_keys_and_has_a_line_for_each_tracker() {
        let of = |tracker: &str, count: u32| {
            let axes = [
                ("x", 1.0.into()),
                ("particles.number.count", count.into()),
                ("timing.pairs.count", 2.into()),
            ];
            entry(tracker, 0.5, &axes)
        };
        let entries = [of("ncc", 5), of("spots", 5), of("ncc", 9)];
        let page = plot("x", &lines_over("x", &entries.iter().collect::<Vec<_>>(), 0), "F1", 0);
        let page = page.unwrap().unwrap().into_string();
        let (ncc, spots) = (page.find("<b>ncc</b>: ").unwrap(), page.find("<b>spots</b>: ").unwrap());
        assert!(page[ncc..spots].contains("number.count = 5, pairs.count = 2"), "{page}");
        assert!(page[ncc..spots].contains("number.count = 9, pairs.count = 2"), "{page}");
        assert!(page[spots..].contains("number.count = 5") && !page[spots..].contains("number.count = 9"));
        let alone = [entry("ncc", 0.5, &[("x", 1.0.into())])];
        let page = plot("x", &lines_over("x", &alone.iter().collect::<Vec<_>>(), 0), "F1", 0);
        assert!(page.unwrap().unwrap().into_string().contains("<b>ncc</b> <span"));
    }

    #[test]
    fn a_logarithmic_axis_has_ticks_at_its_values() {
        let of = |x: f64| entry("ncc", 0.5, &[("x", x.into())]);
        let entries = [4.0, 16.0, 64.0, 256.0].map(of);
        let on_axis = lines_over("x", &entries.iter().collect::<Vec<_>>(), 0);
        let page = plot("x", &on_axis, "F1", 0).unwrap().unwrap().into_string();
        assert!(page.contains("F1 against x (logarithmic)."));
        for tick in ["4", "16", "64", "256"] {
            assert!(page.lines().any(|line| line.trim() == tick), "{tick} is no tick");
        }
    }

    #[test]
    fn vectors_are_placed_by_the_component_that_differs() {
        let page = |values: [&str; 3]| {
            let of = |value: &str| entry("piv", 0.5, &[("velocity", value.into())]);
            let entries = values.map(of);
            let plots = axis_plots(&entries.iter().collect::<Vec<_>>()).unwrap();
            plots.into_iter().map(Markup::into_string).collect::<String>()
        };
        let vectors = page(["(-12.9, 0, 1)", "(0, 0, 1)", "(25, 0, 1)"]);
        assert!(vectors.contains("F1 against velocity, number 1 of 3"), "{vectors}");
        assert_eq!(numbers_of("x", &[&entry("a", 0.5, &[("x", 3.into())])]).unwrap().label, "x");
        for values in [["(0, 1)", "(1, 2)", "(2, 3)"], ["spherical", "cylindrical", "spherical"]] {
            assert!(page(values).starts_with("<p>There is no plot over <code>velocity</code>"));
        }
    }
}
