//! Tecplot's text files: particles as in the LPT and DA challenges (`VARIABLES = "X [mm]" "Y [mm]" "Z [mm]"
//! "PartID"`, a zone for each snapshot), and fields as DaVis (`"x", "y", "Vx", "Vy" [, "isValid"]`, a zone for
//! each pair), TSI Insight (`.vec`: `"X mm", "Y mm", "U m/s", "V m/s", "CHC"`, with the scale in
//! `DATASETAUXDATA`) and PIVlab (`pivlab.rs`) write them. And DaVis's own text: `#DaVis 8.4.0 2D-vector 16 90
//! 120 "position" "pixel" "position" "pixel" "displacement" "pixel"`, then x, y, Vx, Vy.
//!
//! Particles are in mm from the middle of the image in focus, y downward and z away from the lens, unless the
//! names of columns state px and um. Fields are in px from the first pixel's center, or in the stated unit;
//! DaVis writes (0, 0) where it has no vector.

use super::fields::{self, FieldColumns, FieldLayout, Unit};
use super::sheet::{OptionalColumns, TextTable};
use super::{Conventions, Converter, Field, FormatDefaults, Origin, Points, pivlab, shown};
use storage::InputFile;
use storage::advice;
use storage::advice::option;
use storage::error::{Error, Result};

const PARTICLES: FormatDefaults = FormatDefaults::px("Tecplot (LPT/DA)", Origin::Center1);
const DAVIS: FormatDefaults = FormatDefaults::px("DaVis", Origin::Center0);
const INSIGHT: FormatDefaults = FormatDefaults { name: "TSI Insight", ..DAVIS };

/// A table, its header, and the units of its columns, whose names are in lower case.
pub(super) struct Table {
    pub(super) sheet: TextTable,
    pub(super) header: String,
    pub(super) units: Vec<String>,
}

impl Table {
    fn open(path: &InputFile, given: &Conventions) -> Result<Self> {
        let (sheet, header) = TextTable::tecplot(path)?;
        let columns = if header.starts_with("#DaVis") {
            davis_columns(header.lines().next().unwrap_or_default()).ok_or_else(|| {
                let line = header.lines().next().unwrap_or_default();
                Error::input(format!("{}:1: {line:?}: expected 2D-vector with units", sheet.name()))
            })?
        } else {
            variables(&header)
        };
        let (names, units) = columns.into_iter().unzip();
        Ok(Table { sheet: sheet.at_most(given.limits.rows).named(names), header, units })
    }

    /// The first column with one of these names.
    fn column(&self, names: &[&str]) -> Option<usize> {
        names.iter().find_map(|name| self.sheet.column(name))
    }

    fn need(&self, names: &[&str]) -> Result<usize> {
        self.column(names).ok_or_else(|| {
            let there = shown(&self.sheet.names().join(", "));
            Error::input(format!("{}: variable {} is missing; found {there}", self.sheet.name(), names[0]))
        })
    }
}

/// The names of VARIABLES in lower case and their units, such as `"X [mm]"` or `"X mm"`.
fn variables(header: &str) -> Vec<(String, String)> {
    let upper = header.to_ascii_uppercase();
    let Some(after) = upper.find("VARIABLES").and_then(|at| header[at..].split_once('=')) else {
        return Vec::new();
    };
    // The list ends with the next entry, a word that is not quoted.
    let mut parts = after.1.split('"');
    let mut names = Vec::new();
    while let (Some(between), Some(name)) = (parts.next(), parts.next()) {
        if between.contains(|c: char| c.is_ascii_alphabetic()) {
            break;
        }
        let name = name.to_lowercase();
        let (name, unit) = match name.split_once(['[', '(']) {
            Some((name, unit)) => (name, unit.trim_matches([']', ')', ' '])),
            None => {
                name.rsplit_once(' ').filter(|(_, unit)| Unit::parse(unit).is_some()).unwrap_or((&name, ""))
            }
        };
        names.push((name.trim().to_owned(), unit.to_owned()));
    }
    names
}

/// The columns of DaVis's own text, whose header states quantity and unit of x, y and vectors.
fn davis_columns(header: &str) -> Option<Vec<(String, String)>> {
    let quoted: Vec<&str> = header.split('"').skip(1).step_by(2).collect();
    let [_, x, _, y, _, moved] = quoted[..] else { return None };
    header.contains("2D-vector").then(|| {
        [("x", x), ("y", y), ("vx", moved), ("vy", moved)]
            .map(|(name, unit)| (name.to_owned(), unit.to_lowercase()))
            .to_vec()
    })
}

