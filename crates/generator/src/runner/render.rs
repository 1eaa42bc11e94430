//! `microsig render`: images from MicroSIG's own settings file and data files.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use microsig_core::formats::{data_file, settings_file};
use microsig_core::render::{Context, RendererSpec};
use microsig_core::sensor::{Image, ImageFormat, NoiseRounding, Sensor};
use microsig_core::stream::Streams;
use microsig_core::{Particle, Settings};
use rayon::prelude::*;
use serde::Serialize;

use super::cost::ImageTime;
use crate::dataset::Camera;
use storage::dataset::manifest::MANIFEST;
use storage::folder::{Earlier, FolderClaim};
use storage::{Error, InputFile, OutputFolder, Progress, Result, advice, may_write, walk};

/// Options of [`render`].
#[derive(Debug, Clone)]
pub struct RenderOptions {
    /// The settings file.
    pub settings: InputFile,
    /// A data file, or a folder of them.
    pub data: InputFile,
    /// The folder for the images.
    pub out: PathBuf,
    /// Seed of rays and noise.
    pub seed: u64,
    /// Frame number of the first image; it selects the random numbers.
    pub first_frame: u32,
    /// The renderer.
    pub renderer: RendererSpec,
    /// Where it keeps its tables.
    pub context: Context,
    /// Whether noise is rounded on its own or after it is added to the image.
    pub rounding: NoiseRounding,
    /// What the pixels of the images hold.
    pub format: ImageFormat,
    /// Whether existing images are replaced.
    pub force: bool,
    /// How progress is shown.
    pub progress: Progress,
}

/// Summary of the rendered images.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Rendered {
    /// The folder with the images.
    pub out: PathBuf,
    /// Number of images.
    pub images: usize,
    /// Particles in all images.
    pub particles: usize,
    /// Width of an image, px.
    pub width_px: u32,
    /// Height of an image, px.
    pub height_px: u32,
    /// Duration, s.
    pub seconds: f64,
    /// Warnings about the images.
    pub warnings: Vec<String>,
}

/// Maximum number of warnings that are listed; the rest are only counted.
const MAX_WARNINGS: usize = 10;

/// Renders the images of data files. All input is checked before the first image is rendered; images are
/// written atomically. Errors: malformed settings or data files, all of them listed; existing images, unless
/// `force`; an I/O error.
pub fn render(options: &RenderOptions) -> Result<Rendered> {
    let start = Instant::now();
    let file = options.settings.open()?;
    let largest = options.renderer.largest_aperture();
    let settings = settings_file::read_immersed(file, &options.settings.display().to_string(), largest)?;
    let renderer = options.renderer.clone().build(&settings.settings, &options.context)?;
    let sensor = Sensor::new(&settings.settings).with_rounding(options.rounding).with_format(options.format);
    let camera = Camera::new(renderer, sensor, Streams::new(options.seed));
    let mut warnings = settings.warnings;
    warnings.extend(camera.renderer().warning());

    let files = data_files(&options.data, &options.settings)?;
    if u32::try_from(files.len()).ok().and_then(|n| options.first_frame.checked_add(n)).is_none() {
        let what = format!(": the largest frame number is {}", u32::MAX);
        return Err(Error::option(advice!(advice::option("first_frame").of(options.first_frame), what)));
    }
    let particles = check(&files, &camera, &options.progress, &mut warnings)?;

    let image_names = image_names(&files)?;
    // A new folder gets its name when all images are in it; in an existing folder, images appear one by one.
    // The path is canonicalized because `.` and links have no name that could be locked.
    let canonical = options.out.canonicalize().unwrap_or_else(|_| options.out.clone());
    let claim = FolderClaim::take(&canonical)?;
    options.progress.warn(claim.warning());
    let (partial, _claim) = if options.out.exists() {
        if !options.out.is_dir() {
            return Err(Error::input(format!("{}: expected a folder", options.out.display())));
        }
        if let Some(name) = image_names.iter().find(|n| options.out.join(n).exists() && !options.force) {
            return Err(Error::exists(&options.out.join(name)));
        }
        for name in &image_names {
            may_write(&options.out.join(name), options.force)?;
        }
        (None, Some(claim))
    } else {
        (Some(claim.start(true)?), None)
    };
    let folder =
        partial.as_ref().map_or(OutputFolder::existing(&options.out), |partial| partial.folder().clone());
    if options.progress.has_notes() {
        announce(&files, particles, &camera, &options.progress)?;
    }

    let bar = options.progress.images(files.len() as u64);
    files.par_iter().zip(&image_names).enumerate().try_for_each(|(i, (file, name))| {
        options.progress.check()?;
        let image = camera.image(&read(file)?, options.first_frame + i as u32);
        camera.renderer().shortfall()?;
        folder.save(name, |writer| camera.write_tiff(writer, &image, None, &folder.join(name)))?;
        bar.inc(1);
        Ok::<(), Error>(())
    })?;
    bar.finish();
    if let Some(partial) = partial {
        partial.finish_without_journal(Earlier::new(MANIFEST, false))?;
    }
    warnings.extend(camera.renderer().shortfall()?);
    Ok(Rendered {
        out: options.out.clone(),
        images: files.len(),
        particles,
        width_px: settings.settings.pixel_dim_x,
        height_px: settings.settings.pixel_dim_y,
        seconds: start.elapsed().as_secs_f64(),
        warnings,
    })
}

