//! Whether a result matches more particles than chance does: one of another dataset does not.

use super::detection::Detection;
use super::gate::Gate;
use super::matching::{Cost, optimal};
use super::track_set::TrackSet;
use storage::error::Result;

/// Shift of a result that has nothing in common with the truth any more, in gates.
const SHIFT_GATES: f64 = 5.0;

/// F1 above which chance is not considered.
const PLAUSIBLE_F1: f64 = 0.5;

/// Fewest points of truth and result for which chance is estimated.
const FEWEST: usize = 20;

/// A warning if a result has no more matches than when it is shifted by five gates, or is empty.
///
/// # Errors
/// A gate so wide that a frame has too many pairs.
pub(super) fn caution(
    (truth, result): (&TrackSet, &TrackSet),
    gate: &Gate,
    detection: &Detection,
) -> Result<Option<String>> {
    let (matches, f1) = (detection.tp, detection.f1);
    if result.is_empty() && !truth.is_empty() {
        return Ok(Some("the result has no scored point: every particle is missed".to_owned()));
    }
    if truth.len() < FEWEST || result.len() < FEWEST || f1.is_none_or(|f1| f1 > PLAUSIBLE_F1) {
        return Ok(None);
    }
    let by = SHIFT_GATES * gate.xy_px;
    let mut shifted = 0;
    for (dx, dy) in [(by, 0.0), (-by, 0.0), (0.0, by), (0.0, -by)] {
        let mut other = result.clone();
        other.points.iter_mut().for_each(|point| {
            point.at.x_px += dx;
            point.at.y_px += dy;
        });
        shifted += optimal(truth, &other, gate, Cost::Squares)?.pairs().count();
    }
    let expected = shifted as f64 / 4.0;
    // Three standard deviations of the difference of two Poisson numbers, one of them a mean of four.
    if matches as f64 > expected + 3.0 * (1.25 * expected).sqrt() {
        return Ok(None);
    }
    Ok(Some(format!(
        "{matches} matches are no more than chance gives ({expected:.0} with the result shifted by five gates): a result of another \
         dataset?"
    )))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::track_set::{Position, UnsortedPoint};

    fn cloud(seed: u32, n: u32) -> TrackSet {
        let chance = |i: u32| {
            let mixed = (i ^ seed.wrapping_mul(0x9e37_79b9)).wrapping_mul(2_654_435_761).rotate_left(13);
            f64::from((mixed ^ (mixed >> 15)).wrapping_mul(0x85eb_ca6b)) / f64::from(u32::MAX)
        };
        let point = |i: u32| UnsortedPoint {
            frame: 0,
            track: None,
            at: Position { x_px: 200.0 * chance(2 * i), y_px: 200.0 * chance(2 * i + 1), z_um: 0.0 },
            source: i,
        };
        TrackSet::new((0..n).map(point).collect())
    }

    #[test]
    fn other_particles_are_chance_and_few_of_the_right_ones_are_not() {
        let gate = Gate::radial(2.0);
        let said = |truth: &TrackSet, result: &TrackSet| {
            let matches = optimal(truth, result, &gate, Cost::Squares).unwrap().pairs().count();
            let f1 = 2.0 * matches as f64 / (truth.len() + result.len()) as f64;
            let detection = Detection { tp: matches, f1: Some(f1), ..Detection::default() };
            caution((truth, result), &gate, &detection).unwrap()
        };
        let truth = cloud(1, 400);
        assert!(said(&truth, &cloud(2, 400)).unwrap().contains("another dataset?"));
        assert_eq!(said(&truth, &cloud(1, 40)), None);
        assert_eq!(said(&truth, &truth), None);
        assert!(said(&truth, &TrackSet::default()).unwrap().contains("no scored point"));
    }
}
