//! Tecplot's text files: particles as in the LPT and DA challenges (`VARIABLES = "X [mm]" "Y [mm]" "Z [mm]"
//! "PartID"`, a zone for each snapshot), and fields as
//! DaVis exports them (`"x", "y", "Vx", "Vy" [, "isValid"]`, a zone for each pair). And DaVis's own text:
//! `#DaVis 8.4.0 2D-vector 16 90 120 "position" "pixel" "position" "pixel" "displacement" "pixel"`, then x,
//! y, Vx, Vy.
//!
//! Particles are in mm from the middle of the image in focus, y downward and z away from the lens, unless the
//! names of columns state px and um. Fields are in px from the first pixel's center; DaVis writes (0, 0) where
//! it has no vector. Fields in mm are refused, because their origin and time step are not in the file.

use std::io::{BufRead, BufReader};

use super::canonical::vector;
use super::text::{Bounded, Text, UnixLines};
use super::{
    Conventions, Converter, DroppedRows, Field, FormatDefaults, LengthUnit, Origin, Points, TrackRow, sheet,
};
use storage::InputFile;
use storage::advice;
use storage::advice::option;
use storage::error::{Error, Result};

const PARTICLES: FormatDefaults =
    FormatDefaults { name: "Tecplot (LPT/DA)", origin: Origin::Center1, frame_base: 0, unit: LengthUnit::Px };
const FIELD: FormatDefaults =
    FormatDefaults { name: "DaVis", origin: Origin::Center0, frame_base: 0, unit: LengthUnit::Px };

/// Rows of a file: their lines, zones (counted from 0, and as the file numbers them) and numbers.
struct Table {
    name: String,
    /// Names of the columns without units, in lower case, and their units.
    columns: Vec<(String, String)>,
    rows: Vec<(u64, u32, Vec<f64>)>,
    has_numbered_zones: bool,
}

impl Table {
    fn read(path: &InputFile, most_rows: usize) -> Result<Self> {
        let name = path.display().to_string();
        let lines = BufReader::new(UnixLines::new(Bounded::new(Text::open(path)?, b'\n')));
        let mut table = Table { name, columns: Vec::new(), rows: Vec::new(), has_numbered_zones: false };
        let (mut zone, mut zones, mut in_variables, mut problems) = (0, 0u32, false, Vec::new());
        for (line, text) in (1..).zip(lines.lines()) {
            let text = text.map_err(|e| Error::input(format!("{}: {e}", table.name)))?;
            let text = text.trim();
            let upper = text.to_ascii_uppercase();
            if let Some(header) = text.strip_prefix("#DaVis") {
                table.columns = davis_columns(header).ok_or_else(|| {
                    Error::input(format!("{}:{line}: {text:?}: expected 2D-vector with units", table.name))
                })?;
            } else if upper.starts_with("TITLE") || text.is_empty() || text.starts_with('#') {
                in_variables = false;
                if table.rows.is_empty() {
                    zone = number_in(text).unwrap_or(zone);
                }
            } else if upper.starts_with("VARIABLES") || (in_variables && text.starts_with('"')) {
                in_variables = true;
                let names = text.split_once('=').map_or(text, |(_, names)| names);
                table.columns.extend(quoted(names));
            } else if upper.starts_with("ZONE") {
                in_variables = false;
                let numbered = title(text).and_then(|title| number_in(&title));
                table.has_numbered_zones |= numbered.is_some();
                zone = numbered.unwrap_or(if zones == 0 { zone } else { zone + 1 });
                zones += 1;
            } else if text.starts_with(|c: char| c.is_ascii_alphabetic()) && !upper.starts_with("NAN") {
                // Other entries of a header: I=..., DATAPACKING=POINT, SOLUTIONTIME=...
                if upper.contains("BLOCK") {
                    problems.push(format!("{}:{line}: {text:?}: expected DATAPACKING=POINT", table.name));
                }
            } else {
                match numbers(text) {
                    Some(row) if row.len() == table.columns.len() => table.rows.push((line, zone, row)),
                    Some(row) => problems.push(format!(
                        "{}:{line}: {} numbers: expected {}, one per variable",
                        table.name,
                        row.len(),
                        table.columns.len()
                    )),
                    None => problems.push(format!(
                        "{}:{line}: {:?}: expected numbers",
                        table.name,
                        super::shown(text)
                    )),
                }
            }
            if table.rows.len() > most_rows {
                return Err(Error::input(format!("{}: more than {most_rows} rows", table.name)));
            }
            if problems.len() > 100 {
                break;
            }
        }
        sheet::shorten(&mut problems);
        if problems.is_empty() { Ok(table) } else { Err(Error::Input(problems)) }
    }

