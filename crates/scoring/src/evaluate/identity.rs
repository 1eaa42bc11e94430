//! IDF1: how well one global pairing of true and result tracks explains the result (Ristani et al., ECCV
//! Workshops, 2016).
//!
//! IDTP is the maximum number of frames, over all one-to-one pairings of tracks, in which paired tracks are
//! within the gate.

use super::candidates::Candidates;
use super::statistics::{Interval, ratio};
use super::track_set::TrackSet;
use super::units::Units;
use numeric::assignment::{Pair, max_weight_matching};

scores! {
    /// Identity scores (Ristani et al., ECCV workshops, 2016): the best one-to-one pairing of whole tracks.
    pub struct Identity {
        /// Identity F1: 2 IDTP / (true points + result points).
        fraction idf1: Option<f64>,
        /// Identity precision: IDTP / result points.
        fraction idp: Option<f64>,
        /// Identity recall: IDTP / true points.
        fraction idr: Option<f64>,
        /// Number of frames in which paired tracks are within the gate, summed over pairs.
        pub idtp: usize,
        /// False positives: result points - IDTP.
        pub idfp: usize,
        /// False negatives: true points - IDTP.
        pub idfn: usize,
        /// 95 % bootstrap interval of IDF1, resampling true tracks.
        fraction interval_idf1: Interval,
    }
}

impl Identity {
    /// Scores the pairs within the gate.
    pub fn of(truth: &TrackSet, result: &TrackSet, candidates: &Candidates, units: &Units) -> Self {
        let mut tracks: Vec<(u32, u32)> =
            candidates.admitted().map(|p| candidates.tracks(truth, result, p)).collect();
        tracks.sort_unstable();
        let pairs: Vec<Pair> = tracks
            .chunk_by(|a, b| a == b)
            .map(|same| Pair { row: same[0].0, column: same[0].1, value: same.len() as f64 })
            .collect();
        let best = max_weight_matching(truth.n_tracks(), result.n_tracks(), pairs);
        let idtp = best.iter().map(|p| p.value).sum::<f64>();
        // A result track belongs to the true track that it is paired with, even if it follows another one
        // equally long.
        let mut partner = vec![None; result.n_tracks()];
        best.iter().for_each(|p| partner[p.column as usize] = Some(units.track_unit(p.row as usize)));
        let own_unit = |j: usize| partner[result.points[j].track as usize].unwrap_or(units.result_unit(j));
        let found = best.iter().map(|p| (units.track_unit(p.row as usize), [p.value, 0.0]));
        let points = (0..truth.len()).map(|i| units.truth_unit(i)).chain((0..result.len()).map(own_unit));
        let sums = units.sums(found.chain(points.map(|unit| (unit, [0.0, 1.0]))));
        let [interval_idf1] = units.intervals(&sums, |&[idtp, both]| [ratio(2.0 * idtp, both)]);
        let (n, m) = (truth.len() as f64, result.len() as f64);
        Identity {
            idf1: ratio(2.0 * idtp, n + m),
            idp: ratio(idtp, m),
            idr: ratio(idtp, n),
            idtp: idtp as usize,
            idfp: (m - idtp) as usize,
            idfn: (n - idtp) as usize,
            interval_idf1,
        }
    }
}
