//! Reader of text tables: limits lines and rows, finds columns by name, reports problems with line numbers.
//!
//! Spreadsheet programs write tables according to the locale: semicolons between columns and decimal commas,
//! tabs, a first line `sep=;`, UTF-16. The header shows the format, and a note of the result states it.

use std::cell::RefCell;
use std::collections::BTreeSet;

use csv::ByteRecord;
use microsig_core::Spheroid;
use storage::dataset::Columns;

pub use super::cells::Cells;
use super::cells::{Decimals, Place, number};
use super::conventions::MAX_ROWS;
use super::text::{HEAD, Lines, Text, excel_separator};
use super::{Converter, DroppedRows, Points, TrackRow, Velocities, VelocityUnit};
use storage::InputFile;
use storage::error::{Error, Result};

/// Maximum number of problems listed in full.
const LISTED: usize = 10;

/// The rows below the header.
enum Source {
    /// With the delimiter; Tecplot's text has zones.
    Lines(Lines, u8, Option<Zones>),
    Columns(Columns),
}

/// Zones of Tecplot's text.
#[derive(Debug, Default)]
struct Zones {
    /// The current zone, counted from 0 or as the file numbers it, and whether it does.
    current: (u32, bool),
    read: u32,
    /// The number in the title, for a zone without one.
    title: Option<u32>,
    /// Lines before the first zone, and that with it.
    above: String,
}

impl Zones {
    /// Reads a line that is not a row.
    fn header(&mut self, line: &str) -> std::result::Result<(), String> {
        if self.read == 0 && self.above.len() < HEAD {
            self.above += line;
            self.above.push('\n');
        }
        if line.starts_with('#') {
            return Ok(());
        }
        // Without quoted text, which may contain keywords.
        let bare: String = line.split('"').step_by(2).collect::<Vec<_>>().join("\"").to_ascii_uppercase();
        if bare.contains("BLOCK") {
            return Err(format!("{:?}: expected DATAPACKING=POINT", super::shown(line)));
        }
        if bare.contains("ZONE") {
            // Other entries may end with T, too.
            let title = line.match_indices('T').find_map(|(i, _)| {
                let is_word = !line[..i].ends_with(char::is_alphanumeric);
                line[i + 1..].trim_start().strip_prefix('=').filter(|_| is_word).map(str::trim_start)
            });
            let title = title.map(|title| match title.strip_prefix('"') {
                Some(title) => title.split('"').next().unwrap_or_default(),
                None => title.split([',', ' ']).next().unwrap_or_default(),
            });
            let numbered = title.and_then(number_in);
            let next = if self.read == 0 { self.title.unwrap_or(0) } else { self.current.0 + 1 };
            self.current = (numbered.unwrap_or(next), numbered.is_some());
            self.read += 1;
        } else if bare.starts_with("TITLE") && self.read == 0 {
            self.title = number_in(line);
            self.current.0 = self.title.unwrap_or(0);
        }
        Ok(())
    }
}

/// The first whole number in a text.
fn number_in(text: &str) -> Option<u32> {
    let digits = text.split(|c: char| !c.is_ascii_digit()).find(|digits| !digits.is_empty())?;
    digits.parse().ok()
}

/// A table in a text file, or columns in memory whose header counts as line 1.
pub struct TextTable {
    name: String,
    header: Vec<String>,
    source: Source,
    waiting: Option<(u64, ByteRecord)>,
    rows: usize,
    most_rows: usize,
    problems: Vec<String>,
    /// Requested columns that appear more than once: the one that is read, and the others.
    twice: RefCell<BTreeSet<(usize, usize)>>,
    /// `None` where commas separate columns.
    decimals: Option<Decimals>,
    /// How the table differs from plain CSV.
    style: Vec<&'static str>,
}