    /// The first column with one of these names (lower case), and its unit.
    fn column(&self, names: &[&str]) -> Option<(usize, &str)> {
        let found = names.iter().find_map(|name| self.columns.iter().position(|(own, _)| own == name))?;
        Some((found, &self.columns[found].1))
    }

    fn need(&self, names: &[&str]) -> Result<(usize, &str)> {
        self.column(names).ok_or_else(|| {
            let there: Vec<&str> = self.columns.iter().map(|(name, _)| name.as_str()).collect();
            Error::input(format!(
                "{}: variable {} is missing; found {}",
                self.name,
                names[0],
                super::shown(&there.join(", "))
            ))
        })
    }
}

/// Numbers between blanks or commas; with blanks between them, commas may be decimal.
fn numbers(text: &str) -> Option<Vec<f64>> {
    let is_decimal =
        text.contains(',') && text.contains([' ', '\t']) && !text.contains(", ") && !text.contains('.');
    let text = if is_decimal { text.replace(',', ".") } else { text.to_owned() };
    let parts = text.split([' ', '\t', ',']).filter(|part| !part.is_empty());
    parts.map(|part| part.parse().ok()).collect()
}

/// The first whole number in a text.
fn number_in(text: &str) -> Option<u32> {
    let digits = text.split(|c: char| !c.is_ascii_digit()).find(|digits| !digits.is_empty())?;
    digits.parse().ok()
}

/// The title of a zone.
fn title(zone: &str) -> Option<String> {
    let (_, after) = zone.split_once("T=").or_else(|| zone.split_once("T ="))?;
    let after = after.trim_start();
    match after.strip_prefix('"') {
        Some(text) => text.split('"').next().map(str::to_owned),
        None => after.split([',', ' ']).next().map(str::to_owned),
    }
}

/// Quoted names with units in brackets, such as `"X [mm]"`.
fn quoted(text: &str) -> Vec<(String, String)> {
    let names = text.split('"').skip(1).step_by(2);
    let one = |name: &str| {
        let (name, unit) = name.split_once(['[', '(']).unwrap_or((name, ""));
        (name.trim().to_ascii_lowercase(), unit.trim_matches([']', ')', ' ']).to_ascii_lowercase())
    };
    names.map(one).collect()
}

/// The columns of DaVis's own text, whose header states quantity and unit of x, y and vectors.
fn davis_columns(header: &str) -> Option<Vec<(String, String)>> {
    let quoted: Vec<&str> = header.split('"').skip(1).step_by(2).collect();
    let [_, x, _, y, _, moved] = quoted[..] else { return None };
    header.contains("2D-vector").then(|| {
        [("x", x), ("y", y), ("vx", moved), ("vy", moved)]
            .map(|(name, unit)| (name.to_owned(), unit.to_ascii_lowercase()))
            .to_vec()
    })
}

const PIXELS: [&str; 5] = ["px", "pix", "pixel", "pixels", "voxel"];

