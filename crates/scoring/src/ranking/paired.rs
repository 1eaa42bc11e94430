//! Paired comparison of two results by one score.
//!
//! Rates and means: the difference of the two scores over resamples of the units that both results share
//! (`evaluate/units.rs`), each resample the same for both; a result is significantly better if the 95 %
//! interval of the difference excludes 0. Omitting frames lowers a result in most units at once, and is
//! therefore significant against the complete result, regardless of the width of its own interval.
//!
//! Errors of found particles: the number of true particles that are nearer in one result against the number
//! nearer in the other; a missed particle is never nearer. An RMS error over the found particles would favor
//! a result that omits its worst ones; this comparison does not, against any other result. A particle
//! counts as nearer if its error is smaller by more than a tenth of the median error: without this, a shift by a
//! thousandth of the bias would make the majority of all particles nearer. The same difference for all particles,
//! because a ratio (an error 10 % smaller) favors a result with random numbers added: of errors of 1, those that
//! become 0.89 are 10 % smaller, but 1 is not 10 % smaller than those that become 1.11.
//!
//! Fewer than five units have no interval: there, a result is better if it is better in some resample and worse
//! in none. Without units (scores of
//! earlier versions, of different datasets, or over vectors that a result chose itself), intervals that do
//! not overlap decide or, if an interval is undefined, the values. A result without a value is behind all
//! results with one.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

use scenario::Metric;

use super::Contestant;
use super::metric::{Better, ScoreDef};
use crate::evaluate::hota::{self, SUMS};
use crate::evaluate::statistics::{FEWEST, Interval, draws, quantile, ratio};
use crate::evaluate::units::MISSED;

/// The resamples, made once for each number of units, so that all results share them.
pub(super) struct Draws {
    seed: u64,
    of_units: RefCell<BTreeMap<usize, Rc<Vec<Vec<u16>>>>>,
}

impl Draws {
    pub(super) fn new(seed: u64) -> Self {
        Draws { seed, of_units: RefCell::default() }
    }

    fn of(&self, units: usize) -> Rc<Vec<Vec<u16>>> {
        let mut known = self.of_units.borrow_mut();
        Rc::clone(known.entry(units).or_insert_with(|| Rc::new(draws(units, self.seed))))
    }
}

/// The data of a result that are compared.
#[derive(Debug)]
enum Compared<'a> {
    /// Number of units, and the merit in each resample.
    Resampled(usize, Vec<f64>),
    /// Unit and squared error of every true particle, and the median error of those that are found.
    Errors(&'a [u32], &'a [f32], f32),
    /// Only value and interval.
    Interval,
}

/// One score of a result. Merits are values transformed so that larger is better.
#[derive(Debug)]
pub(super) struct Paired<'a> {
    merit: Option<f64>,
    interval: Interval,
    compared: Compared<'a>,
}

impl<'a> Paired<'a> {
    pub(super) fn new(metric: Metric, of: &Contestant<'a>, draws: &Draws) -> Self {
        let def = ScoreDef::of(metric);
        let ((value, interval), better) = (def.measured(of.score), def.better);
        let ends = interval.filter(|_| better != Better::NearOne).map(|ends| ends.map(|v| better.merit(v)));
        let whole = Paired {
            merit: value.map(|value| better.merit(value)),
            interval: ends.map(|[a, b]| [a.min(b), a.max(b)]),
            compared: Compared::Interval,
        };
        let Some(units) = of.units else { return whole };
        let errors = match metric {
            Metric::RmseXyPx => Some(&units.xy),
            Metric::SigmaZOverH => Some(&units.z),
            Metric::VelocityRmsUmS => Some(&units.velocity),
            _ => None,
        };
        if let Some(errors) = errors {
            let compared = match errors.is_empty() || errors.len() != units.unit.len() {
                true => Compared::Interval,
                false => Compared::Errors(&units.unit, errors, median(errors)),
            };
            return Paired { compared, ..whole };
        }
        let of = |value: Option<f64>| value.map_or(f64::NEG_INFINITY, |value| better.merit(value));
        let compared = match metric {
            Metric::F1 => {
                let beside = units.beside.iter().copied().chain(std::iter::repeat(0.0));
                let of_unit =
                    |([tp, missed, fp], beside): (&[f64; 3], f64)| [tp - beside, 2.0 * tp + missed + fp];
                let sums: Vec<[f64; 2]> = units.detection.iter().zip(beside).map(of_unit).collect();
                resampled(&sums, draws, |[found, all]| of(ratio(2.0 * found, all)))
            }
            Metric::Recall | Metric::LptCorrect => {
                resampled(&units.detection, draws, |[tp, missed, _]| of(ratio(tp, tp + missed)))
            }
            Metric::Precision => resampled(&units.detection, draws, |[tp, _, fp]| of(ratio(tp, tp + fp))),
            Metric::LptGhost => {
                resampled(&units.detection, draws, |[tp, missed, fp]| of(ratio(fp, tp + missed)))
            }
            Metric::LinkF1 => resampled(&units.links, draws, |[tp, n, m]| of(ratio(2.0 * tp, n + m))),
            Metric::Hota => {
                let sums: Option<Vec<[f64; SUMS]>> =
                    units.hota.iter().map(|sums| sums.as_slice().try_into().ok()).collect();
                sums.and_then(|sums| resampled(&sums, draws, |sums| of(hota::means(&sums)[0])))
            }
            Metric::IsbiBeta => {
                resampled(&units.isbi, draws, |[gain, length, others]| of(ratio(gain, length + others)))
            }
            Metric::CrpsXyPx => resampled(&units.crps, draws, |[n, xy, _]| of(ratio(xy, n))),
            Metric::CrpsZUm => resampled(&units.crps, draws, |[n, _, z]| of(ratio(z, n))),
            Metric::AngleMeanAllDeg => resampled(&units.angles, draws, |[n, sum]| of(ratio(sum, n))),
            Metric::ValidNodes => resampled(&units.nodes, draws, |[n, _, valid, ..]| of(ratio(valid, n))),
            Metric::RmsNodesPx => {
                resampled(&units.nodes, draws, |[n, _, _, squares, ..]| of(ratio(squares, n).map(f64::sqrt)))
            }
            Metric::ResponseNodes => {
                resampled(&units.nodes, draws, |[.., product, exact]| of(ratio(product, exact)))
            }
            // These scores are over the vectors of the result.
            _ => None,
        };
        Paired { compared: compared.unwrap_or(Compared::Interval), ..whole }
    }

