//! `microsig export`: writes the truth or the images in the format of another program.

use std::path::PathBuf;

use clap::Args;

use super::Common;
use super::argument::output;
use super::choice::choice;
use super::options::Replace;
use super::output::written;
use crate::export::{ExportFormat, ExportOptions, StackImages, export};
use scoring::evaluate::field::true_field::Displacement;
use storage::OutputFile;
use storage::error::Result;

/// Export the truth or the images of a dataset to the format of another program
#[derive(Debug, Args)]
#[command(after_help = "Example: microsig export datasets/quickstart --format trackpy --out truth.csv")]
pub(super) struct Export {
    /// The dataset's folder
    dataset: PathBuf,
    /// Output format
    #[arg(long, value_parser = choice::<ExportFormat>(), value_name = "F")]
    format: ExportFormat,
    /// Output file, `-` for standard output
    #[arg(long, short, value_name = "PATH", value_parser = output())]
    out: OutputFile,
    /// Image pair, if the displacement field changes with time
    #[arg(long, value_name = "N")]
    pair: Option<u32>,
    /// Definition of the displacement field
    #[arg(long, value_parser = choice::<Displacement>(), value_name = "DEFINITION", default_value = "central")]
    displacement: Displacement,
    /// Images of ome-tiff and imagej-stack
    #[arg(long, value_parser = choice::<StackImages>(), value_name = "IMAGES", default_value = "frames")]
    images: StackImages,
    /// Folder below calibration/images, such as d_2um, if there are several calibration stacks
    #[arg(long, value_name = "NAME")]
    stack: Option<String>,
    #[command(flatten)]
    replace: Replace,
}

impl Export {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        let exported = export(
            &self.dataset.as_path().into(),
            &ExportOptions {
                format: self.format,
                out: self.out.clone(),
                pair: self.pair,
                displacement: self.displacement,
                images: self.images,
                stack: self.stack.clone(),
                force: self.replace.force,
            },
        )?;
        let rows = self.format.rows();
        let of = exported.tracks.map_or_else(|| rows.to_owned(), |n| format!("{rows} of {n} tracks"));
        let text = format!("{}: {} {of}", exported.out.display(), exported.rows);
        written(&self.out, &text, &exported, common)
    }
}
