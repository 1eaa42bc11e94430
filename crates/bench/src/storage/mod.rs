//! Atomic writing of files and folders, checksums, and locks.

pub mod checksums;
mod file;
pub mod folder;
pub(crate) mod input;
mod interrupt;
pub(crate) mod journal;
mod lock;
mod removal;
pub mod tables;
mod walk;

pub(crate) use file::{may_write, save, save_bytes, save_private, save_result};
pub(crate) use input::read_text;
pub use interrupt::{TemporaryFolder, clean_up_on_signals, on_interrupt};
