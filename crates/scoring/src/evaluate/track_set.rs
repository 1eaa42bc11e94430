//! Points of all frames with their tracks, in an order independent of the order of rows and of track
//! identifiers.
//!
//! Points are sorted by frame, x, y, z; tracks are numbered in the order of their points. Permuting the rows
//! of a table or renumbering its tracks therefore gives the same set, and ties are always broken in the same
//! way.

use std::ops::Range;

pub use crate::results::Position;

/// A point before sorting.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnsortedPoint {
    /// Frame.
    pub frame: u32,
    /// Track identifier and section; `None` if the point is not linked (a track of its own).
    pub track: Option<(i64, u32)>,
    /// Position.
    pub at: Position,
    /// Row of the table it came from, from 0.
    pub source: u32,
}

/// A point of a [`TrackSet`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Frame.
    pub frame: u32,
    /// Number of the track in the set.
    pub track: u32,
    /// Row of the table it came from, from 0.
    pub source: u32,
    /// Position.
    pub at: Position,
}

impl Point {
    /// Position in the image plane, px.
    pub fn in_plane(&self) -> [f64; 2] {
        [self.at.x_px, self.at.y_px]
    }
}

/// Points of all frames and their tracks.
#[derive(Debug, Clone, Default)]
pub struct TrackSet {
    /// The points, sorted by frame, then position.
    pub points: Vec<Point>,
    /// Frames with points, ascending, and the ranges of their points.
    pub frames: Vec<(u32, Range<usize>)>,
    members: Vec<u32>,
    offsets: Vec<u32>,
}

