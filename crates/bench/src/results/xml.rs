//! Tracks as XML: `<particle>` with `<detection t x y z/>`, of TrackMate's "Export tracks to XML" (um, first pixel's centre
//! at 0) and of the ISBI 2012 challenge (px). Frames from 0. Document types, and with them all entities of a file's own,
//! are refused.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

use super::sheet::{Bounded, MAX_ROWS};
use super::{Conventions, Converter, Origin, Points, Row, Unit, Usual, shown};
use crate::error::{Error, Result};

pub(super) fn trackmate(path: &Path, given: &Conventions) -> Result<Points> {
    let usual = Usual { name: "TrackMate tracks", origin: Origin::Center0, frame_base: 0, unit: Unit::Um };
    read(path, given, usual, "Tracks")
}

pub(super) fn isbi(path: &Path, given: &Conventions) -> Result<Points> {
    let usual = Usual { name: "ISBI tracks", origin: Origin::Center0, frame_base: 0, unit: Unit::Px };
    read(path, given, usual, "TrackContestISBI2012")
}

fn read(path: &Path, given: &Conventions, mut usual: Usual, root: &str) -> Result<Points> {
    let file = File::open(path).map_err(|e| Error::read(path, e))?;
    let mut reader = Reader::from_reader(BufReader::new(Bounded::new(file, b'>')));
    let at =
        |position: u64, what: String| Error::input(format!("{}: byte {position}: {what}", path.display()));
    let mut points = Points { has_z: true, ..Points::default() };
    let (mut converter, mut claimed) = (None, None);
    let (mut buffer, mut track, mut inside, mut whole) = (Vec::new(), -1i64, false, false);
    loop {
        buffer.clear();
        let event = reader.read_event_into(&mut buffer);
        let position = reader.buffer_position();
        let event = event.map_err(|e| at(position, e.to_string()))?;
        whole |= matches!(&event, Event::Empty(e) if e.name().as_ref() == root);
        match event {
            Event::DocType(_) => return Err(at(position, "a document type, which is not read".to_owned())),
            Event::Start(e) | Event::Empty(e) if e.name().as_ref() == root => {
                let units = attribute(&e, "spaceUnits").map_err(|what| at(position, what))?;
                if units.is_some_and(|u| u.starts_with("pixel")) {
                    usual.unit = Unit::Px;
                }
                claimed = attribute(&e, "nTracks").map_err(|what| at(position, what))?;
                converter = Some(Converter::new(usual, given)?);
            }
            Event::Start(e) if e.name().as_ref() == "particle" => (track, inside) = (track + 1, true),
            Event::End(e) if e.name().as_ref() == "particle" => inside = false,
            Event::End(e) if e.name().as_ref() == root => whole = true,
            Event::Start(e) | Event::Empty(e) if e.name().as_ref() == "detection" => {
                let Some(converter) = converter.as_ref().filter(|_| inside) else {
                    return Err(at(position, "a detection outside of a particle".to_owned()));
                };
                let row = detection(&e, converter, track).map_err(|what| at(position, what))?;
                match row {
                    Some(row) => points.rows.push(row),
                    None => points.n_nan += 1,
                }
                if points.rows.len() > MAX_ROWS {
                    return Err(at(position, format!("more than {MAX_ROWS} detections")));
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
        let what = format!("nTracks = {:?}, but {} are in it", shown(&claimed), track + 1);
        return Err(at(reader.buffer_position(), what));
    }
    points.notes = converter.notes;
    Ok(points)
}

fn detection(
    e: &BytesStart<'_>,
    converter: &Converter,
    track: i64,
) -> std::result::Result<Option<Row>, String> {
    let number = |name: &str| {
        let text = attribute(e, name)?.ok_or_else(|| format!("a detection without {name}"))?;
        text.parse::<f64>().map_err(|_| format!("{name} = {:?}: expected a number", shown(&text)))
    };
    let frame = converter.frame(number("t")?)?;
    let at = converter.place(number("x")?, number("y")?, number("z")?)?;
    Ok(at.map(|at| Row { frame, track, at }))
}

fn attribute(e: &BytesStart<'_>, name: &str) -> std::result::Result<Option<String>, String> {
    let attribute = e.try_get_attribute(name).map_err(|e| e.to_string())?;
    // Numbers need no entities; whatever is written instead is no number.
    Ok(attribute.map(|a| a.value.into_owned()))
}
