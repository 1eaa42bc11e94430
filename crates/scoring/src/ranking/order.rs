//! Order of results from pairwise comparisons.

use std::cmp::Ordering;

/// Which of several results are better than which others, and by which criterion.
#[derive(Debug, Clone)]
pub struct Pairs {
    /// For each result and each other one: the criterion by which it is better, 0 being the first.
    better: Vec<Vec<Option<usize>>>,
}

impl Pairs {
    /// From the order of each pair `(a, b)` with a < b, `Less` if a is better, and the criterion that decides it.
    pub fn new(n: usize, order: impl Fn(usize, usize) -> (Ordering, usize)) -> Self {
        let mut better = vec![vec![None; n]; n];
        for (a, b) in (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b))) {
            match order(a, b) {
                (Ordering::Less, criterion) => better[a][b] = Some(criterion),
                (Ordering::Greater, criterion) => better[b][a] = Some(criterion),
                (Ordering::Equal, _) => {}
            }
        }
        Pairs { better }
    }

    /// Whether a is better than b.
    pub fn is_better(&self, a: usize, b: usize) -> bool {
        self.better[a][b].is_some()
    }

    /// Indices of the results by rank: 1 + the number of results that are better, directly or through others that
    /// they are better than. Pairs that the first criterion decides count first, and pairs decided by a later one where they do
    /// not contradict what follows from the earlier ones. A better result thus ranks before a worse one, whoever else is
    /// there, unless others that an earlier criterion separates say the opposite; only results of a circle by one criterion
    /// (a better than b, b than c, c than a) share a rank. Of two results that are not separated, one may rank first
    /// because of a third one between them.
    pub fn ranks(&self) -> Vec<(usize, usize)> {
        let n = self.better.len();
        let mut through = vec![vec![false; n]; n];
        let mut criteria: Vec<usize> = self.better.iter().flatten().flatten().copied().collect();
        criteria.sort_unstable();
        criteria.dedup();
        for criterion in criteria {
            let earlier = through.clone();
            for (a, b) in (0..n).flat_map(|a| (0..n).map(move |b| (a, b))) {
                through[a][b] |= self.better[a][b] == Some(criterion) && !earlier[b][a];
            }
            for k in 0..n {
                let of_k = through[k].clone();
                for row in through.iter_mut().filter(|row| row[k]) {
                    row.iter_mut().zip(&of_k).for_each(|(own, more)| *own |= more);
                }
            }
        }
        let rank = |a: usize| 1 + (0..n).filter(|&b| through[b][a] && !through[a][b]).count();
        let mut ranked: Vec<(usize, usize)> = (0..n).map(|a| (a, rank(a))).collect();
        ranked.sort_by_key(|(_, rank)| *rank);
        ranked
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values are separated if they differ by more than a margin.
    fn by_values(values: &[f64], margin: f64) -> Vec<(usize, usize)> {
        let order = |a: usize, b: usize| {
            let is_tie = (values[a] - values[b]).abs() <= margin;
            (if is_tie { Ordering::Equal } else { values[b].total_cmp(&values[a]) }, 0)
        };
        Pairs::new(values.len(), order).ranks()
    }

    #[test]
    fn ranks_count_the_better_results_only() {
        // The third is behind the first only, the fourth behind the first two.
        assert_eq!(by_values(&[0.9, 0.875, 0.855, 0.83], 0.03), [(0, 1), (1, 1), (2, 2), (3, 3)]);
        // One between two rivals changes neither.
        assert_eq!(by_values(&[0.90, 0.86], 0.03), [(0, 1), (1, 2)]);
        assert_eq!(by_values(&[0.90, 0.88, 0.86], 0.03), [(0, 1), (1, 1), (2, 2)]);
    }

    #[test]
    fn a_circle_is_a_tie_and_others_keep_their_places() {
        let circle = |of_last: usize| {
            move |a: usize, b: usize| match (a, b) {
                (0, 2) => (Ordering::Greater, of_last),
                _ => (Ordering::Less, 0),
            }
        };
        assert_eq!(Pairs::new(4, circle(0)).ranks(), [(0, 1), (1, 1), (2, 1), (3, 4)]);
        // One that a later criterion closes is none: a decoy that is better only there ties nobody.
        assert_eq!(Pairs::new(4, circle(1)).ranks(), [(0, 1), (1, 2), (2, 3), (3, 4)]);
    }

    #[test]
    fn whoever_else_is_there_a_better_result_ranks_first() {
        // Random relations of seven results: a better one by the first criterion ranks before, unless a circle joins both.
        for seed in 0..2000_u32 {
            let order = |a: usize, b: usize| {
                let mixed = (seed ^ (8 * a + b) as u32)
                    .wrapping_mul(2_654_435_761)
                    .rotate_left(13)
                    .wrapping_mul(0x85eb_ca6b);
                let order = [Ordering::Less, Ordering::Equal, Ordering::Greater, Ordering::Equal]
                    [(mixed >> 30) as usize];
                (order, (mixed >> 20) as usize % 2)
            };
            let pairs = Pairs::new(7, order);
            let mut rank = [0; 7];
            pairs.ranks().into_iter().for_each(|(i, of)| rank[i] = of);
            let all = (0..7).flat_map(|a| (0..7).map(move |b| (a, b)));
            for (a, b) in all.filter(|(a, b)| pairs.better[*a][*b] == Some(0)) {
                assert!(rank[a] <= rank[b], "{seed} {rank:?}");
            }
        }
    }
}
