//! The images of a recording: which page of which file is which frame, and their way into the folder. Memory
//! holds one page at a time.

use std::io::BufReader;
use std::path::{Path, PathBuf};

use generator::dataset::ContactSheet;
use microsig_core::formats::pages::{PageOrder, PageSize, Pages};
use microsig_core::formats::tiff::{self, PixelScale};
use microsig_core::sensor::{Counts, Image};
use storage::advice;
use storage::advice::{flag, option};
use storage::error::{Error, MOST_SHOWN, Result};
use storage::{OutputFolder, Placed, input};

use super::correction::Correction;
use super::{ImportOptions, files};

/// Counts at which cameras saturate, besides those at which their files do.
const FULL_SCALES: [u16; 5] = [255, 1023, 4095, 16_383, u16::MAX];

/// Number of pixels at full scale at which an image counts as saturated.
const SATURATED_PIXELS: usize = 3;

/// A frame: a page of a file.
#[derive(Debug, Clone, Copy)]
struct Source {
    file: usize,
    page: usize,
    /// Whether the file has no other page.
    is_alone: bool,
}

/// The frames of a recording, in order.
#[derive(Debug)]
pub(crate) struct Frames {
    files: Vec<PathBuf>,
    sources: Vec<Source>,
    size: PageSize,
    pairs: bool,
}

/// How the images came into the folder.
#[derive(Debug, Default)]
pub(crate) struct Written {
    /// Hard links to the given files.
    pub(crate) linked: usize,
    /// Copies of the given files.
    pub(crate) copied: usize,
    /// Images written from pages of files, or after a correction.
    pub(crate) written: usize,
    /// Warnings about the images.
    pub(crate) warnings: Vec<String>,
}

impl Frames {
    /// Finds the frames in the files, and checks that all are gray counts of the size of the scan.
    ///
    /// # Errors
    /// Files that are no such images; pages that cannot be divided into times.
    pub(crate) fn find(options: &ImportOptions, scan: (usize, usize)) -> Result<Self> {
        let files = files::of(&options.images)?;
        let (mut sources, mut bits, mut problems) = (Vec::new(), 8, Vec::new());
        for (number, file) in files.iter().enumerate() {
            match pages_of(file, options, scan) {
                Ok((pages, of_file)) => {
                    bits = bits.max(of_file.bits);
                    let is_alone = of_file.pages == 1;
                    sources.extend(pages.into_iter().map(|page| Source { file: number, page, is_alone }));
                }
                Err(e) => problems.extend(e.problems()),
            }
            if problems.len() > MOST_SHOWN {
                break;
            }
        }
        if !problems.is_empty() {
            return Err(Error::Input(problems));
        }
        if options.pairs && !sources.len().is_multiple_of(2) {
            let what = format!(" with {} images: expected an even number", sources.len());
            return Err(Error::option(advice!(flag("pairs"), what)));
        }
        let size = PageSize { width: scan.0 as u32, height: scan.1 as u32, bits };
        Ok(Frames { files, sources, size, pairs: options.pairs })
    }

    /// Number of frames.
    pub(crate) fn len(&self) -> usize {
        self.sources.len()
    }

    /// Whether frames 2k and 2k + 1 are a pair.
    pub(crate) fn are_pairs(&self) -> bool {
        self.pairs
    }

    /// Size and bits of the images.
    pub(crate) fn size(&self) -> PageSize {
        self.size
    }

    /// Path of the image of a frame in the folder, named as in datasets.
    pub(crate) fn path(&self, frame: usize) -> String {
        if self.pairs {
            format!("images/pair_{:05}_{}.tif", frame / 2, ["a", "b"][frame % 2])
        } else {
            format!("images/frame_{frame:05}.tif")
        }
    }

