//! A real bead beside the fitted models: planes of the scan, of rays and of waves, row by row.

use std::path::Path;

use anyhow::Context;
use fit::{Scan, StagePositions};
use image::{GrayImage, imageops};
use suite::picture::{side_by_side, stacked, write};

/// Number of planes shown, and the planes from one to the next.
const PLANES: usize = 11;
const EVERY: usize = 2;
/// Screen pixels for one pixel.
const ZOOM: u32 = 2;

/// Writes `<name>.png`: square roots of counts above the background, each column on the scale of the scan's
/// plane. The brightest plane is in the middle.
pub(super) fn montage(scans: &[&Path], out: &Path, name: &str) -> anyhow::Result<()> {
    let scans = scans.iter().map(|path| Ok(Scan::read(path, &StagePositions::Step(1.0))?));
    let scans = scans.collect::<anyhow::Result<Vec<Scan>>>()?;
    let data = &scans[0].planes;
    let peak = |plane: &Vec<u16>| plane.iter().copied().max().unwrap_or_default();
    let brightest = (0..data.len()).max_by_key(|&i| peak(&data[i])).context("a plane")?;
    let first = brightest.saturating_sub(PLANES / 2 * EVERY).min(data.len().saturating_sub(PLANES * EVERY));
    let shown: Vec<usize> = (first..data.len()).step_by(EVERY).take(PLANES).collect();
    let rows = scans.iter().map(|scan| {
        let tiles = shown.iter().map(|&i| {
            let dark = f64::from(median(&data[i]));
            let white = f64::from(peak(&data[i])) - dark;
            let gray = scan.planes[i].iter().map(|&count| {
                (255.0 * ((f64::from(count) - dark) / white).clamp(0.0, 1.0).sqrt()).round() as u8
            });
            GrayImage::from_raw(scan.width as u32, scan.height as u32, gray.collect()).context("a plane")
        });
        Ok(side_by_side(&tiles.collect::<anyhow::Result<Vec<_>>>()?))
    });
    let picture = stacked(&rows.collect::<anyhow::Result<Vec<_>>>()?);
    let (width, height) = picture.dimensions();
    let zoomed = imageops::resize(&picture, width * ZOOM, height * ZOOM, imageops::FilterType::Nearest);
    write(&zoomed, out, name)
}

fn median(counts: &[u16]) -> u16 {
    let mut sorted = counts.to_vec();
    sorted.sort_unstable();
    sorted[sorted.len() / 2]
}
