//! Tables: a struct of a row gives the header, the manifest's columns, writing and reading; tables stored by column.

use microsig_core::formats::number;

use crate::dataset::read::Record;

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
    /// Name of the optional columns that it belongs to; empty if it is always there.
    pub part: &'static str,
}

/// A table of a dataset: the columns that it has.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Table {
    /// Path in the dataset.
    pub path: &'static str,
    /// Description for the manifest.
    pub description: &'static str,
    /// The columns.
    pub columns: Vec<Column>,
    /// For each column of the row whether the table has it.
    kept: Vec<bool>,
}

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
    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.0.first().map_or(0, |(_, values)| match values {
            Values::Whole(values) => values.len(),
            Values::Numbers(values) => values.len(),
            Values::Texts(values) => values.len(),
        })
    }

    /// The table as CSV: missing numbers are empty cells.
    pub fn csv(&self) -> String {
        let names: Vec<&str> = self.0.iter().map(|(name, _)| name.as_str()).collect();
        let mut text = names.join(",") + "\n";
        for row in 0..self.rows() {
            let cells = self.0.iter().map(|(_, values)| match values {
                Values::Whole(values) => values[row].to_string(),
                Values::Numbers(values) if values[row].is_nan() => String::new(),
                Values::Numbers(values) => values[row].to_string(),
                Values::Texts(values) => values[row].clone(),
            });
            text.push_str(&cells.collect::<Vec<_>>().join(","));
            text.push('\n');
        }
        text
    }
}

/// A row of a table, declared by `table!` (`rows.rs`).
pub trait Row: Clone + Sized {
    /// Path of the table in a dataset.
    const PATH: &'static str;
    /// Description of the table and its rows.
    const DESCRIPTION: &'static str;
    /// All columns, optional ones included.
    const COLUMNS: &'static [Column];

    /// Writes all cells in the order of the columns.
    fn write(&self, cells: &mut Cells<'_>);

    /// Reads all cells in the order of the columns. Errors: a cell of another type than its column, by name
    /// and value.
    fn read(record: &mut Record<'_>) -> Result<Self, String>;

    /// The values of each column.
    fn values<'r>(rows: impl Iterator<Item = &'r Self> + Clone) -> Vec<Values>
    where
        Self: 'r;

    /// The table with these groups of optional columns.
    fn table(parts: &[&str]) -> Table {
        let kept = |column: &Column| column.part.is_empty() || parts.contains(&column.part);
        Table {
            path: Self::PATH,
            description: Self::DESCRIPTION,
            columns: Self::COLUMNS.iter().filter(|column| kept(column)).copied().collect(),
            kept: Self::COLUMNS.iter().map(kept).collect(),
        }
    }
}

impl Table {
    /// The same table with another description.
    pub fn described(self, description: &'static str) -> Self {
        Table { description, ..self }
    }

    /// The same table with these columns only.
    pub fn only(self, names: &[&str]) -> Self {
        let mut own = self.columns.iter().map(|column| names.contains(&column.name));
        let kept = self.kept.iter().map(|kept| *kept && own.next().unwrap_or_default()).collect();
        let columns = self.columns.iter().filter(|column| names.contains(&column.name)).copied().collect();
        Table { columns, kept, ..self }
    }

    /// The header as CSV.
    pub fn header(&self) -> String {
        let names: Vec<&str> = self.columns.iter().map(|column| column.name).collect();
        names.join(",") + "\n"
    }

    /// Rows as CSV, below the header: numbers in the shortest form that reads back to the same value.
    pub fn text<R: Row>(&self, rows: &[R]) -> String {
        let mut text = String::new();
        for row in rows {
            row.write(&mut Cells { kept: self.kept.iter(), text: &mut text, is_first: true });
            text.push('\n');
        }
        text
    }

    /// Rows by columns.
    pub fn by_column<'r, R: Row + 'r>(&self, rows: impl Iterator<Item = &'r R> + Clone) -> Columns {
        let all = R::COLUMNS.iter().zip(R::values(rows)).zip(&self.kept);
        let kept = all.filter(|(_, kept)| **kept);
        Columns(kept.map(|((column, values), _)| (column.name.to_owned(), values)).collect())
    }
}

/// The cells of a row while it is written.
#[derive(Debug)]
pub struct Cells<'t> {
    kept: std::slice::Iter<'t, bool>,
    text: &'t mut String,
    is_first: bool,
}

