//! Ranking by several criteria in order of priority, as far as confidence intervals separate scores.

use scoring::evaluate::statistics::Interval;

/// A ranking criterion; greater values are better.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Criterion {
    value: Option<f64>,
    interval: Interval,
}

impl Criterion {
    /// A rate: greater is better.
    pub(crate) fn rate(value: Option<f64>, interval: Interval) -> Self {
        Criterion { value, interval }
    }

    /// An error: smaller is better, so signs are reversed.
    pub(crate) fn error(value: Option<f64>, interval: Interval) -> Self {
        Criterion { value: value.map(|v| -v), interval: interval.map(|[low, high]| [-high, -low]) }
    }

    /// Number of dimensions in which a result was scored: without depth more of it is within the gate.
    pub(crate) fn dimensions(dims: u8) -> Self {
        Criterion { value: Some(f64::from(dims)), interval: None }
    }

    /// Whether a result leaves out no frame or image pair: errors of those that do cover fewer frames.
    pub(crate) fn complete(missing: usize) -> Self {
        Criterion { value: Some(f64::from(u8::from(missing == 0))), interval: None }
    }

    /// Whether the intervals of two scores, the better one first, overlap. Without intervals only equal
    /// values are tied.
    fn is_tied_with(&self, worse: &Criterion) -> bool {
        match self.interval.zip(worse.interval) {
            Some(([low, _], [_, high])) => high >= low,
            None => self.value == worse.value,
        }
    }
}

/// Indices of the scores in order, each with its rank from 1. Scores tied with the best of their group at one
/// criterion are compared by the next one; those tied at all criteria share a rank.
pub(crate) fn ranks(levels: &[Vec<Criterion>]) -> Vec<(usize, usize)> {
    let mut groups = Vec::new();
    split(levels, (0..levels.len()).collect(), 0, &mut groups);
    let mut ranked = Vec::with_capacity(levels.len());
    for group in groups {
        let rank = ranked.len() + 1;
        ranked.extend(group.into_iter().map(|i| (i, rank)));
    }
    ranked
}

fn split(levels: &[Vec<Criterion>], mut group: Vec<usize>, depth: usize, groups: &mut Vec<Vec<usize>>) {
    let level = |i: usize| levels[i].get(depth).copied().unwrap_or_default();
    if group.len() < 2 || group.iter().all(|&i| depth >= levels[i].len()) {
        if !group.is_empty() {
            groups.push(group);
        }
        return;
    }
    let value = |i: usize| level(i).value.unwrap_or(f64::NEG_INFINITY);
    group.sort_by(|&a, &b| value(b).total_cmp(&value(a)));
    let mut rest = group.as_slice();
    while let Some(&best) = rest.first() {
        let n = rest.iter().take_while(|&&i| level(best).is_tied_with(&level(i))).count().max(1);
        split(levels, rest[..n].to_vec(), depth + 1, groups);
        rest = &rest[n..];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rate(value: f64, half: f64) -> Criterion {
        Criterion::rate(Some(value), Some([value - half, value + half]))
    }

    fn error(value: f64, half: f64) -> Criterion {
        Criterion::error(Some(value), Some([value - half, value + half]))
    }

    #[test]
    fn scores_that_intervals_do_not_tell_apart_share_a_rank() {
        let scores = [0.9, 0.87, 0.85, 0.84].map(|f1| vec![rate(f1, 0.02)]);
        // The third does not overlap the first, so it begins a new rank, which the fourth shares.
        assert_eq!(ranks(&scores), [(0, 1), (1, 1), (2, 3), (3, 3)]);
    }

    #[test]
    fn what_one_level_does_not_tell_apart_the_next_one_does() {
        let scores = [
            vec![rate(0.90, 0.02), error(0.30, 0.01), rate(0.5, 0.1)],
            vec![rate(0.89, 0.02), error(0.10, 0.01), rate(0.5, 0.1)],
            // Its errors overlap those of the first score, its link scores do not.
            vec![rate(0.88, 0.02), error(0.31, 0.01), rate(0.8, 0.1)],
            vec![rate(0.70, 0.02), error(0.01, 0.01), rate(0.9, 0.1)],
        ];
        assert_eq!(ranks(&scores), [(1, 1), (2, 2), (0, 3), (3, 4)]);
    }

    #[test]
    fn what_leaves_out_frames_comes_after_complete_results_of_the_same_score() {
        let scores = [
            vec![rate(0.88, 0.06), Criterion::complete(2), error(0.10, 0.01)],
            vec![rate(0.90, 0.02), Criterion::complete(0), error(0.20, 0.01)],
            vec![rate(0.70, 0.02), Criterion::complete(0), error(0.20, 0.01)],
        ];
        assert_eq!(ranks(&scores), [(1, 1), (0, 2), (2, 3)]);
    }

    #[test]
    fn without_intervals_only_equals_are_tied_and_what_is_undefined_comes_last() {
        let of = |value: Option<f64>| vec![Criterion::rate(value, None)];
        let scores = [of(None), of(Some(0.8)), of(Some(0.9)), of(Some(0.9))];
        assert_eq!(ranks(&scores), [(2, 1), (3, 1), (1, 3), (0, 4)]);
    }
}
