//! Errors of the `microsig` command and their exit codes.

use std::path::{Path, PathBuf};

use microsig_core::problem::{MOST_COLLECTED, Problem};

use crate::advice::{Advice, flag};
use crate::problem::rendered;

/// An error of the `microsig` command.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Input that cannot be used: one message per problem.
    #[error("{}", first_of(.0, Clone::clone).join("\n"))]
    Input(Vec<String>),
    /// A scenario or sweep that cannot be used: every problem, with its position in the file.
    #[error("{}", first_of(.0, ToString::to_string).join("\n"))]
    Problems(Vec<Problem>),
    /// Options that cannot be used, or that the input needs: one message per problem.
    #[error("{}", first_of(.0, ToString::to_string).join("\n"))]
    Options(Vec<Advice>),
    /// Valid input that is not implemented: one message per key or option.
    #[error("{}", .0.join("\n"))]
    Unsupported(Vec<String>),
    /// The output path exists.
    #[error("{}: {hint}", path.display())]
    Exists {
        /// The existing path.
        path: PathBuf,
        /// What can be done about it.
        hint: Advice,
    },
    /// Another process is writing this folder.
    #[error("{}: {owner} is writing it", path.display())]
    Busy {
        /// The folder.
        path: PathBuf,
        /// Process and host that hold the lock.
        owner: String,
    },
    /// The program ran, but a check failed: one message per failure.
    #[error("{}", .0.join("\n"))]
    Failed(Vec<String>),
    /// The run was interrupted before it finished.
    #[error("interrupted")]
    Interrupted,
    /// An input cannot be read.
    #[error("{}: {}", path.display(), reason(source))]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// Error reported by the operating system.
        source: std::io::Error,
    },
    /// Writing failed.
    #[error("{}: {source}", path.display())]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// Error reported by the operating system.
        source: std::io::Error,
    },
    /// An error in the optical model or in one of its files.
    #[error(transparent)]
    Optics(#[from] microsig_core::Error),
    /// An error in a flow, its seeding or a trajectory.
    #[error("{error}{keys}", error = .0, keys = keys_of(.0))]
    Flow(#[from] flows::Error),
}

/// The keys of a scenario that affect a trajectory.
fn keys_of(error: &flows::Error) -> &'static str {
    match error {
        flows::Error::Trajectory { .. } => "; see the speeds in motion.flow.field, and the times in timing",
        _ => "",
    }
}

/// Why an input cannot be read.
fn reason(source: &std::io::Error) -> String {
    // Without the number of the system's error.
    match source.kind() {
        std::io::ErrorKind::NotFound => "no such file or folder".to_owned(),
        _ => source.to_string(),
    }
}

/// Maximum number of problems that a message lists; the rest are only counted.
pub const MOST_SHOWN: usize = 20;

/// The messages of the first problems, and the number of the others.
fn first_of<T>(problems: &[T], message: impl Fn(&T) -> String) -> Vec<String> {
    let mut messages: Vec<String> = problems.iter().take(MOST_SHOWN).map(message).collect();
    messages.extend(more(problems.len()));
    messages
}

/// The sentence about the problems of `all` that are not listed.
pub fn more(all: usize) -> Option<String> {
    let rest = all.checked_sub(MOST_SHOWN).filter(|rest| *rest > 0)?;
    let at_least = if all >= MOST_COLLECTED { "at least " } else { "" };
    Some(format!("and {at_least}{rest} more"))
}

/// Result type of this crate.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// An input error with a single message.
    pub fn input(message: impl Into<String>) -> Self {
        Error::Input(vec![message.into()])
    }

    /// An option that cannot be used, or that the input needs.
    pub fn option(message: Advice) -> Self {
        Error::Options(vec![message])
    }

    /// An existing file that `force` replaces.
    pub fn exists(path: &Path) -> Self {
        Error::Exists {
            path: path.to_owned(),
            hint: crate::advice!("already exists; ", flag("force"), " replaces it"),
        }
    }

    /// One message per problem, all of them.
    pub fn problems(&self) -> Vec<String> {
        match self {
            Error::Input(problems) | Error::Unsupported(problems) | Error::Failed(problems) => {
                problems.clone()
            }
            Error::Problems(problems) | Error::Optics(microsig_core::Error::Malformed(problems)) => {
                problems.iter().map(ToString::to_string).collect()
            }
            Error::Options(all) => all.iter().map(ToString::to_string).collect(),
            other => vec![other.to_string()],
        }
    }

    /// One message per problem; of input, options and scenarios at most [`MOST_SHOWN`] and the number of the others;
    /// problems in a scenario file show the line with a caret.
    pub fn messages(&self) -> Vec<String> {
        match self {
            Error::Problems(problems) => first_of(problems, rendered),
            Error::Input(problems) => first_of(problems, Clone::clone),
            Error::Options(all) => first_of(all, ToString::to_string),
            other => other.problems(),
        }
    }

    /// An input file that cannot be read.
    pub fn read(path: &Path, source: std::io::Error) -> Self {
        Error::Read { path: path.to_owned(), source }
    }

    /// For `map_err`: wraps an I/O error that occurred while writing to `path`.
    pub fn write(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Error::Write { path, source }
    }

    /// The same error with `folder` prepended to the path of a failed write, unless the path already starts
    /// with it.
    pub fn below(self, folder: &Path) -> Self {
        match self {
            Error::Write { path, source } if !path.starts_with(folder) => {
                Error::Write { path: folder.join(path), source }
            }
            other => other,
        }
    }

    /// Whether the cause lies outside the request, such as a full disk or another process.
    pub fn is_io(&self) -> bool {
        matches!(
            self,
            Error::Write { .. }
                | Error::Busy { .. }
                | Error::Interrupted
                | Error::Optics(microsig_core::Error::Io { .. })
        )
    }

    /// Exit code: 1 if the program ran but a check failed or a result could not be written, 2 for bad usage
    /// or bad input.
    pub fn exit_code(&self) -> u8 {
        match self {
            Error::Failed(_) => 1,
            Error::Busy { .. } => 2,
            error if error.is_io() => 1,
            Error::Flow(flows::Error::Trajectory { .. }) => 1,
            _ => 2,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn problems_that_are_passed_on_are_shortened_once() {
        let of_file = Error::Input((0..25).map(|line| format!("a.csv:{line}: no number")).collect());
        assert_eq!(of_file.problems().len(), 25);
        let of_all = Error::Input([of_file.problems(), of_file.problems()].concat());
        assert_eq!(of_all.messages().last().map(String::as_str), Some("and 30 more"));
    }
}