/// Reads particles.
pub(super) fn points(path: &InputFile, given: &Conventions) -> Result<Points> {
    let table = Table::read(path, given.limits.rows)?;
    let ((x, unit), (y, _)) = (table.need(&["x"])?, table.need(&["y"])?);
    let (z, track) = (table.column(&["z"]), table.column(&["partid", "trackid", "track id", "id"]));
    let mut converter = Converter::new(PARTICLES, given)?;
    // Factor to um, and where the middle of the image is in px.
    let in_um = match unit {
        "mm" | "" => Some(1e3),
        "um" | "\u{b5}m" | "micron" => Some(1.0),
        "m" => Some(1e6),
        unit if PIXELS.contains(&unit) => None,
        unit => {
            return Err(Error::input(format!("{}: X in {unit:?}: expected mm, um or px", table.name)));
        }
    };
    let place = match (in_um, given.um_per_px, given.width_px.zip(given.height_px)) {
        (None, ..) => (1.0, [0.0; 2]),
        (Some(factor), Some(um), Some((width, height))) => {
            (factor / um, [0.5 * (width + 1.0), 0.5 * (height + 1.0)])
        }
        (Some(_), None, _) => {
            let what = format!(
                "{}: positions are in {}; give ",
                table.name,
                if unit.is_empty() { "mm" } else { unit }
            );
            return Err(Error::option(advice!(what, option("um_per_px"))));
        }
        (Some(_), Some(_), None) => {
            return Err(Error::input(format!(
                "{}: positions are from the middle of the image: expected a dataset, which has its size",
                table.name
            )));
        }
    };
    if in_um.is_some() {
        converter.notes.push(format!(
            "x, y, z are in {} from the middle of the image in focus",
            if unit.is_empty() { "mm (no unit given)" } else { unit }
        ));
    }
    let (scale, [middle_x, middle_y]) = place;
    let z_um = z.map(|(_, unit)| if unit == "um" || in_um.is_none() { 1.0 } else { in_um.unwrap_or(1.0) });
    let (mut points, mut dropped) =
        (Points { has_z: z.is_some(), ..Points::default() }, DroppedRows::default());
    let mut problems = Vec::new();
    for (line, zone, row) in &table.rows {
        let depth = z.zip(z_um).map_or(0.0, |((z, _), factor)| factor * row[z]);
        let read = converter.frame(f64::from(*zone)).and_then(|frame| {
            let track = track.map_or(-1.0, |(track, _)| row[track]);
            if track.fract() != 0.0 || track.abs() > 9e15 {
                return Err(format!("PartID = {track}: expected a whole number"));
            }
            let at = converter.position(middle_x + scale * row[x], middle_y + scale * row[y], depth)?;
            Ok(at.map(|at| TrackRow { frame, track: (track as i64).max(-1), at }))
        });
        match read {
            Ok(Some(row)) => {
                points.rows.push(row);
                points.lines.push(u32::try_from(*line).unwrap_or(u32::MAX));
            }
            Ok(None) => dropped.at(*line),
            Err(what) => problems.push(format!("{}:{line}: {what}", table.name)),
        }
    }
    sheet::shorten(&mut problems);
    if !problems.is_empty() {
        return Err(Error::Input(problems));
    }
    points.notes = converter.notes;
    points.n_nan = dropped.finish(&mut points.notes);
    Ok(points)
}

