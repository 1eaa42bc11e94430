//! `cases.csv`, the table of a sweep's cases.

use std::fs::File;
use std::ops::Range;
use std::path::Path;

use crate::Result;
use crate::dataset::TableReader;

/// Name of the table, beside the folders of the cases.
pub const CASES: &str = "cases.csv";

/// The columns before the axes.
pub const BEFORE_AXES: [&str; 4] = ["case", "dataset", "repetition", "seed"];

/// The first column after the axes.
pub const STATUS: &str = "status";

/// Reads the table row by row.
#[derive(Debug)]
pub struct CaseReader {
    reader: TableReader<File>,
    dataset: usize,
    axes: Range<usize>,
}

impl CaseReader {
    /// Opens the table in the folder of a sweep; `None` if it is a table of other columns.
    pub fn open(sweep: &Path) -> Result<Option<Self>> {
        let reader = TableReader::open(sweep.join(CASES))?;
        let column = |name| reader.column(name);
        let columns = (column(BEFORE_AXES[1]), column(BEFORE_AXES[3]), column(STATUS));
        let (Some(dataset), Some(last), Some(after)) = columns else { return Ok(None) };
        Ok(Some(CaseReader { dataset, axes: last + 1..after, reader }))
    }

    /// Paths of the axes.
    pub fn axes(&self) -> &[String] {
        self.reader.header().get(self.axes.clone()).unwrap_or_default()
    }

    /// The next case: name of its dataset, values of the axes as written; `None` at the end. Errors: reading;
    /// a row with another number of cells than the header.
    pub fn next_case(&mut self) -> Result<Option<(String, Vec<String>)>> {
        let (dataset, axes) = (self.dataset, self.axes.clone());
        let Some((_, cells)) = self.reader.next_row()? else { return Ok(None) };
        let values = axes.map(|i| cells[i].to_owned()).collect();
        Ok(Some((cells[dataset].to_owned(), values)))
    }
}
