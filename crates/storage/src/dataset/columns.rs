//! Tables stored by column.

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::read::TableReader;
    use crate::error::Result;

    fn read<'k>(csv: &str, kind: impl Fn(&str) -> &'k str) -> Result<Columns> {
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
