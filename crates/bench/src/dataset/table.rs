//! Tables: one definition of columns serves the header, the rows and the manifest.

use std::fmt::Display;
use std::io::Write;

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
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Table {
    /// Path in the dataset.
    pub path: &'static str,
    /// What a row is.
    pub description: &'static str,
    /// The columns.
    pub columns: &'static [Column],
}

/// Writes rows of a table as CSV: comma, header, shortest numbers that read back to the same value.
#[derive(Debug)]
pub struct TableWriter<W: Write> {
    table: &'static Table,
    writer: csv::Writer<W>,
    cell: String,
}

impl<W: Write> TableWriter<W> {
    /// Begins a table with its header.
    pub fn new(table: &'static Table, writer: W) -> Result<Self> {
        let mut writer = csv::Writer::from_writer(writer);
        writer.write_record(table.columns.iter().map(|c| c.name)).map_err(|e| failed(table, e))?;
        Ok(TableWriter { table, writer, cell: String::new() })
    }

    /// Writes a row, one value per column.
    pub fn row(&mut self, values: &[&dyn Display]) -> Result<()> {
        use std::fmt::Write;
        for value in values {
            self.cell.clear();
            // Writing to a string cannot fail.
            let _ = write!(self.cell, "{value}");
            self.writer.write_field(&self.cell).map_err(|e| failed(self.table, e))?;
        }
        // The writer refuses a row whose number of fields differs from the header's.
        self.writer.write_record(None::<&[u8]>).map_err(|e| failed(self.table, e))
    }

    /// Ends the table.
    pub fn finish(mut self) -> Result<()> {
        self.writer.flush().map_err(|e| failed(self.table, csv::Error::from(e)))
    }
}

fn failed(table: &Table, e: csv::Error) -> Error {
    Error::Write { path: table.path.into(), source: std::io::Error::other(e) }
}
