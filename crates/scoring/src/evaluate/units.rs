//! Resampling units of intervals and of paired comparisons of two results, and the errors of every true particle.
//!
//! A unit is a true track: the frames of a sequence show the same particles, and what makes one of them difficult
//! (its depth, a neighbor) does so in all frames. Every result point belongs to a unit, too: a matched point to
//! its true particle's; another one to the unit of a true particle within twice the gate, to the one that its
//! track mostly follows, or to one that its place selects (a square of 8 px), in this order. Each result thus has the
//! same units, and what is wrong in the same place or along the same track stays together. A unit has no
//! more than twice the average number of unmatched points, or as many as the longest true track has points; others go to the
//! next unit with room: a thousand ghosts at one position in a single unit would be absent from a third of all
//! resamples, and so would never be significant. For fields, a unit is a square of reference nodes.
//!
//! A true particle whose gate contains a ghost in addition to its match counts as missed where errors are
//! compared: of several answers the nearest one is matched, so that many answers would give a small error.
//! One with a ghost within twice its gate, or within its gate in the image plane at any depth, does not count as found where F1 is compared: an additional row raises
//! F1 if its chance of a match exceeds F1 / 2, so that a poor result would gain by several answers around each
//! particle, with gates that touch.

use numeric::cell_grid::CellGrid;
use serde::{Deserialize, Serialize};

use super::candidates::Candidates;
use super::detection::error;
use super::hota;
use super::matching::{Matching, NONE};
use super::motion::TrackComparison;
use super::statistics::{BLOCKS, Interval, add, intervals};
use super::track_set::{Position, TrackSet};

/// Squared error of a particle that is missed.
pub(crate) const MISSED: f32 = -1.0;

/// Side of the squares by which ghosts far from all particles are assigned to units, px.
const PLACE_PX: f64 = 8.0;

/// The resampling unit of every point of truth and result.
#[derive(Debug, Clone)]
pub struct Units {
    seed: u64,
    n: usize,
    truth_units: Vec<u32>,
    result_units: Vec<u32>,
}

/// A true point or a ghost.
pub(super) enum Matched {
    /// True point and its result point.
    Pair(usize, usize),
    /// True point without a result point.
    Missed(usize),
    /// Result point without a true point.
    Ghost,
}

impl Units {
    /// The units of a matched result; `seed`: of the bootstrap.
    pub fn new(
        (truth, result): (&TrackSet, &TrackSet),
        matching: &Matching,
        candidates: &Candidates,
        seed: u64,
    ) -> Self {
        let n = truth.n_tracks().clamp(1, BLOCKS);
        let truth_units: Vec<u32> = truth.points.iter().map(|point| point.track % BLOCKS as u32).collect();
        let mut near = vec![None; result.len()];
        for (unit, of) in near.iter_mut().zip(&matching.truth_for) {
            *unit = truth_units.get(*of as usize).copied();
        }
        for pair in &candidates.pairs {
            near[pair.result as usize].get_or_insert(truth_units[pair.truth as usize]);
        }
        let n_ghosts = matching.truth_for.iter().filter(|of| **of == NONE).count();
        let longest = (0..truth.n_tracks()).map(|track| truth.track(track).len()).max().unwrap_or(0);
        let mut places = Places::new(n, n_ghosts, longest);
        let mut result_units = vec![0; result.len()];
        for track in 0..result.n_tracks() {
            let points = result.track(track);
            let mut units: Vec<u32> = points.iter().filter_map(|&j| near[j as usize]).collect();
            units.sort_unstable();
            let followed =
                units.chunk_by(|a, b| a == b).rev().max_by_key(|same| same.len()).map(|same| same[0]);
            let own = followed.unwrap_or_else(|| place(&result.points[points[0] as usize].at, n));
            for j in points.iter().map(|&j| j as usize) {
                let unit = near[j].unwrap_or(own);
                result_units[j] = if matching.truth_for[j] == NONE { places.take(unit) } else { unit };
            }
        }
        Units { seed, n, truth_units, result_units }
    }

    /// All points in a single unit, which gives no intervals.
    pub fn single(truth: &TrackSet, result: &TrackSet) -> Self {
        Units { seed: 0, n: 1, truth_units: vec![0; truth.len()], result_units: vec![0; result.len()] }
    }

