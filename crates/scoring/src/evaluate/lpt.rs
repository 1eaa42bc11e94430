//! Scores of Lagrangian particle tracking: correct, missed and ghost particles, errors of velocity and
//! acceleration, track lengths.
//!
//! After Sciacchitano, Leclaire and Schröder (LPT challenge, 2021); definitions in docs/scoring.md and
//! `motion.rs`.

use super::matching::{Matching, NONE};
use super::motion::{Motion, TrackComparison};
use super::statistics::{Interval, median, ratio};
use super::track_set::TrackSet;
use super::truth::TrueParticles;
use super::units::{Matched, Units};

scores! {
    /// Lagrangian particle tracking (Sciacchitano, Leclaire and Schroeder, LPT challenge, 2021).
    pub struct Lpt {
        /// Fraction of true particles that are found: TP / true particles.
        fraction correct: Option<f64>,
        /// Fraction of true particles that are missed: FN / true particles.
        fraction missed: Option<f64>,
        /// Ghosts per true particle: FP / true particles; may exceed 1.
        not_negative ghost: Option<f64>,
        /// Fraction of result points that are ghosts: FP / result points.
        fraction ghost_of_measured: Option<f64>,
        /// Errors of displacement, velocity and acceleration.
        #[serde(flatten)]
        pub motion: Motion,
        /// Mean over true tracks of the longest run of points followed by one result track, divided by the length
        /// of the true track.
        fraction coverage_longest: Option<f64>,
        /// Mean number of result tracks per true track, over true tracks with any match.
        not_negative fragments_per_truth: Option<f64>,
        /// Mean number of true tracks per result track, over result tracks with any match.
        not_negative truths_per_result: Option<f64>,
        /// Fraction of true tracks with at least 80 % of their points matched.
        fraction mostly_tracked: Option<f64>,
        /// Fraction of true tracks with 20 to 80 % of their points matched.
        fraction partially_tracked: Option<f64>,
        /// Fraction of true tracks with at most 20 % of their points matched.
        fraction mostly_lost: Option<f64>,
        /// Fraction of result tracks that reproduce exactly one complete true track.
        fraction strict: Option<f64>,
        /// Mean fraction of the points of a result track that belong to the true track it follows most.
        fraction purity: Option<f64>,
        /// Mean number of points of result tracks.
        not_negative mean_length: Option<f64>,
        /// Median number of points of result tracks.
        not_negative median_length: Option<f64>,
        /// Numbers of result tracks of 1, 2, 3-5, 6-10, 11-20, > 20 points.
        pub lengths: [usize; 6],
        /// Numbers of true tracks of 1, 2, 3-5, 6-10, 11-20, > 20 points.
        pub true_lengths: [usize; 6],
        /// 95 % bootstrap interval of correct, resampling true tracks.
        fraction interval_correct: Interval,
        /// 95 % bootstrap interval of ghost.
        not_negative interval_ghost: Interval,
        /// 95 % bootstrap interval of displacement_rms_px.
        not_negative interval_displacement_rms_px: Interval,
        /// 95 % bootstrap interval of velocity_rms_um_s.
        not_negative interval_velocity_rms_um_s: Interval,
        /// 95 % bootstrap interval of acceleration_rms_px.
        not_negative interval_acceleration_rms_px: Interval,
        /// 95 % bootstrap interval of acceleration_rms_um_s2.
        not_negative interval_acceleration_rms_um_s2: Interval,
    }
}

/// Labels of the track-length classes, in points.
pub const LENGTHS: [&str; 6] = ["1", "2", "3-5", "6-10", "11-20", "> 20"];

fn class(length: usize) -> usize {
    [1, 2, 5, 10, 20].iter().position(|&most| length <= most).unwrap_or(5)
}

