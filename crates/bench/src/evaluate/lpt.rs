//! Scores of Lagrangian particle tracking: found, missed and ghost particles, errors of motion, lengths of tracks.
//!
//! Displacements are compared over right links, so the finite difference is the same on both sides. Velocities are central
//! differences of the result (one-sided at the ends of tracks) against the flow's exact velocity; accelerations second
//! differences against second differences of the truth. After Sciacchitano, Leclaire and Schröder (LPT challenge, 2021);
//! definitions in docs/scoring.md.

use std::collections::BTreeMap;

use serde::Serialize;

use super::cloud::Cloud;
use super::detection::per_frame;
use super::links::{right, successors};
use super::matching::{Matching, NONE};
use super::statistics::{Bootstrap, Errors, Interval, quantile, ratio};
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
    pub displacement_rms_px: Option<f64>,
    pub displacement_bias_x_px: Option<f64>,
    pub displacement_bias_y_px: Option<f64>,
    pub displacement_rms_z_um: Option<f64>,
    /// Derived from positions: no format that is read carries velocities.
    pub velocity_rms_um_s: Option<f64>,
    pub velocity_rms_relative: Option<f64>,
    pub velocity_rms_z_um_s: Option<f64>,
    pub acceleration_rms_px: Option<f64>,
    pub acceleration_rms_relative: Option<f64>,
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
}

/// Sums by frame: true points, found ones, matches; numbers and squares of errors of displacement, velocity, acceleration.
type Frames = BTreeMap<u32, [f64; 9]>;

/// Names of the classes of lengths.
pub const LENGTHS: [&str; 6] = ["1", "2", "3-5", "6-10", "11-20", "> 20"];

fn class(length: usize) -> usize {
    [1, 2, 5, 10, 20].iter().position(|&most| length <= most).unwrap_or(5)
}