    /// The unit of a true track.
    pub(super) fn track_unit(&self, track: usize) -> u32 {
        (track % self.n) as u32
    }

    /// The unit of a true point.
    pub(super) fn truth_unit(&self, point: usize) -> u32 {
        self.truth_units[point]
    }

    pub(super) fn result_unit(&self, point: usize) -> u32 {
        self.result_units[point]
    }

    /// All true points and all ghosts, each with its unit.
    pub(super) fn matched<'a>(&'a self, matching: &'a Matching) -> impl Iterator<Item = (u32, Matched)> + 'a {
        let truth = matching.result_for.iter().enumerate().map(|(i, &j)| {
            (self.truth_units[i], if j == NONE { Matched::Missed(i) } else { Matched::Pair(i, j as usize) })
        });
        let ghosts = matching.truth_for.iter().enumerate().filter(|(_, of)| **of == NONE);
        truth.chain(ghosts.map(|(j, _)| (self.result_units[j], Matched::Ghost)))
    }

    /// Sums over every unit of items, each with its unit.
    pub(super) fn sums<const N: usize>(&self, items: impl Iterator<Item = (u32, [f64; N])>) -> Vec<[f64; N]> {
        let mut sums = vec![[0.0; N]; self.n];
        items.for_each(|(unit, item)| add(&mut sums[unit as usize], &item));
        sums
    }

    /// 95 % intervals of statistics of the sums over units; see [`intervals`].
    pub(super) fn intervals<const N: usize, const M: usize>(
        &self,
        sums: &[[f64; N]],
        statistics: impl Fn(&[f64; N]) -> [Option<f64>; M],
    ) -> [Interval; M] {
        intervals(sums, self.seed, statistics)
    }
}

/// The unit that a place selects out of `n`; the same in each result.
fn place(at: &Position, n: usize) -> u32 {
    let [column, row] = [at.x_px, at.y_px].map(|px| (px / PLACE_PX).floor() as i64 as u64);
    let mixed = (column << 32 ^ row).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    ((u128::from(mixed ^ mixed >> 32) * n as u128) >> 64) as u32
}

/// Room for ghosts in units.
struct Places {
    taken: Vec<usize>,
    room: usize,
    next: usize,
}

impl Places {
    /// Places for `n` items among `units` units, at least `least` in each.
    fn new(units: usize, n: usize, least: usize) -> Self {
        Places { taken: vec![0; units], room: (2 * n).div_ceil(units).max(least).max(1), next: 0 }
    }

    /// The wanted unit, or the next one with room.
    fn take(&mut self, wanted: u32) -> u32 {
        let mut unit = wanted as usize;
        if self.taken[unit] >= self.room {
            // There is room for twice as many.
            while self.taken[self.next] >= self.room {
                self.next = (self.next + 1) % self.taken.len();
            }
            unit = self.next;
        }
        self.taken[unit] += 1;
        unit as u32
    }
}

/// Sums of a result over units, and errors of true particles.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct UnitScores {
    /// TP, FN and FP.
    pub(crate) detection: Vec<[f64; 3]>,
    /// TP that have a ghost within twice their gate, or within their gate in the image plane; empty in files of earlier versions.
    pub(crate) beside: Vec<f64>,
    /// Correct links, true links, links of the result.
    pub(crate) links: Vec<[f64; 3]>,
    /// Points of truth and result, then matches and association at each threshold of HOTA.
    pub(crate) hota: Vec<Vec<f64>>,
    /// Gain, length of true tracks, length of unpaired result tracks (ISBI).
    pub(crate) isbi: Vec<[f64; 3]>,
    /// True spheroids and ghosts, and the sum of the angles between true and found axes, degrees.
    pub(crate) angles: Vec<[f64; 2]>,
    /// True particles and ghosts, and particles with the right class of diameters.
    pub(crate) sizes: Vec<[f64; 2]>,
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
    /// The same of the in-plane velocity, (um/s)²: at most the error of the truth's mean velocity, which also
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
        let more = more.chain(self.crps.iter().flatten()).chain(self.sizes.iter().flatten());
        let mut sums = flat.chain(more).chain(self.hota.iter().flatten());
        let mut errors = [&self.xy, &self.z, &self.velocity].into_iter().flatten();
        let units = self.detection.len();
        sums.all(|sum| sum.is_finite())
            && errors.all(|error| error.is_finite())
            && self.unit.iter().all(|unit| (*unit as usize) < units)
            && self.hota.iter().all(|sums| sums.len() == hota::SUMS)
    }
}

