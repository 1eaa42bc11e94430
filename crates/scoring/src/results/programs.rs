//! Tables of particles as other programs write them, by the names of their columns, which may be in any order:
//!
//! - trackpy's data frame (`DataFrame.to_csv`): `y, x [, z], ..., frame [, particle]`, in px; also with
//!   LapTrack's `track_id`.
//! - napari's tracks: `track_id, t [, z], y, x`, in px.
//! - TrackMate's spots (`CSVExporter`, `ExportAllSpotsStatsAction`): below the names of the columns two rows of
//!   longer names and a row of units, which older versions do not write; lengths are then in um.
//!
//! The first pixel's center is at 0, frames are numbered from 0.

use super::sheet::{OptionalColumns, TextTable};
use super::{Conventions, Converter, Format, FormatDefaults, LengthUnit, Origin, Points};
use storage::advice;
use storage::advice::option;
use storage::error::{Error, Result};

/// Name of the program, names of the columns of frame, x, y, z and, of several possible ones, of the track.
type Layout = (&'static str, [&'static str; 4], &'static [&'static str]);

const TRACKPY: Layout = ("trackpy", ["frame", "x", "y", "z"], &["particle", "track_id"]);
const NAPARI: Layout = ("napari tracks", ["t", "x", "y", "z"], &["track_id"]);
const TRACKMATE: Layout =
    ("TrackMate spots", ["FRAME", "POSITION_X", "POSITION_Y", "POSITION_Z"], &["TRACK_ID"]);

/// Reads a table of particles in one of these formats.
pub(super) fn read(mut sheet: TextTable, format: Format, given: &Conventions) -> Result<Points> {
    let (name, places, tracks) = match format {
        Format::TrackmateSpots => TRACKMATE,
        Format::Napari => NAPARI,
        _ => TRACKPY,
    };
    let [frame, x, y] = [0, 1, 2].map(|k| sheet.need(places[k]));
    let (frame, x, y, z) = (frame?, x?, y?, sheet.column(places[3]));
    let track = tracks.iter().find_map(|name| sheet.column(name));
    let unit = match format {
        Format::TrackmateSpots => stated_unit(&sheet.skip_words(x)?, given)?,
        _ => LengthUnit::Px,
    };
    let usual = FormatDefaults { name, origin: Origin::Center0, frame_base: 0, unit };
    let mut converter = Converter::new(usual, given)?;
    if track.is_none() {
        converter.notes.push(format!("no column `{}`: points are not linked", tracks[0]));
    }
    // trackpy's estimated position error, one value for all axes (column ep of `locate`).
    let ep = sheet.column("ep").filter(|_| format == Format::Trackpy);
    if ep.is_some() {
        converter
            .notes
            .push("ep is taken as the uncertainty of x and y; negative values are unknown".to_owned());
    }
    let used = [&places[..], tracks, if ep.is_some() { &["ep"] } else { &[] }].concat();
    converter.ignores(&sheet.others(&used));
    let more = OptionalColumns { sigma: [ep, ep, None], negative_is_unknown: true, ..Default::default() };
    sheet.points(converter, z.is_some(), more, |cells| {
        let z = z.map_or(Ok(0.0), |z| cells.number(z))?;
        Ok((cells.number(frame)?, cells.track(track)?, [cells.number(x)?, cells.number(y)?, z]))
    })
}

/// The unit that TrackMate states for a coordinate: the last of its names, in parentheses.
fn stated_unit(names: &[String], given: &Conventions) -> Result<LengthUnit> {
    let stated = names.iter().rev().find_map(|name| name.strip_prefix('(')?.strip_suffix(')'));
    stated.map_or(Ok(LengthUnit::Um), |stated| trackmate_unit(stated, given))
}

/// A unit of length that TrackMate states.
///
/// # Errors
/// One that is not known, unless the unit is given.
pub(super) fn trackmate_unit(stated: &str, given: &Conventions) -> Result<LengthUnit> {
    given.unit.or_else(|| LengthUnit::of_name(stated)).ok_or_else(|| {
        let known: Vec<&str> = LengthUnit::ALL.iter().map(|unit| unit.symbol()).collect();
        let what = format!(
            "TrackMate: lengths in {:?}: expected one of {}; give the unit by ",
            super::shown(stated),
            known.join(", ")
        );
        Error::option(advice!(what, option("unit")))
    })
}
