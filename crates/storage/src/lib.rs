//! Files and folders written atomically, checksums and locks; the folder of a dataset as types ([`dataset`]); the errors of all verbs ([`error`]).

pub mod advice;
pub mod argument;
pub mod checksums;
pub mod dataset;
pub mod error;
mod file;
pub mod folder;
pub mod input;
mod interrupt;
pub mod journal;
pub mod json;
mod lock;
pub mod memory;
mod output;
mod problem;
pub mod progress;
pub mod range;
mod removal;
pub mod shown;
mod standard;
pub mod table_cache;
pub mod walk;

pub use error::{Error, Result};
pub use file::{Placed, may_write, outside_datasets, save, save_bytes, save_changed, save_result};
pub use input::read_text;
pub use interrupt::{TemporaryFolder, clean_up_on_signals, file_size_limits_are_errors, on_interrupt};
pub use output::OutputFolder;
pub use progress::Progress;
pub use range::NumberRange;
pub use standard::{InputFile, OutputFile, print};

/// The version of the program.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
/// The commit of a release build.
pub const COMMIT: &str = env!("MICROSIG_COMMIT");
