//! `microsig export`: writes the truth in the format of another program.

use std::path::PathBuf;

use clap::Args;

use super::Common;
use super::options::Replace;
use super::output::written;
use crate::export::{Displacement, ExportFormat, ExportOptions, export};
use storage::error::Result;

/// Export the truth of a dataset to the format of another program
#[derive(Debug, Args)]
#[command(after_help = "Example: microsig export datasets/quickstart --format trackpy --out truth.csv")]
pub(super) struct Export {
    /// The dataset's folder
    dataset: PathBuf,
    /// Output format
    #[arg(long, value_enum, value_name = "F")]
    format: ExportFormat,
    /// Output file, `-` for standard output
    #[arg(long, short, value_name = "PATH")]
    out: PathBuf,
    /// Image pair, if the displacement field changes with time
    #[arg(long, value_name = "N")]
    pair: Option<u32>,
    /// Definition of the displacement field
    #[arg(long, value_enum, value_name = "DEFINITION", default_value_t = Displacement::Central)]
    displacement: Displacement,
    #[command(flatten)]
    replace: Replace,
}

impl Export {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        let exported = export(
            &self.dataset,
            &ExportOptions {
                format: self.format,
                out: self.out.clone(),
                pair: self.pair,
                displacement: self.displacement,
                force: self.replace.force,
            },
        )?;
        let rows = match self.format {
            ExportFormat::Coco | ExportFormat::Yolo | ExportFormat::Masks => "boxes",
            _ => "vectors",
        };
        let of = exported.tracks.map_or_else(|| rows.to_owned(), |n| format!("points of {n} tracks"));
        let text = format!("{}: {} {of}", exported.out.display(), exported.rows);
        written(&exported.out, &text, &exported, common)
    }
}
