//! Reader of text tables: limits lines and rows, finds columns by name, reports problems with line numbers.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use csv::{ByteRecord, ReaderBuilder, Trim};
use microsig_core::Spheroid;

use super::conventions::MAX_ROWS;
use super::{Converter, DroppedRows, Points, TrackRow, Velocities, VelocityUnit};
use storage::error::{Error, Result};
use storage::input;

/// Maximum length of a line, or distance between the ends of two XML tags, bytes.
const LONGEST_LINE: usize = 1 << 16;

/// Maximum number of problems listed in full.
const LISTED: usize = 10;

/// A reader that fails if a line is too long.
#[derive(Debug)]
pub(crate) struct Bounded<R> {
    inner: R,
    end: u8,
    length: usize,
    line: u64,
}

impl<R: Read> Bounded<R> {
    /// Pieces end with the byte `end`: a newline, or `>` in XML.
    pub(crate) fn new(inner: R, end: u8) -> Self {
        Bounded { inner, end, length: 0, line: 1 }
    }
}

impl<R: Read> Read for Bounded<R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let n = self.inner.read(buffer)?;
        for &byte in &buffer[..n] {
            self.length += 1;
            self.line += u64::from(byte == b'\n');
            if byte == self.end {
                self.length = 0;
            }
            if self.length > LONGEST_LINE {
                let what = if self.end == b'\n' { "the line" } else { "a tag or text" };
                let message = format!("line {}: {what} is longer than {LONGEST_LINE} bytes", self.line);
                return Err(std::io::Error::new(std::io::ErrorKind::InvalidData, message));
            }
        }
        Ok(n)
    }
}

/// A reader of text whose lines all end with a single newline, also those that end with a carriage return,
/// with both, or with the file.
#[derive(Debug)]
struct UnixLines<R> {
    inner: R,
    /// Whether the last byte read was a carriage return, for which a newline was given.
    after_return: bool,
    /// The last byte given.
    last: u8,
}

impl<R: Read> UnixLines<R> {
    fn new(inner: R) -> Self {
        UnixLines { inner, after_return: false, last: b'\n' }
    }
}

impl<R: Read> Read for UnixLines<R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        if buffer.is_empty() {
            return Ok(0);
        }
        loop {
            let n = self.inner.read(buffer)?;
            if n == 0 {
                if self.last == b'\n' {
                    return Ok(0);
                }
                (self.last, buffer[0]) = (b'\n', b'\n');
                return Ok(1);
            }
            let mut given = n;
            if self.after_return || buffer[..n].contains(&b'\r') {
                given = 0;
                for i in 0..n {
                    let byte = buffer[i];
                    if !(self.after_return && byte == b'\n') {
                        buffer[given] = if byte == b'\r' { b'\n' } else { byte };
                        given += 1;
                    }
                    self.after_return = byte == b'\r';
                }
            }
            if given > 0 {
                self.last = buffer[given - 1];
                return Ok(given);
            }
        }
    }
}

/// Column separator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Separator {
    /// A comma.
    Comma,
    /// One or more tabs or spaces.
    Space,
}

enum Source {
    Comma(csv::Reader<UnixLines<Bounded<File>>>),
    Space(BufReader<UnixLines<Bounded<File>>>, u64),
}

/// A table in a text file.
pub struct TextTable {
    name: String,
    header: Vec<String>,
    source: Source,
    waiting: Option<(u64, ByteRecord)>,
    rows: usize,
    most_rows: usize,
    problems: Vec<String>,
    /// Requested columns that appear more than once.
    twice: RefCell<BTreeSet<String>>,
}

