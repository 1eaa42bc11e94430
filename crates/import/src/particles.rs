//! The particles of a scan from which calibration stacks are made: those that lie whole in the image, far
//! enough from others, and that are not saturated.

use fit::{Level, Scan};

use rayon::prelude::*;
use tracking::GrayImage;

use super::Unused;
use super::located::Located;

/// Pixels around the window that sub-pixel shifts reach.
pub(crate) const MARGIN: usize = 3;

/// Largest share of the pixels of a window that may belong to neighbors at any depth.
const MOST_LOST: f64 = 0.4;

/// Distance added to the radius of a neighbor's image, px.
const APART_PX: f64 = 1.5;

/// Number of pixels at full scale at which a particle counts as saturated.
const SATURATED_PIXELS: usize = 3;

#[derive(Debug)]
pub(crate) struct ScanParticle {
    /// Column and row of the middle pixel of its images, px from 0.
    pub(crate) middle: [usize; 2],
    /// Mean image at each depth above the background.
    pub(crate) images: Vec<GrayImage>,
    /// For each depth and pixel, whether it is the particle's own; others are lit by neighbors.
    pub(crate) own: Vec<Vec<bool>>,
}

/// The usable particles with windows of this half width, in the order of `located`, and numbers of others;
/// `radii`: radius of the image at each depth.
pub(crate) fn usable(
    scan: &Scan,
    levels: &[Level],
    located: &Located,
    (half, radii): (usize, &[usize]),
    wanted: impl Fn([f64; 2]) -> bool + Sync,
) -> (Vec<ScanParticle>, Unused) {
    let reach = half + MARGIN;
    let full = scan.full_scale;
    let mut unused = Unused::default();
    let mut middles = Vec::new();
    for (k, at) in located.places.iter().enumerate() {
        let middle = at.map(|c| c.round() as usize);
        if middle[0] < reach
            || middle[1] < reach
            || middle[0] + reach >= scan.width
            || middle[1] + reach >= scan.height
        {
            unused.cut += 1;
            continue;
        }
        let own = own_pixels(located, k, middle, (half, radii));
        let lost = |own: &Vec<bool>| own.iter().filter(|own| !**own).count() as f64 / own.len() as f64;
        if own.iter().any(|own| lost(own) > MOST_LOST) {
            unused.crowded += 1;
            continue;
        }
        if is_saturated(scan, middle, half, full) {
            unused.saturated += 1;
            continue;
        }
        if wanted(*at) {
            middles.push((middle, own));
        }
    }
    let cut = |(middle, own): ([usize; 2], Vec<Vec<bool>>)| {
        let images =
            levels.iter().map(|level| image(scan, level, middle, reach, located.background)).collect();
        ScanParticle { middle, images, own }
    };
    (middles.into_par_iter().map(cut).collect(), unused)
}

fn own_pixels(
    located: &Located,
    k: usize,
    middle: [usize; 2],
    (half, radii): (usize, &[usize]),
) -> Vec<Vec<bool>> {
    let reach = half + MARGIN;
    let side = 2 * reach + 1;
    let relative = |at: &[f64; 2]| [0, 1].map(|axis| at[axis] - middle[axis] as f64);
    let others = located.places.iter().enumerate().filter(|(j, _)| *j != k).map(|(_, at)| relative(at));
    let others: Vec<[f64; 2]> = others.filter(|[x, y]| x.hypot(*y) < 4.0 * reach as f64).collect();
    let distance = |i: usize| {
        let at = [(i % side) as f64 - reach as f64, (i / side) as f64 - reach as f64];
        others.iter().map(|other| (at[0] - other[0]).hypot(at[1] - other[1])).fold(f64::INFINITY, f64::min)
    };
    let distances: Vec<f64> = (0..side * side).map(distance).collect();
    let of_depth = |radius: &usize| distances.iter().map(|d| *d > *radius as f64 + APART_PX).collect();
    radii.iter().map(of_depth).collect()
}

fn is_saturated(scan: &Scan, [column, row]: [usize; 2], half: usize, full: u16) -> bool {
    scan.planes.iter().any(|plane| {
        let rows = row - half..=row + half;
        let pixels =
            rows.flat_map(|y| &plane[y * scan.width + column - half..=y * scan.width + column + half]);
        pixels.filter(|count| **count >= full).count() >= SATURATED_PIXELS
    })
}

/// Mean over the frames of a depth, above the background.
fn image(scan: &Scan, level: &Level, [column, row]: [usize; 2], reach: usize, background: f64) -> GrayImage {
    let n = level.planes.len() as f64;
    GrayImage::from_fn((2 * reach + 1, 2 * reach + 1), |x, y| {
        let at = (row + y - reach) * scan.width + column + x - reach;
        let sum: f64 = level.planes.iter().map(|plane| f64::from(scan.planes[*plane][at])).sum();
        (sum / n - background) as f32
    })
}