impl Cells<'_> {
    /// Appends the next cell, if the table has its column.
    pub fn push(&mut self, cell: &impl Cell) {
        if self.kept.next().is_none_or(|kept| *kept) {
            if !std::mem::take(&mut self.is_first) {
                self.text.push(',');
            }
            cell.write(self.text);
        }
    }
}

/// The value of a cell.
pub trait Cell: Sized {
    /// Type of its column in the manifest.
    const KIND: &'static str;
    /// The value in a table without its column.
    const ABSENT: Self;

    /// Writes the cell.
    fn write(&self, text: &mut String);

    /// Reads a cell; `None` if it has another type.
    fn read(cell: &str) -> Option<Self>;

    /// The values of a column.
    fn column<'v>(values: impl Iterator<Item = &'v Self>) -> Values
    where
        Self: 'v;
}

/// A number; empty if it is not finite.
impl Cell for f64 {
    const KIND: &'static str = "number";
    const ABSENT: Self = f64::NAN;

    fn write(&self, text: &mut String) {
        if self.is_finite() {
            number::push(text, *self);
        }
    }

    fn read(cell: &str) -> Option<Self> {
        if cell.is_empty() { Some(f64::NAN) } else { cell.parse().ok() }
    }

    fn column<'v>(values: impl Iterator<Item = &'v Self>) -> Values {
        // As a reader of the table sees them.
        Values::Numbers(values.map(|value| if value.is_finite() { *value } else { f64::NAN }).collect())
    }
}

/// A whole number; other programs may write it with a decimal point.
macro_rules! whole {
    ($($type:ty)+) => { $(
        impl Cell for $type {
            const KIND: &'static str = "integer";
            const ABSENT: Self = 0;

            fn write(&self, text: &mut String) {
                number::push_whole(text, u64::from(*self));
            }

            fn read(cell: &str) -> Option<Self> {
                let point = || cell.parse().ok().filter(|x: &f64| x.fract() == 0.0 && (0.0..=Self::MAX as f64).contains(x));
                cell.parse().ok().or_else(|| point().map(|x| x as Self))
            }

            fn column<'v>(values: impl Iterator<Item = &'v Self>) -> Values {
                Values::Whole(values.map(|value| i64::try_from(*value).unwrap_or(i64::MAX)).collect())
            }
        }
    )+ };
}

whole!(u32 u64);

impl Cell for Option<u32> {
    const KIND: &'static str = "integer";
    const ABSENT: Self = None;

    fn write(&self, text: &mut String) {
        self.iter().for_each(|value| value.write(text));
    }

    fn read(cell: &str) -> Option<Self> {
        if cell.is_empty() { Some(None) } else { u32::read(cell).map(Some) }
    }

    fn column<'v>(values: impl Iterator<Item = &'v Self>) -> Values {
        Values::Whole(values.map(|value| value.map_or(MISSING, i64::from)).collect())
    }
}

/// 1 or 0.
impl Cell for bool {
    const KIND: &'static str = "integer";
    const ABSENT: Self = false;

    fn write(&self, text: &mut String) {
        text.push(if *self { '1' } else { '0' });
    }

    fn read(cell: &str) -> Option<Self> {
        u32::read(cell).map(|value| value != 0)
    }

    fn column<'v>(values: impl Iterator<Item = &'v Self>) -> Values {
        Values::Whole(values.map(|value| i64::from(*value)).collect())
    }
}

/// Text, quoted if necessary.
impl Cell for String {
    const KIND: &'static str = "string";
    const ABSENT: Self = String::new();

    fn write(&self, text: &mut String) {
        if self.contains(['"', ',', '\n', '\r']) {
            text.push_str(&format!("\"{}\"", self.replace('"', "\"\"")));
        } else {
            text.push_str(self);
        }
    }

    fn read(cell: &str) -> Option<Self> {
        Some(cell.to_owned())
    }

    fn column<'v>(values: impl Iterator<Item = &'v Self>) -> Values {
        Values::Texts(values.cloned().collect())
    }
}

