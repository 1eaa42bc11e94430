//! Average precision of boxes as COCO defines it (Lin et al., ECCV 2014), without classes and without a limit
//! on the number of detections: pycocotools with `useCats = 0` and `maxDets` above that number gives the same
//! values.
//!
//! True boxes of particles whose centers are off the sensor are not scored (COCO's `iscrowd`): a detection
//! that they cover counts neither as correct nor as false.

use std::collections::BTreeMap;

use crate::results::Points;
use storage::dataset::BoxRow;

scores! {
    /// Average precision and recall of boxes.
    pub struct BoxScore {
        /// Number of true boxes that are scored.
        pub n_truth: usize,
        /// Number of boxes in the result.
        pub n_result: usize,
        /// Average precision: mean over intersections over union (IoU) of 0.50, 0.55, ..., 0.95 and over 101
        /// recalls (COCO).
        fraction ap: Option<f64>,
        /// Average precision at an IoU of 0.50.
        fraction ap50: Option<f64>,
        /// Average precision at an IoU of 0.75.
        fraction ap75: Option<f64>,
        /// Average recall: mean over IoU of 0.50, 0.55, ..., 0.95 (COCO).
        fraction ar: Option<f64>,
        /// Maximum recall at an IoU of 0.50 with at most one ghost (false positive) per 100 true boxes.
        fraction recall_at_1_percent_ghosts: Option<f64>,
        /// Maximum recall at an IoU of 0.50 with at most one ghost per 10 true boxes.
        fraction recall_at_10_percent_ghosts: Option<f64>,
    }
}

/// A box in COCO's coordinates: left, top, width, height, px.
type Rectangle = [f64; 4];

#[derive(Debug, Clone, Copy)]
struct TrueBox {
    at: Rectangle,
    /// Not scored.
    ignored: bool,
}

#[derive(Debug, Default)]
struct FrameBoxes {
    /// Scored ones first.
    truth: Vec<TrueBox>,
    /// Box and score, in descending order of score.
    found: Vec<(Rectangle, f64)>,
}

/// The outcome of a detection at a threshold.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Outcome {
    Right,
    Ghost,
    Ignored,
}

/// Number of thresholds of the intersection over union.
const THRESHOLDS: usize = 10;

/// The thresholds as NumPy's `linspace(0.5, 0.95, 10)` rounds them.
fn threshold(k: usize) -> f64 {
    const STEP: f64 = (0.95 - 0.5) / 9.0;
    if k == THRESHOLDS - 1 { 0.95 } else { k as f64 * STEP + 0.5 }
}

/// Number of recalls at which precision is sampled.
const RECALLS: usize = 101;

impl BoxScore {
    /// Scores the boxes of a result against a dataset's.
    pub fn of(truth: &[BoxRow], points: &Points) -> Self {
        let mut frames: BTreeMap<u32, FrameBoxes> = BTreeMap::new();
        for row in truth {
            let of_frame = frames.entry(row.frame).or_default();
            of_frame.truth.push(TrueBox { at: row.rectangle(), ignored: !row.visible });
        }
        for (row, size) in points.rows.iter().zip(&points.boxes) {
            // From the first pixel's center at 1 to its corner at 0.
            let corner = |middle: f64, size: f64| middle - 0.5 - 0.5 * size;
            let (x, y) = (corner(row.at.x_px, size.w_px), corner(row.at.y_px, size.h_px));
            frames.entry(row.frame).or_default().found.push(([x, y, size.w_px, size.h_px], size.score));
        }
        Self::from_frames(frames.into_values().collect(), points.boxes.len())
    }

