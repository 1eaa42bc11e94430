//! Grayscale pictures of images: contrast stretching, cropping, stacking, saving.

use std::path::Path;

use anyhow::Context;
use image::{GrayImage, ImageFormat, Luma};
use microsig_core::sensor::{Counts, Image};

/// 8-bit picture of an image: black at `black` counts and below, white at `white` and above.
pub fn stretch(image: &Image, black: f64, white: f64) -> GrayImage {
    let counts = image.counts.whole();
    GrayImage::from_fn(image.width, image.height, |x, y| {
        let level = (f64::from(counts[(y * image.width + x) as usize]) - black) / (white - black);
        Luma([(level * 255.0).round() as u8])
    })
}

/// 8-bit picture of the light on rows of `width` pixels: square roots, from 0 to the highest, since rings are
/// much fainter than focused images.
pub fn square_roots(light: &[f64], width: u32) -> GrayImage {
    let peak = light.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    GrayImage::from_fn(width, light.len() as u32 / width, |x, y| {
        Luma([(255.0 * (light[(y * width + x) as usize] / peak).max(0.0).sqrt()).round() as u8])
    })
}

/// Every pixel of a picture as a square of `zoom` x `zoom`.
pub fn magnified(picture: &GrayImage, zoom: u32) -> GrayImage {
    let (width, height) = picture.dimensions();
    image::imageops::resize(picture, width * zoom, height * zoom, image::imageops::FilterType::Nearest)
}

/// Quantile of the counts: `share` (0 to 1) of the pixels lie below it.
pub fn quantile(image: &Image, share: f64) -> f64 {
    let mut sorted = image.counts.whole().into_owned();
    sorted.sort_unstable();
    f64::from(sorted[((sorted.len() - 1) as f64 * share) as usize])
}

/// `height` rows of an image from row `first` (from 0) on.
pub fn crop(image: &Image, first: u32, height: u32) -> Image {
    let at = |row: u32| (row * image.width) as usize;
    let counts = image.counts.whole()[at(first)..at(first + height)].to_vec();
    Image { height, counts: Counts::Whole(counts), ..image.clone() }
}

/// Pictures on top of one another.
pub fn stacked(parts: &[GrayImage]) -> GrayImage {
    let mut picture = GrayImage::new(parts[0].width(), parts.iter().map(GrayImage::height).sum());
    let mut top = 0;
    for part in parts {
        image::imageops::replace(&mut picture, part, 0, i64::from(top));
        top += part.height();
    }
    picture
}

/// Pictures side by side with a white line between them.
pub fn side_by_side(tiles: &[GrayImage]) -> GrayImage {
    let (width, height) = tiles[0].dimensions();
    let mut strip = GrayImage::from_pixel(tiles.len() as u32 * (width + 1) - 1, height, Luma([255]));
    for (i, tile) in tiles.iter().enumerate() {
        image::imageops::replace(&mut strip, tile, (i as u32 * (width + 1)).into(), 0);
    }
    strip
}

/// Writes `<name>.png`.
pub fn write(picture: &GrayImage, folder: &Path, name: &str) -> anyhow::Result<()> {
    let path = folder.join(format!("{name}.png"));
    picture.save_with_format(&path, ImageFormat::Png).with_context(|| path.display().to_string())
}