/// Declares the row of a table. Comments are the descriptions in the manifest; a field has type, unit and, if
/// it is optional, the name of its group of columns.
macro_rules! table {
    ($(#[doc = $about:literal])+ $vis:vis struct $row:ident in $path:literal {
        $($(#[doc = $meaning:literal])+ $field:ident: $type:ty, $unit:literal $(, $part:ident)?;)+
    }) => {
        $(#[doc = $about])+
        #[derive(Debug, Clone, Default, PartialEq)]
        $vis struct $row {
            $($(#[doc = $meaning])+ $vis $field: $type,)+
        }

        impl $crate::dataset::table::Row for $row {
            const PATH: &'static str = $path;
            const DESCRIPTION: &'static str = concat!($($about),+).trim_ascii_start();
            const COLUMNS: &'static [$crate::dataset::table::Column] = &[$($crate::dataset::table::Column {
                name: stringify!($field),
                kind: <$type as $crate::dataset::table::Cell>::KIND,
                unit: $unit,
                description: concat!($($meaning),+).trim_ascii_start(),
                part: $crate::dataset::table::part!($($part)?),
            },)+];

            fn write(&self, cells: &mut $crate::dataset::table::Cells<'_>) {
                $(cells.push(&self.$field);)+
            }

            fn read(record: &mut $crate::dataset::read::Record<'_>) -> Result<Self, String> {
                Ok($row { $($field: record.take()?,)+ })
            }

            fn values<'r>(rows: impl Iterator<Item = &'r Self> + Clone) -> Vec<$crate::dataset::table::Values> {
                vec![$($crate::dataset::table::Cell::column(rows.clone().map(|row| &row.$field)),)+]
            }
        }
    };
}

/// The name of a group of columns; empty without one.
macro_rules! part {
    () => {
        ""
    };
    ($part:ident) => {
        $part
    };
}

pub(crate) use {part, table};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::read::TableReader;

    table! {
        /// Rows
        /// of a test.
        struct TestRow in "t.csv" {
            /// a text
            a: String, "";
            /// a number
            b: f64, "um";
            /// a number that may
            /// be absent
            c: u64, "", EXTRA;
        }
    }

    const EXTRA: &str = "extra";

    #[test]
    fn a_table_reads_back_as_it_was_written() {
        let texts = ["plain", "a, b", "say \"so\"", "two\nlines", ""];
        let row =
            |(k, text): (usize, &&str)| TestRow { a: (*text).to_owned(), b: 0.1 * k as f64, c: u64::MAX };
        let rows: Vec<TestRow> = texts.iter().enumerate().map(row).collect();
        for parts in [&[EXTRA][..], &[]] {
            let table = TestRow::table(parts);
            let text = table.header() + &table.text(&rows);
            let mut read = Vec::new();
            let reader = TableReader::new("t.csv", text.as_bytes()).unwrap();
            reader
                .rows(&[], |_, row: TestRow| {
                    read.push(row);
                    Ok(())
                })
                .unwrap();
            let absent =
                |row: &TestRow| TestRow { c: if parts.is_empty() { 0 } else { row.c }, ..row.clone() };
            assert_eq!(read, rows.iter().map(absent).collect::<Vec<_>>());
            assert!(text.contains("0.30000000000000004"), "{text}");
            assert_eq!(table.by_column(rows.iter()).0.len(), table.columns.len());
        }
        let nan = TestRow { b: f64::NAN, ..TestRow::default() };
        assert_eq!(TestRow::table(&[EXTRA]).text(&[nan]), ",,0\n");
    }

    #[test]
    fn comments_are_descriptions() {
        assert_eq!(TestRow::DESCRIPTION, "Rows of a test.");
        let [a, _, c] = TestRow::COLUMNS else { panic!() };
        assert_eq!((a.name, a.kind, a.description, a.part), ("a", "string", "a text", ""));
        assert_eq!(
            (c.name, c.kind, c.description, c.part),
            ("c", "integer", "a number that may be absent", EXTRA)
        );
    }

    fn read<'k>(csv: &str, kind: impl Fn(&str) -> &'k str) -> crate::Result<Columns> {
        TableReader::new("t.csv", csv.as_bytes())?.columns(kind)
    }

    #[test]
    fn columns_are_read_by_type_and_missing_values_are_told() {
        let kind = |name: &str| match name {
            "n" => "integer",
            "x" => "number",
            _ => "string",
        };
        let found = read("n,x,s\n3,0.1,a\n,,\n", kind).unwrap();
        assert_eq!(found.rows(), 2);
        assert_eq!(found.0[0].1, Values::Whole(vec![3, MISSING]));
        assert!(matches!(&found.0[1].1, Values::Numbers(x) if x[0] == 0.1 && x[1].is_nan()));
        assert_eq!(found.0[2].1, Values::Texts(vec!["a".to_owned(), String::new()]));
        let message = read("n\n1\nx\n", kind).unwrap_err().to_string();
        assert_eq!(message, "t.csv:3: n = \"x\": expected a number");
    }
}