impl Lpt {
    /// Of a matching; `depth` tells whether z is scored.
    pub fn of(
        truth: &Truth,
        clouds: (&Cloud, &Cloud),
        matching: &Matching,
        depth: bool,
        bootstrap: &Bootstrap,
    ) -> Self {
        let (t, r) = clouds;
        let tp = matching.pairs().count() as f64;
        let (n, m) = (t.len() as f64, r.len() as f64);
        let mut score = Lpt {
            correct: ratio(tp, n),
            missed: ratio(n - tp, n),
            ghost: ratio(m - tp, n),
            ghost_of_measured: ratio(m - tp, m),
            ..Lpt::default()
        };
        let mut frames: Frames = per_frame(t, r, matching)
            .iter()
            .map(|f| {
                let [tp, missed, ghosts] = f.counts.map(|n| n as f64);
                (f.frame, [tp + missed, tp + ghosts, tp, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
            })
            .collect();
        score.motion(truth, clouds, matching, depth, &mut frames);
        let root = |squares: f64, n: f64| ratio(squares, n).map(f64::sqrt);
        let [correct, ghost, displacement_rms_px, velocity_rms_um_s, acceleration_rms_px] = bootstrap
            .intervals(&bootstrap.by_frame(frames.into_iter()), |&[n, m, tp, nd, d, nv, v, na, a]| {
                [ratio(tp, n), ratio(m - tp, n), root(d, nd), root(v, nv), root(a, na)]
            });
        score.interval =
            Intervals { correct, ghost, displacement_rms_px, velocity_rms_um_s, acceleration_rms_px };
        score.tracks(clouds, matching);
        score
    }

    fn motion(
        &mut self,
        truth: &Truth,
        (t, r): (&Cloud, &Cloud),
        matching: &Matching,
        depth: bool,
        of_frames: &mut Frames,
    ) {
        let mut note = |frame: u32, kind: usize, error: &[f64]| {
            let sums = of_frames.entry(frame).or_insert([0.0; 9]);
            sums[3 + 2 * kind] += 1.0;
            sums[4 + 2 * kind] += error.iter().map(|e| e * e).sum::<f64>();
        };
        let next = successors(t);
        let moved = |cloud: &Cloud, a: usize, b: usize| {
            let (p, q) = (&cloud.points[a].at, &cloud.points[b].at);
            [q.x_px - p.x_px, q.y_px - p.y_px, q.z_um - p.z_um]
        };
        let errors: Vec<[f64; 3]> = right(r, matching, &next)
            .map(|((ta, tb), (ra, rb))| {
                let (true_, found) = (moved(t, ta, tb), moved(r, ra, rb));
                let error = [found[0] - true_[0], found[1] - true_[1], found[2] - true_[2]];
                note(r.points[ra].frame, 0, &error[..2]);
                error
            })
            .collect();
        let axis = |k: usize| Errors::of(errors.iter().map(move |e| e[k]));
        let (x, y) = (axis(0), axis(1));
        self.displacement_rms_px = x.rms.zip(y.rms).map(|(x, y)| (x * x + y * y).sqrt());
        (self.displacement_bias_x_px, self.displacement_bias_y_px) = (x.bias, y.bias);
        self.displacement_rms_z_um = axis(2).rms.filter(|_| depth);

        // In the image plane, px per frame and px per frame^2.
        let flat = |d: [f64; 3], frames: f64| [d[0] / frames, d[1] / frames];
        let frames =
            |cloud: &Cloud, a: usize, b: usize| f64::from(cloud.points[b].frame - cloud.points[a].frame);
        let to_um_s = truth.facts.um_per_px.zip(truth.facts.dt_s).map(|(um, dt)| um / dt);
        let (mut speed, mut bend, mut upward) = (Sum::default(), Sum::default(), Vec::new());
        for track in 0..r.n_tracks() {
            let points = r.track(track);
            for (k, &i) in points.iter().enumerate().filter(|_| points.len() > 1) {
                let i = i as usize;
                let of = matching.of_result[i];
                let (a, b) =
                    (points[k.saturating_sub(1)] as usize, points[(k + 1).min(points.len() - 1)] as usize);
                if of == NONE {
                    continue;
                }
                if let (Some(scale), false) = (to_um_s, truth.velocity_um_s.is_empty()) {
                    let v = flat(moved(r, a, b), frames(r, a, b)).map(|v| v * scale);
                    let exact = truth.velocity_um_s[t.points[of as usize].source as usize];
                    let error = [v[0] - exact[0], v[1] - exact[1]];
                    speed.add(error, [exact[0], exact[1]]);
                    note(r.points[i].frame, 1, &error);
                    let w = moved(r, a, b)[2] / frames(r, a, b) / truth.facts.dt_s.unwrap_or(f64::NAN);
                    upward.push(w - exact[2]);
                }
                // Three consecutive frames, followed on the same particle.
                let same = |a: usize, b: usize| {
                    let (p, q) = (matching.of_result[a], matching.of_result[b]);
                    p != NONE
                        && q != NONE
                        && next[p as usize] == q
                        && r.points[b].frame - r.points[a].frame == 1
                };
                if a != i && b != i && same(a, i) && same(i, b) {
                    let second = |cloud: &Cloud, a, i, b| {
                        let (d, e) = (moved(cloud, a, i), moved(cloud, i, b));
                        [e[0] - d[0], e[1] - d[1]]
                    };
                    let of = |i: usize| matching.of_result[i] as usize;
                    let (found, exact) = (second(r, a, i, b), second(t, of(a), of(i), of(b)));
                    let error = [found[0] - exact[0], found[1] - exact[1]];
                    bend.add(error, exact);
                    note(r.points[i].frame, 2, &error);
                }
            }
        }
        (self.velocity_rms_um_s, self.velocity_rms_relative) = speed.rms();
        self.velocity_rms_z_um_s = Errors::of(upward.iter().copied()).rms.filter(|_| depth);
        (self.acceleration_rms_px, self.acceleration_rms_relative) = bend.rms();
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

/// Squares of errors and of what they are errors of.
#[derive(Default)]
struct Sum {
    n: f64,
    errors: f64,
    exact: f64,
}

impl Sum {
    fn add(&mut self, error: [f64; 2], exact: [f64; 2]) {
        self.n += 1.0;
        self.errors += error[0] * error[0] + error[1] * error[1];
        self.exact += exact[0] * exact[0] + exact[1] * exact[1];
    }

    fn rms(&self) -> (Option<f64>, Option<f64>) {
        (ratio(self.errors, self.n).map(f64::sqrt), ratio(self.errors, self.exact).map(f64::sqrt))
    }
}