/// Reports the rendering time if it is long, estimated from the first file with particles.
fn announce(files: &[InputFile], particles: usize, camera: &Camera, progress: &Progress) -> Result<()> {
    let first = files.iter().map(read).find(|read| !matches!(read, Ok(rows) if rows.is_empty()));
    let rows = first.transpose()?.unwrap_or_default();
    let tables = || camera.renderer().missing_tables(&rows);
    let time = ImageTime::measure(rows.len(), tables, |n| {
        let step = rows.len().checked_div(n).unwrap_or(0);
        let some: Vec<Particle> = (0..n).map(|k| rows[k * step]).collect();
        camera.image(&some, 0);
        Ok(())
    })?;
    time.warning(files.len(), particles).iter().for_each(|text| progress.note(text));
    Ok(())
}

/// The names of the images of data files. Errors: two files whose names differ only in their extension.
fn image_names(files: &[InputFile]) -> Result<Vec<PathBuf>> {
    let mut by_name: HashMap<PathBuf, &InputFile> = HashMap::new();
    files
        .iter()
        .map(|file| {
            let stem = if file.is_standard() { Some("image".as_ref()) } else { file.file_stem() };
            let stem = PathBuf::from(stem.unwrap_or_default());
            let name = stem.with_added_extension("tif");
            match by_name.insert(name.clone(), file) {
                Some(other) => Err(Error::input(format!(
                    "{} and {}: both would be the data file of {}; rename one of them",
                    other.display(),
                    file.display(),
                    name.display()
                ))),
                None => Ok(name),
            }
        })
        .collect()
}

fn read(file: &InputFile) -> Result<Vec<Particle>> {
    Ok(data_file::read(file.open()?, &file.display().to_string())?)
}

/// The data files in natural order of names: the file itself, or all `*.txt` files of a folder except the
/// settings file.
fn data_files(data: &InputFile, settings: &Path) -> Result<Vec<InputFile>> {
    if data.is_standard() || data.is_file() {
        return Ok(vec![data.clone()]);
    }
    let settings = settings.canonicalize().ok();
    let names = walk::names(data, |name| {
        let path = data.join(name);
        let is_text = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("txt"));
        is_text && path.is_file() && path.canonicalize().ok() != settings
    })?;
    if names.is_empty() {
        return Err(Error::input(format!("{}: expected data files (*.txt), found none", data.display())));
    }
    Ok(names.into_iter().map(|name| data.join(name).into()).collect())
}

/// Renders particles to an image in memory; returns the image and warnings. Errors: settings that cannot be
/// rendered; particles that cannot be rendered, all of them listed.
pub fn render_particles(
    settings: &Settings,
    renderer: RendererSpec,
    particles: &[Particle],
    (seed, frame): (u64, u32),
    (rounding, format): (NoiseRounding, ImageFormat),
    context: &Context,
) -> Result<(Image, Vec<String>)> {
    let sensor = Sensor::new(settings).with_rounding(rounding).with_format(format);
    let camera = Camera::new(renderer.build(settings, context)?, sensor, Streams::new(seed));
    let mut warnings: Vec<String> = camera.renderer().warning().into_iter().collect();
    limit(check_particles(particles, &camera, "particles")?, &mut warnings);
    let image = camera.image(particles, frame);
    warnings.extend(camera.renderer().shortfall()?);
    Ok((image, warnings))
}

/// Checks that particles can be rendered; returns warnings. `name` is the file's name in messages.
fn check_particles(particles: &[Particle], camera: &Camera, name: &str) -> Result<Vec<String>> {
    let (mut found, mut wrong) = (Vec::new(), Vec::new());
    for (row, particle) in particles.iter().enumerate() {
        let in_row = |what| format!("{name}: particle {}: {what}", row + 1);
        match camera.renderer().check(particle) {
            Ok(warning) => found.extend(warning.map(in_row)),
            Err(e) => wrong.push(in_row(e.to_string())),
        }
    }
    if wrong.is_empty() { Ok(found) } else { Err(Error::Input(wrong)) }
}

/// Adds at most [`MAX_WARNINGS`] of the warnings found, and the number of the others.
fn limit(mut found: Vec<String>, warnings: &mut Vec<String>) {
    if found.len() > MAX_WARNINGS {
        let rest = found.len() - MAX_WARNINGS;
        found.truncate(MAX_WARNINGS);
        found.push(format!("... and {rest} more warnings of this kind"));
    }
    warnings.append(&mut found);
}

/// Reads all files and checks that every particle can be rendered; returns the number of particles.
fn check(
    files: &[InputFile],
    camera: &Camera,
    progress: &Progress,
    warnings: &mut Vec<String>,
) -> Result<usize> {
    let checked: Vec<Result<(usize, Vec<String>)>> = files
        .par_iter()
        .map(|file| {
            progress.check()?;
            let particles = read(file)?;
            let warnings = check_particles(&particles, camera, &file.display().to_string())?;
            Ok((particles.len(), warnings))
        })
        .collect();
    let (mut particles, mut problems) = (0, Vec::new());
    let mut found = Vec::new();
    for result in checked {
        match result {
            Err(Error::Interrupted) => return Err(Error::Interrupted),
            Ok((n, more)) => {
                particles += n;
                found.extend(more);
            }
            Err(e) => problems.extend(e.problems()),
        }
    }
    if !problems.is_empty() {
        return Err(Error::Input(problems));
    }
    limit(found, warnings);
    Ok(particles)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_files_of_one_image_are_refused() {
        let names = |files: &[&str]| image_names(&files.iter().map(InputFile::from).collect::<Vec<_>>());
        assert_eq!(
            names(&["d/a.txt", "d/a.b.txt"]).unwrap(),
            [PathBuf::from("a.tif"), PathBuf::from("a.b.tif")]
        );
        let message = names(&["d/a.txt", "d/a.TXT"]).unwrap_err().to_string();
        assert!(message.contains("d/a.txt and d/a.TXT"), "{message}");
    }
}