/// A matched result whose errors are compared with other results.
pub(super) struct Divided<'a> {
    pub(super) clouds: (&'a TrackSet, &'a TrackSet),
    pub(super) matching: &'a Matching,
    pub(super) candidates: &'a Candidates,
    pub(super) depth: bool,
}

impl Divided<'_> {
    /// Units and errors of true particles.
    pub(super) fn points(&self, units: &Units) -> UnitScores {
        let (t, r) = self.clouds;
        let ambiguous = self.ambiguous();
        let squared = |i: usize, axes: &[usize]| {
            let found = (i, self.matching.result_for[i] as usize);
            if self.matching.result_for[i] == NONE || ambiguous[i] {
                return MISSED;
            }
            let error = error(t, r, found);
            axes.iter().map(|&k| error[k] * error[k]).sum::<f64>() as f32
        };
        let xy = (0..t.len()).map(|i| squared(i, &[0, 1])).collect();
        let z = (0..t.len()).filter(|_| self.depth).map(|i| squared(i, &[2])).collect();
        let mut beside = self.with_ghost(2.0);
        self.mark_with_ghost_in_plane(&mut beside);
        let is_beside = (0..t.len()).filter(|&i| beside[i] && self.matching.result_for[i] != NONE);
        let beside =
            units.sums(is_beside.map(|i| (units.truth_unit(i), [1.0]))).into_iter().map(|[n]| n).collect();
        UnitScores { unit: units.truth_units.clone(), beside, xy, z, ..Default::default() }
    }

    /// Whether the gate of a true particle contains a ghost.
    pub(super) fn ambiguous(&self) -> Vec<bool> {
        self.with_ghost(1.0)
    }

    /// Whether a ghost lies within this many gates (at most two) of a true particle.
    fn with_ghost(&self, gates: f64) -> Vec<bool> {
        let mut near = vec![false; self.clouds.0.len()];
        for pair in &self.candidates.pairs {
            let is_ghost = self.matching.truth_for[pair.result as usize] == NONE;
            near[pair.truth as usize] |= is_ghost && pair.squared < gates * gates;
        }
        near
    }

    /// Marks the true particles within whose gate in the image plane lies a ghost, at any depth: several depths for each
    /// position are several answers, too.
    fn mark_with_ghost_in_plane(&self, marked: &mut [bool]) {
        let ((t, r), reach_px) = (self.clouds, self.candidates.gate.xy_px);
        for (_, truths, results, _) in &self.candidates.frames {
            let is_ghost = |j: &usize| self.matching.truth_for[*j] == NONE;
            let ghosts: Vec<[f64; 2]> =
                results.clone().filter(is_ghost).map(|j| r.points[j].in_plane()).collect();
            let grid = CellGrid::new(&ghosts, reach_px);
            for i in truths.clone() {
                let [x, y] = t.points[i].in_plane();
                grid.around([x, y], |k| {
                    let [u, v] = ghosts[k as usize];
                    marked[i] |= (u - x).hypot(v - y) < reach_px;
                });
            }
        }
    }

    /// Squared errors of velocities, see [`UnitScores`]; empty if true velocities are unknown.
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
        let mut places = Places::new(10, 1000, 6);
        for _ in 0..1000 {
            places.take(7);
        }
        assert_eq!(places.taken.iter().sum::<usize>(), 1000);
        assert_eq!((places.taken[7], places.taken.iter().filter(|n| **n > 0).count()), (200, 5));
        // As many as a track has points are where they belong.
        let mut places = Places::new(10, 3, 2);
        assert_eq!([4, 4, 4].map(|wanted| places.take(wanted)), [4, 4, 0]);
        let units: Vec<u32> = (0..1000)
            .map(|k| {
                place(
                    &Position { x_px: 8.0 * f64::from(k % 40), y_px: 8.0 * f64::from(k / 40), z_um: 0.0 },
                    10,
                )
            })
            .collect();
        // A hundred each, and their standard deviation 9.5.
        assert!(
            (0..10).all(|unit| (70..130).contains(&units.iter().filter(|of| **of == unit).count())),
            "{units:?}"
        );
    }
}
