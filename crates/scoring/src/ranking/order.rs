//! Order of results from pairwise comparisons.

use std::cmp::Ordering;

/// Which of `n` results are better than which others.
#[derive(Debug, Clone)]
pub struct Pairs {
    /// For each result, whether it is better than each other one.
    better: Vec<Vec<bool>>,
}

impl Pairs {
    /// From the order of each pair `(a, b)` with a < b: `Less` if a is better.
    pub fn new(n: usize, order: impl Fn(usize, usize) -> Ordering) -> Self {
        let mut better = vec![vec![false; n]; n];
        for (a, b) in (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b))) {
            match order(a, b) {
                Ordering::Less => better[a][b] = true,
                Ordering::Greater => better[b][a] = true,
                Ordering::Equal => {}
            }
        }
        Pairs { better }
    }

    /// Whether a is better than b.
    pub fn is_better(&self, a: usize, b: usize) -> bool {
        self.better[a][b]
    }

    /// Indices of the results by rank: 1 + the number of results that are better, directly or through others that
    /// they are better than. A better result thus ranks before a worse one, whoever else is there; only results of a circle
    /// (a better than b, b than c, c than a) share a rank.
    pub fn ranks(&self) -> Vec<(usize, usize)> {
        let n = self.better.len();
        let mut through = self.better.clone();
        for k in 0..n {
            let of_k = through[k].clone();
            for row in through.iter_mut().filter(|row| row[k]) {
                row.iter_mut().zip(&of_k).for_each(|(own, more)| *own |= more);
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
            if (values[a] - values[b]).abs() <= margin {
                Ordering::Equal
            } else {
                values[b].total_cmp(&values[a])
            }
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
        let circle = |a: usize, b: usize| match (a, b) {
            (_, 3) => Ordering::Less,
            (0, 2) => Ordering::Greater,
            _ => Ordering::Less,
        };
        assert_eq!(Pairs::new(4, circle).ranks(), [(0, 1), (1, 1), (2, 1), (3, 4)]);
    }

    #[test]
    fn whoever_else_is_there_a_better_result_ranks_first() {
        // Random relations of seven results: a direct better one ranks before, unless a circle joins both.
        for seed in 0..2000_u32 {
            let order = |a: usize, b: usize| {
                let mixed = (seed ^ (8 * a + b) as u32)
                    .wrapping_mul(2_654_435_761)
                    .rotate_left(13)
                    .wrapping_mul(0x85eb_ca6b);
                [Ordering::Less, Ordering::Equal, Ordering::Greater, Ordering::Equal][(mixed >> 30) as usize]
            };
            let pairs = Pairs::new(7, order);
            let mut rank = [0; 7];
            pairs.ranks().into_iter().for_each(|(i, of)| rank[i] = of);
            for (a, b) in
                (0..7).flat_map(|a| (0..7).map(move |b| (a, b))).filter(|(a, b)| pairs.is_better(*a, *b))
            {
                assert!(rank[a] <= rank[b], "{seed} {rank:?}");
            }
        }
    }
}