impl TextTable {
    /// Opens a table whose header is line `header_line`, counted from 1, without empty lines and a line
    /// `sep=` for Excel. The header shows what separates columns.
    pub fn open(path: impl Into<InputFile>, header_line: u64) -> Result<Self> {
        let path = &path.into();
        let name = path.display().to_string();
        let text = Text::open(path)?;
        let mut style = Vec::new();
        if text.is_utf16() {
            style.push("in UTF-16");
        }
        let mut lines = Lines::new(text);
        let (mut header, mut left, mut excel) = (Vec::new(), header_line, None);
        while left > 0 {
            if !lines.next(&mut header).map_err(|e| Error::input(format!("{name}: {e}")))? {
                return Err(Error::input(format!("{name}: empty; expected at least a header")));
            }
            if lines.number == 1 && excel_separator(&header).is_some() {
                excel = excel_separator(&header);
                style.push("below a line sep= for Excel");
            } else if !header.trim_ascii().is_empty() {
                left -= 1;
            }
        }
        let delimiter = excel.unwrap_or_else(|| delimiter(&header));
        // Headers of fields, where tabs and blanks are usual.
        let is_usual = header_line > 1 || header.starts_with(b"#");
        match delimiter {
            b';' => style.push("with semicolons between columns"),
            b'\t' if !is_usual => style.push("with tabs between columns"),
            b' ' if !is_usual => style.push("with blanks between columns"),
            _ => {}
        }
        let decimals = (delimiter != b',').then(Decimals::default);
        let header = names(&header, delimiter);
        let source = Source::Lines(lines, delimiter, None);
        Ok(TextTable { decimals, style, ..TextTable::new(name, header, source) })
    }

    /// Opens Tecplot's text; returns its header, too. The columns have no names yet.
    pub(super) fn tecplot(path: &InputFile) -> Result<(Self, String)> {
        let source = Source::Lines(Lines::new(Text::open(path)?), b' ', Some(Zones::default()));
        let mut table = TextTable::new(path.display().to_string(), Vec::new(), source);
        table.decimals = Some(Decimals::default());
        let mut record = ByteRecord::new();
        table.waiting = table.record(&mut record)?.map(|line| (line, record));
        let Source::Lines(_, _, Some(zones)) = &mut table.source else {
            return Ok((table, String::new()));
        };
        let header = std::mem::take(&mut zones.above);
        Ok((table, header))
    }

    /// The table of these columns, with a name for messages.
    pub(super) fn from_columns(name: &str, columns: Columns) -> Self {
        let header = columns.0.iter().map(|(name, _)| name.clone()).collect();
        TextTable::new(name.to_owned(), header, Source::Columns(columns))
    }

    fn new(name: String, header: Vec<String>, source: Source) -> Self {
        TextTable {
            name,
            header,
            source,
            waiting: None,
            rows: 0,
            most_rows: MAX_ROWS,
            problems: Vec::new(),
            twice: RefCell::default(),
            decimals: None,
            style: Vec::new(),
        }
    }

    /// Skips up to three rows below the header that contain words instead of numbers in this column; returns
    /// the words.
    pub(crate) fn skip_words(&mut self, column: usize) -> Result<Vec<String>> {
        let (mut words, mut record) = (Vec::new(), ByteRecord::new());
        while let Some(line) = self.record(&mut record)? {
            let text = String::from_utf8_lossy(record.get(column).unwrap_or_default()).into_owned();
            if words.len() == 3 || text.is_empty() || number(&text, self.decimals.is_some()).is_some() {
                self.waiting = Some((line, record));
                break;
            }
            words.push(text);
        }
        Ok(words)
    }

