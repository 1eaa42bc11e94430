//! Tracks as XML: `<particle>` with `<detection t x y z/>`, as written by TrackMate's "Export tracks to XML"
//! (um, first pixel's center at 0) and by the ISBI 2012 challenge (px). Frames from 0. Document type
//! declarations, and thus custom entities, are refused.

use std::io::BufReader;

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

use super::text::{Bounded, Text};
use super::{Conventions, Converter, FormatDefaults, LengthUnit, Origin, Points, Position, TrackRow, shown};
use storage::InputFile;
use storage::error::{Error, Result};

pub(super) fn trackmate(path: &InputFile, given: &Conventions) -> Result<Points> {
    let usual = FormatDefaults {
        name: "TrackMate tracks",
        origin: Origin::Center0,
        frame_base: 0,
        unit: LengthUnit::Um,
    };
    read(path, given, usual, "Tracks", false)
}

pub(super) fn isbi(path: &InputFile, given: &Conventions) -> Result<Points> {
    let usual =
        FormatDefaults { name: "ISBI tracks", origin: Origin::Center0, frame_base: 0, unit: LengthUnit::Px };
    // The challenge's readers trim NaN at the ends of tracks and drop tracks with NaN in between.
    read(path, given, usual, "TrackContestISBI2012", true)
}

fn read(
    path: &InputFile,
    given: &Conventions,
    mut usual: FormatDefaults,
    root: &str,
    trims: bool,
) -> Result<Points> {
    let file = Text::open(path)?;
    let mut reader = Reader::from_reader(BufReader::new(Bounded::new(file, b'>')));
    let at =
        |position: u64, what: String| Error::input(format!("{}: byte {position}: {what}", path.display()));
    let mut points = Points { has_z: true, ..Points::default() };
    let (mut converter, mut claimed) = (None, None);
    let (mut buffer, mut track, mut inside, mut whole) = (Vec::new(), -1i64, false, false);
    // For the current particle: its first row, and the frames in which a coordinate is NaN.
    let (mut first, mut holes, mut torn) = (0, Vec::new(), 0);
    loop {
        buffer.clear();
        let event = reader.read_event_into(&mut buffer);
        let position = reader.buffer_position();
        let event = event.map_err(|e| at(position, e.to_string()))?;
        whole |= matches!(&event, Event::Empty(e) if e.name().as_ref() == root);
        match event {
            Event::DocType(_) => return Err(at(position, "document types are not supported".to_owned())),
            Event::Start(e) | Event::Empty(e) if e.name().as_ref() == root => {
                let units = attribute(&e, "spaceUnits").map_err(|what| at(position, what))?;
                if units.is_some_and(|u| u.starts_with("pixel")) {
                    usual.unit = LengthUnit::Px;
                }
                claimed = attribute(&e, "nTracks").map_err(|what| at(position, what))?;
                converter = Some(Converter::new(usual, given)?);
            }
            Event::Start(e) if e.name().as_ref() == "particle" => {
                (track, inside, first) = (track + 1, true, points.rows.len());
                holes.clear();
            }
            Event::End(e) if e.name().as_ref() == "particle" => {
                inside = false;
                let whole = points.rows.split_off(first);
                let span = whole.iter().map(|r| r.frame).min().zip(whole.iter().map(|r| r.frame).max());
                let is_inner = |hole: &u32| span.is_some_and(|(first, last)| (first..=last).contains(hole));
                points.n_nan += holes.len();
                if trims && holes.iter().any(is_inner) {
                    points.n_nan += whole.len();
                    torn += 1;
                } else {
                    points.rows.extend(whole);
                }
            }
            Event::End(e) if e.name().as_ref() == root => whole = true,
            Event::Start(e) | Event::Empty(e) if e.name().as_ref() == "detection" => {
                let Some(converter) = converter.as_ref().filter(|_| inside) else {
                    return Err(at(position, "a detection outside of a particle".to_owned()));
                };
                let (frame, place) = detection(&e, converter).map_err(|what| at(position, what))?;
                match place {
                    Some(at) => points.rows.push(TrackRow { frame, track, at }),
                    None => holes.push(frame),
                }
                if points.rows.len() > given.limits.rows {
                    return Err(at(position, format!("more than {} detections", given.limits.rows)));
                }
            }
            Event::Eof => break,
            _ => {}
        }
    }
    if inside {
        return Err(at(reader.buffer_position(), "the file ends within a particle".to_owned()));
    }
    let converter =
        converter.ok_or_else(|| Error::input(format!("{}: no element {root}", path.display())))?;
    if !whole {
        return Err(at(reader.buffer_position(), format!("the file ends within {root}")));
    }
    if let Some(claimed) = claimed.filter(|n| *n != (track + 1).to_string()) {
        let what = format!("nTracks = {:?}, but the file has {}", shown(&claimed), track + 1);
        return Err(at(reader.buffer_position(), what));
    }
    points.notes = converter.notes;
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

/// Frame and position of a detection; `None` if a coordinate is NaN.
fn detection(
    e: &BytesStart<'_>,
    converter: &Converter,
) -> std::result::Result<(u32, Option<Position>), String> {
    let number = |name: &str| {
        let text = attribute(e, name)?.ok_or_else(|| format!("a detection without {name}"))?;
        text.parse::<f64>().map_err(|_| format!("{name} = {:?}: expected a number", shown(&text)))
    };
    let frame = converter.frame(number("t")?)?;
    let at = converter.position(number("x")?, number("y")?, number("z")?)?;
    Ok((frame, at))
}

fn attribute(e: &BytesStart<'_>, name: &str) -> std::result::Result<Option<String>, String> {
    let attribute = e.try_get_attribute(name).map_err(|e| e.to_string())?;
    // Entities are not resolved: numbers do not need them.
    Ok(attribute.map(|a| a.value.into_owned()))
}