impl TrackSet {
    /// Sorts points by frame and position.
    pub fn new(mut loose: Vec<UnsortedPoint>) -> Self {
        let place = |p: &UnsortedPoint| (p.frame, p.at);
        let order = |a: &(u32, Position), b: &(u32, Position)| {
            a.0.cmp(&b.0)
                .then(a.1.x_px.total_cmp(&b.1.x_px))
                .then(a.1.y_px.total_cmp(&b.1.y_px))
                .then(a.1.z_um.total_cmp(&b.1.z_um))
        };
        loose.sort_unstable_by(|a, b| {
            order(&place(a), &place(b)).then(a.track.cmp(&b.track)).then(a.source.cmp(&b.source))
        });
        // Points at the same position and time share a class, so that track identifiers do not affect the
        // order.
        let mut class = vec![0u32; loose.len()];
        for i in 1..loose.len() {
            class[i] = class[i - 1] + u32::from(order(&place(&loose[i - 1]), &place(&loose[i])).is_ne());
        }
        let mut by_track: Vec<u32> = (0..loose.len() as u32).collect();
        let name = |i: u32| match loose[i as usize].track {
            Some(name) => (0, name, 0),
            None => (1, (0, 0), i),
        };
        by_track.sort_unstable_by_key(|&i| (name(i), i));
        let mut tracks: Vec<&[u32]> = by_track.chunk_by(|&a, &b| name(a) == name(b)).collect();
        let classes = |track: &[u32]| track.iter().map(|&i| class[i as usize]).collect::<Vec<_>>();
        tracks.sort_by(|a, b| match class[a[0] as usize].cmp(&class[b[0] as usize]) {
            std::cmp::Ordering::Equal => classes(a).cmp(&classes(b)),
            different => different,
        });
        let mut track_of = vec![0u32; loose.len()];
        for (number, track) in tracks.iter().enumerate() {
            for &i in *track {
                track_of[i as usize] = number as u32;
            }
        }
        let n_tracks = tracks.len();
        let mut points: Vec<(u32, Point)> = loose
            .iter()
            .enumerate()
            .map(|(i, p)| {
                (class[i], Point { frame: p.frame, track: track_of[i], source: p.source, at: p.at })
            })
            .collect();
        points.sort_by_key(|(class, p)| (*class, p.track));
        let points: Vec<Point> = points.into_iter().map(|(_, p)| p).collect();

        let mut frames: Vec<(u32, Range<usize>)> = Vec::new();
        for (i, p) in points.iter().enumerate() {
            match frames.last_mut() {
                Some((frame, range)) if *frame == p.frame => range.end = i + 1,
                _ => frames.push((p.frame, i..i + 1)),
            }
        }
        let mut offsets = vec![0u32; n_tracks + 1];
        points.iter().for_each(|p| offsets[p.track as usize + 1] += 1);
        for i in 0..n_tracks {
            offsets[i + 1] += offsets[i];
        }
        let (mut members, mut next) = (vec![0u32; points.len()], offsets.clone());
        for (i, p) in points.iter().enumerate() {
            let slot = &mut next[p.track as usize];
            members[*slot as usize] = i as u32;
            *slot += 1;
        }
        TrackSet { points, frames, members, offsets }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether the set is empty.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Number of tracks.
    pub fn n_tracks(&self) -> usize {
        self.offsets.len().saturating_sub(1)
    }

    /// Indices of the points of a track, in order of time.
    pub fn track(&self, track: usize) -> &[u32] {
        &self.members[self.offsets[track] as usize..self.offsets[track + 1] as usize]
    }

    /// First and last frame of a track.
    pub fn span(&self, track: usize) -> (i64, i64) {
        let members = self.track(track);
        let frame = |i: u32| i64::from(self.points[i as usize].frame);
        (frame(members[0]), frame(members[members.len() - 1]))
    }

    /// Pairs (indices) of consecutive points of all tracks.
    pub fn links(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        (0..self.n_tracks()).flat_map(|t| self.track(t).windows(2).map(|w| (w[0], w[1])))
    }
}

/// All frames that have points in either set: number of the frame, range of points in `a`, range of points in
/// `b`.
pub fn side_by_side(a: &TrackSet, b: &TrackSet) -> Vec<(u32, Range<usize>, Range<usize>)> {
    let mut frames = Vec::with_capacity(a.frames.len().max(b.frames.len()));
    let (mut i, mut j) = (0, 0);
    while i < a.frames.len() || j < b.frames.len() {
        let (fa, fb) = (a.frames.get(i).map(|f| f.0), b.frames.get(j).map(|f| f.0));
        let frame = fa.into_iter().chain(fb).min().unwrap_or_default();
        let take = |mine: Option<u32>, frames: &[(u32, Range<usize>)], at: &mut usize| {
            if mine == Some(frame) {
                *at += 1;
                frames[*at - 1].1.clone()
            } else {
                0..0
            }
        };
        let (ra, rb) = (take(fa, &a.frames, &mut i), take(fb, &b.frames, &mut j));
        frames.push((frame, ra, rb));
    }
    frames
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(frame: u32, track: i64, x_px: f64) -> UnsortedPoint {
        let at = Position { x_px, y_px: 1.0, z_um: 0.0 };
        UnsortedPoint { frame, track: (track >= 0).then_some((track, 0)), at, source: 0 }
    }

    #[test]
    fn neither_rows_nor_names_matter() {
        let rows =
            [point(0, 7, 3.0), point(1, 7, 4.0), point(0, 2, 3.0), point(1, 2, 3.5), point(1, -1, 9.0)];
        let cloud = TrackSet::new(rows.to_vec());
        let mut other = rows;
        other.reverse();
        for p in &mut other {
            p.track = p.track.map(|(t, s)| (100 - t, s));
        }
        assert_eq!(cloud.points, TrackSet::new(other.to_vec()).points);
        assert_eq!((cloud.n_tracks(), cloud.frames.len()), (3, 2));
        // The track that goes to 3.5 comes first, although both begin at the same position.
        assert_eq!(cloud.points[cloud.track(0)[1] as usize].at.x_px, 3.5);
        assert_eq!(cloud.links().count(), 2);
    }

    #[test]
    fn frames_of_one_cloud_only_are_kept() {
        let a = TrackSet::new(vec![point(1, 0, 1.0)]);
        let b = TrackSet::new(vec![point(0, 0, 1.0), point(1, 0, 1.0), point(5, 0, 2.0)]);
        assert_eq!(side_by_side(&a, &b), [(0, 0..0, 0..1), (1, 0..1, 1..2), (5, 0..0, 2..3)]);
    }
}
