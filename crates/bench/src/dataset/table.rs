//! Tables: one definition of columns serves the header, the rows and the manifest.

use std::borrow::Cow;
use std::fmt::Display;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use microsig_core::formats::number;

use crate::error::{Error, Result};

/// A column of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Column {
    /// Name, with the unit at its end.
    pub name: &'static str,
    /// Type in the manifest: `integer`, `number` or `string`.
    pub kind: &'static str,
    /// Unit; empty if there is none.
    pub unit: &'static str,
    /// What it holds.
    pub description: &'static str,
}

/// Short for a column's definition.
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
    /// What a row is.
    pub description: &'static str,
    /// The columns.
    pub columns: Cow<'static, [Column]>,
}

impl Table {
    /// A table.
    pub const fn new(path: &'static str, description: &'static str, columns: &'static [Column]) -> Self {
        Table { path, description, columns: Cow::Borrowed(columns) }
    }

    /// The table with further columns at its end, if they are asked for.
    pub fn with(mut self, columns: &[Column], wanted: bool) -> Self {
        if wanted {
            self.columns.to_mut().extend_from_slice(columns);
        }
        self
    }
}

/// Writes rows of a table as CSV: comma, header, shortest numbers that read back to the same value.
#[derive(Debug)]
pub struct TableWriter<W: Write> {
    path: &'static str,
    writer: csv::Writer<W>,
    cell: String,
}

impl TableWriter<BufWriter<File>> {
    /// Begins a table in a dataset's folder.
    pub fn create(folder: &Path, table: &Table) -> Result<Self> {
        let path = folder.join(table.path);
        TableWriter::new(table, BufWriter::new(File::create(&path).map_err(Error::write(&path))?))
    }
}

impl<W: Write> TableWriter<W> {
    /// Begins a table with its header.
    pub fn new(table: &Table, writer: W) -> Result<Self> {
        let mut writer = csv::Writer::from_writer(writer);
        writer.write_record(table.columns.iter().map(|c| c.name)).map_err(|e| failed(table.path, e))?;
        Ok(TableWriter { path: table.path, writer, cell: String::new() })
    }

    /// Writes a row, one value per column.
    pub fn row(&mut self, values: &[&dyn Display]) -> Result<()> {
        self.cells(values)?;
        self.end_row()
    }

    /// Writes part of a row.
    pub fn cells(&mut self, values: &[&dyn Display]) -> Result<()> {
        use std::fmt::Write;
        for value in values {
            self.cell.clear();
            // Writing to a string cannot fail.
            let _ = write!(self.cell, "{value}");
            self.writer.write_field(&self.cell).map_err(|e| failed(self.path, e))?;
        }
        Ok(())
    }

    /// Writes numbers into a row; those that are not finite are missing values, empty cells.
    pub fn numbers(&mut self, values: &[f64]) -> Result<()> {
        for value in values {
            self.cell.clear();
            if value.is_finite() {
                number::push(&mut self.cell, *value);
            }
            self.writer.write_field(&self.cell).map_err(|e| failed(self.path, e))?;
        }
        Ok(())
    }

    /// Ends a row; the writer refuses one whose number of cells differs from the header's.
    pub fn end_row(&mut self) -> Result<()> {
        self.writer.write_record(None::<&[u8]>).map_err(|e| failed(self.path, e))
    }

    /// Ends the table.
    pub fn finish(mut self) -> Result<()> {
        self.writer.flush().map_err(|e| failed(self.path, csv::Error::from(e)))
    }
}

fn failed(path: &str, e: csv::Error) -> Error {
    Error::Write { path: path.into(), source: std::io::Error::other(e) }
}
