//! Tracks as XML. `<particle>` with `<detection t x y z/>`, as written by TrackMate's "Export tracks to XML"
//! and by the ISBI 2012 challenge (px); and the file that TrackMate saves (`<TrackMate>`), with all spots and
//! the edges between them. The first pixel's center is at 0, frames are numbered from 0; TrackMate states its
//! unit of length. Document type declarations, and thus custom entities, are refused.
//!
//! Of the file that TrackMate saves, the spots of tracks that its filters keep are read, and visible spots
//! that belong to no track. A spot that splits or merges ends a track, as in GEFF graphs, because a particle
//! does neither.

use std::collections::{BTreeMap, BTreeSet};
use std::io::BufReader;

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

use super::programs::trackmate_unit;
use super::text::{Bounded, Text};
use super::{
    Conventions, Converter, Format, FormatDefaults, LengthUnit, Origin, Points, Position, TrackRow, shown,
};
use storage::InputFile;
use storage::error::{Error, Result};

/// Reads tracks in one of these formats.
pub(super) fn read(path: &InputFile, format: Format, given: &Conventions) -> Result<Points> {
    let mut reader = Reader::from_reader(BufReader::new(Bounded::new(Text::open(path)?)));
    let at =
        |position: u64, what: String| Error::input(format!("{}: byte {position}: {what}", path.display()));
    let is_isbi = format == Format::Isbi;
    let mut points = Points { has_z: true, ..Points::default() };
    let (mut converter, mut claimed, mut graph) = (None, None, None);
    let (mut buffer, mut track, mut inside) = (Vec::new(), -1i64, false);
    // Number of open elements, and whether one of the file's tracks was closed.
    let (mut depth, mut whole) = (0u32, false);
    // For the current particle: its first row, and the frames in which a coordinate is NaN.
    let (mut first, mut holes, mut torn) = (0, Vec::new(), 0);
    loop {
        buffer.clear();
        let event = reader.read_event_into(&mut buffer);
        let position = reader.buffer_position();
        let wrong = |what: String| at(position, what);
        match event.map_err(|e| wrong(e.to_string()))? {
            Event::DocType(_) => return Err(wrong("document types are not supported".to_owned())),
            Event::Eof => break,
            Event::End(e) => {
                depth = depth.saturating_sub(1);
                whole |= depth == 0;
                if e.name().as_ref() == "particle" {
                    inside = false;
                    torn += usize::from(close(&mut points, first, &holes, format));
                }
            }
            ref event @ (Event::Start(ref e) | Event::Empty(ref e)) => {
                if matches!(event, Event::Start(_)) {
                    depth += 1;
                } else {
                    whole |= depth == 0;
                }
                match e.name().as_ref() {
                    root @ ("Tracks" | "TrackContestISBI2012" | "Model") => {
                        let name = if is_isbi { "ISBI tracks" } else { "TrackMate tracks" };
                        let key = if root == "Model" { "spatialunits" } else { "spaceUnits" };
                        let unit = match attribute(e, key).map_err(wrong)? {
                            _ if is_isbi => LengthUnit::Px,
                            Some(stated) => trackmate_unit(&stated, given)?,
                            None => LengthUnit::Um,
                        };
                        let usual = FormatDefaults { name, origin: Origin::Center0, frame_base: 0, unit };
                        converter = Some(Converter::new(usual, given)?);
                        claimed = attribute(e, "nTracks").map_err(wrong)?;
                        graph = (root == "Model").then(Graph::default);
                    }
                    "particle" => {
                        (track, inside, first) =
                            (track + 1, matches!(event, Event::Start(_)), points.rows.len());
                        holes.clear();
                    }
                    "detection" => {
                        let Some(converter) = converter.as_ref().filter(|_| inside) else {
                            return Err(wrong("a detection outside of a particle".to_owned()));
                        };
                        let (frame, place) = place(e, ["t", "x", "y", "z"], converter).map_err(wrong)?;
                        match place {
                            Some(at) => points.rows.push(TrackRow { frame, track, at }),
                            None => holes.push(frame),
                        }
                    }
                    name => {
                        if let Some((graph, converter)) = graph.as_mut().zip(converter.as_ref()) {
                            graph.take(name, e, converter).map_err(wrong)?;
                        }
                    }
                }
                let rows = points.rows.len() + graph.as_ref().map_or(0, |g| g.spots.len().max(g.edges.len()));
                if rows > given.limits.rows {
                    return Err(wrong(format!("more than {} detections", given.limits.rows)));
                }
            }
            _ => {}
        }
    }
    let wrong = |what: String| at(reader.buffer_position(), what);
    if inside {
        return Err(wrong("the file ends within a particle".to_owned()));
    }
    let converter = converter.ok_or_else(|| Error::input(format!("{}: no tracks", path.display())))?;
    if !whole {
        return Err(wrong("the file ends within an element".to_owned()));
    }
    if let Some(claimed) = claimed.filter(|n| *n != (track + 1).to_string()) {
        return Err(wrong(format!("nTracks = {:?}, but the file has {}", shown(&claimed), track + 1)));
    }
    (points.read_as, points.notes) = (Box::new(converter.conventions), converter.notes);
    if let Some(graph) = graph {
        graph.finish(&mut points).map_err(|what| Error::input(format!("{}: {what}", path.display())))?;
    }
    if points.n_nan > 0 {
        let tracks = if torn > 0 {
            format!(", with all of {torn} tracks that have some inside")
        } else {
            String::new()
        };
        points.notes.push(format!("{} detections without coordinates were dropped{tracks}", points.n_nan));
    }
    Ok(points)
}