    fn from_frames(mut frames: Vec<FrameBoxes>, n_result: usize) -> Self {
        for frame in &mut frames {
            frame.truth.sort_by_key(|truth| truth.ignored);
            frame.found.sort_by(|a, b| b.1.total_cmp(&a.1));
        }
        let n_truth = frames.iter().flat_map(|frame| &frame.truth).filter(|truth| !truth.ignored).count();
        let mut score = BoxScore { n_truth, n_result, ..BoxScore::default() };
        if n_truth == 0 {
            return score;
        }
        // All frames, in descending order of score; the sort is stable, as in COCO.
        let mut all: Vec<(f64, [Outcome; THRESHOLDS])> =
            frames.iter().flat_map(FrameBoxes::outcomes).collect();
        all.sort_by(|a, b| b.0.total_cmp(&a.0));
        let curves: Vec<Curve> =
            (0..THRESHOLDS).map(|k| Curve::of(all.iter().map(|(_, at)| at[k]), n_truth)).collect();
        let mean = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / THRESHOLDS as f64;
        score.ap = Some(mean(&mut curves.iter().map(Curve::average_precision)));
        score.ap50 = Some(curves[0].average_precision());
        score.ap75 = Some(curves[5].average_precision());
        score.ar = Some(mean(&mut curves.iter().map(Curve::recall)));
        score.recall_at_1_percent_ghosts = Some(curves[0].recall_at(0.01));
        score.recall_at_10_percent_ghosts = Some(curves[0].recall_at(0.1));
        score
    }
}

impl FrameBoxes {
    /// For every detection its score and outcome at each threshold: the best free true box above the
    /// threshold, a scored one before an ignored one.
    fn outcomes(&self) -> Vec<(f64, [Outcome; THRESHOLDS])> {
        let mut outcomes: Vec<(f64, [Outcome; THRESHOLDS])> =
            self.found.iter().map(|(_, score)| (*score, [Outcome::Ghost; THRESHOLDS])).collect();
        let overlaps: Vec<Vec<(usize, f64)>> = self.found.iter().map(|(at, _)| self.overlaps(at)).collect();
        for k in 0..THRESHOLDS {
            let mut taken = vec![false; self.truth.len()];
            for ((_, outcome), overlaps) in outcomes.iter_mut().zip(&overlaps) {
                let (mut best, mut match_of) = (threshold(k).min(1.0 - 1e-10), None::<usize>);
                for &(g, overlap) in overlaps {
                    let truth = &self.truth[g];
                    if taken[g] && !truth.ignored {
                        continue;
                    }
                    if match_of.is_some_and(|m| !self.truth[m].ignored) && truth.ignored {
                        break;
                    }
                    if overlap >= best {
                        (best, match_of) = (overlap, Some(g));
                    }
                }
                if let Some(g) = match_of {
                    taken[g] = true;
                    outcome[k] = if self.truth[g].ignored { Outcome::Ignored } else { Outcome::Right };
                }
            }
        }
        outcomes
    }

    /// The true boxes that a detection may match at the lowest threshold, with their overlap.
    fn overlaps(&self, found: &Rectangle) -> Vec<(usize, f64)> {
        let overlap = |truth: &TrueBox| overlap(found, &truth.at, truth.ignored);
        let all = self.truth.iter().enumerate().map(|(g, truth)| (g, overlap(truth)));
        all.filter(|(_, overlap)| *overlap >= threshold(0)).collect()
    }
}

/// Intersection over union; for an ignored true box over the area of the detection.
fn overlap(found: &Rectangle, truth: &Rectangle, ignored: bool) -> f64 {
    let along = |k: usize| (found[k] + found[k + 2]).min(truth[k] + truth[k + 2]) - found[k].max(truth[k]);
    let (w, h) = (along(0), along(1));
    if w <= 0.0 || h <= 0.0 {
        return 0.0;
    }
    let area = |of: &Rectangle| of[2] * of[3];
    w * h / if ignored { area(found) } else { area(found) + area(truth) - w * h }
}

/// Numbers of correct detections and ghosts among the best detections.
struct Curve {
    counts: Vec<[usize; 2]>,
    n_truth: usize,
}

impl Curve {
    fn of(outcomes: impl Iterator<Item = Outcome>, n_truth: usize) -> Self {
        let mut sums = [0, 0];
        let counts = outcomes.map(|outcome| {
            sums[0] += usize::from(outcome == Outcome::Right);
            sums[1] += usize::from(outcome == Outcome::Ghost);
            sums
        });
        Curve { counts: counts.collect(), n_truth }
    }

    /// Recall of all detections.
    fn recall(&self) -> f64 {
        self.counts.last().map_or(0.0, |[right, _]| *right as f64 / self.n_truth as f64)
    }

    /// Maximum recall with at most this number of ghosts per true box.
    fn recall_at(&self, ghosts: f64) -> f64 {
        let most = ghosts * self.n_truth as f64;
        let right = self.counts.iter().filter(|[_, n]| *n as f64 <= most).map(|[right, _]| *right).max();
        right.unwrap_or(0) as f64 / self.n_truth as f64
    }

