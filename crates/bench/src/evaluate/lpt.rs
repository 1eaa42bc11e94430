//! Scores of Lagrangian particle tracking: found, missed and ghost particles, errors of motion, lengths of tracks.
//!
//! After Sciacchitano, Leclaire and Schröder (LPT challenge, 2021); definitions in docs/scoring.md and `motion.rs`.

use serde::Serialize;

use super::cloud::Cloud;
use super::detection::per_frame;
use super::matching::{Matching, NONE};
use super::motion::{Compared, Motion};
use super::statistics::{Bootstrap, Interval, quantile, ratio};
use super::truth::Truth;

/// The scores.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Lpt {
    /// TP, FN and FP over true particles; FP over measured ones.
    pub correct: Option<f64>,
    pub missed: Option<f64>,
    pub ghost: Option<f64>,
    pub ghost_of_measured: Option<f64>,
    #[serde(flatten)]
    pub motion: Motion,
    /// Mean over true tracks of the longest run followed by one result track, over the track's length.
    pub coverage_longest: Option<f64>,
    /// Result tracks per true track, true tracks per result track (of those with any).
    pub fragments_per_truth: Option<f64>,
    pub truths_per_result: Option<f64>,
    /// Shares of true tracks with at least 80 %, 20 to 80 %, at most 20 % of their points matched.
    pub mostly_tracked: Option<f64>,
    pub partially_tracked: Option<f64>,
    pub mostly_lost: Option<f64>,
    /// Share of result tracks that are one whole true track and nothing else.
    pub strict: Option<f64>,
    /// Mean share of a result track's points that lie on its main true track.
    pub purity: Option<f64>,
    pub mean_length: Option<f64>,
    pub median_length: Option<f64>,
    /// Result tracks of 1, 2, 3-5, 6-10, 11-20, > 20 points.
    pub lengths: [usize; 6],
    /// True tracks likewise.
    pub true_lengths: [usize; 6],
    /// 95 % intervals under resampling of frames.
    pub interval: Intervals,
}

/// 95 % intervals.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Intervals {
    pub correct: Interval,
    pub ghost: Interval,
    pub displacement_rms_px: Interval,
    pub velocity_rms_um_s: Interval,
    pub acceleration_rms_px: Interval,
    pub acceleration_rms_um_s2: Interval,
}

/// Names of the classes of lengths.
pub const LENGTHS: [&str; 6] = ["1", "2", "3-5", "6-10", "11-20", "> 20"];

fn class(length: usize) -> usize {
    [1, 2, 5, 10, 20].iter().position(|&most| length <= most).unwrap_or(5)
}

impl Lpt {
    /// Of a matching; `depth` tells whether z is scored, `reported` are velocities of the rows of the result, um/s.
    pub fn of(
        truth: &Truth,
        clouds: (&Cloud, &Cloud),
        matching: &Matching,
        depth: bool,
        reported: Option<&[[f64; 3]]>,
        bootstrap: &Bootstrap,
    ) -> Self {
        let (t, r) = clouds;
        let tp = matching.pairs().count() as f64;
        let (n, m) = (t.len() as f64, r.len() as f64);
        let (motion, mut sums) = Compared { truth, clouds, matching, depth, reported }.motion();
        let mut score = Lpt {
            correct: ratio(tp, n),
            missed: ratio(n - tp, n),
            ghost: ratio(m - tp, n),
            ghost_of_measured: ratio(m - tp, m),
            motion,
            ..Lpt::default()
        };
        let frames = per_frame(t, r, matching).into_iter().map(|f| {
            let [tp, missed, ghosts] = f.counts.map(|n| n as f64);
            let [[nd, d], [nv, v], [nb, b], [na, a]] = sums.remove(&f.frame).unwrap_or_default();
            (f.frame, [tp + missed, tp + ghosts, tp, nd, d, nv, v, nb, b, na, a])
        });
        let units = bootstrap.by_frame(frames);
        let root = |squares: f64, n: f64| ratio(squares, n).map(f64::sqrt);
        let ends = bootstrap.intervals(&units, |&[n, m, tp, nd, d, nv, v, nb, b, na, a]| {
            [ratio(tp, n), ratio(m - tp, n), root(d, nd), root(v, nv), root(b, nb), root(a, na)]
        });
        score.interval = Intervals {
            correct: ends[0],
            ghost: ends[1],
            displacement_rms_px: ends[2],
            velocity_rms_um_s: ends[3],
            acceleration_rms_px: ends[4],
            acceleration_rms_um_s2: ends[5],
        };
        score.tracks(clouds, matching);
        score
    }

    fn tracks(&mut self, (t, r): (&Cloud, &Cloud), matching: &Matching) {
        let partner = |i: u32| {
            let of = matching.of_truth[i as usize];
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
            let of = points.iter().map(|&i| matching.of_result[i as usize]).filter(|&of| of != NONE);
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
        lengths.sort_unstable_by(f64::total_cmp);
        self.median_length = quantile(&lengths, 0.5);
    }
}
