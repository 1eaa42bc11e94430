//! Images of particles beside a model's, as data URIs.

use std::io::Cursor;

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use image::{GrayImage, ImageFormat, Luma, Rgb, RgbImage};

use storage::error::{Error, Result};

/// Residuals are shown from minus to plus this many standard deviations.
pub(super) const SHOWN_SD: f32 = 5.0;

/// Data (0), model (1) or residual (2) of a square of this edge, px. Data and model have the same gray scale, from
/// the background to the brightest pixel; pixels of other particles are NaN.
pub(super) fn of(edge: usize, [data, model, residual]: [&[f32]; 3], of: usize) -> Result<String> {
    let brightest = |counts: &[f32]| counts.iter().copied().filter(|v| v.is_finite()).fold(1e-6, f32::max);
    let white = brightest(data).max(brightest(model));
    let side = edge as u32;
    let at = |x: u32, y: u32| y as usize * edge + x as usize;
    let mut png = Cursor::new(Vec::new());
    let failed = |e: image::ImageError| Error::input(format!("montage: {e}"));
    if of == 2 {
        RgbImage::from_fn(side, side, |x, y| Rgb(shade(residual[at(x, y)], x + y)))
            .write_to(&mut png, ImageFormat::Png)
            .map_err(failed)?;
    } else {
        let counts = if of == 0 { data } else { model };
        let level = |v: f32| if v.is_finite() { (255.0 * v / white).clamp(0.0, 255.0) as u8 } else { 96 };
        GrayImage::from_fn(side, side, |x, y| Luma([level(counts[at(x, y)])]))
            .write_to(&mut png, ImageFormat::Png)
            .map_err(failed)?;
    }
    Ok(format!("data:image/png;base64,{}", BASE64_STANDARD.encode(png.into_inner())))
}

/// Color of a residual: blue below zero, red above; stripes on pixels of other particles.
fn shade(residual: f32, stripe: u32) -> [u8; 3] {
    if !residual.is_finite() {
        return if stripe.is_multiple_of(4) { [140; 3] } else { [225; 3] };
    }
    diverging(residual / SHOWN_SD)
}

/// Blue at -1, white at 0, red at 1.
pub(super) fn diverging(value: f32) -> [u8; 3] {
    let strength = value.abs().min(1.0);
    let fade = |full: f32| (255.0 + (full - 255.0) * strength) as u8;
    let [r, g, b] = if value < 0.0 { [11.0, 98.0, 184.0] } else { [196.0, 67.0, 43.0] };
    [fade(r), fade(g), fade(b)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn residuals_fade_from_white_to_their_color() {
        assert_eq!(shade(0.0, 1), [255; 3]);
        assert_eq!(shade(9.0, 1), [196, 67, 43]);
        assert_eq!(shade(-SHOWN_SD, 1), [11, 98, 184]);
        assert_ne!(shade(f32::NAN, 4), shade(f32::NAN, 5));
    }
}
