//! Export of frames and calibration stacks as one file with the scale of pixels, depth and time.

use std::collections::BTreeMap;

use microsig_core::formats::stack::{Stack, StackAxis, StackFormat, equal_step};
use storage::advice;
use storage::advice::option;
use storage::dataset::manifest::{Manifest, TimingFacts};
use storage::dataset::{CalibrationRow, DatasetPlace, FrameRow, Row, TableReader};
use storage::error::{Error, Result};
use storage::save;

use super::{ExportFormat, ExportOptions, StackImages};

/// Writes the stack; gives the number of its images.
pub(super) fn write(dataset: &DatasetPlace, options: &ExportOptions) -> Result<usize> {
    let manifest = dataset.manifest()?;
    let lacks = |what: &str| Error::input(format!("{}: the manifest lacks {what}", dataset.name()));
    let um_per_px = dataset.facts()?.um_per_px;
    let um_per_px = um_per_px.ok_or_else(|| lacks("um_per_px, the size of a pixel"))?;
    let bits = manifest.microsig.sensor.as_ref().ok_or_else(|| lacks("the sensor"))?.bit_depth;
    let (images, axis) = match options.images {
        StackImages::Frames => frames(dataset, &manifest)?,
        StackImages::Calibration => calibration(dataset, options.stack.as_deref())?,
    };
    let n = axis.pages();
    let format = match options.format {
        ExportFormat::OmeTiff => StackFormat::Ome,
        _ => StackFormat::ImageJ,
    };
    let stack = Stack { name: manifest.name.clone(), um_per_px, axis };
    if options.out.is_standard() {
        return Err(Error::input(
            "-: expected a file; a stack of images cannot be written to standard output",
        ));
    }
    options.out.outside_datasets()?;
    let shown = options.out.display().to_string();
    save(&options.out, |writer| {
        stack.write(writer, format, &shown, |k| dataset.whole_image(&images[k], bits))
    })?;
    Ok(n)
}

/// Paths of the frames, and their times.
fn frames(dataset: &DatasetPlace, manifest: &Manifest) -> Result<(Vec<String>, StackAxis)> {
    let dataset = match dataset {
        DatasetPlace::Folder(folder) => folder,
        DatasetPlace::Memory(made) => {
            let (images, at_s): (Vec<String>, Vec<f64>) =
                made.frames().into_iter().map(|row| (row.image, row.t_s)).unzip();
            let interval_s = equal_step(&at_s);
            return Ok((images, StackAxis::Time { pages: at_s.len(), at_s: Some(at_s), interval_s }));
        }
    };
    let numbered = manifest.resources.iter().filter(|resource| resource.path.starts_with("images/"));
    let numbered: BTreeMap<u32, &str> =
        numbered.filter_map(|resource| Some((resource.frame?, resource.path.as_str()))).collect();
    let images: Vec<String> = numbered.values().map(|path| (*path).to_owned()).collect();
    if images.is_empty() {
        return Err(Error::input(format!("{}: the manifest lists no frames", dataset.display())));
    }
    let at_s = FrameRow::path_in(dataset).map(|path| {
        let mut times = BTreeMap::new();
        TableReader::open(&path)?.rows(&["frame", "t_s"], |_, row: FrameRow| {
            times.insert(row.frame, row.t_s);
            Ok(())
        })?;
        let at = numbered.keys().map(|frame| times.get(frame).copied().unwrap_or(f64::NAN));
        Ok::<_, Error>(at.collect::<Vec<f64>>())
    });
    let at_s = at_s.transpose()?.filter(|times: &Vec<f64>| times.iter().all(|t_s| t_s.is_finite()));
    let interval_s = match &at_s {
        Some(at_s) => equal_step(at_s),
        None => is_regular(&manifest.microsig.timing).then(|| manifest.microsig.timing.dt_s()).flatten(),
    };
    let axis = StackAxis::Time { pages: images.len(), at_s, interval_s };
    Ok((images, axis))
}

/// Whether frames are equally far apart as far as the manifest tells.
fn is_regular(timing: &TimingFacts) -> bool {
    !timing.are_pairs() && !timing.are_bursts()
}

/// Paths and depths of the images of a calibration stack.
fn calibration(dataset: &DatasetPlace, wanted: Option<&str>) -> Result<(Vec<String>, StackAxis)> {
    let path = dataset.shown(CalibrationRow::PATH);
    if !dataset.has_calibration()? {
        return Err(Error::input(format!("{path}: missing; this dataset has no calibration")));
    }
    let mut stacks: BTreeMap<String, Vec<(String, f64)>> = BTreeMap::new();
    dataset.calibration_rows(&["image", "z_um"], |_, row| {
        let folder = row.image.rsplit_once('/').map_or("", |(folder, _)| folder);
        let name = folder.trim_start_matches("calibration/images").trim_start_matches('/').to_owned();
        stacks.entry(name).or_default().push((row.image, row.z_um));
        Ok(())
    })?;
    let names: Vec<&str> = stacks.keys().map(String::as_str).collect();
    let stack = match (wanted, names.as_slice()) {
        (None, [one]) => stacks.get(*one),
        (Some(wanted), _) => stacks.get(wanted.trim_end_matches('/')),
        (None, _) => None,
    };
    let stack = stack.ok_or_else(|| {
        let found = match wanted {
            Some(wanted) => format!("no stack {wanted:?}"),
            None => format!("{} stacks", names.len()),
        };
        let what = format!("{path}: {found}; ");
        Error::option(match names.as_slice() {
            [""] => advice!(what, "the only stack needs no ", option("stack")),
            all => advice!(what, "give ", option("stack"), format!(", one of {}", all.join(", "))),
        })
    })?;
    let (images, depths_um) = stack.iter().cloned().unzip();
    Ok((images, StackAxis::Depth(depths_um)))
}