    /// Reads the next record; returns its line number, or `None` at the end.
    fn record(&mut self, record: &mut ByteRecord) -> Result<Option<u64>> {
        if let Some((line, waiting)) = self.waiting.take() {
            *record = waiting;
            return Ok(Some(line));
        }
        let failed = |e: std::io::Error| Error::input(format!("{}: {e}", self.name));
        match &mut self.source {
            Source::Columns(_) => Ok(None),
            Source::Lines(lines, delimiter, zones) => {
                let mut text = Vec::new();
                loop {
                    if !lines.next(&mut text).map_err(failed)? {
                        return Ok(None);
                    }
                    let line = lines.number;
                    if text.trim_ascii().is_empty() {
                        continue;
                    }
                    let Some(zones) = zones else {
                        split(&text, *delimiter, record);
                        return Ok(Some(line));
                    };
                    let text = String::from_utf8_lossy(&text);
                    let text = text.trim();
                    let is_row = text.starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c))
                        || text.get(..3).is_some_and(|start| start.eq_ignore_ascii_case("nan"));
                    if !is_row {
                        let wrong = |what| Error::input(format!("{}:{line}: {what}", self.name));
                        zones.header(text).map_err(wrong)?;
                        continue;
                    }
                    // With blanks between numbers, commas may be decimal.
                    let is_separated =
                        !text.contains([' ', '\t']) || text.contains(", ") || text.contains('.');
                    record.clear();
                    text.split(|c: char| c.is_ascii_whitespace() || c == ',' && is_separated)
                        .filter(|f| !f.is_empty())
                        .for_each(|f| record.push_field(f.as_bytes()));
                    return Ok(Some(line));
                }
            }
        }
    }

    pub(super) fn name(&self) -> &str {
        &self.name
    }

    pub(super) fn names(&self) -> &[String] {
        &self.header
    }

    /// Replaces the names of the columns.
    pub fn named(self, header: Vec<String>) -> Self {
        TextTable { header, ..self }
    }

    /// Limits the number of rows.
    pub fn at_most(self, rows: usize) -> Self {
        TextTable { most_rows: rows, ..self }
    }

    /// Index of a column, if present.
    pub fn column(&self, name: &str) -> Option<usize> {
        let mut found = (0..self.header.len()).filter(|i| self.header[*i] == name);
        let first = found.next()?;
        self.twice.borrow_mut().extend(found.map(|other| (first, other)));
        Some(first)
    }

    /// Index of a required column.
    pub fn need(&self, name: &str) -> Result<usize> {
        self.column(name).ok_or_else(|| {
            let there = super::shown(&self.header.join(", "));
            Error::input(format!("{}: column {name} is missing; found {there}", self.name))
        })
    }

    /// Calls `each` with every row and collects the problems it reports. Returns a note on how the table
    /// differs from plain CSV, if it does.
    /// Errors: all problems, shortened to a readable list.
    pub fn rows(
        mut self,
        mut each: impl FnMut(&Cells<'_>) -> std::result::Result<(), String>,
    ) -> Result<Option<String>> {
        // As after `set_index("frame", drop=False)` in pandas.
        let twice = self.twice.take();
        let mut each = |cells: &Cells<'_>| match twice.iter().find(|(a, b)| !cells.are_equal(*a, *b)) {
            Some((column, _)) => {
                Err(format!("column {} appears twice, with different values", cells.name(*column)))
            }
            None => each(cells),
        };
        if let Source::Columns(columns) = &self.source {
            for row in 0..columns.rows() {
                let line = row as u64 + 2;
                let place = Place::Columns(columns, row);
                if let Err(what) = each(&Cells::new(place, &self.header, line, None)) {
                    self.problems.push(format!("{}:{line}: {what}", self.name));
                }
            }
        }
        let mut record = ByteRecord::new();
        while let Some(line) = self.record(&mut record)? {
            self.rows += 1;
            if self.rows > self.most_rows {
                return Err(Error::input(format!("{}: more than {} rows", self.name, self.most_rows)));
            }
            let wrong = if record.len() == self.header.len() {
                let zone = match &self.source {
                    Source::Lines(_, _, Some(zones)) => Some(zones.current),
                    _ => None,
                };
                let mut cells =
                    Cells::new(Place::Record(&record), &self.header, line, self.decimals.as_ref());
                cells.zone = zone;
                each(&cells).err()
            } else {
                let is_split = record.len() > self.header.len() && self.decimals.is_none();
                let hint = if is_split {
                    " (numbers with decimal commas? Then separate the columns by semicolons or tabs)"
                } else {
                    ""
                };
                Some(format!("{} fields where the header has {}{hint}", record.len(), self.header.len()))
            };
            if let Some(message) = wrong {
                self.problems.push(format!("{}:{line}: {message}", self.name));
                // Stop early: most rows are wrong.
                if self.problems.len() > 10 * LISTED {
                    break;
                }
            }
        }
        let decimals = self.decimals.unwrap_or_default();
        self.problems.extend(decimals.mixed().map(|what| format!("{}: {what}", self.name)));
        if decimals.are_commas() {
            self.style.push("with decimal commas");
        }
        shorten(&mut self.problems);
        if !self.problems.is_empty() {
            return Err(Error::Input(self.problems));
        }
        Ok((!self.style.is_empty()).then(|| format!("read as a table {}", self.style.join(", "))))
    }

    /// Names of the columns not listed in `used`.
    pub fn others(&self, used: &[&str]) -> Vec<&str> {
        self.header.iter().map(String::as_str).filter(|h| !h.is_empty() && !used.contains(h)).collect()
    }

    /// Reads particles: `row` returns frame, track and x, y, z of a row in the file's units; `more` holds
    /// optional columns.
    pub(crate) fn points(
        self,
        converter: Converter,
        has_z: bool,
        more: OptionalColumns,
        mut row: impl FnMut(&Cells<'_>) -> std::result::Result<(f64, i64, [f64; 3]), String>,
    ) -> Result<Points> {
        let (mut points, mut dropped) = (Points { has_z, ..Points::default() }, DroppedRows::default());
        let (mut velocities, unit) = (Vec::new(), more.velocity.map(|(unit, _)| unit));
        let mut has_depth = Vec::new();
        let style = self.rows(|cells| {
            let (frame, track, [x, y, z]) = row(cells)?;
            if frame.is_nan() {
                dropped.at(cells.line);
                return Ok(());
            }
            let frame = converter.frame(frame)?;
            match converter.position(x, y, if z.is_nan() { 0.0 } else { z })? {
                Some(at) => {
                    points.rows.push(TrackRow { frame, track, at });
                    has_depth.push(!z.is_nan());
                    points.lines.push(u32::try_from(cells.line).unwrap_or(u32::MAX));
                    let all = |columns: [Option<usize>; 3]| {
                        let [x, y, z] = columns.map(|c| cells.number_or_nan(c));
                        Ok::<_, String>([x?, y?, z?])
                    };
                    if more.sigma.iter().any(Option::is_some) {
                        let known = |s: f64| if more.negative_is_unknown && s < 0.0 { f64::NAN } else { s };
                        let sigma = all(more.sigma)?.map(known);
                        points.sigma.push(converter.uncertainty(sigma, cells.names(more.sigma))?);
                    }
                    if let [Some(w), Some(h), score] = more.size {
                        let size = [cells.number(w)?, cells.number(h)?];
                        let confidence = score.map_or(Ok(1.0), |score| cells.number(score))?;
                        points.boxes.push(converter.size(size, confidence)?);
                    }
                    if more.diameter.is_some() {
                        points.diameters_um.push(converter.diameter(cells.number_or_nan(more.diameter)?)?);
                    }
                    match more.axis {
                        Some(AxisColumns::Vector(columns)) => {
                            let columns = columns.map(Some);
                            points.axes.push(converter.velocity(all(columns)?, cells.names(columns))?);
                        }
                        Some(AxisColumns::Angles(columns)) => {
                            let [alpha, beta] = columns.map(|c| cells.number_or_nan(Some(c)));
                            let (alpha_rad, beta_rad) = (alpha?, beta?);
                            points.axes.push(Spheroid { e_p: 1.0, alpha_rad, beta_rad }.axis());
                        }
                        None => {}
                    }
                    if let Some((_, columns)) = more.velocity {
                        velocities.push(converter.velocity(all(columns)?, cells.names(columns))?);
                    }
                }
                None => dropped.at(cells.line),
            }
            Ok(())
        })?;
        (points.read_as, points.notes) = (Box::new(converter.conventions), converter.notes);
        points.notes.extend(style);
        if has_z && !has_depth.is_empty() && !has_depth.contains(&true) {
            points.has_z = false;
            points.notes.push("z is empty in every row: no depth".to_owned());
        } else {
            let without = points.lines.iter().zip(&has_depth).filter(|(_, has)| !**has);
            without.for_each(|(line, _)| dropped.at(u64::from(*line)));
            keep(&mut points.rows, &has_depth);
            keep(&mut points.lines, &has_depth);
            keep(&mut points.sigma, &has_depth);
            keep(&mut points.boxes, &has_depth);
            keep(&mut points.axes, &has_depth);
            keep(&mut points.diameters_um, &has_depth);
            keep(&mut velocities, &has_depth);
        }
        points.velocities = unit.map(|unit| Velocities { unit, rows: velocities });
        points.n_nan = dropped.finish(&mut points.notes);
        Ok(points)
    }
}