    /// Whether it is significantly better than another.
    pub(super) fn is_better_than(&self, other: &Paired<'_>, draws: &Draws) -> bool {
        let (own, others) = match (self.merit, other.merit) {
            (Some(own), Some(others)) => (own, others),
            (own, _) => return own.is_some() && other.merit.is_none(),
        };
        match (&self.compared, &other.compared) {
            (Compared::Resampled(n, a), Compared::Resampled(m, b)) if n == m => {
                let differences = a.iter().zip(b).map(|(a, b)| if a == b { 0.0 } else { a - b });
                is_above_zero(*n, differences.collect())
            }
            (Compared::Errors(units, a, m), Compared::Errors(same, b, n)) if units == same => {
                is_nearer(units, (a, b), NEARER * m.min(*n), draws)
            }
            _ => match self.interval.zip(other.interval) {
                Some(([low, _], [_, high])) => low > high,
                None => own > others,
            },
        }
    }
}

/// The merit of the sums of each resample; `None` without units.
fn resampled<'a, const N: usize>(
    units: &[[f64; N]],
    draws: &Draws,
    merit: impl Fn([f64; N]) -> f64,
) -> Option<Compared<'a>> {
    if units.is_empty() {
        return None;
    }
    let of_resample = |counts: &Vec<u16>| {
        let mut sums = [0.0; N];
        for (unit, count) in units.iter().zip(counts) {
            let count = f64::from(*count);
            sums.iter_mut().zip(unit).for_each(|(sum, value)| *sum += count * value);
        }
        merit(sums)
    };
    Some(Compared::Resampled(units.len(), draws.of(units.len()).iter().map(of_resample).collect()))
}

/// Whether the differences over resamples of `units` units are significantly above 0: the 95 % interval is, or,
/// for fewer than five units, some are and none is below.
fn is_above_zero(units: usize, mut differences: Vec<f64>) -> bool {
    differences.sort_unstable_by(f64::total_cmp);
    if units < FEWEST {
        return differences.first() >= Some(&0.0) && differences.last() > Some(&0.0);
    }
    quantile(&differences, 0.025).is_some_and(|low| low > 0.0)
}

/// Median error, from squared errors; 0 if none is known.
fn median(squared: &[f32]) -> f32 {
    let mut found: Vec<f64> =
        squared.iter().filter(|error| **error != MISSED).map(|error| f64::from(error.sqrt())).collect();
    found.sort_unstable_by(f64::total_cmp);
    quantile(&found, 0.5).unwrap_or(0.0) as f32
}

/// Difference of two errors above which one particle is nearer than the other, in units of the smaller median
/// error of both results.
const NEARER: f32 = 0.1;

/// Whether significantly more true particles are nearer by a margin in the first than in the second.
fn is_nearer(units: &[u32], (a, b): (&[f32], &[f32]), margin: f32, draws: &Draws) -> bool {
    let n = units.iter().max().map_or(0, |last| *last as usize + 1);
    let mut wins = vec![0.0; n];
    // The errors are squared.
    let distance = |error: f32| if error == MISSED { f32::INFINITY } else { error.sqrt() };
    for ((unit, a), b) in units.iter().zip(a).zip(b) {
        let (a, b) = (distance(*a), distance(*b));
        wins[*unit as usize] += f64::from(i8::from(b - a > margin) - i8::from(a - b > margin));
    }
    let of_resample =
        |counts: &Vec<u16>| counts.iter().zip(&wins).map(|(count, wins)| f64::from(*count) * wins).sum();
    is_above_zero(n, draws.of(n).iter().map(of_resample).collect())
}
