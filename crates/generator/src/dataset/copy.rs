//! Copies datasets.

use std::path::Path;

use dataset::manifest::MANIFEST;
use storage::checksums::{self, SHA256SUMS};
use storage::error::{Error, Result};
use storage::folder::{Earlier, Partial, check_replaceable};
use storage::{journal, read_text};

/// Copies the files listed in a dataset's checksums into a new folder, which is written atomically.
///
/// # Errors
/// A folder that is not a dataset; an existing folder at `out`, unless `force`; reading; writing.
pub fn copy(dataset: &Path, out: &Path, force: bool) -> Result<()> {
    let earlier = Earlier::new(MANIFEST, force);
    let sums = read_text(&dataset.join(SHA256SUMS))?;
    check_replaceable(out, earlier)?;
    let partial = Partial::start(out)?;
    let files = checksums::read(&sums, SHA256SUMS)?;
    for file in files.keys().map(String::as_str).chain([SHA256SUMS]) {
        let to = partial.folder().join(file);
        if let Some(within) = to.parent() {
            std::fs::create_dir_all(within).map_err(Error::write(within))?;
        }
        journal::record_started(&to)?;
        let bytes = storage::input::read(&dataset.join(file))?;
        std::fs::write(&to, bytes).map_err(Error::write(&to))?;
    }
    partial.finish_without_journal(earlier)
}
