//! `microsig export`: the truth of a dataset in the formats of other programs, and its images as stacks.
//!
//! Exported are the particles that are scored (`evaluate::truth`): visible ones inside the depth range, with
//! a separate track number for each uninterrupted visible section. An exported file that is read back and
//! evaluated therefore has a perfect score. Coordinates, units and first frame follow the format, as in the
//! readers of [`scoring::results`].

mod boxes;
mod field;
mod particles;
mod pivmeta;
mod stack;

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use scoring::evaluate::field::true_field::Displacement;
use storage::OutputFile;
use storage::argument::{choice, output};
use storage::dataset::DatasetPlace;
use storage::error::{Error, Result};

/// Export formats.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ExportFormat {
    /// XML of the ISBI challenge: px, first pixel's center at 0; z in um.
    Isbi,
    /// trackpy's data frame as CSV: px, first pixel's center at 0; z in um.
    Trackpy,
    /// DefocusTracker's table as CSV: px from 1, Z in [0, 1] over the depth range, frames from 1.
    Defocustracker,
    /// TrackMate's table of spots: um, first pixel's center at 0.
    TrackmateSpots,
    /// napari's tracks as CSV: px, first pixel's center at 0; z in um.
    Napari,
    /// COCO's annotations as JSON: boxes and masks of particle images.
    Coco,
    /// YOLO's boxes: a zip archive with a text file for each image.
    Yolo,
    /// Label images: a zip archive with a 16-bit TIFF for each image.
    Masks,
    /// Middlebury's dense flow: a vector for each pixel.
    Flo,
    /// OpenPIV's text file: a vector for each node of the truth's grid.
    Openpiv,
    /// The manifest in the terms of the ontology PIVMeta, as JSON-LD.
    Pivmeta,
    /// Images with their scale as one OME-TIFF file.
    OmeTiff,
    /// Images with their scale as one TIFF file of ImageJ and Fiji.
    ImagejStack,
}

impl ExportFormat {
    /// What the rows of this format are.
    pub fn rows(self) -> &'static str {
        match self {
            ExportFormat::Coco | ExportFormat::Yolo | ExportFormat::Masks => "boxes",
            ExportFormat::Flo | ExportFormat::Openpiv => "vectors",
            ExportFormat::OmeTiff | ExportFormat::ImagejStack => "images",
            ExportFormat::Pivmeta => "distributions",
            _ => "points",
        }
    }
}

/// Images of a stack.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum StackImages {
    /// The frames, over time.
    Frames,
    /// A calibration stack, over depth.
    Calibration,
}

#[derive(Debug, Clone, clap::Args)]
pub struct ExportOptions {
    /// Output format
    #[arg(long, value_parser = choice::<ExportFormat>(), value_name = "F")]
    pub format: ExportFormat,
    /// Output file, `-` for standard output
    #[arg(long, short, value_name = "PATH", value_parser = output())]
    pub out: OutputFile,
    /// Image pair, if the displacement field changes with time
    #[arg(long, value_name = "N")]
    pub pair: Option<u32>,
    /// Definition of the displacement field
    #[arg(long, value_parser = choice::<Displacement>(), value_name = "DEFINITION", default_value = "central")]
    pub displacement: Displacement,
    /// Images of ome-tiff and imagej-stack
    #[arg(long, value_parser = choice::<StackImages>(), value_name = "IMAGES", default_value = "frames")]
    pub images: StackImages,
    /// Folder below calibration/images, such as d_2um, if there are several calibration stacks
    #[arg(long, value_name = "NAME")]
    pub stack: Option<String>,
    /// Replace existing output
    #[arg(long, short)]
    pub force: bool,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Exported {
    pub out: PathBuf,
    /// Number of points, boxes, vectors, images or distributions.
    pub rows: usize,
    /// Number of tracks; `None` for boxes, fields and images.
    pub tracks: Option<usize>,
}

/// Writes the truth or the images of a dataset in another program's format. The file is written atomically.
pub fn export(dataset: &DatasetPlace, options: &ExportOptions) -> Result<Exported> {
    let out = &options.out;
    out.may_write(options.force)?;
    if let DatasetPlace::Folder(folder) = dataset
        && !folder.is_dir()
    {
        let what = if folder.exists() { "a file" } else { "no such file or folder" };
        return Err(Error::input(format!("{}: {what}; expected the folder of a dataset", folder.display())));
    }
    if let ExportFormat::OmeTiff | ExportFormat::ImagejStack = options.format {
        let rows = stack::write(dataset, options)?;
        return Ok(Exported { out: out.to_path_buf(), rows, tracks: None });
    }
    let (bytes, rows, tracks) = match options.format {
        ExportFormat::Pivmeta => {
            let (bytes, rows) = pivmeta::write(dataset)?;
            (bytes, rows, None)
        }
        ExportFormat::Flo | ExportFormat::Openpiv => {
            let (bytes, rows) = field::write(dataset, options)?;
            (bytes, rows, None)
        }
        format @ (ExportFormat::Coco | ExportFormat::Yolo | ExportFormat::Masks) => {
            let boxes = boxes::Boxes::read(dataset)?;
            (boxes.write(format)?, boxes.len(), None)
        }
        format => {
            let spots = particles::Spots::read(dataset)?;
            (spots.write(format)?, spots.len(), Some(spots.tracks()))
        }
    };
    out.save(options.force, &bytes)?;
    Ok(Exported { out: out.to_path_buf(), rows, tracks })
}