impl Lpt {
    /// Scores a matching; `depth`: whether z is scored; `reported`: velocities of the rows of the result,
    /// um/s.
    pub fn of(
        truth: &TrueParticles,
        clouds: (&TrackSet, &TrackSet),
        matching: &Matching,
        depth: bool,
        reported: Option<&[[f64; 3]]>,
        units: &Units,
    ) -> Self {
        let (t, r) = clouds;
        let tp = matching.pairs().count() as f64;
        let (n, m) = (t.len() as f64, r.len() as f64);
        let (motion, errors) = TrackComparison { truth, clouds, matching, depth, reported }.motion();
        let mut score = Lpt {
            correct: ratio(tp, n),
            missed: ratio(n - tp, n),
            ghost: ratio(m - tp, n),
            ghost_of_measured: ratio(m - tp, m),
            motion,
            ..Lpt::default()
        };
        let counts = units.matched(matching).map(|(unit, point)| match point {
            Matched::Ghost => (unit, [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
            Matched::Pair(i, _) | Matched::Missed(i) => {
                let [[nd, d], [nv, v], [nb, b], [na, a]] = errors[i];
                let found = f64::from(u8::from(matching.result_for[i] != NONE));
                (unit, [1.0, found, found, nd, d, nv, v, nb, b, na, a])
            }
        });
        let sums = units.sums(counts);
        let root = |squares: f64, n: f64| ratio(squares, n).map(f64::sqrt);
        [
            score.interval_correct,
            score.interval_ghost,
            score.interval_displacement_rms_px,
            score.interval_velocity_rms_um_s,
            score.interval_acceleration_rms_px,
            score.interval_acceleration_rms_um_s2,
        ] = units.intervals(&sums, |&[n, m, tp, nd, d, nv, v, nb, b, na, a]| {
            [ratio(tp, n), ratio(m - tp, n), root(d, nd), root(v, nv), root(b, nb), root(a, na)]
        });
        score.tracks(clouds, matching);
        score
    }

    fn tracks(&mut self, (t, r): (&TrackSet, &TrackSet), matching: &Matching) {
        let partner = |i: u32| {
            let of = matching.result_for[i as usize];
            (of != NONE).then(|| r.points[of as usize].track)
        };
        let (mut coverage, mut fragments, mut followed) = (0.0, 0.0, 0.0);
        let mut kinds = [0.0; 3];
        for track in 0..t.n_tracks() {
            let points = t.track(track);
            self.true_lengths[class(points.len())] += 1;
            let partners: Vec<Option<u32>> = points.iter().map(|&i| partner(i)).collect();
            let longest = partners
                .chunk_by(|a, b| a.is_some() && a == b)
                .filter(|run| run[0].is_some())
                .map(<[_]>::len);
            let n = points.len() as f64;
            coverage += longest.max().unwrap_or(0) as f64 / n;
            let mut ids: Vec<u32> = partners.iter().flatten().copied().collect();
            let share = ids.len() as f64 / n;
            kinds[if share >= 0.8 {
                0
            } else if share > 0.2 {
                1
            } else {
                2
            }] += 1.0;
            ids.sort_unstable();
            ids.dedup();
            followed += f64::from(u8::from(!ids.is_empty()));
            fragments += ids.len() as f64;
        }
        let n = t.n_tracks() as f64;
        self.coverage_longest = ratio(coverage, n);
        self.fragments_per_truth = ratio(fragments, followed);
        let share = |k: usize| ratio(kinds[k], n);
        (self.mostly_tracked, self.partially_tracked, self.mostly_lost) = (share(0), share(1), share(2));

        let (mut purity, mut strict, mut truths, mut of_any) = (0.0, 0.0, 0.0, 0.0);
        let mut lengths = Vec::with_capacity(r.n_tracks());
        for track in 0..r.n_tracks() {
            let points = r.track(track);
            lengths.push(points.len() as f64);
            self.lengths[class(points.len())] += 1;
            let of = points.iter().map(|&i| matching.truth_for[i as usize]).filter(|&of| of != NONE);
            let mut ids: Vec<u32> = of.map(|of| t.points[of as usize].track).collect();
            ids.sort_unstable();
            let groups: Vec<usize> = ids.chunk_by(|a, b| a == b).map(<[_]>::len).collect();
            let main = groups.iter().copied().max().unwrap_or(0);
            purity += main as f64 / points.len() as f64;
            let whole = groups.len() == 1 && main == points.len() && t.track(ids[0] as usize).len() == main;
            strict += f64::from(u8::from(whole));
            truths += groups.len() as f64;
            of_any += f64::from(u8::from(!groups.is_empty()));
        }
        let m = r.n_tracks() as f64;
        self.purity = ratio(purity, m);
        self.strict = ratio(strict, m);
        self.truths_per_result = ratio(truths, of_any);
        self.mean_length = ratio(lengths.iter().sum(), m);
        self.median_length = median(lengths.into_iter());
    }
}
