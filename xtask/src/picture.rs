//! Grey pictures, and SVG figures that carry one with labels around it.

use base64::{Engine, engine::general_purpose::STANDARD};
use std::fmt::Write;
use std::io::Cursor;
use std::path::Path;

use anyhow::Context;
use image::{GrayImage, ImageFormat, Luma};
use microsig_core::sensor::Image;

/// 8-bit picture of an image: black at `black` counts and below, white at `white` and above.
pub(crate) fn stretch(image: &Image, black: f64, white: f64) -> GrayImage {
    GrayImage::from_fn(image.width, image.height, |x, y| {
        let level = (f64::from(image.counts[(y * image.width + x) as usize]) - black) / (white - black);
        Luma([(level * 255.0).round() as u8])
    })
}

/// The count that `share` of the pixels lie below.
pub(crate) fn quantile(image: &Image, share: f64) -> f64 {
    let mut sorted = image.counts.clone();
    sorted.sort_unstable();
    f64::from(sorted[((sorted.len() - 1) as f64 * share) as usize])
}

/// `height` rows of an image from row `first` (from 0) on.
pub(crate) fn crop(image: &Image, first: u32, height: u32) -> Image {
    let at = |row: u32| (row * image.width) as usize;
    let counts = image.counts[at(first)..at(first + height)].to_vec();
    Image { height, counts, ..image.clone() }
}

/// Pictures below each other.
pub(crate) fn stacked(parts: &[GrayImage]) -> GrayImage {
    let mut picture = GrayImage::new(parts[0].width(), parts.iter().map(GrayImage::height).sum());
    let mut top = 0;
    for part in parts {
        image::imageops::replace(&mut picture, part, 0, i64::from(top));
        top += part.height();
    }
    picture
}

/// Pictures beside each other with a white line between them.
pub(crate) fn side_by_side(tiles: &[GrayImage]) -> GrayImage {
    let (width, height) = tiles[0].dimensions();
    let mut strip = GrayImage::from_pixel(tiles.len() as u32 * (width + 1) - 1, height, Luma([255]));
    for (i, tile) in tiles.iter().enumerate() {
        image::imageops::replace(&mut strip, tile, (i as u32 * (width + 1)).into(), 0);
    }
    strip
}

/// Text at a place of a figure.
pub(crate) struct Label {
    /// Pixels of the picture from its left edge to the middle of the text.
    pub(crate) x: f64,
    /// Pixels of the picture from its top edge to the middle of the text; outside the picture in a margin.
    pub(crate) y: f64,
    pub(crate) text: String,
}

/// A picture with margins for labels.
pub(crate) struct Figure<'a> {
    pub(crate) picture: &'a GrayImage,
    pub(crate) title: &'a str,
    /// Screen pixels for one pixel of the picture.
    pub(crate) scale: f64,
    /// Margins left and below, screen pixels; the title stands above.
    pub(crate) left: f64,
    pub(crate) below: f64,
    pub(crate) labels: Vec<Label>,
    /// Under the picture: what the axis means.
    pub(crate) caption: &'a str,
}

impl Figure<'_> {
    /// Writes `<name>.png`, the bare picture, and `<name>.svg`, the same with its labels.
    pub(crate) fn write(&self, folder: &Path, name: &str) -> anyhow::Result<()> {
        let mut png = Cursor::new(Vec::new());
        self.picture.write_to(&mut png, ImageFormat::Png)?;
        for (suffix, bytes) in [("png", png.get_ref().clone()), ("svg", self.svg(png.get_ref()).into_bytes())]
        {
            let path = folder.join(format!("{name}.{suffix}"));
            std::fs::write(&path, bytes).with_context(|| path.display().to_string())?;
        }
        Ok(())
    }

    fn svg(&self, png: &[u8]) -> String {
        const TOP: f64 = 34.0;
        let (w, h) =
            (f64::from(self.picture.width()) * self.scale, f64::from(self.picture.height()) * self.scale);
        let (width, height) = (self.left + w + 10.0, TOP + h + self.below);
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width:.0}\" height=\"{height:.0}\" \
             viewBox=\"0 0 {width:.0} {height:.0}\" font-family=\"sans-serif\" font-size=\"14\" text-anchor=\"middle\">\n\
             <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
        );
        let mut text = |x: f64, y: f64, size: u32, text: &str| {
            let _ = writeln!(svg, "<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"{size}\">{text}</text>");
        };
        text(self.left + w / 2.0, 22.0, 16, self.title);
        text(self.left + w / 2.0, height - 10.0, 14, self.caption);
        for label in &self.labels {
            text(self.left + label.x * self.scale, TOP + label.y * self.scale + 5.0, 14, &label.text);
        }
        let _ = writeln!(
            svg,
            "<image x=\"{}\" y=\"{TOP}\" width=\"{w}\" height=\"{h}\" style=\"image-rendering:pixelated\" \
             href=\"data:image/png;base64,{}\"/>\n</svg>",
            self.left,
            STANDARD.encode(png)
        );
        svg
    }
}
