//! The errors of this crate, in four classes.

use std::fmt;

/// One error in an input text: its location, what was found and what is allowed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    /// Name of the input as the caller gave it, normally a path.
    pub source_name: String,
    /// Line, counted from 1; `None` if the error is not on a line (for example a missing key).
    pub line: Option<usize>,
    /// Column of the table, counted from 1, if the error is in a column.
    pub column: Option<usize>,
    /// What was found and what is allowed.
    pub finding: Finding,
}

/// What was found and what is allowed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Finding {
    /// A value out of range.
    Value {
        /// Its key.
        key: String,
        /// The value.
        found: String,
        /// The values that are allowed.
        allowed: String,
    },
    /// Anything else.
    Text(String),
}

impl Fault {
    /// An error without line and column.
    pub(crate) fn of(source_name: &str, finding: impl Into<Finding>) -> Self {
        Fault { source_name: source_name.to_owned(), line: None, column: None, finding: finding.into() }
    }
}

/// Collects values that are out of range.
#[derive(Default)]
pub(crate) struct Faults {
    /// What has the values, in messages; by default their keys say it.
    pub(crate) source_name: Option<&'static str>,
    pub(crate) found: Vec<Fault>,
}

impl Faults {
    pub(crate) fn unless(&mut self, fine: bool, key: &str, found: impl fmt::Display, allowed: &str) {
        if !fine {
            let (found, allowed) = (found.to_string(), allowed.to_owned());
            let finding = Finding::Value { key: key.to_owned(), found, allowed };
            self.found.push(Fault::of(self.source_name.unwrap_or(key), finding));
        }
    }

    /// [`Error::Malformed`] with all of them, if there are any.
    pub(crate) fn finish(self) -> Result<(), Error> {
        if self.found.is_empty() { Ok(()) } else { Err(Error::Malformed(self.found)) }
    }
}

impl From<String> for Finding {
    fn from(text: String) -> Self {
        Finding::Text(text)
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Finding::Value { key, found, allowed } => write!(f, "{key} = {found}: expected {allowed}"),
            Finding::Text(text) => f.write_str(text),
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.source_name)?;
        if let Some(line) = self.line {
            write!(f, ":{line}")?;
        }
        if let Some(column) = self.column {
            write!(f, ", column {column}")?;
        }
        write!(f, ": {}", self.finding)
    }
}

/// An error of the optical model or of its file formats.
///
/// A ray that misses the lens is not an error; it is represented by `None`.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Text that violates its format, or values out of range; all errors found.
    #[error("{}", join(.0))]
    Malformed(Vec<Fault>),
    /// Valid input that the optical model cannot draw.
    #[error("{0}")]
    Unsupported(String),
    /// A call with inconsistent arguments.
    #[error("{0}")]
    Misuse(String),
    /// Reading or writing failed.
    #[error("{name}: {source}")]
    Io {
        /// Name of the input or output as the caller gave it.
        name: String,
        /// The error of the operating system.
        source: std::io::Error,
    },
}

impl Error {
    /// A single error in an input, without a line.
    pub(crate) fn malformed(source_name: &str, message: impl Into<String>) -> Self {
        Error::Malformed(vec![Fault::of(source_name, message.into())])
    }

    /// An I/O error with the name of the input or output.
    pub fn io(name: &str, source: std::io::Error) -> Self {
        Error::Io { name: name.to_owned(), source }
    }
}

fn join(faults: &[Fault]) -> String {
    faults.iter().map(Fault::to_string).collect::<Vec<_>>().join("\n")
}

/// A value in a message: long numbers with an exponent, everything else as it is.
pub fn shown(value: impl ToString) -> String {
    let text = value.to_string();
    match text.parse::<f64>() {
        Ok(number) if text.len() > LONGEST => format!("{number:e}"),
        _ => text,
    }
}

/// Length of the longest numbers of common magnitude, such as -0.00012345678901234567.
const LONGEST: usize = 24;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_show_huge_numbers_with_an_exponent() {
        assert_eq!(
            [shown(1e308), shown(-2.5e-300), shown(1e20)],
            ["1e308", "-2.5e-300", "100000000000000000000"]
        );
        assert_eq!([shown(0.1 + 0.2), shown("a".repeat(40))], ["0.30000000000000004", &"a".repeat(40)]);
    }
}
