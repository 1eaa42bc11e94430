//! Ranks by several numbers, one after the other, as far as their intervals tell scores apart.

use crate::evaluate::statistics::Interval;

/// A number that scores are ranked by: greater is better.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Level {
    value: Option<f64>,
    interval: Interval,
}

impl Level {
    /// A rate.
    pub(super) fn rate(value: Option<f64>, interval: Interval) -> Self {
        Level { value, interval }
    }

    /// An error, of which less is better.
    pub(super) fn error(value: Option<f64>, interval: Interval) -> Self {
        Level { value: value.map(|v| -v), interval: interval.map(|[low, high]| [-high, -low]) }
    }

    /// Whether the data do not tell the better one of two from the other. Without intervals only equals are tied.
    fn is_tied_with(&self, worse: &Level) -> bool {
        match self.interval.zip(worse.interval) {
            Some(([low, _], [_, high])) => high >= low,
            None => self.value == worse.value,
        }
    }
}

/// The scores in their order, each with its rank from 1. Those that a level does not tell from the best of a rank go on to
/// the next level; those that no level tells apart share the rank.
pub(super) fn ranks(levels: &[Vec<Level>]) -> Vec<(usize, usize)> {
    let mut groups = Vec::new();
    split(levels, (0..levels.len()).collect(), 0, &mut groups);
    let mut ranked = Vec::with_capacity(levels.len());
    for group in groups {
        let rank = ranked.len() + 1;
        ranked.extend(group.into_iter().map(|i| (i, rank)));
    }
    ranked
}

fn split(levels: &[Vec<Level>], mut group: Vec<usize>, depth: usize, groups: &mut Vec<Vec<usize>>) {
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

    fn rate(value: f64, half: f64) -> Level {
        Level::rate(Some(value), Some([value - half, value + half]))
    }

    fn error(value: f64, half: f64) -> Level {
        Level::error(Some(value), Some([value - half, value + half]))
    }

    #[test]
    fn scores_that_intervals_do_not_tell_apart_share_a_rank() {
        let scores = [0.9, 0.87, 0.85, 0.84].map(|f1| vec![rate(f1, 0.02)]);
        // The third does not reach the first, so it begins a rank of its own, which the fourth shares.
        assert_eq!(ranks(&scores), [(0, 1), (1, 1), (2, 3), (3, 3)]);
    }

    #[test]
    fn what_one_level_does_not_tell_apart_the_next_one_does() {
        let scores = [
            vec![rate(0.90, 0.02), error(0.30, 0.01), rate(0.5, 0.1)],
            vec![rate(0.89, 0.02), error(0.10, 0.01), rate(0.5, 0.1)],
            // Its errors cannot be told from the first one's, its links can.
            vec![rate(0.88, 0.02), error(0.31, 0.01), rate(0.8, 0.1)],
            vec![rate(0.70, 0.02), error(0.01, 0.01), rate(0.9, 0.1)],
        ];
        assert_eq!(ranks(&scores), [(1, 1), (2, 2), (0, 3), (3, 4)]);
    }

    #[test]
    fn without_intervals_only_equals_are_tied_and_what_is_undefined_comes_last() {
        let of = |value: Option<f64>| vec![Level::rate(value, None)];
        let scores = [of(None), of(Some(0.8)), of(Some(0.9)), of(Some(0.9))];
        assert_eq!(ranks(&scores), [(2, 1), (3, 1), (1, 3), (0, 4)]);
    }
}
