//! Tables stored by column.

use std::io::Read;

use crate::error::{Error, Result};

/// Marks a missing integer; integer columns contain no negative numbers otherwise.
pub const MISSING: i64 = -1;

/// The values of a column.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// Integers; [`MISSING`] for an empty cell.
    Whole(Vec<i64>),
    /// Floating-point numbers; NaN for an empty cell.
    Numbers(Vec<f64>),
    /// Strings.
    Texts(Vec<String>),
}

/// Columns of a table (name and values) in file order.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Columns(pub Vec<(String, Values)>);

impl Columns {
    /// Reads a CSV table. `kind` maps the name of a column to its type: "integer", "number" or, for strings,
    /// anything else (see [`super::Column::kind`]).
    ///
    /// # Errors
    /// [`Error::Input`] with the line that is not CSV or has a value of another type than its column.
    pub fn read<'k>(name: &str, csv: impl Read, kind: impl Fn(&str) -> &'k str) -> Result<Self> {
        let broken = |e: csv::Error| Error::input(format!("{name}: {e}"));
        let mut reader = csv::Reader::from_reader(csv);
        let header = reader.headers().map_err(broken)?.clone();
        let mut columns: Vec<(String, Values)> = header
            .iter()
            .map(|column| {
                let values = match kind(column) {
                    "integer" => Values::Whole(Vec::new()),
                    "number" => Values::Numbers(Vec::new()),
                    _ => Values::Texts(Vec::new()),
                };
                (column.to_owned(), values)
            })
            .collect();
        let mut record = csv::StringRecord::new();
        while reader.read_record(&mut record).map_err(broken)? {
            for (cell, (column, values)) in record.iter().zip(&mut columns) {
                if !values.push(cell) {
                    let line = record.position().map_or(0, csv::Position::line);
                    return Err(Error::input(format!(
                        "{name}:{line}: {column} = {cell:?}: expected a number"
                    )));
                }
            }
        }
        Ok(Columns(columns))
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.0.first().map_or(0, |(_, values)| match values {
            Values::Whole(values) => values.len(),
            Values::Numbers(values) => values.len(),
            Values::Texts(values) => values.len(),
        })
    }
}

impl Values {
    /// Appends the value of a cell; returns `false` if the cell has another type.
    fn push(&mut self, cell: &str) -> bool {
        match self {
            Values::Whole(values) if cell.is_empty() => values.push(MISSING),
            Values::Numbers(values) if cell.is_empty() => values.push(f64::NAN),
            Values::Whole(values) => match cell.parse() {
                Ok(value) => values.push(value),
                Err(_) => return false,
            },
            Values::Numbers(values) => match cell.parse() {
                Ok(value) => values.push(value),
                Err(_) => return false,
            },
            Values::Texts(values) => values.push(cell.to_owned()),
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_read_by_type_and_missing_values_are_told() {
        let kind = |name: &str| match name {
            "n" => "integer",
            "x" => "number",
            _ => "string",
        };
        let read = Columns::read("t.csv", "n,x,s\n3,0.1,a\n,,\n".as_bytes(), kind).unwrap();
        assert_eq!(read.rows(), 2);
        assert_eq!(read.0[0].1, Values::Whole(vec![3, MISSING]));
        assert!(matches!(&read.0[1].1, Values::Numbers(x) if x[0] == 0.1 && x[1].is_nan()));
        assert_eq!(read.0[2].1, Values::Texts(vec!["a".to_owned(), String::new()]));
        let message = Columns::read("t.csv", "n\n1\nx\n".as_bytes(), kind).unwrap_err().to_string();
        assert_eq!(message, "t.csv:3: n = \"x\": expected a number");
    }
}