impl TextTable {
    /// Opens a table whose header is line `header_line`, counted from 1.
    pub fn open(path: &Path, separator: Separator, header_line: u64) -> Result<Self> {
        let file = UnixLines::new(Bounded::new(input::open(path)?, b'\n'));
        let source = match separator {
            Separator::Comma => Source::Comma(
                ReaderBuilder::new()
                    .has_headers(false)
                    .flexible(true)
                    .quoting(false)
                    .trim(Trim::All)
                    .from_reader(file),
            ),
            Separator::Space => Source::Space(BufReader::new(file), 0),
        };
        let name = path.display().to_string();
        let mut sheet = TextTable {
            name,
            header: Vec::new(),
            source,
            waiting: None,
            rows: 0,
            most_rows: MAX_ROWS,
            problems: Vec::new(),
            twice: RefCell::default(),
        };
        let mut record = ByteRecord::new();
        for _ in 0..header_line {
            if sheet.record(&mut record)?.is_none() {
                return Err(Error::input(format!("{}: empty; expected at least a header", sheet.name)));
            }
        }
        let clean = |field: &[u8]| {
            String::from_utf8_lossy(field).trim_matches(['"', '\u{feff}', '#', ' ']).to_owned()
        };
        sheet.header =
            record.iter().map(clean).filter(|f| separator == Separator::Comma || !f.is_empty()).collect();
        Ok(sheet)
    }

