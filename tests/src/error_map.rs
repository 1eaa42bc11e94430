//! Pictures of failed comparisons of images.

use std::path::Path;

use image::{Rgb, RgbImage};

/// Writes three panels side by side: ours, theirs (black to white, to a common peak) and the difference in
/// units of its standard deviation (blue: ours is darker, red: brighter; full color at 5).
pub fn write(path: &Path, width: usize, ours: &[f64], theirs: &[f64], z: &[f64]) -> anyhow::Result<()> {
    let peak = ours.iter().chain(theirs).copied().fold(f64::MIN_POSITIVE, f64::max);
    // The square root makes faint rings visible.
    let gray = |v: f64| Rgb([((v / peak).max(0.0).sqrt() * 255.0) as u8; 3]);
    let signed = |z: f64| {
        let fade = 255 - ((z.abs() / 5.0).min(1.0) * 255.0) as u8;
        if z > 0.0 { Rgb([255, fade, fade]) } else { Rgb([fade, fade, 255]) }
    };
    let height = ours.len() / width;
    let mut map = RgbImage::new((3 * width) as u32, height as u32);
    for (i, ((&a, &b), &z)) in ours.iter().zip(theirs).zip(z).enumerate() {
        let (x, y) = ((i % width) as u32, (i / width) as u32);
        let panel = width as u32;
        map.put_pixel(x, y, gray(a));
        map.put_pixel(x + panel, y, gray(b));
        map.put_pixel(x + 2 * panel, y, signed(z));
    }
    Ok(map.save(path)?)
}
