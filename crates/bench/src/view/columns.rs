//! Access to CSV tables by frame: an index of where each frame's rows start, and rows converted to columns
//! for the page.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use serde_json::{Map, Value};

use storage::error::{Error, Result};
use storage::input;

/// Maximum part of a table in one response, bytes.
const MAX_PART: u64 = 64 << 20;

/// A table whose rows are sorted by a whole number in the first column.
#[derive(Debug)]
pub(super) struct Indexed {
    path: PathBuf,
    pub(super) header: Vec<String>,
    /// First row of each number: number, byte offset, number of rows before it. An empty first cell counts as
    /// 0.
    starts: Vec<(u32, u64, u64)>,
    end: u64,
}

impl Indexed {
    /// Indexes a table in one pass.
    pub(super) fn open(path: &Path) -> Result<Self> {
        let failed = |e: csv::Error| Error::input(format!("{}: {e}", path.display()));
        let mut reader = csv::ReaderBuilder::new().flexible(true).from_reader(input::open(path)?);
        let header = reader.headers().map_err(failed)?.iter().map(str::to_owned).collect();
        let mut starts: Vec<(u32, u64, u64)> = Vec::new();
        let (mut row, mut rows) = (csv::ByteRecord::new(), 0);
        let mut at = reader.position().byte();
        while reader.read_byte_record(&mut row).map_err(failed)? {
            let first = row.get(0).filter(|cell| !cell.is_empty()).unwrap_or(b"0");
            let number = std::str::from_utf8(first).ok().and_then(|cell| cell.parse().ok());
            let last = starts.last().map(|(last, ..)| *last);
            match number {
                Some(number) if last.is_none_or(|last| last < number) => starts.push((number, at, rows)),
                Some(number) if last == Some(number) => {}
                _ => return Err(unsorted(path, rows)),
            }
            (rows, at) = (rows + 1, reader.position().byte());
        }
        Ok(Indexed { path: path.to_owned(), header, starts, end: at })
    }

    /// Index of a column.
    pub(super) fn column(&self, name: &str) -> Option<usize> {
        self.header.iter().position(|own| own == name)
    }

    /// The numbers for which there are rows.
    pub(super) fn numbers(&self) -> impl Iterator<Item = u32> + '_ {
        self.starts.iter().map(|(number, ..)| *number)
    }

    /// The rows of a number, and the number of rows before them in the table.
    pub(super) fn rows(&self, number: u32) -> Result<(Vec<Vec<f64>>, u64)> {
        let Ok(k) = self.starts.binary_search_by_key(&number, |(number, ..)| *number) else {
            return Ok((Vec::new(), 0));
        };
        let (_, from, before) = self.starts[k];
        let to = self.starts.get(k + 1).map_or(self.end, |(_, at, _)| *at);
        Ok((self.part(number, from, to)?, before))
    }

    /// All rows of a small table.
    pub(super) fn all(&self) -> Result<Vec<Vec<f64>>> {
        self.starts
            .first()
            .map_or_else(|| Ok(Vec::new()), |(number, from, _)| self.part(*number, *from, self.end))
    }

    fn part(&self, number: u32, from: u64, to: u64) -> Result<Vec<Vec<f64>>> {
        if to - from > MAX_PART {
            return Err(Error::input(format!("{}: {number} has too many rows to show", self.path.display())));
        }
        let failed = |e| Error::read(&self.path, e);
        let mut file: File = input::open(&self.path)?;
        file.seek(SeekFrom::Start(from)).map_err(failed)?;
        let mut bytes = vec![0; (to - from) as usize];
        file.read_exact(&mut bytes).map_err(failed)?;
        let text = String::from_utf8_lossy(&bytes);
        let cell = |cell: &str| cell.parse().ok().filter(|x: &f64| x.is_finite()).unwrap_or(f64::NAN);
        let rows = text.lines().map(|line| {
            let mut row: Vec<f64> = line.split(',').map(cell).collect();
            row.resize(self.header.len(), f64::NAN);
            row
        });
        Ok(rows.collect())
    }
}

fn unsorted(path: &Path, rows: u64) -> Error {
    let expected = "expected a whole number in the first column, not less than in the previous row";
    Error::input(format!("{}:{}: {expected}", path.display(), rows + 2))
}

/// A list of numbers; null for those that are not finite.
pub(super) fn list(values: impl IntoIterator<Item = f64>) -> Value {
    Value::Array(values.into_iter().map(number).collect())
}

/// A number; null if it is not finite.
pub(super) fn number(value: f64) -> Value {
    // Integers are written without a decimal point.
    if value == value.trunc() && value.abs() < 9e15 {
        return Value::from(value as i64);
    }
    serde_json::Number::from_f64(value).map_or(Value::Null, Value::Number)
}

/// Rows as one list per column.
pub(super) fn by_column<'a>(
    header: impl IntoIterator<Item = &'a String>,
    rows: &[Vec<f64>],
) -> Map<String, Value> {
    let columns = header.into_iter().enumerate();
    columns.map(|(k, name)| (name.clone(), list(rows.iter().map(|row| row[k])))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn indexed(text: &str) -> Result<Indexed> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        std::fs::write(&path, text).unwrap();
        let index = Indexed::open(&path)?;
        // Rows are checked here because the folder is deleted afterwards.
        for number in 0..12 {
            let expected: Vec<&str> = text
                .lines()
                .skip(1)
                .filter(|line| line.split(',').next().unwrap().parse().unwrap_or(0) == number)
                .collect();
            let (rows, before) = index.rows(number)?;
            assert_eq!(rows.len(), expected.len(), "{number}");
            if let Some(first) = expected.first() {
                assert_eq!(text.lines().skip(1).position(|line| line == *first), Some(before as usize));
            }
        }
        Ok(index)
    }

    #[test]
    fn rows_are_found_by_their_first_cell() {
        let index = indexed("frame,x,y\n0,1,2\n0,2,\n3,-1.5,inf\n10,1e3,4\n10,2,3\n11,0,0\n").unwrap();
        assert_eq!(index.numbers().collect::<Vec<_>>(), [0, 3, 10, 11]);
        assert_eq!((index.column("y"), index.column("z")), (Some(2), None));
        assert!(indexed("pair,x\n,1\n,2\n").unwrap().numbers().eq([0]));
        assert!(indexed("frame,x\n").unwrap().numbers().next().is_none());
        let many: String = (0..40_000).map(|i| format!("{},{}\n", i / 5000, "7".repeat(i % 23))).collect();
        assert_eq!(indexed(&format!("frame,x\n{many}")).unwrap().numbers().count(), 8);
        assert!(indexed("frame,x\n1,2\n0,2\n").unwrap_err().to_string().contains("t.csv:3"));
        assert!(indexed("frame,x\na,2\n").is_err());
    }

    #[test]
    fn numbers_that_are_not_finite_are_null() {
        assert_eq!(list([1.0, -0.5, f64::NAN, f64::INFINITY]).to_string(), "[1,-0.5,null,null]");
        let rows = [vec![1.0, f64::NAN], vec![2.0, 0.25]];
        let columns = by_column(&["a".to_owned(), "b".to_owned()], &rows);
        assert_eq!(Value::Object(columns).to_string(), r#"{"a":[1,2],"b":[null,0.25]}"#);
    }
}