/// Keeps the values of these rows, if there are any.
fn keep<T>(values: &mut Vec<T>, rows: &[bool]) {
    let mut rows = rows.iter();
    values.retain(|_| rows.next() == Some(&true));
}

/// Optional columns of particles, along x, y, z.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct OptionalColumns {
    /// Claimed uncertainties.
    pub sigma: [Option<usize>; 3],
    /// Whether a negative uncertainty means that it is unknown.
    pub negative_is_unknown: bool,
    /// Velocities and their unit.
    pub velocity: Option<(VelocityUnit, [Option<usize>; 3])>,
    /// Width and height of boxes, and the score of the detection.
    pub size: [Option<usize>; 3],
    /// Symmetry axes of spheroids.
    pub axis: Option<AxisColumns>,
    /// Diameters, um.
    pub diameter: Option<usize>,
}

/// Columns with the symmetry axis of a spheroid.
#[derive(Debug, Clone, Copy)]
pub(crate) enum AxisColumns {
    /// Components along x, y, z.
    Vector([usize; 3]),
    /// Angles alpha and beta of MicroSIG's data file, rad.
    Angles([usize; 2]),
}

/// The separator of the columns of a header: the most frequent of comma, semicolon and tab, or blanks.
pub(super) fn delimiter(header: &[u8]) -> u8 {
    let count = |byte: u8| header.iter().filter(|b| **b == byte).count();
    // Of equal counts the last one is taken.
    [b'\t', b';', b',']
        .into_iter()
        .filter(|byte| count(*byte) > 0)
        .max_by_key(|byte| count(*byte))
        .unwrap_or(b' ')
}

