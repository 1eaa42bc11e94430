//! Order of results from pairwise comparisons.

/// Indices of `n` results in order, each with its rank from 1. `is_better(criterion, a, b)` returns whether a
/// is significantly better than b.
///
/// The first results of a group are those behind no other result or, if there are none (a better than b, b
/// than c, c than a), those behind the fewest.
pub(super) fn ranks(
    n: usize,
    criteria: usize,
    is_better: &dyn Fn(usize, usize, usize) -> bool,
) -> Vec<(usize, usize)> {
    let mut groups = Vec::new();
    split((0..n).collect(), 0, criteria, is_better, &mut groups);
    let mut ranked = Vec::with_capacity(n);
    for group in groups {
        let rank = ranked.len() + 1;
        ranked.extend(group.into_iter().map(|i| (i, rank)));
    }
    ranked
}

fn split(
    mut group: Vec<usize>,
    criterion: usize,
    criteria: usize,
    is_better: &dyn Fn(usize, usize, usize) -> bool,
    groups: &mut Vec<Vec<usize>>,
) {
    if group.len() < 2 || criterion >= criteria {
        groups.extend((!group.is_empty()).then_some(group));
        return;
    }
    while !group.is_empty() {
        let behind: Vec<usize> =
            group.iter().map(|&i| group.iter().filter(|&&j| is_better(criterion, j, i)).count()).collect();
        let fewest = behind.iter().copied().min().unwrap_or(0);
        let of = |is_first: bool| {
            let chosen = group.iter().zip(&behind).filter(move |(_, n)| (**n == fewest) == is_first);
            chosen.map(|(i, _)| *i).collect::<Vec<_>>()
        };
        let (first, rest) = (of(true), of(false));
        split(first, criterion + 1, criteria, is_better, groups);
        group = rest;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values are separated if they differ by more than a margin.
    fn by_values(values: &[&[f64]], margin: f64) -> Vec<(usize, usize)> {
        ranks(values.len(), values[0].len(), &|k, a, b| values[a][k] > values[b][k] + margin)
    }

    #[test]
    fn results_that_are_not_separated_share_a_rank() {
        // The third is behind the first only, the fourth behind the first two.
        assert_eq!(by_values(&[&[0.9], &[0.87], &[0.85], &[0.83]], 0.03), [(0, 1), (1, 1), (2, 3), (3, 3)]);
    }

    #[test]
    fn the_next_criterion_orders_those_that_one_does_not_separate() {
        let values: [&[f64]; 4] = [&[0.90, 0.3], &[0.89, 0.9], &[0.88, 0.31], &[0.70, 5.0]];
        assert_eq!(by_values(&values, 0.05), [(1, 1), (0, 2), (2, 2), (3, 4)]);
    }

    #[test]
    fn a_circle_is_a_tie() {
        let found = ranks(3, 1, &|_, a, b| (a + 1) % 3 == b);
        assert_eq!(found.iter().map(|(_, rank)| *rank).collect::<Vec<_>>(), [1, 1, 1]);
    }
}