    /// Mean over recalls of the maximum precision at that recall or a higher one.
    fn average_precision(&self) -> f64 {
        // COCO's guard against a division by zero; it does not change the value of a perfect result.
        let precision = |[right, ghosts]: [usize; 2]| right as f64 / ((right + ghosts) as f64 + f64::EPSILON);
        let mut best: Vec<f64> = self.counts.iter().map(|at| precision(*at)).collect();
        for k in (1..best.len()).rev() {
            best[k - 1] = best[k - 1].max(best[k]);
        }
        let recall = |k: usize| self.counts[k][0] as f64 / self.n_truth as f64;
        let (mut at, mut sum) = (0, 0.0);
        for step in 0..RECALLS {
            let least = if step == RECALLS - 1 { 1.0 } else { step as f64 * 0.01 };
            while at < best.len() && recall(at) < least {
                at += 1;
            }
            sum += best.get(at).copied().unwrap_or(0.0);
        }
        sum / RECALLS as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers in [0, 1) that are the same in Python.
    struct Random(u64);

    impl Random {
        fn next(&mut self) -> f64 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 40) as f64 / f64::from(1 << 24)
        }

        fn rectangle(&mut self) -> Rectangle {
            [self.next() * 200.0, self.next() * 150.0, 4.0 + self.next() * 40.0, 4.0 + self.next() * 40.0]
        }
    }

    fn frames(seed: u64, frames: usize, per: usize, noise: f64, ghosts: usize) -> Vec<FrameBoxes> {
        let mut random = Random(seed);
        let frame = |_| {
            let mut frame = FrameBoxes::default();
            for _ in 0..per {
                let at @ [x, y, w, h] = random.rectangle();
                frame.truth.push(TrueBox { at, ignored: random.next() < 0.1 });
                if random.next() < 0.85 {
                    let mut off = || noise * (random.next() - 0.5);
                    let found = [x + off() * w, y + off() * h, w * (1.0 + off()), h * (1.0 + off())];
                    frame.found.push((found, random.next()));
                }
            }
            for _ in 0..ghosts {
                frame.found.push((random.rectangle(), random.next() * 0.8));
            }
            frame
        };
        (0..frames).map(frame).collect()
    }

    /// By pycocotools 2.0.11 (`useCats = 0`, `maxDets = [1, 10, 10000]`) for the same boxes.
    #[test]
    fn precision_and_recall_are_those_of_pycocotools() {
        for (frames, [ap, ap50, ap75, ar]) in [
            (
                frames(1, 4, 30, 0.3, 5),
                [0.2988872971396627, 0.7452341771473553, 0.10996521326067649, 0.401923076923077],
            ),
            (
                frames(2, 1, 8, 0.1, 20),
                [0.4619500961085119, 0.6713632901751715, 0.5827983897290826, 0.7857142857142857],
            ),
            (
                frames(3, 6, 12, 0.6, 0),
                [0.06696761094045607, 0.32655903835792804, 0.01702970297029703, 0.14516129032258066],
            ),
        ] {
            let score = BoxScore::from_frames(frames, 0);
            for (found, expected) in [(score.ap, ap), (score.ap50, ap50), (score.ap75, ap75), (score.ar, ar)]
            {
                let found = found.unwrap();
                assert!((found - expected).abs() < 1e-12, "{found} {expected} of {score:?}");
            }
        }
    }

    #[test]
    fn ghosts_limit_the_recall() {
        let at = |k: f64| [10.0 * k, 0.0, 5.0, 5.0];
        let truth = (0..10).map(|k| TrueBox { at: at(f64::from(k)), ignored: false }).collect();
        // In descending order of score: three correct ones, a ghost, four correct ones.
        let places = [0.0, 1.0, 2.0, 20.0, 3.0, 4.0, 5.0, 6.0];
        let found = places.iter().enumerate().map(|(k, place)| (at(*place), 1.0 - 0.1 * k as f64)).collect();
        let score = BoxScore::from_frames(vec![FrameBoxes { truth, found }], 8);
        assert_eq!(score.recall_at_1_percent_ghosts, Some(0.3));
        assert_eq!(score.recall_at_10_percent_ghosts, Some(0.7));
        assert_eq!(BoxScore::from_frames(Vec::new(), 0).ap, None);
    }
}
