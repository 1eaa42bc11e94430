use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use crate::checksums::{Fingerprint, Hashing};
use crate::{Error, OutputFolder, Result};

use crate::dataset::table::{Row, Table};

/// Writes a table as CSV: a header, then rows.
#[derive(Debug)]
pub struct TableWriter {
    path: &'static str,
    writer: BufWriter<Hashing<File>>,
}

/// Write buffer, bytes.
const BUFFER: usize = 1 << 15;

impl TableWriter {
    /// Creates the file of a table in the folder of a dataset and writes the header.
    pub fn create(folder: &OutputFolder, table: &Table) -> Result<Self> {
        let writer = BufWriter::with_capacity(BUFFER, Hashing::new(folder.create(table.path)?));
        let mut writer = TableWriter { path: table.path, writer };
        writer.append(&table.header())?;
        Ok(writer)
    }

    /// Appends rows that [`Table::text`] has written.
    pub fn append(&mut self, rows: &str) -> Result<()> {
        self.writer.write_all(rows.as_bytes()).map_err(Error::write(Path::new(self.path)))
    }

    /// Completes the table and returns the fingerprint of its file.
    pub fn seal(self) -> Result<Fingerprint> {
        let failed = |e: std::io::Error| Error::write(Path::new(self.path))(e);
        let file = self.writer.into_inner().map_err(|e| failed(e.into_error()))?;
        Ok(file.fingerprint())
    }
}

/// Writes a whole table into the folder of a dataset.
pub fn write_table<R: Row>(folder: &OutputFolder, table: &Table, rows: &[R]) -> Result<()> {
    let mut writer = TableWriter::create(folder, table)?;
    writer.append(&table.text(rows))?;
    writer.seal().map(drop)
}
