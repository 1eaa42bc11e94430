//! Data for a paired comparison of two results, besides their scores: sums over resampling units that all
//! results of a dataset share, and the errors of every true particle.
//!
//! A unit is a true track (all of its points: errors along a track are correlated), or a square of reference
//! nodes of a field. Ghosts and wrong links of a result belong to the unit of a nearby true particle as long
//! as this unit has no more than twice the average number, otherwise to the next unit with room: a thousand
//! ghosts at one position in a single unit would be absent from a third of all resamples, and so would never
//! be significant.
//!
//! A true particle whose gate contains a ghost in addition to its match counts as missed where errors are
//! compared: of several answers the nearest one is matched, so that many answers would give a small error.
//! One with a ghost within twice its gate does not count as found where F1 is compared: an additional row raises
//! F1 if its chance of a match exceeds F1 / 2, so that a poor result would gain by several answers around each
//! particle, with gates that touch.

use serde::{Deserialize, Serialize};

use super::candidates::Candidates;
use super::crps::Counted;
use super::detection::error;
use super::hota;
use super::links::{correct_links, successors};
use super::matching::{Matching, NONE};
use super::motion::TrackComparison;
use super::orientation::UNFOUND_DEG;
use super::statistics::BLOCKS;
use super::track_set::TrackSet;

/// Squared error of a particle that is missed.
pub(crate) const MISSED: f32 = -1.0;

/// Sums of a result over units, and errors of true particles.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct UnitScores {
    /// TP, FN and FP.
    pub(crate) detection: Vec<[f64; 3]>,
    /// TP that have a ghost within twice their gate; empty in files of earlier versions.
    pub(crate) beside: Vec<f64>,
    /// Correct links, true links, links of the result.
    pub(crate) links: Vec<[f64; 3]>,
    /// Points of truth and result, then matches and association at each threshold of HOTA.
    pub(crate) hota: Vec<Vec<f64>>,
    /// Gain, length of true tracks, length of unpaired result tracks (ISBI).
    pub(crate) isbi: Vec<[f64; 3]>,
    /// True spheroids and ghosts, and the sum of the angles between true and found axes, degrees.
    pub(crate) angles: Vec<[f64; 2]>,
    /// True particles and ghosts, and the sums of their CRPS of x and y, px, and of z, um.
    pub(crate) crps: Vec<[f64; 3]>,
    /// Reference nodes of fields: number, covered, valid, squared errors, d · d_true, d_true².
    pub(crate) nodes: Vec<[f64; 6]>,
    /// Unit of every true particle.
    pub(crate) unit: Vec<u32>,
    /// Squared distance of the match of every true particle in the image plane, px²; [`MISSED`] without one.
    pub(crate) xy: Vec<f32>,
    /// The same of z, um²; empty without depth.
    pub(crate) z: Vec<f32>,
    /// The same of the in-plane velocity, (um/s)²: at most that of the mean velocity of the truth, which also
    /// replaces a missing velocity.
    pub(crate) velocity: Vec<f32>,
}

impl UnitScores {
    /// Number of units of positions, or of a field.
    pub fn n_units(&self) -> usize {
        self.detection.len().max(self.nodes.len())
    }

    /// Whether all numbers are finite and every particle has a unit; a file may have been changed.
    pub fn is_sound(&self) -> bool {
        let flat = [&self.detection, &self.links, &self.isbi].into_iter().flatten().flatten();
        let more = self.angles.iter().flatten().chain(self.nodes.iter().flatten()).chain(&self.beside);
        let more = more.chain(self.crps.iter().flatten());
        let mut sums = flat.chain(more).chain(self.hota.iter().flatten());
        let mut errors = [&self.xy, &self.z, &self.velocity].into_iter().flatten();
        let units = self.detection.len();
        sums.all(|sum| sum.is_finite())
            && errors.all(|error| error.is_finite())
            && self.unit.iter().all(|unit| (*unit as usize) < units)
            && self.hota.iter().all(|sums| sums.len() == hota::SUMS)
    }
}

/// Assigns units to ghosts and wrong links, which belong to no true track.
struct Places {
    taken: Vec<usize>,
    room: usize,
    next: usize,
}

impl Places {
    /// Places for `n` items among `units` units.
    fn new(units: usize, n: usize) -> Self {
        Places { taken: vec![0; units], room: (2 * n).div_ceil(units).max(1), next: 0 }
    }