/// Ends a particle whose rows begin at `first`; `holes` are the frames without coordinates. The challenge's readers
/// trim these at the ends of tracks and drop tracks with some in between: whether this one was.
fn close(points: &mut Points, first: usize, holes: &[u32], format: Format) -> bool {
    let frames = || points.rows[first..].iter().map(|r| r.frame);
    let span = frames().min().zip(frames().max());
    let is_inner = |hole: &u32| span.is_some_and(|(a, b)| (a..=b).contains(hole));
    let is_torn = format == Format::Isbi && holes.iter().any(is_inner);
    points.n_nan += holes.len();
    if is_torn {
        points.n_nan += points.rows.len() - first;
        points.rows.truncate(first);
    }
    is_torn
}

/// Spots and edges of the file that TrackMate saves.
#[derive(Default)]
struct Graph {
    /// Frame and position of every spot, and whether it is visible.
    spots: BTreeMap<i64, (u32, Option<Position>, bool)>,
    /// Edges with their tracks.
    edges: Vec<(i64, [i64; 2])>,
    /// The tracks that filters keep; `None`: all.
    kept: Option<BTreeSet<i64>>,
    /// The track that contains the current edges.
    track: i64,
}

impl Graph {
    fn take(
        &mut self,
        name: &str,
        e: &BytesStart<'_>,
        converter: &Converter,
    ) -> std::result::Result<(), String> {
        let id = |key: &str| {
            let text = attribute(e, key)?.ok_or_else(|| format!("{name} without {key}"))?;
            text.parse::<i64>().map_err(|_| format!("{key} = {:?}: expected a whole number", shown(&text)))
        };
        match name {
            "Spot" => {
                let keys = ["FRAME", "POSITION_X", "POSITION_Y", "POSITION_Z"];
                let (frame, at) = place(e, keys, converter)?;
                let is_visible = attribute(e, "VISIBILITY")?.is_none_or(|v| v.parse() != Ok(0.0));
                let id = id("ID")?;
                if self.spots.insert(id, (frame, at, is_visible)).is_some() {
                    return Err(format!("two spots with ID = {id}"));
                }
            }
            "Track" => self.track = id("TRACK_ID")?,
            "Edge" => self.edges.push((self.track, [id("SPOT_SOURCE_ID")?, id("SPOT_TARGET_ID")?])),
            "FilteredTracks" => self.kept = Some(BTreeSet::new()),
            "TrackID" => {
                let id = id("TRACK_ID")?;
                self.kept.get_or_insert_default().insert(id);
            }
            _ => {}
        }
        Ok(())
    }

