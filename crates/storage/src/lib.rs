//! Files and folders written atomically, checksums and locks; the columns of tables ([`tables`]); the errors
//! of all verbs ([`error`], [`problem`]).

pub mod checksums;
pub mod error;
mod file;
pub mod folder;
pub mod input;
mod interrupt;
pub mod journal;
mod lock;
pub mod problem;
mod removal;
pub mod table_cache;
pub mod tables;
mod walk;

pub use error::{Error, Result};
pub use file::{may_write, outside_datasets, save, save_bytes, save_private, save_result};
pub use input::read_text;
pub use interrupt::{TemporaryFolder, clean_up_on_signals, on_interrupt};

/// Whether a character is not shown but changes how others are: control characters, and the invisible ones of
/// Unicode that reverse or join text. Names from untrusted files may contain them.
pub fn is_hidden(c: char) -> bool {
    let format = ['\u{200b}'..='\u{200f}', '\u{2028}'..='\u{202e}', '\u{2060}'..='\u{206f}'];
    c.is_control() || c == '\u{feff}' || format.iter().any(|range| range.contains(&c))
}

/// The version of the program.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
/// The commit that a release build was made from.
pub const COMMIT: &str = env!("MICROSIG_COMMIT");