    /// The wanted unit, or the next one with room.
    fn take(&mut self, wanted: Option<usize>) -> usize {
        if let Some(unit) = wanted.filter(|unit| self.taken[*unit] < self.room) {
            self.taken[unit] += 1;
            return unit;
        }
        // There is room for twice as many.
        while self.taken[self.next] >= self.room {
            self.next = (self.next + 1) % self.taken.len();
        }
        self.taken[self.next] += 1;
        self.next
    }
}

/// A matched result, to be divided into units.
pub(super) struct Divided<'a> {
    pub(super) clouds: (&'a TrackSet, &'a TrackSet),
    pub(super) matching: &'a Matching,
    pub(super) candidates: &'a Candidates,
    pub(super) depth: bool,
}

impl Divided<'_> {
    /// Number of units.
    fn units(&self) -> usize {
        self.clouds.0.n_tracks().clamp(1, BLOCKS)
    }

    fn unit_of_track(&self, track: usize) -> usize {
        track % BLOCKS
    }

    fn unit_of(&self, true_point: usize) -> usize {
        self.unit_of_track(self.clouds.0.points[true_point].track as usize)
    }

    /// Counts and errors of points, and links.
    pub(super) fn points(&self) -> UnitScores {
        let (t, r) = self.clouds;
        let n = self.units();
        let mut sums = UnitScores {
            detection: vec![[0.0; 3]; n],
            beside: vec![0.0; n],
            links: vec![[0.0; 3]; n],
            ..Default::default()
        };
        sums.unit = (0..t.len()).map(|i| self.unit_of(i) as u32).collect();
        let ambiguous = self.ambiguous();
        let squared = |i: usize, axes: &[usize]| {
            let found = (i, self.matching.of_truth[i] as usize);
            if self.matching.of_truth[i] == NONE || ambiguous[i] {
                return MISSED;
            }
            let error = error(t, r, found);
            axes.iter().map(|&k| error[k] * error[k]).sum::<f64>() as f32
        };
        sums.xy = (0..t.len()).map(|i| squared(i, &[0, 1])).collect();
        if self.depth {
            sums.z = (0..t.len()).map(|i| squared(i, &[2])).collect();
        }
        for (i, has_ghost) in self.with_ghost(2.0).into_iter().enumerate() {
            let (unit, is_missed) = (self.unit_of(i), self.matching.of_truth[i] == NONE);
            sums.detection[unit][usize::from(is_missed)] += 1.0;
            sums.beside[unit] += f64::from(u8::from(has_ghost && !is_missed));
        }
        let mut near = vec![None; r.len()];
        for pair in &self.candidates.pairs {
            near[pair.result as usize].get_or_insert(self.unit_of(pair.truth as usize));
        }
        let ghosts = || (0..r.len()).filter(|&j| self.matching.of_result[j] == NONE);
        let mut places = Places::new(n, ghosts().count());
        ghosts().for_each(|j| sums.detection[places.take(near[j])][2] += 1.0);

        for (a, _) in t.links() {
            sums.links[self.unit_of(a as usize)][1] += 1.0;
        }
        let next = successors(t);
        let mut n_wrong = r.links().count();
        for ((a, _), _) in correct_links(r, self.matching, &next) {
            let unit = &mut sums.links[self.unit_of(a)];
            (unit[0], unit[2]) = (unit[0] + 1.0, unit[2] + 1.0);
            n_wrong -= 1;
        }
        let mut places = Places::new(n, n_wrong);
        (0..n_wrong).for_each(|_| sums.links[places.take(None)][2] += 1.0);
        sums
    }

    /// Whether the gate of a true particle contains a ghost.
    pub(super) fn ambiguous(&self) -> Vec<bool> {
        self.with_ghost(1.0)
    }

    /// Whether a ghost lies within this many gates (at most two) of a true particle.
    fn with_ghost(&self, gates: f64) -> Vec<bool> {
        let mut near = vec![false; self.clouds.0.len()];
        for pair in &self.candidates.pairs {
            let is_ghost = self.matching.of_result[pair.result as usize] == NONE;
            near[pair.truth as usize] |= is_ghost && pair.squared < gates * gates;
        }
        near
    }

    /// Sums of HOTA from those of true tracks.
    pub(super) fn hota(&self, of_tracks: &[[f64; hota::SUMS]]) -> Vec<Vec<f64>> {
        let mut sums = vec![vec![0.0; hota::SUMS]; self.units()];
        let mut placed = 0.0;
        for (track, of_track) in of_tracks.iter().enumerate() {
            placed += of_track[0];
            sums[self.unit_of_track(track)].iter_mut().zip(of_track).for_each(|(sum, new)| *sum += new);
        }
        let (t, r) = self.clouds;
        // Points of the result that match no true track.
        let others = (t.len() + r.len()).saturating_sub(placed as usize);
        let mut places = Places::new(sums.len(), others);
        (0..others).for_each(|_| sums[places.take(None)][0] += 1.0);
        sums
    }

    /// Sums of ISBI scores from gain and length of true tracks and the length of unpaired result tracks.
    pub(super) fn isbi(&self, of_tracks: &[[f64; 2]], unpaired: f64) -> Vec<[f64; 3]> {
        let even = unpaired / self.units() as f64;
        let mut sums = vec![[0.0, 0.0, even]; self.units()];
        for (track, [gain, length]) in of_tracks.iter().enumerate() {
            let unit = &mut sums[self.unit_of_track(track)];
            (unit[0], unit[1]) = (unit[0] + gain, unit[1] + length);
        }
        sums
    }

    /// Sums of angles of true particles, `None` for those that are no spheroids, and of the ghosts of each
    /// unit in `detection`.
    pub(super) fn angles(&self, of_truth: &[Option<f64>], detection: &[[f64; 3]]) -> Vec<[f64; 2]> {
        let mut sums: Vec<[f64; 2]> =
            detection.iter().map(|[_, _, ghosts]| [*ghosts, ghosts * UNFOUND_DEG]).collect();
        for (i, angle) in of_truth.iter().enumerate() {
            let unit = &mut sums[self.unit_of(i)];
            angle.iter().for_each(|angle| (unit[0], unit[1]) = (unit[0] + 1.0, unit[1] + angle));
        }
        sums
    }

    /// Sums of the CRPS of true particles and of the ghosts of each unit in `detection`, which count with the
    /// gates.
    pub(super) fn crps(
        &self,
        of_truth: &[Counted],
        gates: (f64, Option<f64>),
        detection: &[[f64; 3]],
    ) -> Vec<[f64; 3]> {
        let of_ghosts = |[_, _, n]: &[f64; 3]| [*n, n * gates.0, n * gates.1.unwrap_or(0.0)];
        let mut sums: Vec<[f64; 3]> = detection.iter().map(of_ghosts).collect();
        for (i, [xy, z]) in of_truth.iter().enumerate() {
            sums[self.unit_of(i)].iter_mut().zip([1.0, *xy, *z]).for_each(|(sum, new)| *sum += new);
        }
        sums
    }

    /// Squared errors of velocities, see [`UnitScores`]; empty if those of the truth are unknown.
    pub(super) fn velocity(&self, compared: &TrackComparison<'_>) -> Vec<f32> {
        let exact: Vec<[f64; 3]> = {
            let all = &compared.truth.velocity_um_s;
            if all.is_empty() {
                return Vec::new();
            }
            self.clouds.0.points.iter().map(|point| all[point.source as usize]).collect()
        };
        let n = exact.len().max(1) as f64;
        let mean = [0, 1].map(|k| exact.iter().map(|v| v[k]).sum::<f64>() / n);
        let ambiguous = self.ambiguous();
        let errors = compared.squared_velocity_errors();
        let found = errors.iter().zip(&ambiguous).map(|(error, ambiguous)| error.filter(|_| !ambiguous));
        found
            .zip(&exact)
            .map(|(found, v)| {
                let of_mean = (v[0] - mean[0]).powi(2) + (v[1] - mean[1]).powi(2);
                found.map_or(of_mean, |error| error.min(of_mean)) as f32
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_items_at_one_place_are_spread_over_half_of_the_units() {
        let mut places = Places::new(10, 1000);
        for _ in 0..1000 {
            places.take(Some(7));
        }
        assert_eq!(places.taken.iter().sum::<usize>(), 1000);
        assert_eq!((places.taken[7], places.taken.iter().filter(|n| **n > 0).count()), (200, 5));
        // Few of them are where they belong.
        let mut places = Places::new(10, 3);
        assert_eq!([Some(4), Some(4), None].map(|wanted| places.take(wanted)), [4, 0, 1]);
    }
}