    /// Puts the images into the folder: whole files as links or copies, pages of longer files and corrected
    /// images as files of their own. Also writes the contact sheet.
    ///
    /// # Errors
    /// Images that cannot be read; writing.
    pub(crate) fn write(
        &self,
        folder: &OutputFolder,
        um_per_px: f64,
        correction: &Correction,
        options: &ImportOptions,
    ) -> Result<Written> {
        folder.subfolder("images")?;
        let scale = PixelScale { frame_interval_s: options.dt_s, ..PixelScale::um_per_px(um_per_px) };
        let chosen = ContactSheet::chosen(self.len() as u32, self.pairs);
        let (mut written, mut sheet) = (Written::default(), ContactSheet::default());
        let mut saturated: Vec<String> = Vec::new();
        let bar = options.progress.images(self.len() as u64);
        let mut open: Option<(usize, Pages<BufReader<std::fs::File>>)> = None;
        for (frame, source) in self.sources.iter().enumerate() {
            options.progress.check()?;
            let file = &self.files[source.file];
            let mut pages = match open.take() {
                Some((number, pages)) if number == source.file => pages,
                _ => opened(file)?,
            };
            while pages.page() < source.page {
                pages.go_on()?;
            }
            let mut counts = pages.counts(self.size)?;
            if let Some((n, level)) = saturation(&counts) {
                saturated.push(format!("{}: page {}: {n} px at {level} counts", file.display(), source.page));
            }
            let path = self.path(frame);
            let is_kept = source.is_alone && correction.is_none();
            let image = |counts| Image {
                width: self.size.width,
                height: self.size.height,
                bits: if correction.is_none() { self.size.bits } else { 16 },
                counts: Counts::Whole(counts),
            };
            let shown = chosen.contains(&(frame as u32));
            if is_kept {
                match folder.place(&path, file, !options.copy)? {
                    Placed::Linked => written.linked += 1,
                    Placed::Copied => written.copied += 1,
                }
            } else {
                correction.apply(&mut counts);
                written.written += 1;
            }
            let image = image(counts);
            if shown {
                sheet.add(frame as u32, &image);
            }
            if !is_kept {
                let name = folder.join(&path).display().to_string();
                folder.save(&path, |writer| Ok(tiff::write(writer, &image, &scale, &name)?))?;
            }
            open = Some((source.file, pages));
            bar.inc(1);
        }
        bar.finish();
        sheet.write(folder)?;
        written.warnings = saturation_warning(&saturated, self.len());
        Ok(written)
    }
}

fn opened(file: &Path) -> Result<Pages<BufReader<std::fs::File>>> {
    Ok(Pages::open(BufReader::with_capacity(1 << 16, input::open(file)?), &file.display().to_string())?)
}

/// Number of pages of a file and bits of its pixels.
struct OfFile {
    pages: usize,
    bits: u8,
}

/// The pages of a file that are frames, in the order of times.
fn pages_of(file: &Path, options: &ImportOptions, scan: (usize, usize)) -> Result<(Vec<usize>, OfFile)> {
    let name = file.display();
    let mut pages = opened(file)?;
    let order = pages.order();
    let mut bits = 8;
    loop {
        let size = pages.size()?;
        bits = bits.max(size.bits);
        if (size.width as usize, size.height as usize) != scan {
            return Err(Error::input(format!(
                "{name}: page {}: {} x {} px: expected {} x {} px, as the scan; calibration images are for a place of the field of \
                 view, so crop both in the same way",
                pages.page(),
                size.width,
                size.height,
                scan.0,
                scan.1
            )));
        }
        if !pages.go_on()? {
            break;
        }
    }
    let n = pages.page() + 1;
    let order = order.filter(|order| order.pages() == n);
    let per_time = options.pages_per_time.or(order.as_ref().map(PageOrder::per_time)).unwrap_or(1);
    if per_time == 0 || !n.is_multiple_of(per_time) {
        let what = format!("{name}: {n} pages: expected a multiple of ");
        return Err(Error::option(advice!(what, option("pages_per_time").of(per_time))));
    }
    let page = match (options.page, per_time) {
        (None, 1) => 0,
        (None, _) => {
            let by = order.filter(|_| options.pages_per_time.is_none());
            let by = by.map_or_else(String::new, |order| format!(" ({})", order.by));
            let (what, last) = (format!("{name}: {per_time} pages for each time{by}: give "), per_time - 1);
            let which = format!(", 0 to {last}, the one with the particles");
            return Err(Error::option(advice!(what, option("page"), which)));
        }
        (Some(page), _) if page >= per_time => {
            let (s, last) = (if per_time == 1 { "" } else { "s" }, per_time - 1);
            let what = format!(": {name} has {per_time} page{s} for each time, expected 0 to {last}");
            return Err(Error::option(advice!(option("page").of(page), what)));
        }
        (Some(page), _) => page,
    };
    let place = |of: usize| match &order {
        Some(order) if options.pages_per_time.is_none() => order.place(of),
        _ => (of / per_time, of % per_time),
    };
    Ok(((0..n).filter(|&of| place(of).1 == page).collect(), OfFile { pages: n, bits }))
}

/// Number of saturated pixels of an image, and their count.
pub(crate) fn saturation(counts: &[u16]) -> Option<(usize, u16)> {
    let most = counts.iter().copied().max()?;
    let n = counts.iter().filter(|count| **count == most).count();
    (FULL_SCALES.contains(&most) && n >= SATURATED_PIXELS).then_some((n, most))
}

fn saturation_warning(saturated: &[String], frames: usize) -> Vec<String> {
    let Some(first) = saturated.first() else { return Vec::new() };
    let n = saturated.len();
    vec![format!(
        "saturated: {first}, and so {n} of {frames} images: depths and brightnesses of these particles are wrong"
    )]
}
