//! `microsig verify`: checks that a dataset is complete and unchanged.

use std::path::PathBuf;

use clap::Args;

use super::Common;
use super::options::ImageTables;
use super::output::{progress, summarize};
use generator::runner::verify;
use storage::error::Result;

/// Check a dataset: checksums, manifest, tables
#[derive(Debug, Args)]
#[command(after_help = "Example: microsig verify datasets/quickstart --regenerate")]
pub(super) struct Verify {
    /// Folder of the dataset
    dataset: PathBuf,
    /// Generate the dataset again from its scenario and compare all bytes
    #[arg(long)]
    regenerate: bool,
    #[command(flatten)]
    tables: ImageTables,
}

impl Verify {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        let verified = verify(&self.dataset, self.regenerate, progress(common), &common.context)?;
        let again = if verified.regenerated { "; generated again with identical bytes" } else { "" };
        let text = format!(
            "{}: {} files ({:.1} MB) agree with checksums and manifest{again}",
            self.dataset.display(),
            verified.files,
            verified.bytes as f64 / 1e6
        );
        summarize(&text, &verified, common)
    }
}