    /// Skips up to three rows below the header that have words instead of numbers in this column; returns the
    /// words.
    pub(crate) fn skip_words(&mut self, column: usize) -> Result<Vec<String>> {
        let (mut words, mut record) = (Vec::new(), ByteRecord::new());
        while let Some(line) = self.record(&mut record)? {
            let text = String::from_utf8_lossy(record.get(column).unwrap_or_default()).into_owned();
            if words.len() == 3 || text.is_empty() || text.parse::<f64>().is_ok() {
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
            Source::Comma(reader) => {
                let more = reader.read_byte_record(record).map_err(|e| failed(std::io::Error::from(e)))?;
                // A record is a line; its own position is that of empty lines before it.
                Ok(more.then(|| reader.position().line() - 1))
            }
            Source::Space(reader, line) => {
                let mut text = Vec::new();
                loop {
                    text.clear();
                    if reader.read_until(b'\n', &mut text).map_err(failed)? == 0 {
                        return Ok(None);
                    }
                    *line += 1;
                    let fields = text.split(u8::is_ascii_whitespace).filter(|f| !f.is_empty());
                    record.clear();
                    fields.for_each(|f| record.push_field(f));
                    if !record.is_empty() {
                        return Ok(Some(*line));
                    }
                }
            }
        }
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
        let mut found = self.header.iter().enumerate().filter(|(_, h)| *h == name);
        let first = found.next();
        if found.next().is_some() {
            self.twice.borrow_mut().insert(name.to_owned());
        }
        first.map(|(i, _)| i)
    }

    /// Index of a required column.
    pub fn need(&self, name: &str) -> Result<usize> {
        self.column(name).ok_or_else(|| {
            let there = super::shown(&self.header.join(", "));
            Error::input(format!("{}: column {name} is missing; found {there}", self.name))
        })
    }

    /// Calls `each` with every row and collects the problems it reports.
    ///
    /// # Errors
    /// All problems, shortened to a readable list.
    pub fn rows(mut self, mut each: impl FnMut(&Cells<'_>) -> std::result::Result<(), String>) -> Result<()> {
        let twice = self.twice.take();
        if !twice.is_empty() {
            let message = |column: &String| format!("{}: column {column} appears twice", self.name);
            return Err(Error::Input(twice.iter().map(message).collect()));
        }
        let mut record = ByteRecord::new();
        while let Some(line) = self.record(&mut record)? {
            self.rows += 1;
            if self.rows > self.most_rows {
                return Err(Error::input(format!("{}: more than {} rows", self.name, self.most_rows)));
            }
            let wrong = if record.len() == self.header.len() {
                each(&Cells { record: &record, header: &self.header, line }).err()
            } else {
                let hint =
                    if record.len() > self.header.len() { " (numbers with decimal commas?)" } else { "" };
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
        shorten(&mut self.problems);
        if self.problems.is_empty() { Ok(()) } else { Err(Error::Input(self.problems)) }
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
        self.rows(|cells| {
            let (frame, track, [x, y, z]) = row(cells)?;
            if frame.is_nan() {
                dropped.at(cells.line);
                return Ok(());
            }
            let frame = converter.frame(frame)?;
            match converter.position(x, y, z)? {
                Some(at) => {
                    points.rows.push(TrackRow { frame, track, at });
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
        points.velocities = unit.map(|unit| Velocities { unit, rows: velocities });
        points.notes = converter.notes;
        points.n_nan = dropped.told(&mut points.notes);
        Ok(points)
    }
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
}

/// Columns with the symmetry axis of a spheroid.
#[derive(Debug, Clone, Copy)]
pub(crate) enum AxisColumns {
    /// Components along x, y, z.
    Vector([usize; 3]),
    /// Angles alpha and beta of MicroSIG's data file, rad.
    Angles([usize; 2]),
}

/// The cells of a row.
pub struct Cells<'a> {
    record: &'a ByteRecord,
    header: &'a [String],
    /// Line in the file.
    pub line: u64,
}

impl Cells<'_> {
    /// The number in a cell; NaN if the cell is empty, `NaN` or TrackMate's empty-set sign.
    pub fn number(&self, column: usize) -> std::result::Result<f64, String> {
        let text = std::str::from_utf8(&self.record[column]).unwrap_or("?").trim_matches('"');
        if let Ok(number) = text.parse::<f64>() {
            return Ok(number);
        }
        if text.is_empty() || text == "\u{f8}" {
            return Ok(f64::NAN);
        }
        let hint = if text.contains(',') { " with a decimal point, not a comma" } else { "" };
        Err(format!("{} = {:?}: expected a number{hint}", self.header[column], super::shown(text)))
    }

    /// The text of a cell.
    ///
    /// # Errors
    /// Bytes that are not UTF-8.
    pub fn text(&self, column: usize) -> std::result::Result<&str, String> {
        let text = std::str::from_utf8(&self.record[column]).map(|text| text.trim_matches('"'));
        text.map_err(|_| format!("{}: expected UTF-8 text", self.header[column]))
    }

    /// Names of columns, empty for missing ones.
    fn names(&self, columns: [Option<usize>; 3]) -> [&str; 3] {
        columns.map(|c| c.map_or("", |c| self.header[c].as_str()))
    }

    /// The number in an optional column; NaN if the column is missing.
    pub(crate) fn number_or_nan(&self, column: Option<usize>) -> std::result::Result<f64, String> {
        column.map_or(Ok(f64::NAN), |c| self.number(c))
    }

    /// The track in a cell, an integer; -1 (not linked) if the column or number is missing or negative.
    pub fn track(&self, column: Option<usize>) -> std::result::Result<i64, String> {
        let Some(column) = column else { return Ok(-1) };
        let value = self.number(column)?;
        if value.is_nan() {
            return Ok(-1);
        }
        // Beyond 2^53 not every integer is representable as f64.
        if value.fract() != 0.0 || value.abs() > 9_007_199_254_740_992.0 {
            return Err(format!("{} = {value:?}: expected a whole number", self.header[column]));
        }
        Ok(if value < 0.0 { -1 } else { value as i64 })
    }
}

/// Shortens a list of problems.
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

    fn sheet(text: &str, separator: Separator) -> Result<Vec<f64>> {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("t.csv");
        std::fs::write(&path, text).unwrap();
        let sheet = TextTable::open(&path, separator, 1)?;
        let column = sheet.need("b")?;
        let mut values = Vec::new();
        sheet.rows(|cells| {
            values.push(cells.number(column)?);
            Ok(())
        })?;
        Ok(values)
    }

    #[test]
    fn line_ends_quotes_and_empty_lines_do_not_matter() {
        assert_eq!(sheet("a,\"b\"\r\n1,2\r\n\r\n3,\"4\"", Separator::Comma).unwrap(), [2.0, 4.0]);
        assert_eq!(sheet("# a\tb\n 1  2.5e0\n\n3\t4\n", Separator::Space).unwrap(), [2.5, 4.0]);
    }

    #[test]
    fn problems_name_their_lines() {
        let message = |text| sheet(text, Separator::Comma).unwrap_err().to_string();
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
        let long = format!("a,b\n1,{}", "1".repeat(LONGEST_LINE + 1));
        assert!(message(&long).contains("line 2: the line is longer"));
    }
}
