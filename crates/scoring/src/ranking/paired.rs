//! Paired comparison of two results by one score.
//!
//! Rates and means: the difference of the two scores over resamples of the units that both results share
//! (`evaluate/units.rs`), each resample the same for both; a result is significantly better if the interval
//! of the difference excludes 0. Omitting frames lowers a result in most units at once, and is
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
//! Fewer than five units separate nothing. Without units (scores of earlier versions, of different datasets, or over
//! vectors that a result chose itself), 95 % intervals that do not overlap decide. A result without a value is behind
//! all results with one.

use std::cell::RefCell;
use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::rc::Rc;

use storage::dataset::manifest::Metric;

use super::Contestant;
use super::metric::{self, Better, ScoreDef};
use crate::evaluate::statistics::{FEWEST, Interval, draws, median, quantile, tail};
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
        let compared = match def.compared {
            metric::Compared::Interval => Compared::Interval,
            metric::Compared::Errors(of) => match of(units) {
                errors if errors.is_empty() || errors.len() != units.unit.len() => Compared::Interval,
                errors => Compared::Errors(&units.unit, errors, median_error(errors)),
            },
            metric::Compared::Resamples(of) => of(units, draws).map_or(Compared::Interval, |resamples| {
                let merit = |value: Option<f64>| value.map_or(f64::NEG_INFINITY, |value| better.merit(value));
                Compared::Resampled(resamples.units, resamples.values.into_iter().map(merit).collect())
            }),
        };
        Paired { compared, ..whole }
    }

    /// How much better it is than another.
    pub(super) fn difference(&self, other: &Paired<'_>, draws: &Draws) -> Difference {
        if self.merit.is_none() || other.merit.is_none() {
            return Difference::Certain(self.merit.is_some().cmp(&other.merit.is_some()));
        }
        match (&self.compared, &other.compared) {
            (Compared::Resampled(n, a), Compared::Resampled(m, b)) if n == m => {
                let differences = a.iter().zip(b).map(|(a, b)| if a == b { 0.0 } else { a - b });
                Difference::resampled(*n, differences.collect())
            }
            (Compared::Errors(units, a, m), Compared::Errors(same, b, n)) if units == same => {
                nearer(units, (a, b), NEARER * m.min(*n), draws)
            }
            _ => Difference::Certain(match self.interval.zip(other.interval) {
                Some(([low, _], [_, high])) if low > high => Ordering::Greater,
                Some(([_, high], [low, _])) if high < low => Ordering::Less,
                _ => Ordering::Equal,
            }),
        }
    }
}

/// The difference of two results.
#[derive(Debug)]
pub(super) enum Difference {
    /// Known without resamples.
    Certain(Ordering),
    /// Number of units, and the difference in each resample, sorted.
    Resampled(usize, Vec<f64>),
}

impl Difference {
    fn resampled(units: usize, mut differences: Vec<f64>) -> Self {
        differences.sort_unstable_by(f64::total_cmp);
        Difference::Resampled(units, differences)
    }

    /// The sign of the difference if it is significant with a two-sided error of `level`, else `Equal`.
    pub(super) fn significant(&self, level: f64) -> Ordering {
        let (units, differences) = match self {
            Difference::Certain(order) => return *order,
            Difference::Resampled(units, _) if *units < FEWEST => return Ordering::Equal,
            Difference::Resampled(units, differences) => (*units, differences),
        };
        let tail = tail(units, 0.5 * level);
        match (quantile(differences, tail), quantile(differences, 1.0 - tail)) {
            (Some(low), _) if low > 0.0 => Ordering::Greater,
            (_, Some(high)) if high < 0.0 => Ordering::Less,
            _ => Ordering::Equal,
        }
    }
}

/// A score over resamples of units.
#[derive(Debug)]
pub(super) struct OfResamples {
    units: usize,
    values: Vec<Option<f64>>,
}

/// The score of the sums of each resample; `None` without units.
pub(super) fn resampled<const N: usize>(
    units: &[[f64; N]],
    draws: &Draws,
    score: impl Fn([f64; N]) -> Option<f64>,
) -> Option<OfResamples> {
    if units.is_empty() {
        return None;
    }
    let of_resample = |counts: &Vec<u16>| {
        let mut sums = [0.0; N];
        for (unit, count) in units.iter().zip(counts) {
            let count = f64::from(*count);
            sums.iter_mut().zip(unit).for_each(|(sum, value)| *sum += count * value);
        }
        score(sums)
    };
    let values = draws.of(units.len()).iter().map(of_resample).collect();
    Some(OfResamples { units: units.len(), values })
}

/// Median error, from squared errors; 0 if none is known.
fn median_error(squared: &[f32]) -> f32 {
    let found = squared.iter().filter(|error| **error != MISSED);
    median(found.map(|error| f64::from(error.sqrt()))).unwrap_or(0.0) as f32
}

/// Difference of two errors above which one particle is nearer than the other, in units of the smaller median
/// error of both results.
const NEARER: f32 = 0.1;

/// How many more true particles are nearer by a margin in the first than in the second.
fn nearer(units: &[u32], (a, b): (&[f32], &[f32]), margin: f32, draws: &Draws) -> Difference {
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
    Difference::resampled(n, draws.of(n).iter().map(of_resample).collect())
}