/// Splits a line into fields without their quotes; a delimiter between quotes separates nothing. A delimiter of
/// a space stands for any number of spaces and tabs.
fn split(line: &[u8], delimiter: u8, record: &mut ByteRecord) {
    record.clear();
    // An odd quote is a character, such as the sign of inches.
    let quotes = line.iter().filter(|byte| **byte == b'"').count() % 2 == 0;
    let (mut field, mut is_quoted) = (Vec::new(), false);
    for &byte in line.iter().chain(&[delimiter]) {
        let separates = byte == delimiter || (delimiter == b' ' && byte == b'\t');
        if byte == b'"' && quotes {
            is_quoted = !is_quoted;
        } else if separates && !is_quoted {
            if delimiter != b' ' || !field.is_empty() {
                record.push_field(field.trim_ascii());
            }
            field.clear();
        } else {
            field.push(byte);
        }
    }
}

pub(super) fn names(header: &[u8], delimiter: u8) -> Vec<String> {
    let mut fields = ByteRecord::new();
    split(header, delimiter, &mut fields);
    let name = |field: &[u8]| String::from_utf8_lossy(field).trim_matches(['"', '#', ' ', '\t']).to_owned();
    fields.iter().map(name).filter(|name| delimiter != b' ' || !name.is_empty()).collect()
}

