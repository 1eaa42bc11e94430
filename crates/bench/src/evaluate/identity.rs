//! IDF1: how well one global pairing of true and result tracks explains the result (Ristani et al., ECCV workshops 2016).
//!
//! IDTP = greatest sum, over a one-to-one pairing of tracks, of the frames in which a pair of tracks is within the gate.

use serde::Serialize;

use super::assignment::{Pair, heaviest};
use super::cloud::Cloud;
use super::statistics::{Bootstrap, Interval, TrackUnits, ratio};
use super::wide::Wide;

/// The scores of identity.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Identity {
    pub idf1: Option<f64>,
    pub idp: Option<f64>,
    pub idr: Option<f64>,
    pub idtp: usize,
    pub idfp: usize,
    pub idfn: usize,
    /// 95 % interval under resampling of tracks.
    pub interval_idf1: Interval,
}

impl Identity {
    /// Of the pairs within the gate.
    pub fn of(truth: &Cloud, result: &Cloud, wide: &Wide, bootstrap: &Bootstrap) -> Self {
        let mut tracks: Vec<(u32, u32)> = wide.admitted().map(|p| wide.tracks(truth, result, p)).collect();
        tracks.sort_unstable();
        let pairs: Vec<Pair> = tracks
            .chunk_by(|a, b| a == b)
            .map(|same| Pair { row: same[0].0, column: same[0].1, value: same.len() as f64 })
            .collect();
        let best = heaviest(truth.n_tracks(), result.n_tracks(), pairs.clone());
        let idtp = best.iter().map(|p| p.value).sum::<f64>();
        let shared = pairs.iter().map(|p| (p.row, p.column, p.value as usize));
        let mut units = TrackUnits::<2>::new(truth.n_tracks(), result.n_tracks(), shared);
        (0..truth.n_tracks()).for_each(|t| units.of_truth(t)[1] += truth.track(t).len() as f64);
        (0..result.n_tracks()).for_each(|r| units.of_result(r)[1] += result.track(r).len() as f64);
        best.iter().for_each(|p| units.of_truth(p.row as usize)[0] += p.value);
        let [interval_idf1] = bootstrap.intervals(&units.finish(), |&[idtp, both]| [ratio(2.0 * idtp, both)]);
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
