//! Tables: a single definition of the columns gives header, rows and manifest entry.

mod columns;
pub mod truth;

use std::borrow::Cow;
use std::fmt::{Display, Write as _};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use microsig_core::formats::number;

use crate::checksums::{Fingerprint, Hashing};
use crate::error::{Error, Result};
use crate::journal;
pub use columns::{Columns, MISSING, Values};

/// A column of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Column {
    /// Name, which ends with the unit.
    pub name: &'static str,
    /// Type in the manifest: `integer`, `number` or `string`.
    pub kind: &'static str,
    /// Unit; empty if there is none.
    pub unit: &'static str,
    /// Description for the manifest.
    pub description: &'static str,
}

/// Shorthand for a [`Column`].
pub const fn column(
    name: &'static str,
    kind: &'static str,
    unit: &'static str,
    description: &'static str,
) -> Column {
    Column { name, kind, unit, description }
}

/// A table of a dataset.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Table {
    /// Path in the dataset.
    pub path: &'static str,
    /// Description for the manifest.
    pub description: &'static str,
    /// The columns.
    pub columns: Cow<'static, [Column]>,
}

impl Table {
    /// A table with these columns.
    pub const fn new(path: &'static str, description: &'static str, columns: &'static [Column]) -> Self {
        Table { path, description, columns: Cow::Borrowed(columns) }
    }

    /// Appends columns if `wanted`.
    pub fn with(mut self, columns: &[Column], wanted: bool) -> Self {
        if wanted {
            self.columns.to_mut().extend_from_slice(columns);
        }
        self
    }
}

/// Rows of a table as CSV: comma-separated, numbers in the shortest form that reads back to the same value.
#[derive(Debug)]
pub struct Rows {
    path: &'static str,
    columns: usize,
    /// Number of cells in the current row.
    cells: usize,
    text: String,
}

impl Rows {
    /// An empty buffer for rows of a table.
    pub fn of(table: &Table) -> Self {
        Rows { path: table.path, columns: table.columns.len(), cells: 0, text: String::new() }
    }

    /// As [`Rows::of`], reusing the allocation of `text`, which must be empty.
    pub fn on(table: &Table, text: String) -> Self {
        Rows { text, ..Rows::of(table) }
    }

    /// The rows as text.
    pub fn into_text(self) -> String {
        self.text
    }

    /// Appends cells to the row, quoted if necessary.
    pub fn cells(&mut self, values: &[&dyn Display]) {
        for value in values {
            self.next_cell();
            let start = self.text.len();
            // Writing to a string cannot fail.
            let _ = write!(self.text, "{value}");
            let cell = &self.text[start..];
            if cell.contains(['"', ',', '\n', '\r']) {
                let quoted = format!("\"{}\"", cell.replace('"', "\"\""));
                self.text.replace_range(start.., &quoted);
            }
        }
    }

    /// Appends numbers to the row; values that are not finite become empty cells.
    pub fn numbers(&mut self, values: &[f64]) {
        for value in values {
            self.next_cell();
            if value.is_finite() {
                number::push(&mut self.text, *value);
            }
        }
    }

    /// Appends integers to the row.
    pub fn whole_numbers(&mut self, values: &[u64]) {
        for value in values {
            self.next_cell();
            number::push_whole(&mut self.text, *value);
        }
    }

    fn next_cell(&mut self) {
        if self.cells > 0 {
            self.text.push(',');
        }
        self.cells += 1;
    }

    /// Ends a row.
    ///
    /// # Errors
    /// A row whose number of cells differs from the number of columns.
    pub fn end_row(&mut self) -> Result<()> {
        self.text.push('\n');
        let cells = std::mem::take(&mut self.cells);
        if cells == self.columns {
            return Ok(());
        }
        let message = format!("a row of {cells} cells: expected {}, one per column", self.columns);
        Err(failed(self.path, std::io::Error::other(message)))
    }
}

/// Writes a table as CSV: a header, then [`Rows`].
#[derive(Debug)]
pub struct TableWriter<W: Write> {
    writer: W,
    rows: Rows,
}

/// Writer of the tables of a dataset.
pub type TableSink = BufWriter<Hashing<File>>;

/// A table file in the folder of a dataset.
pub type TableFile = TableWriter<TableSink>;

