//! The images of a recording: which page of which file is which frame, and their way into the folder. Memory
//! holds one page at a time.

use std::io::BufReader;
use std::path::{Path, PathBuf};

use generator::dataset::ContactSheet;
use microsig_core::formats::pages::{PageSize, Pages};
use microsig_core::formats::tiff::{self, PixelScale};
use microsig_core::sensor::{Counts, Image};
use storage::advice;
use storage::advice::{flag, option};
use storage::error::{Error, MOST_SHOWN, Result};
use storage::{OutputFolder, Placed, input};
use tracking::GrayImage;

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
    time: usize,
    /// Whether the file is the image: it has no other page, and any program reads its counts.
    is_image: bool,
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
    /// Mean and standard deviation of the background of the first frame, counts.
    pub(crate) background: [f64; 2],
    /// Warnings about the images.
    pub(crate) warnings: Vec<String>,
}

impl Frames {
    /// Finds the frames in the files, and checks that all are gray counts of the size of the scan, or without
    /// one of the first image.
    pub(crate) fn find(options: &ImportOptions, scan: Option<(usize, usize)>) -> Result<Self> {
        let mut files = files::of(&options.images)?;
        let named = if options.pairs { files::paired(&files)? } else { None };
        let are_named = named.is_some();
        files = named.unwrap_or(files);
        let (mut sources, mut problems) = (Vec::new(), Vec::new());
        let mut size =
            scan.map(|(width, height)| PageSize { width: width as u32, height: height as u32, bits: 8 });
        let mut sets: Vec<Option<(Vec<String>, usize)>> = Vec::new();
        for (number, file) in files.iter().enumerate() {
            match pages_of(number, file, options, (&mut size, scan.is_some())) {
                Ok((pages, set)) => {
                    sources.extend(pages);
                    sets.push(set);
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
        if let Some((set, times)) = sets.iter().flatten().next() {
            sources.sort_by_key(|source| source.time);
            let is_whole = sources.iter().map(|source| source.time).eq(0..*times);
            if !is_whole || sets.iter().any(|of| of.as_ref().is_none_or(|(other, _)| other != set)) {
                return Err(Error::input(format!(
                    "{}: {} of {times} times of a set of files (OME-XML): expected all files of one set: {}",
                    files[0].display(),
                    sources.len(),
                    set.join(", ")
                )));
            }
        }
        if are_named && sources.len() != files.len() {
            let what = "several images in files whose names tell a and b of pairs: expected one in each";
            return Err(Error::input(format!("{}: {what}", files[0].display())));
        }
        if options.pairs && !sources.len().is_multiple_of(2) {
            let what = format!(" with {} images: expected an even number", sources.len());
            return Err(Error::option(advice!(flag("pairs"), what)));
        }
        // There is at least one file, and each has a page.
        let size = size.unwrap_or(PageSize { width: 0, height: 0, bits: 8 });
        Ok(Frames { files, sources, size, pairs: options.pairs })
    }

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
                Some((number, pages)) if number == source.file && pages.page() <= source.page => pages,
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
            let is_kept = source.is_image && correction.is_none();
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
            if frame == 0 {
                let gray = GrayImage {
                    width: self.size.width as usize,
                    height: self.size.height as usize,
                    counts: counts.iter().copied().map(f32::from).collect(),
                };
                written.background = <[f32; 2]>::from(gray.background()).map(f64::from);
            }
            let image = image(counts);
            if shown {
                sheet.add(frame as u32, ContactSheet::tile(&image));
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

pub(crate) fn opened(file: &Path) -> Result<Pages<BufReader<std::fs::File>>> {
    Ok(Pages::open(BufReader::with_capacity(1 << 16, input::open(file)?), &file.display().to_string())?)
}

/// The frames of a file, in the order of times, and the set of files that it is part of, with the times of the
/// set. `size`: of all images, if it is known, and whether the scan states it.
#[allow(clippy::type_complexity)]
fn pages_of(
    number: usize,
    file: &Path,
    options: &ImportOptions,
    (size, is_scan): (&mut Option<PageSize>, bool),
) -> Result<(Vec<Source>, Option<(Vec<String>, usize)>)> {
    let name = file.display();
    let mut pages = opened(file)?;
    let mut is_plain = true;
    loop {
        let found = pages.size()?;
        let expected = size.get_or_insert(found);
        if (found.width, found.height) != (expected.width, expected.height) {
            let why = if is_scan {
                "as the scan; calibration images are for a place of the field of view, so crop both in the same way"
            } else {
                "as the first image"
            };
            let [a, b, c, d] = [found.width, found.height, expected.width, expected.height];
            let page = pages.page();
            return Err(Error::input(format!(
                "{name}: page {page}: {a} x {b} px: expected {c} x {d} px, {why}"
            )));
        }
        expected.bits = expected.bits.max(found.bits);
        is_plain &= pages.is_plain();
        if !pages.go_on()? {
            break;
        }
    }
    let n = pages.page() + 1;
    let stated = if options.pages_per_time.is_none() { pages.arrangement(n)? } else { None };
    let [channels, slices, times] =
        stated.as_ref().map_or([options.pages_per_time.unwrap_or(1), 1, n], |of| of.sizes);
    // Programs write sequences as slices, too.
    let are_slices_times = times == 1 && slices > 1;
    let per_time = if are_slices_times { channels } else { channels.saturating_mul(slices) };
    if stated.is_none() && (per_time == 0 || !n.is_multiple_of(per_time)) {
        let what = format!("{name}: {n} pages: expected a multiple of ");
        return Err(Error::option(advice!(what, option("pages_per_time").of(per_time))));
    }
    let chosen = match (options.page, per_time) {
        (None, 1) => 0,
        (None, _) => {
            let by = stated.as_ref().map_or("", |of| of.by);
            let by = match per_time == channels {
                _ if by.is_empty() => String::new(),
                true => format!(" ({channels} channels, {by})"),
                false => format!(" ({channels} channels x {slices} slices, channels first, {by})"),
            };
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
    let place = |page: usize| match &stated {
        None => (page / per_time, page % per_time),
        Some(of) => match of.pages[page] {
            [channel, slice, _] if are_slices_times => (slice, channel),
            [channel, slice, time] => (time, channel + channels * slice),
        },
    };
    let mut sources: Vec<Source> = (0..n)
        .filter(|page| place(*page).1 == chosen)
        .map(|page| Source { file: number, page, time: place(page).0, is_image: n == 1 && is_plain })
        .collect();
    sources.sort_by_key(|source| source.time);
    let whole = if are_slices_times { slices } else { times };
    Ok((sources, stated.filter(|of| !of.set.is_empty()).map(|of| (of.set, whole))))
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