    /// Adds the spots to the points; tracks are chains of edges.
    fn finish(self, points: &mut Points) -> std::result::Result<(), String> {
        let is_kept = |track| self.kept.as_ref().is_none_or(|kept| kept.contains(&track));
        let (mut in_tracks, mut in_others) = (BTreeSet::new(), BTreeSet::new());
        let (mut after, mut before) = (BTreeMap::<i64, Vec<i64>>::new(), BTreeMap::<i64, Vec<i64>>::new());
        for (track, [mut a, mut b]) in self.edges {
            let frame = |id| match self.spots.get(&id) {
                Some((frame, ..)) => Ok(*frame),
                None => Err(format!("an edge of track {track} to spot {id}, which does not exist")),
            };
            let (first, last) = (frame(a)?, frame(b)?);
            if first == last {
                return Err(format!("an edge of track {track} between two spots of frame {first}"));
            }
            if first > last {
                (a, b) = (b, a);
            }
            if is_kept(track) {
                in_tracks.extend([a, b]);
                after.entry(a).or_default().push(b);
                before.entry(b).or_default().push(a);
            } else {
                in_others.extend([a, b]);
            }
        }
        let only = |ends: Option<&Vec<i64>>| ends.filter(|ends| ends.len() == 1).map(|ends| ends[0]);
        let link = |a: i64| only(after.get(&a)).filter(|b| only(before.get(b)).is_some());
        let starts = in_tracks.iter().filter(|b| only(before.get(b)).and_then(link).is_none());
        let mut numbers = BTreeMap::new();
        for (track, start) in (0..).zip(starts) {
            let chain = std::iter::successors(Some(*start), |spot| link(*spot));
            numbers.extend(chain.map(|spot| (spot, track)));
        }
        let (mut hidden, mut filtered) = (0, 0);
        for (id, (frame, at, is_visible)) in self.spots {
            let track = numbers.get(&id).copied();
            match at {
                _ if track.is_none() && in_others.contains(&id) => filtered += 1,
                _ if track.is_none() && !is_visible => hidden += 1,
                Some(at) => points.rows.push(TrackRow { frame, track: track.unwrap_or(-1), at }),
                None => points.n_nan += 1,
            }
        }
        let branches = after.values().chain(before.values()).filter(|ends| ends.len() > 1).count();
        let said = [
            (hidden, "spots hidden by filters are not read"),
            (filtered, "spots of tracks that filters remove are not read"),
            (branches, "splits and merges end tracks"),
        ];
        points.notes.extend(said.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}")));
        Ok(())
    }
}

/// Frame and position of an element, from attributes of these names; no position if a coordinate is NaN.
fn place(
    e: &BytesStart<'_>,
    [t, x, y, z]: [&str; 4],
    converter: &Converter,
) -> std::result::Result<(u32, Option<Position>), String> {
    let number = |name: &str| {
        let text = attribute(e, name)?.ok_or_else(|| format!("a {} without {name}", e.name().as_ref()))?;
        text.parse::<f64>().map_err(|_| format!("{name} = {:?}: expected a number", shown(&text)))
    };
    let frame = converter.frame(number(t)?)?;
    Ok((frame, converter.position(number(x)?, number(y)?, number(z)?)?))
}

fn attribute(e: &BytesStart<'_>, name: &str) -> std::result::Result<Option<String>, String> {
    let attribute = e.try_get_attribute(name).map_err(|e| e.to_string())?;
    // Entities are not resolved: numbers do not need them.
    Ok(attribute.map(|a| a.value.into_owned()))
}

#[cfg(test)]
mod tests {
    use crate::results::{Conventions, Points, TrackerResult, read};

    fn points(contents: &str) -> Result<Points, String> {
        let place = tempfile::tempdir().unwrap();
        let file = place.path().join("r.xml");
        std::fs::write(&file, contents).unwrap();
        let given = Conventions { um_per_px: Some(0.5), ..Conventions::default() };
        match read(&file, &given).map_err(|e| e.to_string())? {
            TrackerResult::Points(points) => Ok(points),
            TrackerResult::Field(_) => Err("a field".to_owned()),
        }
    }

