//! Tables of particles as other programs write them, by the names of their columns, which may be in any order:
//!
//! - trackpy's data frame (`DataFrame.to_csv`): `y, x [, z], ..., frame [, particle]`, in px; also with
//!   LapTrack's `track_id`.
//! - napari's tracks: `track_id, t [, z], y, x`, in px; and its saved points, `index, axis-0, axis-1, ...`, whose
//!   axes have no names: they are taken as frame, (z,) y and x.
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
const NAPARI_POINTS: [Layout; 2] = [
    ("napari points", ["axis-0", "axis-2", "axis-1", "z"], &["track_id"]),
    ("napari points with depth", ["axis-0", "axis-3", "axis-2", "axis-1"], &["track_id"]),
];
const TRACKMATE: Layout =
    ("TrackMate spots", ["FRAME", "POSITION_X", "POSITION_Y", "POSITION_Z"], &["TRACK_ID"]);

/// Reads a table of particles in one of these formats.
pub(super) fn read(mut sheet: TextTable, format: Format, given: &Conventions) -> Result<Points> {
    let (name, places, tracks) = match format {
        Format::TrackmateSpots => TRACKMATE,
        Format::Napari if sheet.column("axis-0").is_some() => {
            NAPARI_POINTS[usize::from(sheet.column("axis-3").is_some())]
        }
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
/// Errors: one that is not known, unless the unit is given.
pub(super) fn trackmate_unit(stated: &str, given: &Conventions) -> Result<LengthUnit> {
    given.unit.or_else(|| LengthUnit::from_name(stated)).ok_or_else(|| {
        let known: Vec<&str> = LengthUnit::all().map(LengthUnit::symbol).collect();
        let what = format!(
            "TrackMate: lengths in {:?}: expected one of {}; give the unit by ",
            super::shown(stated),
            known.join(", ")
        );
        Error::option(advice!(what, option("unit")))
    })
}

#[cfg(test)]
mod tests {
    use crate::results::{Conventions, Points, TrackerResult, read};

    /// Reads a file with these contents; 0.5 um per px.
    fn points(contents: &[u8], given: &Conventions) -> Result<Points, String> {
        let place = tempfile::tempdir().unwrap();
        let file = place.path().join("r.csv");
        std::fs::write(&file, contents).unwrap();
        let given = Conventions { um_per_px: Some(0.5), ..*given };
        match read(&file, &given).map_err(|e| e.to_string())? {
            TrackerResult::Points(points) => Ok(points),
            TrackerResult::Field(_) => Err("a field".to_owned()),
        }
    }

    /// Frame, track, x, y, z of the rows.
    fn rows(contents: &[u8]) -> Vec<(u32, i64, [f64; 3])> {
        let points = points(contents, &Conventions::default());
        let points = points.unwrap_or_else(|e| panic!("{e}: {}", String::from_utf8_lossy(contents)));
        points.rows.iter().map(|r| (r.frame, r.track, [r.at.x_px, r.at.y_px, r.at.z_um])).collect()
    }

    fn spots(unit: &str, label: &str, [x, y, z]: [f64; 3]) -> String {
        format!(
            "LABEL,ID,TRACK_ID,QUALITY,POSITION_X,POSITION_Y,POSITION_Z,POSITION_T,FRAME,RADIUS,VISIBILITY\n\
             Label,Spot ID,Track ID,Quality,X,Y,Z,T,Frame,Radius,Visibility\n\
             Label,Spot ID,Track ID,Quality,X,Y,Z,T,Frame,R,Visibility\n\
             ,,,(quality),({unit}),({unit}),({unit}),(sec),,({unit}),\n\
             {label},0,7,1.0,{x:?},{y:?},{z:?},0.1,1,2.5,1\n"
        )
    }

    #[test]
    fn the_unit_that_trackmate_states_is_converted_or_refused_by_name() {
        let spellings =
            ["micron", "microns", "um", "\u{b5}m", "\u{3bc}m", "\\u00B5m", "micrometer", "\u{c2}\u{b5}m"];
        let others = [
            ("nm", 1e3),
            ("mm", 1e-3),
            ("cm", 1e-4),
            ("m", 1e-6),
            ("inch", 1.0 / 25_400.0),
            ("inches", 1.0 / 25_400.0),
        ];
        let all = spellings.map(|name| (name, 1.0)).into_iter().chain(others);
        for (unit, scale) in all.chain([("pixel", 2.0), ("pixels", 2.0)]) {
            let text = spots(unit, "ID0", [3.0, 4.0, 5.0].map(|um| um * scale));
            let [(frame, track, at)] = rows(text.as_bytes())[..] else { panic!("{unit}") };
            let error = at.iter().zip([7.0, 9.0, 5.0]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            // Rounding errors of a few products.
            assert!((frame, track) == (1, 7) && error < 1e-12, "{unit}: {at:?}");
        }
        // On Windows, Java writes the micro sign as a single byte.
        let latin: Vec<u8> = spots("\u{b5}m", "ID0", [3.0; 3]).chars().map(|c| c as u8).collect();
        assert_eq!(rows(&latin), [(1, 7, [7.0, 7.0, 3.0])]);
        let unknown = spots("furlong", "ID0", [3.0; 3]);
        let said = points(unknown.as_bytes(), &Conventions::default()).unwrap_err();
        assert!(said.contains("lengths in \"furlong\"") && said.ends_with("--unit"), "{said}");
        let given = Conventions { unit: Some(crate::results::LengthUnit::Um), ..Conventions::default() };
        assert_eq!(points(unknown.as_bytes(), &given).unwrap().rows[0].at.x_px, 7.0);
    }

    #[test]
    fn cells_line_ends_and_columns_are_as_programs_write_them() {
        let expected = [(1, 7, [7.0, 9.0, 5.0])];
        let plain = spots("um", "ID0", [3.0, 4.0, 5.0]);
        assert_eq!(rows(plain.as_bytes()), expected);
        for text in [
            plain.replace('\n', "\r"),
            plain.replace('\n', "\r\n"),
            spots("um", "\"beads, red\"", [3.0, 4.0, 5.0]),
            spots("um", "5\" lens", [3.0, 4.0, 5.0]),
            format!("\u{feff}{}", plain.replace(',', ";").replace('.', ",")),
            plain.replace(',', "\t"),
            "frame x y z particle\n1  6 8 5 7\n".to_owned(),
        ] {
            assert_eq!(rows(text.as_bytes()), expected, "{text}");
        }
        // Longer than a line may be.
        let many = "frame,x,y,particle\r".to_owned() + &"0,1,2,\r".repeat(20_000);
        assert_eq!(rows(many.as_bytes()).len(), 20_000);
        for missing in ["NA", "<NA>", "None", "nan", "", "N/A", "#N/A", "null", "--", "-nan(ind)"] {
            let text = format!("y,x,frame,particle\n2,1,0,{missing}\n{missing},1,0,3\n");
            assert_eq!(rows(text.as_bytes()), [(0, -1, [2.0, 3.0, 0.0])], "{missing}");
        }
        // pandas after `set_index("frame", drop=False)`, and LapTrack.
        for text in
            ["frame,y,x,frame,particle\n4,2,1,4,7\n", "frame,index,x,y,tree_id,track_id\n4,0,1,2,0,7\n"]
        {
            assert_eq!(rows(text.as_bytes()), [(4, 7, [2.0, 3.0, 0.0])], "{text}");
        }
        let unequal = b"frame,y,x,frame,particle\n4,2,1,5,7\n";
        let said = points(unequal, &Conventions::default()).unwrap_err();
        assert!(said.contains("r.csv:2: column frame appears twice, with different values"), "{said}");
    }
}
