//! The cells of a row of a table: numbers with a decimal point or comma, text, tracks.

use std::cell::Cell;

use csv::ByteRecord;
use storage::dataset::{Columns, Values};

/// The first lines with a decimal comma and with a decimal point; 0 if there is none yet.
#[derive(Debug, Default)]
pub(super) struct Decimals {
    comma: Cell<u64>,
    point: Cell<u64>,
}

impl Decimals {
    fn see(&self, number: &str, line: u64) {
        for (first, mark) in [(&self.comma, ','), (&self.point, '.')] {
            if first.get() == 0 && number.contains(mark) {
                first.set(line);
            }
        }
    }

    pub(super) fn are_commas(&self) -> bool {
        self.comma.get() > 0
    }

    /// A message if there are both: a comma may then separate thousands.
    pub(super) fn mixed(&self) -> Option<String> {
        let (comma, point) = (self.comma.get(), self.point.get());
        (comma > 0 && point > 0).then(|| {
            format!(
                "numbers with a decimal comma (line {comma}) and with a decimal point (line {point}); expected one of them, \
                 and no thousands separators"
            )
        })
    }
}

/// Signs of a missing value: in pandas, R, spreadsheets, Python, masked arrays and C on Windows, and TrackMate's
/// empty-set sign.
const MISSING: [&str; 17] = [
    "",
    "NA",
    "<NA>",
    "N/A",
    "#N/A",
    "#NUM!",
    "#VALUE!",
    "None",
    "null",
    "\u{f8}",
    "-",
    "--",
    ".",
    "nan(ind)",
    "-nan(ind)",
    "1.#QNAN",
    "-1.#IND",
];

/// Where the cells of a row are.
#[derive(Clone, Copy)]
pub(super) enum Place<'a> {
    /// In a file.
    Record(&'a ByteRecord),
    /// In columns, at this index.
    Columns(&'a Columns, usize),
}

/// The cells of a row.
pub struct Cells<'a> {
    place: Place<'a>,
    header: &'a [String],
    /// Line in the file.
    pub line: u64,
    /// Zone of Tecplot's text, counted from 0 or as the file numbers it, and whether it does.
    pub(super) zone: Option<(u32, bool)>,
    decimals: Option<&'a Decimals>,
}

impl<'a> Cells<'a> {
    /// `decimals`: `None` where commas separate columns.
    pub(super) fn new(
        place: Place<'a>,
        header: &'a [String],
        line: u64,
        decimals: Option<&'a Decimals>,
    ) -> Self {
        Cells { place, header, line, zone: None, decimals }
    }

    /// The number in a cell; NaN if the cell is empty or a sign of a missing value.
    pub fn number(&self, column: usize) -> std::result::Result<f64, String> {
        let text = match self.place {
            Place::Record(record) => std::str::from_utf8(&record[column]).unwrap_or("?"),
            Place::Columns(columns, row) => match &columns.0[column].1 {
                Values::Whole(values) => return Ok(values[row] as f64),
                Values::Numbers(values) => return Ok(values[row]),
                Values::Texts(values) => &values[row],
            },
        };
        if let Some(number) = number(text, self.decimals.is_some()) {
            if let Some(decimals) = self.decimals {
                decimals.see(text, self.line);
            }
            return Ok(number);
        }
        if MISSING.iter().any(|missing| text.eq_ignore_ascii_case(missing)) {
            return Ok(f64::NAN);
        }
        let hint = match text.contains(',') {
            true if self.decimals.is_some() => " without thousands separators",
            true => " with a decimal point, not a comma",
            false => "",
        };
        Err(format!("{} = {:?}: expected a number{hint}", self.header[column], super::shown(text)))
    }

    /// Whether two cells of columns of one name have the same number, or the same text that is none.
    pub(super) fn are_equal(&self, a: usize, b: usize) -> bool {
        // NaN, which is no number, has one text.
        format!("{:?}", self.number(a)) == format!("{:?}", self.number(b))
    }

    pub(super) fn name(&self, column: usize) -> &str {
        &self.header[column]
    }

    /// Names of columns, empty for missing ones.
    pub(super) fn names(&self, columns: [Option<usize>; 3]) -> [&str; 3] {
        columns.map(|c| c.map_or("", |c| self.header[c].as_str()))
    }

    /// The number in an optional column; NaN if the column is missing.
    pub(crate) fn number_or_nan(&self, column: Option<usize>) -> std::result::Result<f64, String> {
        column.map_or(Ok(f64::NAN), |c| self.number(c))
    }

    /// The track in a cell, an integer; -1 (not linked) if the column or number is missing or negative.
    pub fn track(&self, column: Option<usize>) -> std::result::Result<i64, String> {
        let Some(column) = column else { return Ok(-1) };
        let value = self.number(column)?;
        if value.is_nan() {
            return Ok(-1);
        }
        // Beyond 2^53 not every integer is representable as f64.
        if value.fract() != 0.0 || value.abs() > 9_007_199_254_740_992.0 {
            return Err(format!("{} = {value:?}: expected a whole number", self.header[column]));
        }
        Ok(if value < 0.0 { -1 } else { value as i64 })
    }
}

/// The number in a text, with a decimal point or, if `may` is set, one decimal comma.
pub(super) fn number(text: &str, may: bool) -> Option<f64> {
    let number = text.parse::<f64>().ok();
    if number.is_some() || !may || text.contains('.') || text.matches(',').count() != 1 {
        return number;
    }
    text.replace(',', ".").parse().ok()
}
