//! The contact sheet of a dataset: an image with a few of its frames.

use image::GrayImage;
use image::imageops;
use microsig_core::sensor::Image;

use storage::{Error, OutputFolder, Result};

/// Name of the sheet.
const FILE: &str = "preview.png";
/// Frames on the sheet.
const FRAMES: u32 = 6;
/// Frames side by side: the two images of a pair, or two of a sequence.
const COLUMNS: u32 = 2;
/// Largest width of a frame on the sheet, px.
const WIDTH: u32 = 376;
/// White gap between frames, px.
const GAP: u32 = 6;

/// A contact sheet to which frames are added.
#[derive(Default)]
pub struct ContactSheet {
    tiles: Vec<(u32, GrayImage)>,
}

impl ContactSheet {
    /// The frames to show out of `frames`: the first ones if they are pairs, otherwise evenly spaced ones.
    pub fn chosen(frames: u32, pairs: bool) -> Vec<u32> {
        let n = frames.min(FRAMES);
        if pairs || frames <= FRAMES {
            (0..n).collect()
        } else {
            (0..n).map(|i| (u64::from(i) * u64::from(frames - 1) / u64::from(n - 1)) as u32).collect()
        }
    }

    /// The image of a frame, as the sheet shows it.
    pub fn tile(image: &Image) -> GrayImage {
        fit(stretch(image))
    }

    /// Adds a frame.
    pub fn add(&mut self, frame: u32, tile: GrayImage) {
        self.tiles.push((frame, tile));
    }

    /// Writes the sheet as `preview.png`.
    pub fn write(mut self, folder: &OutputFolder) -> Result<()> {
        self.tiles.sort_by_key(|&(frame, _)| frame);
        let (width, height) = self.tiles.first().map_or((WIDTH, 1), |(_, tile)| tile.dimensions());
        let rows = (self.tiles.len() as u32).div_ceil(COLUMNS);
        let columns = COLUMNS.min(self.tiles.len() as u32).max(1);
        let size = |n: u32, side: u32| n * side + (n + 1) * GAP;
        let mut sheet =
            GrayImage::from_pixel(size(columns, width), size(rows.max(1), height), image::Luma([255]));
        for (i, (_, tile)) in self.tiles.iter().enumerate() {
            let (column, row) = (i as u32 % COLUMNS, i as u32 / COLUMNS);
            let (x, y) = (GAP + column * (width + GAP), GAP + row * (height + GAP));
            imageops::replace(&mut sheet, tile, i64::from(x), i64::from(y));
        }
        let mut bytes = std::io::Cursor::new(Vec::new());
        sheet
            .write_to(&mut bytes, image::ImageFormat::Png)
            .map_err(|e| Error::Write { path: folder.join(FILE), source: std::io::Error::other(e) })?;
        folder.save_bytes(FILE, bytes.get_ref())
    }
}

/// The image as a frame on the sheet: a wide one is reduced to [`WIDTH`]; a narrow one is enlarged by the
/// largest whole number that fits, so that its pixels stay sharp and of one size.
fn fit(image: GrayImage) -> GrayImage {
    let (width, height) = image.dimensions();
    match WIDTH / width {
        0 => imageops::thumbnail(&image, WIDTH, (WIDTH * height / width).max(1)),
        1 => image,
        times => {
            GrayImage::from_fn(times * width, times * height, |x, y| *image.get_pixel(x / times, y / times))
        }
    }
}

/// Converts counts to 8 bit, linearly from the 1 % quantile (black) to the 99.8 % quantile (white). Integer
/// arithmetic gives the same bytes on all machines.
fn stretch(image: &Image) -> GrayImage {
    let whole = image.counts.whole();
    let mut pixels_at = vec![0u32; 1 << 16];
    whole.iter().for_each(|count| pixels_at[usize::from(*count)] += 1);
    let quantile = |per_mille: usize| {
        let rank = ((whole.len() - 1) * per_mille / 1000) as u32;
        let mut below = 0;
        let passes = |pixels: &u32| {
            below += pixels;
            below > rank
        };
        pixels_at.iter().position(passes).unwrap_or_default() as u32
    };
    let black = quantile(10);
    let white = quantile(998).max(black + 1);
    let gray = |count: &u16| ((u32::from(*count).clamp(black, white) - black) * 255 / (white - black)) as u8;
    let pixels = whole.iter().map(gray).collect();
    GrayImage::from_raw(image.width, image.height, pixels).unwrap_or_default()
}
