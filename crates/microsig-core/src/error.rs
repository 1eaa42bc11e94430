//! The errors of this crate, in four classes.

use crate::problem::Problem;

/// An error of the optical model or of its file formats.
///
/// A ray that misses the lens is not an error; it is represented by `None`.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Text that violates its format, or values out of range; all problems found.
    #[error("{}", join(.0))]
    Malformed(Vec<Problem>),
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
    /// A single problem in an input, without a line.
    pub(crate) fn malformed(input: &str, message: impl Into<String>) -> Self {
        Error::Malformed(vec![Problem::other("", message).within(input)])
    }

    /// An I/O error with the name of the input or output.
    pub fn io(name: &str, source: std::io::Error) -> Self {
        Error::Io { name: name.to_owned(), source }
    }
}

fn join(problems: &[Problem]) -> String {
    problems.iter().map(Problem::to_string).collect::<Vec<_>>().join("\n")
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