impl TableFile {
    /// Creates the file of a table and writes the header.
    pub fn create(folder: &Path, table: &Table) -> Result<Self> {
        let path = folder.join(table.path);
        journal::record_started(&path)?;
        let file = File::create(&path).map_err(Error::write(&path))?;
        TableWriter::new(table, BufWriter::with_capacity(BUFFER, Hashing::new(file)))
    }

    /// Completes the table and returns the fingerprint of its file.
    pub fn seal(self) -> Result<Fingerprint> {
        let path = self.rows.path;
        let file = self.writer.into_inner().map_err(|e| failed(path, e.into_error()))?;
        Ok(file.fingerprint())
    }
}

/// Write buffer, bytes.
const BUFFER: usize = 1 << 15;

impl<W: Write> TableWriter<W> {
    /// Writes the header of a table.
    pub fn new(table: &Table, writer: W) -> Result<Self> {
        let mut writer = TableWriter { writer, rows: Rows::of(table) };
        table.columns.iter().for_each(|column| writer.rows.cells(&[&column.name]));
        writer.end_row()?;
        Ok(writer)
    }

    /// Writes a row, one value per column.
    pub fn row(&mut self, values: &[&dyn Display]) -> Result<()> {
        self.rows.cells(values);
        self.end_row()
    }

    /// The current row.
    pub fn cells(&mut self) -> &mut Rows {
        &mut self.rows
    }

    /// Ends the row; an error if its number of cells differs from the number of columns.
    pub fn end_row(&mut self) -> Result<()> {
        self.rows.end_row()?;
        let written = self.writer.write_all(self.rows.text.as_bytes());
        self.rows.text.clear();
        written.map_err(|e| failed(self.rows.path, e))
    }

    /// Appends rows from a separate buffer.
    pub fn append(&mut self, rows: &Rows) -> Result<()> {
        self.writer.write_all(rows.text.as_bytes()).map_err(|e| failed(self.rows.path, e))
    }

    /// Flushes the table and returns the writer.
    pub fn into_writer(mut self) -> Result<W> {
        self.writer.flush().map_err(|e| failed(self.rows.path, e))?;
        Ok(self.writer)
    }

    /// Flushes the table.
    pub fn finish(mut self) -> Result<()> {
        self.writer.flush().map_err(|e| failed(self.rows.path, e))
    }
}

fn failed(path: &str, source: std::io::Error) -> Error {
    Error::Write { path: path.into(), source }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLE: Table = Table::new(
        "t.csv",
        "",
        &[column("a", "string", "", ""), column("b", "number", "", ""), column("c", "integer", "", "")],
    );

    #[test]
    fn a_table_reads_back_as_it_was_written() {
        let mut file = Vec::new();
        let mut writer = TableWriter::new(&TABLE, &mut file).unwrap();
        let texts = ["plain", "a, b", "say \"so\"", "two\nlines", ""];
        for (k, text) in texts.iter().enumerate() {
            writer.cells().cells(&[text]);
            writer.cells().numbers(&[0.1 * k as f64]);
            writer.cells().whole_numbers(&[k as u64]);
            writer.end_row().unwrap();
        }
        let mut more = Rows::of(&TABLE);
        more.cells(&[&"more"]);
        more.numbers(&[f64::NAN]);
        more.whole_numbers(&[u64::MAX]);
        more.end_row().unwrap();
        writer.append(&more).unwrap();
        writer.finish().unwrap();
        let mut reader = csv::Reader::from_reader(file.as_slice());
        assert_eq!(reader.headers().unwrap(), vec!["a", "b", "c"]);
        let rows: Vec<csv::StringRecord> = reader.records().collect::<csv::Result<_>>().unwrap();
        assert!(texts.iter().zip(&rows).all(|(text, row)| row[0] == **text));
        assert_eq!(rows[3].get(1), Some("0.30000000000000004"));
        assert_eq!(rows[5], vec!["more", "", "18446744073709551615"]);
    }

    #[test]
    fn rows_of_another_length_are_refused() {
        let mut writer = TableWriter::new(&TABLE, Vec::new()).unwrap();
        let message = writer.row(&[&1, &2]).unwrap_err().to_string();
        assert!(message.contains("t.csv"), "{message}");
    }
}