pub(crate) fn shorten(problems: &mut Vec<String>) {
    if problems.len() > LISTED {
        let rest = problems.len() - LISTED;
        problems.truncate(LISTED);
        problems.push(format!("... and {rest} or more problems of this kind"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The numbers in column b, and the note on the table.
    fn read(text: &str) -> Result<(Vec<f64>, String)> {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("t.csv");
        std::fs::write(&path, text).unwrap();
        let sheet = TextTable::open(&path, 1)?;
        let column = sheet.need("b")?;
        let mut values = Vec::new();
        let note = sheet.rows(|cells| {
            values.push(cells.number(column)?);
            Ok(())
        })?;
        Ok((values, note.unwrap_or_default()))
    }

    #[test]
    fn line_ends_quotes_and_empty_lines_do_not_matter() {
        assert_eq!(read("a,\"b\"\r\n1,2\r\n\r\n3,\"4\"").unwrap().0, [2.0, 4.0]);
        assert_eq!(read("# a b\n 1  2.5e0\n\n3\t4\n").unwrap().0, [2.5, 4.0]);
    }

    #[test]
    fn problems_name_their_lines() {
        let message = |text| read(text).unwrap_err().to_string();
        assert!(
            message("a,b\n1,2\n1,2,5\n")
                .contains("t.csv:3: 3 fields where the header has 2 (numbers with decimal")
        );
        assert!(message("a,b\n1,x\n").contains("t.csv:2: b = \"x\": expected a number"));
        assert!(message("a\n1\n").contains("column b is missing"));
        assert!(message("").contains("empty"));
        for lines in ["a,b\r\n\r\n1,2\r\n1,x\r\n", "a,b\r\r1,2\r1,x", "a,b\n\n1,2\n1,x"] {
            assert!(message(lines).contains("t.csv:4: b = \"x\": expected"), "{lines:?}: {}", message(lines));
        }
        let many = format!("a,b\n{}", "1,x\n".repeat(1000));
        assert_eq!(message(&many).lines().count(), LISTED + 1);
        let long = format!("a,b\n1,{}", "1".repeat(1 << 17));
        assert!(message(&long).contains("line 2: the line is longer"));
    }

    #[test]
    fn semicolons_tabs_and_decimal_commas_are_read_and_said() {
        let cases = [
            ("a,b\n1,2.5\n", ""),
            ("a;b\n1;2,5\n", "read as a table with semicolons between columns, with decimal commas"),
            ("a\tb\n1\t2.5\n", "read as a table with tabs between columns"),
            (
                "sep=;\r\n\"a\";\"b\"\r\n1;\"2,5\"\r\n",
                "read as a table below a line sep= for Excel, with semicolons",
            ),
            ("\"sep=,\"\na,b\n1,2.5\n", "read as a table below a line sep= for Excel"),
        ];
        for (text, note) in cases {
            let (values, said) = read(text).unwrap();
            assert_eq!(values, [2.5], "{text:?}");
            assert!(said.starts_with(note) && said.is_empty() == note.is_empty(), "{text:?}: {said}");
        }
        let message = |text| read(text).unwrap_err().to_string();
        let mixed = message("sep=;\na;b\n1;2,5\n1;1.5\n");
        assert!(mixed.contains("a decimal comma (line 3) and with a decimal point (line 4)"), "{mixed}");
        assert!(
            message("a;b\n1;1.234,5\n")
                .contains("t.csv:2: b = \"1.234,5\": expected a number without thousands sep")
        );
        assert!(message("a,b\n1,2,5\n").contains("separate the columns by semicolons or tabs"));
    }
}
