//! Diameters of particles, and their classes.
//!
//! Errors cover the found particles that report a diameter. A tracker that reports only the easy ones has
//! smaller errors, so results are ranked by the fraction of all particles whose class is right.

use super::matching::Matching;
use super::statistics::{Errors, Interval, distinct, quantile, ratio, sorted};
use super::track_set::TrackSet;
use super::truth::TrueParticles;
use super::units::{Matched, Units};

/// Largest number of different true diameters that are classes.
const CLASSES: usize = 10;

/// Bins over depth.
const DEPTH_BINS: usize = 10;

scores! {
    /// Errors of diameters, from `d_um` of the result.
    pub struct Size {
        /// Number of true particles.
        pub n_true: usize,
        /// Number of found particles with a diameter.
        pub n: usize,
        /// Mean error of the diameter.
        pub bias_um: Option<f64>,
        /// RMS error of the diameter.
        not_negative rms_um: Option<f64>,
        /// Median absolute error of the diameter.
        not_negative median_abs_um: Option<f64>,
        /// 95 % interval of bias_um.
        pub interval_bias_um: Interval,
        /// 95 % interval of rms_um.
        not_negative interval_rms_um: Interval,
        /// Classes: the true diameters, ascending; empty if there are less than 2 or more than 10 different ones.
        not_negative classes_um: Vec<f64>,
        /// For each class: the number of its particles that are found with the diameter nearest to each class, then
        /// of those that are found without a diameter, then of the missed ones.
        pub confusion: Vec<Vec<usize>>,
        /// Particles found with the right class / (true particles + ghosts). A particle that has a ghost within
        /// its gate in addition to its match does not count as right.
        fraction right: Option<f64>,
        /// 95 % interval of right.
        fraction interval_right: Interval,
        /// The errors over depth; empty without depth.
        pub over_depth: Vec<SizeBin>,
    }

    /// Errors of diameters in a range of true depths.
    pub struct SizeBin {
        /// Lower edge, um.
        pub from_um: f64,
        /// Upper edge, um.
        pub to_um: f64,
        /// Number of true particles.
        pub n_true: usize,
        /// Number of found particles with a diameter.
        pub n: usize,
        /// Mean error of the diameter.
        pub bias_um: Option<f64>,
        /// RMS error of the diameter.
        not_negative rms_um: Option<f64>,
        /// Particles with the right class / true particles.
        fraction right: Option<f64>,
    }
}

/// What is known of a true particle.
#[derive(Clone, Copy)]
struct Compared {
    /// Error of the diameter, um; `None` if it is missed or found without one.
    error_um: Option<f64>,
    is_right: bool,
}

impl Size {
    /// Errors of the diameters of matched particles. `found_um`: one per row of the result, NaN if missing.
    /// `ambiguous` marks the true particles that have a ghost within their gate. `None` if the result has no
    /// diameters, or the truth has none.
    ///
    /// Also gives the sums over units of what counts in `right`: true particles and ghosts, and right ones.
    pub fn of(
        truth: &TrueParticles,
        (t, r): (&TrackSet, &TrackSet),
        found_um: &[f64],
        (matching, ambiguous): (&Matching, &[bool]),
        units: &Units,
    ) -> Option<(Self, Vec<[f64; 2]>)> {
        if found_um.is_empty() || truth.sizes.is_empty() {
            return None;
        }
        let true_um: Vec<f64> = t.points.iter().map(|point| truth.sizes[point.source as usize][0]).collect();
        let classes_um = classes(&true_um);
        let nearest = |d_um: f64| {
            let off = |class: &f64| (class - d_um).abs();
            (0..classes_um.len()).min_by(|a, b| off(&classes_um[*a]).total_cmp(&off(&classes_um[*b])))
        };
        let n_classes = classes_um.len();
        let mut confusion = vec![vec![0; n_classes + 2]; n_classes];
        let mut compared = vec![Compared { error_um: None, is_right: false }; t.len()];
        for (i, compared) in compared.iter_mut().enumerate() {
            let matched = r.points.get(matching.result_for[i] as usize);
            let d_um = matched.map(|point| found_um[point.source as usize]);
            let known = d_um.filter(|d_um| d_um.is_finite());
            let (own, found) = (nearest(true_um[i]), known.and_then(nearest));
            if let Some(own) = own {
                confusion[own][found.unwrap_or(n_classes + usize::from(d_um.is_none()))] += 1;
            }
            *compared = Compared {
                error_um: known.map(|d_um| d_um - true_um[i]),
                is_right: own.is_some() && own == found && !ambiguous[i],
            };
        }
        // True particles and ghosts, right ones; number of errors, their sum and sum of squares.
        let sums = units.sums(units.matched(matching).map(|(unit, point)| {
            let sums = match point {
                Matched::Pair(i, _) | Matched::Missed(i) => {
                    let [n, sum, squares] = compared[i].error_um.map_or([0.0; 3], |e| [1.0, e, e * e]);
                    [1.0, f64::from(compared[i].is_right), n, sum, squares]
                }
                Matched::Ghost => [1.0, 0.0, 0.0, 0.0, 0.0],
            };
            (unit, sums)
        }));
        let right = |s: &[f64; 5]| ratio(s[1], s[0]).filter(|_| n_classes > 0);
        let rms = |s: &[f64; 5]| ratio(s[4], s[2]).map(f64::sqrt);
        let [interval_bias_um, interval_rms_um, interval_right] =
            units.intervals(&sums, |s| [ratio(s[3], s[2]), rms(s), right(s)]);
        let total = sums.iter().fold([0.0; 5], |t: [f64; 5], u| std::array::from_fn(|k| t[k] + u[k]));
        let away = sorted(compared.iter().filter_map(|c| c.error_um.map(f64::abs)));
        let over_depth = truth.facts.depth_um.filter(|(low, high)| truth.has_z && high > low);
        let bins = over_depth.map_or_else(Vec::new, |range| {
            bins(range, t.points.iter().map(|point| point.at.z_um).zip(compared), n_classes > 0)
        });
        let score = Size {
            n_true: t.len(),
            n: away.len(),
            bias_um: ratio(total[3], total[2]),
            rms_um: rms(&total),
            median_abs_um: quantile(&away, 0.5),
            interval_bias_um,
            interval_rms_um,
            right: right(&total),
            interval_right,
            classes_um,
            confusion,
            over_depth: bins,
        };
        Some((score, sums.iter().map(|s| [s[0], s[1]]).collect()))
    }
}