/// Reads particles.
pub(super) fn points(path: &InputFile, given: &Conventions) -> Result<Points> {
    let table = Table::open(path, given)?;
    let (x, y, z) = (table.need(&["x"])?, table.need(&["y"])?, table.column(&["z"]));
    let track = table.column(&["partid", "trackid", "track id", "id"]);
    let mut converter = Converter::new(PARTICLES, &Conventions { unit: None, ..*given })?;
    let (name, unit) = (table.sheet.name(), given.unit.map_or(table.units[x].as_str(), |unit| unit.symbol()));
    // Factor to um, and where the middle of the image is in px.
    let in_um = Unit::parse(if unit.is_empty() { "mm" } else { unit }).and_then(Unit::length_um);
    let in_um = in_um.ok_or_else(|| Error::input(format!("{name}: X in {unit:?}: expected mm, um or px")))?;
    let (scale, [middle_x, middle_y]) = match (in_um, given.um_per_px, given.width_px.zip(given.height_px)) {
        (None, ..) => (1.0, [0.0; 2]),
        (Some(factor), Some(um), Some((width, height))) => {
            (factor / um, [0.5 * (width + 1.0), 0.5 * (height + 1.0)])
        }
        (Some(_), None, _) => {
            let what =
                format!("{name}: positions are in {}; give ", if unit.is_empty() { "mm" } else { unit });
            return Err(Error::option(advice!(what, option("um_per_px"))));
        }
        (Some(_), Some(_), None) => {
            return Err(Error::input(format!(
                "{name}: positions are from the middle of the image: expected a dataset, which has its size"
            )));
        }
    };
    if in_um.is_some() {
        converter.notes.push(format!(
            "x, y, z are in {} from the middle of the image in focus",
            if unit.is_empty() { "mm (no unit given)" } else { unit }
        ));
    }
    let is_um = z.is_some_and(|z| table.units[z] == "um");
    let z_um = if is_um { 1.0 } else { in_um.unwrap_or(1.0) };
    let Table { sheet, .. } = table;
    sheet.points(converter, z.is_some(), OptionalColumns::default(), |cells| {
        let depth = z.map_or(Ok(0.0), |z| cells.number(z))? * z_um;
        let at = [middle_x + scale * cells.number(x)?, middle_y + scale * cells.number(y)?, depth];
        Ok((cells.zone.map_or(0.0, |(zone, _)| f64::from(zone)), cells.track(track)?, at))
    })
}

pub(super) fn field(path: &InputFile, given: &Conventions) -> Result<Field> {
    let table = Table::open(path, given)?;
    let is_pivlab = table.header.contains("PIVlab");
    read(table, is_pivlab, given)
}

/// Reads a field from a table of DaVis, Insight or PIVlab.
pub(super) fn read(table: Table, is_pivlab: bool, given: &Conventions) -> Result<Field> {
    let at = [table.need(&["x"])?, table.need(&["y"])?];
    let moved = [
        table.need(&["vx", "u", "velocity u", "displacement x"])?,
        table.need(&["vy", "v", "velocity v", "displacement y"])?,
    ];
    let (valid, choice) = (table.column(&["isvalid", "valid", "vector type"]), table.column(&["chc"]));
    let (nan, sigma) = (table.column(&["isnan"]), table.column(&["uncertainty_map", "uncertainty"]));
    let (name, header) = (table.sheet.name().to_owned(), &table.header);
    let (length, speed) = (table.units[at[0]].as_str(), table.units[moved[0]].as_str());
    let is_insight = choice.is_some();
    let mut layout = if is_pivlab {
        // In Tecplot's text, units are in a comment.
        let units = match length {
            "" if header.contains("x [m]") => ["m", "m/s"],
            "" => ["px", "px/frame"],
            _ => [length, speed],
        };
        pivlab::layout(header, units, &name, given)?
    } else {
        let mut layout = FieldLayout::new(if is_insight { INSIGHT } else { DAVIS });
        // Insight states the scale, the time between frames, and where the origin is in the image.
        let stated = |key: &str| {
            let value = header.split_once(key)?.1.split('"').nth(1)?.trim().parse::<f64>().ok()?;
            value.is_finite().then_some(value)
        };
        let scale = Conventions {
            um_per_px: stated("MicrometersPerPixelX").filter(|um| *um > 0.0).or(given.um_per_px),
            dt_s: stated("MicrosecondsPerDeltaT").filter(|dt| *dt > 0.0).map(|dt| 1e-6 * dt).or(given.dt_s),
            ..*given
        };
        layout.origin_px = ["OriginInImageX", "OriginInImageY"].map(|key| stated(key).unwrap_or(0.0));
        if !(length.is_empty() && speed.is_empty()) {
            let px = |text: &str| {
                let unit = Unit::parse(if text.is_empty() { "px" } else { text });
                let unit = unit.ok_or_else(|| {
                    Error::input(format!("{name}: in {text:?}: expected a unit such as pixel, mm or m/s"))
                })?;
                unit.px(&scale, &name)
            };
            let words = match [length, speed].map(Unit::parse) {
                both if both == [Unit::parse("px"); 2] => "px".to_owned(),
                _ if speed == length => length.to_owned(),
                _ => format!("{length}, u, v in {speed}"),
            };
            layout.scale = Some(([px(length)?, px(speed)?], words));
        }
        layout
    };
    if !is_pivlab && !is_insight {
        layout.notes.push("vectors of exactly (0, 0) are taken as missing".to_owned());
    }
    let flags = [valid, choice, nan];
    let columns = FieldColumns { at, moved, sigma: [sigma; 2], flags, ..FieldColumns::default() };
    fields::read(table.sheet, columns, layout, given, |cells| {
        let is_missing =
            !is_pivlab && !is_insight && cells.number(moved[0])? == 0.0 && cells.number(moved[1])? == 0.0;
        let kind = cells.number_or_nan(valid)?;
        let is_rejected = kind <= 0.0 || cells.number_or_nan(choice)? <= 0.0;
        let is_invalid = is_missing || is_rejected || cells.number_or_nan(nan)? == 1.0;
        // Of PIVlab, 2 is interpolated.
        Ok(if is_pivlab && kind == 2.0 { 2 } else { u8::from(is_invalid) })
    })
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
            ("0 0 -0.01 7", "0 0 -0.01", "t.dat:6: 3 fields where the header has 4"),
            ("0 0 -0.01 7", "0 0 x 7", "t.dat:6: z = \"x\": expected a number"),
            ("0 0 -0.01 7", "0 0 0 0.5", "t.dat:6: partid = 0.5"),
            ("POINT", "BLOCK", "expected DATAPACKING=POINT"),
            ("[mm]", "[mile]", "X in \"mile\""),
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
        assert!(said.contains("lengths are not in px; give --um-per-px"), "{said}");
        assert!(read("#DaVis 8.1.6 3D-vector 16\n").unwrap_err().contains("expected 2D-vector"));
    }
}
