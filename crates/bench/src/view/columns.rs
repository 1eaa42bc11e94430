//! Access to CSV tables by frame: an index of where each frame's rows start, and rows converted to columns
//! for the page.

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
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
    header: Vec<String>,
    /// First row of each number: number, byte offset, number of rows before it. An empty first cell counts as
    /// 0.
    starts: Vec<(u32, u64, u64)>,
    end: u64,
}

impl Indexed {
    /// Indexes a table in one pass.
    ///
    /// # Errors
    /// A file that cannot be read; a first column that is not sorted whole numbers.
    pub(super) fn open(path: &Path) -> Result<Self> {
        let failed = |e| Error::read(path, e);
        let mut reader = BufReader::with_capacity(1 << 18, input::open(path)?);
        let mut header = String::new();
        let mut at = (&mut reader).take(1 << 16).read_line(&mut header).map_err(failed)? as u64;
        let header: Vec<String> = header.trim_end().split(',').map(str::to_owned).collect();
        let mut starts: Vec<(u32, u64, u64)> = Vec::new();
        // State of the current row: value of the first cell so far, whether it continues, byte offset of the
        // row; and the number of rows.
        let (mut number, mut in_first, mut row_at, mut rows) = (0u32, true, at, 0u64);
        loop {
            let piece = reader.fill_buf().map_err(failed)?;
            if piece.is_empty() {
                break;
            }
            let (n, mut i) = (piece.len(), 0);
            while i < n {
                if !in_first {
                    // The rest of the row is skipped.
                    match piece[i..].iter().position(|byte| *byte == b'\n') {
                        None => break,
                        Some(length) => i += length + 1,
                    }
                    (number, in_first, row_at) = (0, true, at + i as u64);
                    continue;
                }
                match piece[i] {
                    digit @ b'0'..=b'9' => {
                        number = number.saturating_mul(10).saturating_add(u32::from(digit - b'0'));
                    }
                    b',' => {
                        in_first = false;
                        match starts.last() {
                            Some((last, ..)) if *last > number => return Err(unsorted(path, rows)),
                            Some((last, ..)) if *last == number => {}
                            _ => starts.push((number, row_at, rows)),
                        }
                        rows += 1;
                    }
                    _ => return Err(unsorted(path, rows)),
                }
                i += 1;
            }
            at += n as u64;
            reader.consume(n);
        }
        Ok(Indexed { path: path.to_owned(), header, starts, end: at })
    }

    /// Names of the columns.
    pub(super) fn header(&self) -> &[String] {
        &self.header
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
    ///
    /// # Errors
    /// A file that has changed; too many rows for a response.
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