    /// A file as TrackMate 7 saves it: spots by ID, frame and visibility, edges by track, tracks that filters keep.
    fn saved(unit: &str, spots: &[(u32, u32, u8)], tracks: &[(u32, &[(u32, u32)])], kept: &[u32]) -> String {
        let spot = |(id, frame, visible): &(u32, u32, u8)| {
            format!(
                "<SpotsInFrame frame=\"{frame}\"><Spot ID=\"{id}\" name=\"a, &amp; b\" QUALITY=\"38.7\" POSITION_T=\"{frame}.0\" \
                 FRAME=\"{frame}\" VISIBILITY=\"{visible}\" RADIUS=\"2.5\" POSITION_X=\"{id}.5\" POSITION_Y=\"2.0\" \
                 POSITION_Z=\"1.0\">-1.0 -1.0 1.0 1.0</Spot></SpotsInFrame>\n"
            )
        };
        let track = |(id, edges): &(u32, &[(u32, u32)])| {
            let edge = |(a, b): &(u32, u32)| {
                format!(
                    "<Edge SPOT_SOURCE_ID=\"{a}\" SPOT_TARGET_ID=\"{b}\" LINK_COST=\"0.6\" EDGE_TIME=\"0.5\" />\n"
                )
            };
            let edges: String = edges.iter().map(edge).collect();
            format!(
                "<Track name=\"Track_{id}\" TRACK_INDEX=\"0\" TRACK_ID=\"{id}\" NUMBER_SPOTS=\"3\">\n{edges}</Track>\n"
            )
        };
        let kept: String = kept.iter().map(|id| format!("<TrackID TRACK_ID=\"{id}\" />\n")).collect();
        format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<TrackMate version=\"7.14.0\">\n<Log>{}</Log>\n\
             <Model spatialunits=\"{unit}\" timeunits=\"sec\">\n<FeatureDeclarations />\n<AllSpots nspots=\"{}\">\n{}</AllSpots>\n\
             <AllTracks>\n{}</AllTracks>\n<FilteredTracks>\n{kept}</FilteredTracks>\n</Model>\n<Settings />\n</TrackMate>\n",
            "found spots. ".repeat(10_000),
            spots.len(),
            spots.iter().map(spot).collect::<String>(),
            tracks.iter().map(track).collect::<String>(),
        )
    }

    /// Spots 1 to 8 in frames 0 to 7.
    fn spots() -> Vec<(u32, u32, u8)> {
        (1..9).map(|id| (id, id - 1, 1)).collect()
    }

    fn tracks(points: &Points) -> Vec<(i64, Vec<u32>)> {
        let mut rows: Vec<(i64, u32)> = points.rows.iter().map(|row| (row.track, row.frame)).collect();
        rows.sort_unstable();
        rows.chunk_by(|a, b| a.0 == b.0).map(|t| (t[0].0, t.iter().map(|r| r.1).collect())).collect()
    }

    #[test]
    fn the_file_that_trackmate_saves_is_read_with_gaps_and_filters() {
        let mut all = spots();
        all.extend([(20, 3, 0), (21, 3, 1)]);
        // Edges in any order and direction; a gap; a track that filters remove; a hidden spot; one that is not linked.
        let edges = [(4, &[(2, 4), (2, 1), (4, 5)][..]), (6, &[(6, 7), (7, 8)])];
        let found = points(&saved("micron", &all, &edges, &[4])).unwrap();
        assert_eq!(tracks(&found), [(-1, vec![2, 3]), (0, vec![0, 1, 3, 4])]);
        assert_eq!(found.rows[0].at.x_px, 4.0);
        for note in ["1 spots hidden by filters", "3 spots of tracks that filters remove"] {
            assert!(found.notes.iter().any(|n| n.starts_with(note)), "{:?}", found.notes);
        }
        let found = points(&saved("mm", &spots(), &edges, &[4, 6])).unwrap();
        assert_eq!((found.rows[0].at.x_px, found.rows[0].at.z_um), (3001.0, 1e3));
        assert_eq!(tracks(&found), [(-1, vec![2]), (0, vec![0, 1, 3, 4]), (1, vec![5, 6, 7])]);
        assert!(points(&saved("furlong", &spots(), &[], &[])).unwrap_err().contains("\"furlong\""));
        let wrong = |edge: (u32, u32)| points(&saved("um", &all, &[(4, &[edge])], &[4])).unwrap_err();
        assert!(wrong((1, 99)).contains("spot 99, which does not exist"), "{}", wrong((1, 99)));
        assert!(wrong((4, 21)).contains("two spots of frame 3"), "{}", wrong((4, 21)));
        let text = saved("um", &all, &edges, &[4]);
        for part in 1..20 {
            let cut = &text[..text.len() - (text.len() - text.find("<Model").unwrap_or(0)) * part / 20];
            assert!(points(cut).is_err(), "{part}");
        }
    }

    #[test]
    fn a_spot_that_splits_or_merges_ends_a_track() {
        let all: Vec<(u32, u32, u8)> = spots().into_iter().chain([(13, 2, 1), (14, 3, 1)]).collect();
        let edges = [(1, 2), (2, 3), (2, 13), (3, 4), (13, 14), (4, 5), (14, 5), (5, 6)];
        let found = points(&saved("um", &all, &[(0, &edges)], &[0])).unwrap();
        let chains = [(-1, vec![6, 7]), (0, vec![0, 1]), (1, vec![2, 3]), (2, vec![4, 5]), (3, vec![2, 3])];
        assert_eq!(tracks(&found), chains);
        assert!(found.notes.iter().any(|n| n == "2 splits and merges end tracks"), "{:?}", found.notes);
    }
}
