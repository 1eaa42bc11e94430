//! Linking from frame to frame by minimum-cost assignment of localizations to tracks.
//!
//! The cost of a link is its squared distance from the predicted position; the end of a track and the start
//! of a new one each cost the squared maximum distance, so that a link is made if it is cheaper than both
//! (Jaqaman et al. 2008, Nat. Methods 5, 695). A track with at least two points is extrapolated at constant
//! velocity; a track may be missing in one frame.

use numeric::assignment::{Pair, max_weight_matching};
use numeric::cell_grid::CellGrid;

use super::Localization;
use super::output::Row;

/// Maximum distance of a particle from its predicted position.
#[derive(Debug, Clone, Copy)]
pub(super) struct SearchRange {
    /// In the image plane, px.
    pub(super) px: f64,
    /// The depth range, um, if there is one. Depths are less accurate than in-plane positions: a third of the
    /// range corresponds to `px`.
    pub(super) um: Option<f64>,
}

/// Maximum number of consecutive frames in which a track is missing.
const GAP: usize = 1;

struct Track {
    id: i64,
    last_frame: usize,
    last: Localization,
    /// Displacement per frame (px, px, um), if the track has two points.
    velocity: Option<[f64; 3]>,
}

impl Track {
    fn expected(&self, frame: usize) -> [f64; 3] {
        let ahead = (frame - self.last_frame) as f64;
        let v = self.velocity.unwrap_or_default();
        let last = place(&self.last);
        std::array::from_fn(|i| last[i] + ahead * v[i])
    }

    /// The squared distance of a point from the expected position, px^2, and the sides of the focus of the last point and of
    /// this one on which it is least: 0 as found, 1 the other.
    fn step(&self, frame: usize, point: &Localization, um_per_px: f64) -> (f64, [usize; 2]) {
        let ahead = (frame - self.last_frame) as f64;
        let [u, v, w] = self.velocity.unwrap_or_default();
        let mut best = (f64::INFINITY, [0, 0]);
        for (from, at) in places(&self.last).enumerate() {
            // On the other side of the focus, depth changes the other way.
            let w = if from == 0 { w } else { -w };
            let [x, y, z] = [at[0] + ahead * u, at[1] + ahead * v, at[2] + ahead * w];
            for (to, at) in places(point).enumerate() {
                let dz = (at[2] - z) / um_per_px;
                let squared = (at[0] - x).powi(2) + (at[1] - y).powi(2) + dz * dz;
                if squared < best.0 {
                    best = (squared, [from, to]);
                }
            }
        }
        best
    }
}

/// Where a particle is, then where it is if it is on the other side of the focus.
fn places(found: &Localization) -> impl Iterator<Item = [f64; 3]> {
    let other = found.other.map(|other| [other.at[0], other.at[1], other.z_um]);
    std::iter::once(place(found)).chain(other)
}

fn place(found: &Localization) -> [f64; 3] {
    [found.x_px, found.y_px, found.z_um.unwrap_or(0.0)]
}

/// Links all frames; in double-frame recordings only within pairs.
pub(super) fn link(frames: &[Vec<Localization>], reach: SearchRange, pairs: bool) -> Vec<Row> {
    let um_per_px = reach.um.map_or(f64::INFINITY, |h| h / 3.0 / reach.px);
    let limit = reach.px * reach.px;
    let mut tracks: Vec<Track> = Vec::new();
    let mut rows = Vec::new();
    let mut next_id = 0;
    for (frame, found) in frames.iter().enumerate() {
        if pairs && frame % 2 == 0 {
            tracks.clear();
        }
        tracks.retain(|t| frame - t.last_frame <= GAP + 1);
        let mut candidates = Vec::new();
        let places: Vec<[f64; 2]> = found.iter().map(|point| [point.x_px, point.y_px]).collect();
        // Wider than the range by more than rounding.
        let grid = CellGrid::new(&places, reach.px * (1.0 + 1e-9));
        for (row, track) in tracks.iter().enumerate() {
            let [x, y, _] = track.expected(frame);
            let first = candidates.len();
            grid.around([x, y], |column| {
                let squared = track.step(frame, &found[column as usize], um_per_px).0;
                if squared < limit {
                    candidates.push(Pair { row: row as u32, column, value: 2.0 * limit - squared });
                }
            });
            candidates[first..].sort_unstable_by_key(|p| p.column);
        }
        let mut found_track: Vec<Option<usize>> = vec![None; found.len()];
        for pair in max_weight_matching(tracks.len(), found.len(), candidates) {
            found_track[pair.column as usize] = Some(pair.row as usize);
        }
        for (point, track) in found.iter().zip(found_track) {
            let id = match track {
                Some(k) => {
                    let track = &mut tracks[k];
                    let (_, sides) = track.step(frame, point, um_per_px);
                    let on = |found: Localization, side: usize| {
                        if side == 0 { found } else { found.on_other_side().unwrap_or(found) }
                    };
                    let (from, to) = (on(track.last, sides[0]), on(*point, sides[1]));
                    let ahead = (frame - track.last_frame) as f64;
                    let moved: [f64; 3] = std::array::from_fn(|i| (place(&to)[i] - place(&from)[i]) / ahead);
                    (track.velocity, track.last, track.last_frame) = (Some(moved), to, frame);
                    track.id
                }
                None => {
                    next_id += 1;
                    tracks.push(Track { id: next_id - 1, last_frame: frame, last: *point, velocity: None });
                    next_id - 1
                }
            };
            rows.push(Row { frame: frame as u32, track: id, found: *point });
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x_px: f64, y_px: f64) -> Localization {
        Localization { x_px, y_px, ..Localization::default() }
    }

    const SEARCH_RANGE: SearchRange = SearchRange { px: 6.0, um: None };

    fn tracks(rows: &[Row]) -> Vec<i64> {
        rows.iter().map(|r| r.track).collect()
    }

    #[test]
    fn the_cheapest_assignment_wins_over_the_nearest_neighbor() {
        // The first point of frame 1 is nearest to both tracks; the total cost is lower if each track moves
        // by 2 px.
        let frames = [vec![at(0.0, 0.0), at(3.0, 0.0)], vec![at(2.0, 0.0), at(5.0, 0.0)]];
        assert_eq!(tracks(&link(&frames, SEARCH_RANGE, true)), [0, 1, 0, 1]);
    }

    #[test]
    fn a_track_goes_on_as_it_did_and_survives_a_frame_unseen() {
        let mut frames: Vec<Vec<Localization>> = (0..6).map(|k| vec![at(5.0 * f64::from(k), 1.0)]).collect();
        frames[3].clear();
        assert_eq!(tracks(&link(&frames, SEARCH_RANGE, false)), [0; 5]);
        frames[4].clear();
        assert_eq!(tracks(&link(&frames, SEARCH_RANGE, false)), [0, 0, 0, 1]);
    }

    #[test]
    fn pairs_are_not_linked_to_each_other_and_far_points_not_at_all() {
        let frames = [vec![at(0.0, 0.0)], vec![at(1.0, 0.0)], vec![at(1.0, 0.0)], vec![at(9.0, 0.0)]];
        assert_eq!(tracks(&link(&frames, SEARCH_RANGE, true)), [0, 0, 1, 2]);
    }
}
