//! Reads the tables of datasets (CSV). Columns are found by name, and others are skipped.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::{Error, InputFile, Result};

use crate::dataset::table::{Cell, Columns, MISSING, Row, Values};

/// Number of rows after whose problems a table is given up: most of its rows are wrong.
const MOST_PROBLEMS: usize = 100;

/// A table that is read row by row.
#[derive(Debug)]
pub struct TableReader<R> {
    name: String,
    reader: csv::Reader<R>,
    header: Vec<String>,
    record: csv::StringRecord,
}

impl TableReader<File> {
    /// Opens a table; it must be a regular file.
    pub fn open(path: impl Into<InputFile>) -> Result<Self> {
        let file = path.into();
        TableReader::new(&file.display().to_string(), file.open()?)
    }
}

/// What is wrong with a table, or why it cannot be read.
fn unreadable(name: &str, error: csv::Error) -> Error {
    let what = error.to_string();
    match error.into_kind() {
        csv::ErrorKind::Io(source) => Error::read(Path::new(name), source),
        _ => Error::input(format!("{name}: {what}")),
    }
}

impl<R: Read> TableReader<R> {
    /// A table of this name in messages.
    pub fn new(name: &str, reader: R) -> Result<Self> {
        let mut reader = csv::ReaderBuilder::new().flexible(true).trim(csv::Trim::All).from_reader(reader);
        let header = reader.headers().map_err(|e| unreadable(name, e))?;
        let header: Vec<String> = header.iter().map(str::to_owned).collect();
        Ok(TableReader { name: name.to_owned(), reader, header, record: csv::StringRecord::new() })
    }

    /// Names of the columns.
    pub fn header(&self) -> &[String] {
        &self.header
    }

    /// Number of a column.
    pub fn column(&self, name: &str) -> Option<usize> {
        self.header.iter().position(|own| own == name)
    }

    /// The same with a column called `name`.
    pub fn renamed(mut self, column: &str, name: &str) -> Self {
        self.header.iter_mut().filter(|own| *own == column).for_each(|own| *own = name.to_owned());
        self
    }

    /// The cells of the next row and its line. Errors: a file that cannot be read; a row of another length
    /// than the header.
    pub fn next_row(&mut self) -> Result<Option<(u64, &csv::StringRecord)>> {
        let more = self.reader.read_record(&mut self.record);
        if !more.map_err(|e| unreadable(&self.name, e))? {
            return Ok(None);
        }
        let (line, fields) = (self.record.position().map_or(0, csv::Position::line), self.record.len());
        if fields != self.header.len() {
            let (name, n) = (&self.name, self.header.len());
            return Err(Error::input(format!("{name}:{line}: {fields} fields where the header has {n}")));
        }
        Ok(Some((line, &self.record)))
    }

    /// Calls `each` with line and contents of every row, which must have the columns in `needed`. Returns
    /// what was read from. Errors: a missing column; all problems of rows, also those that `each` finds,
    /// shortened to a readable list.
    pub fn rows<T: Row>(
        mut self,
        needed: &[&str],
        mut each: impl FnMut(u64, T) -> std::result::Result<(), String>,
    ) -> Result<R> {
        if let Some(missing) = needed.iter().find(|name| self.column(name).is_none()) {
            let there: String = self.header.join(", ").chars().take(80).collect();
            return Err(Error::input(format!("{}: column {missing} is missing; found {there}", self.name)));
        }
        let columns: Vec<Option<usize>> = T::COLUMNS.iter().map(|column| self.column(column.name)).collect();
        let (name, mut problems) = (self.name.clone(), Vec::new());
        while let Some((line, cells)) = self.next_row()? {
            let mut record = Record { cells, columns: columns.iter().zip(T::COLUMNS) };
            if let Err(problem) = T::read(&mut record).and_then(|row| each(line, row)) {
                problems.push(format!("{name}:{line}: {problem}"));
                if problems.len() > MOST_PROBLEMS {
                    break;
                }
            }
        }
        if problems.is_empty() { Ok(self.reader.into_inner()) } else { Err(Error::Input(problems)) }
    }

    /// The columns of the table. `kind` maps the name of a column to its type: "integer", "number" or, for
    /// strings, anything else (see [`crate::dataset::Column::kind`]). Errors: the first row with a value of
    /// another type than its column.
    pub fn columns<'k>(mut self, kind: impl Fn(&str) -> &'k str) -> Result<Columns> {
        let empty = |name: &String| match kind(name) {
            "integer" => Values::Whole(Vec::new()),
            "number" => Values::Numbers(Vec::new()),
            _ => Values::Texts(Vec::new()),
        };
        let mut columns: Vec<(String, Values)> =
            self.header.iter().map(|name| (name.clone(), empty(name))).collect();
        let name = self.name.clone();
        while let Some((line, cells)) = self.next_row()? {
            for (cell, (column, values)) in cells.iter().zip(&mut columns) {
                if !push(values, cell) {
                    let what = format!("{column} = {cell:?}: expected a number");
                    return Err(Error::input(format!("{name}:{line}: {what}")));
                }
            }
        }
        Ok(Columns(columns))
    }
}

/// Appends the value of a cell; returns `false` if the cell has another type.
fn push(values: &mut Values, cell: &str) -> bool {
    match values {
        Values::Whole(values) if cell.is_empty() => values.push(MISSING),
        Values::Whole(values) => match cell.parse() {
            Ok(value) => values.push(value),
            Err(_) => return false,
        },
        Values::Numbers(values) => match f64::read(cell) {
            Some(value) => values.push(value),
            None => return false,
        },
        Values::Texts(values) => values.push(cell.to_owned()),
    }
    true
}

/// The rows of a table in a dataset, which must have the columns in `needed`.
pub fn read_rows<T: Row>(dataset: &Path, needed: &[&str]) -> Result<Vec<T>> {
    let mut rows = Vec::new();
    let keep = |_: u64, row: T| {
        rows.push(row);
        Ok(())
    };
    TableReader::open(dataset.join(T::PATH))?.rows(needed, keep)?;
    Ok(rows)
}

/// Refuses a frame that a recording does not have.
pub fn check_frame(frame: u32, frames: usize) -> std::result::Result<(), String> {
    if (frame as usize) < frames {
        Ok(())
    } else {
        Err(format!("frame = {frame}: expected 0 to {}", frames - 1))
    }
}

/// Refuses a position (px, the first pixel's center is 1) beyond images of this size.
pub fn check_position(at: [f64; 2], (width, height): (usize, usize)) -> std::result::Result<(), String> {
    for (name, value, size) in [("x_px", at[0], width), ("y_px", at[1], height)] {
        let (low, high) = (0.5, size as f64 + 0.5);
        if !(low..=high).contains(&value) {
            return Err(format!("{name} = {value}: expected {low} to {high}"));
        }
    }
    Ok(())
}

/// The cells of a row while it is read.
#[derive(Debug)]
pub struct Record<'r> {
    cells: &'r csv::StringRecord,
    columns: std::iter::Zip<
        std::slice::Iter<'r, Option<usize>>,
        std::slice::Iter<'static, crate::dataset::Column>,
    >,
}

impl Record<'_> {
    /// The next cell, or the value of an absent one. Errors: a cell of another type, by name and value.
    pub fn take<C: Cell>(&mut self) -> std::result::Result<C, String> {
        let Some((Some(column), about)) = self.columns.next() else { return Ok(C::ABSENT) };
        let cell = self.cells.get(*column).unwrap_or_default();
        C::read(cell).ok_or_else(|| format!("{} = {cell:?}: expected a number", about.name))
    }
}
