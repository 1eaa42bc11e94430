//! What can go wrong, and the exit code that tells it.

use std::path::{Path, PathBuf};

/// An error of the `microsig` command.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Input that cannot be used: one message per problem.
    #[error("{}", .0.join("\n"))]
    Input(Vec<String>),
    /// Input that is valid but not built yet: one message per key or option.
    #[error("{}", .0.join("\n"))]
    Unsupported(Vec<String>),
    /// Something stands where a result should go.
    #[error("{} exists already; --force replaces it", .0.display())]
    Exists(PathBuf),
    /// The program ran, but what it checked does not hold: one message per failure.
    #[error("{}", .0.join("\n"))]
    Failed(Vec<String>),
    /// Writing failed.
    #[error("{}: {source}", path.display())]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The optical model or one of its files.
    #[error(transparent)]
    Optics(#[from] microsig_core::Error),
    /// A flow, its seeding or a trajectory.
    #[error(transparent)]
    Flow(#[from] flows::Error),
}

/// What this crate's functions return.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// One problem of the input.
    pub fn input(message: impl Into<String>) -> Self {
        Error::Input(vec![message.into()])
    }

    /// An input that cannot be read.
    pub fn read(path: &Path, source: std::io::Error) -> Self {
        Error::input(format!("{}: {source}", path.display()))
    }

    /// For `map_err`: writing to `path` failed.
    pub fn write(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Error::Write { path, source }
    }

    /// The same with the whole path of a file that was named by its place in a dataset.
    pub fn below(self, folder: &Path) -> Self {
        match self {
            Error::Write { path, source } if !path.starts_with(folder) => {
                Error::Write { path: folder.join(path), source }
            }
            other => other,
        }
    }

    /// Whether the system failed to read or write, as on a full disk.
    pub fn is_of_the_system(&self) -> bool {
        matches!(self, Error::Write { .. } | Error::Optics(microsig_core::Error::Io { .. }))
    }

    /// 1: ran, but a check failed or a result could not be written; 2: bad usage or bad input.
    pub fn exit_code(&self) -> u8 {
        match self {
            Error::Failed(_) => 1,
            error if error.is_of_the_system() => 1,
            Error::Flow(flows::Error::Trajectory { .. }) => 1,
            _ => 2,
        }
    }
}