/// The different diameters, ascending, if they are a few.
fn classes(true_um: &[f64]) -> Vec<f64> {
    let all = distinct(true_um.iter().copied());
    if (2..=CLASSES).contains(&all.len()) { all } else { Vec::new() }
}

/// Errors in equal bins over the depth range.
fn bins(
    (low, high): (f64, f64),
    particles: impl Iterator<Item = (f64, Compared)>,
    has_classes: bool,
) -> Vec<SizeBin> {
    let mut all = vec![Vec::new(); DEPTH_BINS];
    for (z_um, compared) in particles {
        let bin = ((z_um - low) / (high - low) * DEPTH_BINS as f64) as usize;
        all[bin.min(DEPTH_BINS - 1)].push(compared);
    }
    let edge = |k: usize| low + (high - low) * k as f64 / DEPTH_BINS as f64;
    let bin = |(k, bin): (usize, Vec<Compared>)| {
        let errors = Errors::of(bin.iter().filter_map(|c| c.error_um));
        let n_right = bin.iter().filter(|c| c.is_right).count();
        SizeBin {
            from_um: edge(k),
            to_um: edge(k + 1),
            n_true: bin.len(),
            n: bin.iter().filter(|c| c.error_um.is_some()).count(),
            bias_um: errors.bias,
            rms_um: errors.rms,
            right: ratio(n_right as f64, bin.len() as f64).filter(|_| has_classes),
        }
    };
    all.into_iter().enumerate().map(bin).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::{EvaluateOptions, particles};
    use crate::results::{Points, Position, TrackRow};

    #[test]
    fn diameters_are_compared_with_those_of_the_matched_particles() {
        let at = |i: u32| Position { x_px: 20.0 * f64::from(i + 1), y_px: 30.0, z_um: f64::from(i) };
        let row = |i: u32| TrackRow { frame: 0, track: i64::from(i), at: at(i) };
        // Diameters 1, 1, 2, 2, 5 um; the fourth is missed, the second found without a diameter, the last taken for 2 um.
        let mut truth = TrueParticles {
            rows: (0..5).map(row).collect(),
            visible: vec![true; 5],
            has_z: true,
            sizes: [1.0, 1.0, 2.0, 2.0, 5.0].map(|d_um| [d_um, 1.0]).to_vec(),
            ..TrueParticles::default()
        };
        truth.facts.depth_um = Some((0.0, 10.0));
        let ghost = TrackRow { frame: 0, track: 9, at: Position { x_px: 50.0, y_px: 90.0, z_um: 1.0 } };
        let rows = vec![row(0), row(1), row(2), row(4), ghost];
        let diameters_um = vec![1.2, f64::NAN, 1.8, 2.5, 3.0];
        let found = Points { rows, diameters_um, has_z: true, ..Points::default() };
        let score = particles(&truth, &found, &EvaluateOptions::default()).unwrap().score;
        let size = score.size.unwrap();
        assert_eq!((size.n_true, size.n), (5, 3));
        assert_eq!(size.classes_um, [1.0, 2.0, 5.0]);
        assert_eq!(size.confusion, [[1, 0, 0, 1, 0], [0, 1, 0, 0, 1], [0, 1, 0, 0, 0]]);
        assert_eq!(size.right, Some(2.0 / 6.0));
        let close = |a: Option<f64>, b: f64| (a.unwrap() - b).abs() < 1e-12;
        assert!(close(size.bias_um, (0.2 - 0.2 - 2.5) / 3.0), "{size:?}");
        assert!(close(size.rms_um, ((0.04 + 0.04 + 6.25) / 3.0f64).sqrt()), "{size:?}");
        assert!(close(size.median_abs_um, 0.2), "{size:?}");
        let bins: Vec<(usize, usize)> = size.over_depth.iter().map(|bin| (bin.n_true, bin.n)).collect();
        assert_eq!(bins[..5], [(1, 1), (1, 0), (1, 1), (1, 0), (1, 1)]);
        assert_eq!(size.over_depth[4].bias_um, Some(-2.5));
        // One size: no classes.
        truth.sizes = vec![[2.0, 1.0]; 5];
        let size = particles(&truth, &found, &EvaluateOptions::default()).unwrap().score.size.unwrap();
        assert_eq!((size.right, size.confusion.len(), size.n), (None, 0, 3));
    }
}