/// Reads a field.
pub(super) fn field(path: &InputFile, given: &Conventions) -> Result<Field> {
    let table = Table::read(path, given.limits.rows)?;
    let ((x, unit), (y, _)) = (table.need(&["x"])?, table.need(&["y"])?);
    let (u, moved) = table.need(&["vx", "u", "velocity u", "displacement x"])?;
    let (v, _) = table.need(&["vy", "v", "velocity v", "displacement y"])?;
    let valid = table.column(&["isvalid", "valid"]);
    for unit in [unit, moved] {
        if !unit.is_empty() && !PIXELS.contains(&unit) {
            return Err(Error::input(format!(
                "{}: in {unit}: expected positions and displacements in pixels; export without calibration",
                table.name
            )));
        }
    }
    let mut converter = Converter::new(FIELD, given)?;
    converter.notes.push("vectors of exactly (0, 0) are taken as missing".to_owned());
    let (mut field, mut dropped, mut problems) = (Field::default(), DroppedRows::default(), Vec::new());
    for (line, zone, row) in &table.rows {
        let missing = row[u] == 0.0 && row[v] == 0.0;
        let flag = u8::from(missing || valid.is_some_and(|(valid, _)| row[valid] <= 0.0));
        let [dx, dy] = converter.displacement(row[u], row[v]);
        let pair =
            if table.has_numbered_zones { converter.frame(f64::from(*zone)).map(Some) } else { Ok(None) };
        let read = pair.and_then(|pair| {
            let at = converter.position(row[x], row[y], 0.0)?;
            at.map(|at| vector(pair, at, [dx, dy, f64::NAN], flag, [f64::NAN; 2])).transpose()
        });
        match read {
            Ok(Some(vector)) => {
                field.vectors.push(vector);
                field.lines.push(u32::try_from(*line).unwrap_or(u32::MAX));
            }
            Ok(None) => dropped.at(*line),
            Err(what) => problems.push(format!("{}:{line}: {what}", table.name)),
        }
    }
    sheet::shorten(&mut problems);
    if !problems.is_empty() {
        return Err(Error::Input(problems));
    }
    field.notes = converter.notes;
    field.n_nan = dropped.finish(&mut field.notes);
    Ok(field)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with<T>(text: &str, read: impl Fn(&InputFile) -> Result<T>) -> std::result::Result<T, String> {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("t.dat");
        std::fs::write(&path, text).unwrap();
        read(&path.into()).map_err(|e| e.messages().join("\n"))
    }

    #[test]
    fn snapshots_of_the_challenges_are_frames() {
        let given = Conventions {
            um_per_px: Some(0.5),
            width_px: Some(100.0),
            height_px: Some(60.0),
            ..Conventions::default()
        };
        let text = "TITLE = \"TR\"\nVARIABLES = \"X [mm]\" \"Y [mm]\"\n\"Z [mm]\" \"PartID\"\n\
            ZONE T=\"Snapshot 0002\"\nI=2, DATAPACKING=POINT\n0 0 -0.01 7\n0.005,0.01,0,8\nZONE T=\"Snapshot 0003\"\n1e-3 0 0 7\n";
        let points = with(text, |path| points(path, &given)).unwrap();
        let rows: Vec<_> =
            points.rows.iter().map(|r| (r.frame, r.track, r.at.x_px, r.at.y_px, r.at.z_um)).collect();
        assert_eq!(rows, [(2, 7, 50.5, 30.5, -10.0), (2, 8, 60.5, 50.5, 0.0), (3, 7, 52.5, 30.5, 0.0)]);
        assert_eq!((points.lines.as_slice(), points.has_z), (&[6, 7, 9][..], true));
        let px = text.replace("[mm]", "[px]");
        let points = with(&px, |path| super::points(path, &Conventions::default())).unwrap();
        assert_eq!((points.rows[2].at.x_px, points.rows[0].at.z_um), (1e-3, -0.01));
        for (from, to, expected) in [
            ("0 0 -0.01 7", "0 0 -0.01", "t.dat:6: 3 numbers: expected 4"),
            ("0 0 -0.01 7", "0 0 x 7", "t.dat:6: \"0 0 x 7\": expected numbers"),
            ("0 0 -0.01 7", "0 0 0 0.5", "t.dat:6: PartID = 0.5"),
            ("POINT", "BLOCK", "expected DATAPACKING=POINT"),
            ("[mm]", "[inch]", "X in \"inch\""),
            ("\"X [mm]\"", "\"A\"", "variable x is missing"),
        ] {
            let said = with(&text.replacen(from, to, 1), |path| super::points(path, &given)).unwrap_err();
            assert!(said.contains(expected), "{said}");
        }
        let said = with(text, |path| super::points(path, &Conventions::default())).unwrap_err();
        assert!(said.contains("um-per-px") || said.contains("mm"), "{said}");
    }

    #[test]
    fn fields_of_davis_are_read_in_both_forms() {
        let read = |text: &str| with(text, |path| field(path, &Conventions::default()));
        let own = "#DaVis 8.1.6 2D-vector 16 1 2 \"position\" \"pixel\" \"position\" \"pixel\" \"displacement\" \"pixel\"\n\
            7,5\t7,5\t1,25\t-0,5\n23,5\t7,5\t0\t-0\n";
        let tecplot = "TITLE = \"B1\"\nVARIABLES = \"x\", \"y\", \"Vx\", \"Vy\", \"isValid\"\nZONE T=\"Frame 0\", I=2, J=1, F=POINT\n\
            7.5 7.5 1.25 -0.5 1\n23.5, 7.5, 2, 2, 0\n";
        for (text, pair) in [(own, None), (tecplot, Some(0))] {
            let field = read(text).unwrap();
            let first = field.vectors[0];
            assert_eq!((first.pair, first.at.x_px, first.at.y_px), (pair, 8.5, 8.5));
            assert_eq!((first.moved[0], first.moved[1], first.flag), (1.25, -0.5, 0));
            assert_eq!(field.vectors[1].flag, 1);
        }
        let said = read(&own.replace("\"displacement\" \"pixel\"", "\"velocity\" \"m/s\"")).unwrap_err();
        assert!(said.contains("in m/s: expected positions and displacements in pixels"), "{said}");
        assert!(read("#DaVis 8.1.6 3D-vector 16\n").unwrap_err().contains("expected 2D-vector"));
    }
}
