//! `microsig export`: writes the truth or the images in the format of another program.

use std::path::PathBuf;

use clap::Args;

use super::Common;
use super::output::written;
use crate::export::{ExportOptions, export};
use storage::error::Result;

/// Export the truth or the images of a dataset to the format of another program
#[derive(Debug, Args)]
#[command(after_help = "Example: microsig export datasets/quickstart --format trackpy --out truth.csv")]
pub(super) struct Export {
    /// The dataset's folder
    dataset: PathBuf,
    #[command(flatten)]
    options: ExportOptions,
}

impl Export {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        let exported = export(&self.dataset.as_path().into(), &self.options)?;
        let rows = self.options.format.rows();
        let of = exported.tracks.map_or_else(|| rows.to_owned(), |n| format!("{rows} of {n} tracks"));
        let text = format!("{}: {} {of}", exported.out.display(), exported.rows);
        written(&self.options.out, &text, &exported, common)
    }
}
