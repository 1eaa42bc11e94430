//! Copies datasets.

use std::path::Path;

use dataset::manifest::MANIFEST;
use storage::checksums::{self, SHA256SUMS};
use storage::error::Result;
use storage::folder::{Earlier, Partial, check_replaceable};
use storage::read_text;

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
        if let Some((within, _)) = file.rsplit_once('/') {
            partial.folder().subfolder(within)?;
        }
        partial.folder().place(file, &dataset.join(file), false)?;
    }
    partial.finish_without_journal(earlier)
}
