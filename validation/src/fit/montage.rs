//! A real bead beside the fitted models: planes of the scan, of rays and of waves, row by row.

use std::path::Path;

use anyhow::Context;
use fit::{Scan, StagePositions};
use image::GrayImage;
use suite::picture::{magnified, side_by_side, stacked, write};

/// Largest number of planes shown.
const PLANES: usize = 11;
/// A plane shows the bead if its peak exceeds this fraction of the brightest plane's peak and twice the peak
/// of the darkest plane; otherwise noise and rounding dominate.
const MIN_PEAK: f64 = 0.05;
/// Screen pixels for one pixel.
const ZOOM: u32 = 2;

/// Writes `<name>.png`: square roots of counts above the background, each column on the scale of the scan's
/// plane. The planes are spread evenly over those that show the bead.
pub(super) fn montage(scans: &[&Path], out: &Path, name: &str) -> anyhow::Result<()> {
    let scans = scans.iter().map(|path| Ok(Scan::read(path, &StagePositions::Step(1.0), None)?));
    let scans = scans.collect::<anyhow::Result<Vec<Scan>>>()?;
    let data = &scans[0].planes;
    let heights: Vec<f64> = data.iter().map(|plane| f64::from(peak(plane) - median(plane))).collect();
    let highest = heights.iter().copied().fold(0.0, f64::max);
    let lowest = heights.iter().copied().fold(highest, f64::min);
    let shows = |height: &f64| *height > (MIN_PEAK * highest).max(2.0 * lowest);
    let first = heights.iter().position(shows).context("a plane with the bead")?;
    let last = heights.iter().rposition(shows).context("a plane with the bead")?;
    let count = (last - first + 1).min(PLANES);
    let shown: Vec<usize> = (0..count).map(|i| first + i * (last - first) / (count - 1).max(1)).collect();
    let rows = scans.iter().map(|scan| {
        let tiles = shown.iter().map(|&i| {
            let dark = f64::from(median(&data[i]));
            let white = heights[i].max(1.0);
            let gray = scan.planes[i].iter().map(|&count| {
                (255.0 * ((f64::from(count) - dark) / white).clamp(0.0, 1.0).sqrt()).round() as u8
            });
            GrayImage::from_raw(scan.width as u32, scan.height as u32, gray.collect()).context("a plane")
        });
        Ok(side_by_side(&tiles.collect::<anyhow::Result<Vec<_>>>()?))
    });
    let picture = stacked(&rows.collect::<anyhow::Result<Vec<_>>>()?);
    write(&magnified(&picture, ZOOM), out, name)
}

fn peak(counts: &[u16]) -> u16 {
    counts.iter().copied().max().unwrap_or_default()
}

fn median(counts: &[u16]) -> u16 {
    let mut sorted = counts.to_vec();
    sorted.sort_unstable();
    sorted[sorted.len() / 2]
}
