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
    pub message: String,
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
        write!(f, ": {}", self.message)
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
    /// An I/O error with the name of the input or output.
    pub fn io(name: &str, source: std::io::Error) -> Self {
        Error::Io { name: name.to_owned(), source }
    }
}

fn join(faults: &[Fault]) -> String {
    faults.iter().map(Fault::to_string).collect::<Vec<_>>().join("\n")
}
