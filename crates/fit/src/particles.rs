//! The particles of a scan: their positions, and the surrounding pixels without other particles.

use std::collections::BTreeMap;

use super::background::Background;
use super::scan::Scan;
use storage::advice;
use storage::advice::{Advice, option};
use storage::error::{Error, Result};

/// Maximum number of particles in a fit; more take time without adding information.
const MAX_PARTICLES: usize = 8;

/// Standard deviation of the Gaussian filter on the sum over all planes, in which particles are detected, px.
const SMOOTHING_PX: f64 = 3.0;

/// A maximum must be this many standard deviations above the background, and reach this fraction of the
/// brightest one.
const THRESHOLD_SD: f64 = 8.0;
const THRESHOLD_FRACTION: f64 = 0.15;

/// A ring of pixels counts as lit if its mean is this many standard errors above the background.
const RING_SD: f64 = 3.0;

/// Margin added to the radius of the outermost lit ring, px; and maximum half width of a window, px.
const WINDOW_MARGIN: usize = 4;
const MAX_HALF_WIDTH: usize = 64;

/// Windows are never made smaller than this to fit into the image (half width, px).
const SMALLEST_HALF_WIDTH: usize = 8;

/// Number of pixels at full scale at which a plane counts as saturated.
pub(super) const SATURATED_PIXELS: usize = 3;

/// A window is not used if it loses more than this fraction of its pixels to neighbors.
const MAX_LOST: f64 = 0.25;

/// A detected particle.
#[derive(Debug, Clone)]
pub(super) struct Candidate {
    /// Position of the maximum relative to the center of the first pixel, px.
    pub(super) x: f64,
    pub(super) y: f64,
    /// Light in the smoothed sum over planes, counts.
    pub(super) brightness: f64,
}

/// The windows around the particles of a scan.
#[derive(Debug)]
pub(super) struct Windows {
    /// (width - 1) / 2 of the windows, px.
    pub(super) half: usize,
    pub(super) particles: Vec<Window>,
}

/// A square of pixels around a particle, without those closer than the half width to another particle.
#[derive(Debug, Clone)]
pub(super) struct Window {
    /// Column and row of the middle pixel, from 0.
    pub(super) column: usize,
    pub(super) row: usize,
    /// Indices of the pixels in a plane, and their offsets from the middle, px.
    pub(super) pixels: Vec<(usize, [f64; 2])>,
    /// Pairs of pixels that share an edge, as indices in `pixels`.
    pub(super) neighbors: Vec<(usize, usize)>,
}

impl Window {
    pub(super) fn new([column, row]: [usize; 2], pixels: Vec<(usize, [f64; 2])>) -> Window {
        let place = |[dx, dy]: [f64; 2]| (dy as i64, dx as i64);
        let places: BTreeMap<(i64, i64), usize> =
            pixels.iter().enumerate().map(|(i, &(_, offset))| (place(offset), i)).collect();
        let neighbors = places.iter().flat_map(|(&(dy, dx), &i)| {
            let other = |at: (i64, i64)| places.get(&at).map(|&j| (i, j));
            [other((dy, dx + 1)), other((dy + 1, dx))].into_iter().flatten()
        });
        let neighbors = neighbors.collect();
        Window { column, row, pixels, neighbors }
    }
}

/// Sum of all planes above the background, smoothed by a Gaussian filter.
fn smoothed_sum(scan: &Scan, background: Background) -> Vec<f64> {
    let mut sum = vec![-background.mean * scan.planes.len() as f64; scan.width * scan.height];
    for plane in &scan.planes {
        sum.iter_mut().zip(plane).for_each(|(s, &c)| *s += f64::from(c));
    }
    let half = (3.0 * SMOOTHING_PX) as isize;
    let weights: Vec<f64> = (-half..=half)
        .map(|k| libm::exp(-0.5 * (k as f64 / SMOOTHING_PX) * (k as f64 / SMOOTHING_PX)))
        .collect();
    let total: f64 = weights.iter().sum();
    let (w, h) = (scan.width as isize, scan.height as isize);
    let along = |from: &[f64], dx: isize, dy: isize| -> Vec<f64> {
        let at = |x: isize, y: isize| from[(y.clamp(0, h - 1) * w + x.clamp(0, w - 1)) as usize];
        let value = |i: isize| {
            let (x, y) = (i % w, i / w);
            weights.iter().zip(-half..=half).map(|(v, k)| v * at(x + k * dx, y + k * dy)).sum::<f64>() / total
        };
        (0..w * h).map(value).collect()
    };
    along(&along(&sum, 1, 0), 0, 1)
}

/// The particles of a scan, brightest first.
///
/// # Errors
/// [`Error::Input`] if no particle is found, with the threshold and the best candidate.
pub(super) fn find(scan: &Scan, background: Background) -> Result<Vec<Candidate>> {
    let sum = smoothed_sum(scan, background);
    let (w, h) = (scan.width, scan.height);
    // Noise of the smoothed sum: a Gaussian filter of standard deviation s averages over 4 pi s^2 pixels.
    let averaged = 4.0 * std::f64::consts::PI * SMOOTHING_PX * SMOOTHING_PX;
    let noise = background.noise * libm::sqrt(scan.planes.len() as f64 / averaged);
    let brightest = sum.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let threshold = (THRESHOLD_SD * noise).max(THRESHOLD_FRACTION * brightest);
    let reach = SMOOTHING_PX as usize;
    let is_maximum = |x: usize, y: usize| {
        let here = sum[y * w + x];
        let rows = y.saturating_sub(reach)..(y + reach + 1).min(h);
        here > threshold
            && rows.flat_map(|j| (x.saturating_sub(reach)..(x + reach + 1).min(w)).map(move |i| (i, j))).all(
                |(i, j)| {
                    let there = sum[j * w + i];
                    there < here || (there == here && (j, i) >= (y, x))
                },
            )
    };
    let mut found: Vec<Candidate> = (0..w * h)
        .filter(|&i| is_maximum(i % w, i / w))
        .map(|i| Candidate { x: (i % w) as f64, y: (i / w) as f64, brightness: sum[i] })
        .collect();
    found.sort_by(|a, b| b.brightness.total_cmp(&a.brightness));
    if found.is_empty() {
        let best = sum.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |(i, _)| i);
        let what = format!(
            "no particle found: the brightest position, ({}, {}) px, has {:.0} counts above the background in the smoothed sum over all planes, \
             the threshold is {threshold:.0}; give the positions of the particles with ",
            best % w + 1,
            best / w + 1,
            sum[best]
        );
        return Err(Error::option(advice!(what, option("particles"))));
    }
    Ok(found)
}

/// Particles at positions given by the user, px, with the first pixel's center at (1, 1); those closer than 3 px
/// in x and y, such as the positions of a particle in several frames, are one.
///
/// # Errors
/// A position that is not on the image; none.
pub(super) fn given(scan: &Scan, places_px: &[[f64; 2]]) -> Result<Vec<Candidate>> {
    let mut found: Vec<Candidate> = Vec::new();
    let most = [scan.width, scan.height].map(|pixels| pixels as f64);
    for &[x, y] in places_px {
        if !((1.0..=most[0]).contains(&x) && (1.0..=most[1]).contains(&y)) {
            let what = format!(
                ": ({x}, {y}): expected a position in px on the image of {} x {} px, with the first pixel's center at (1, 1)",
                most[0], most[1]
            );
            return Err(Error::option(advice!(option("particles"), what)));
        }
        let candidate = Candidate { x: x - 1.0, y: y - 1.0, brightness: 0.0 };
        let is_same =
            |other: &Candidate| (other.x - candidate.x).abs() < 3.0 && (other.y - candidate.y).abs() < 3.0;
        if !found.iter().any(is_same) {
            found.push(candidate);
        }
    }
    if found.is_empty() {
        return Err(Error::option(advice!(
            option("particles"),
            ": no rows: expected the positions of particles"
        )));
    }
    Ok(found)
}

/// What helps if windows are too large.
pub(super) fn smaller(what: String) -> Advice {
    let (planes, window) = (option("planes"), option("window_px"));
    advice!(what, "omit the planes with the largest images (", planes, ") or set a smaller ", window)
}

/// Half width of the windows, px: the largest radius at which the ring around a particle is lit in any plane,
/// plus a margin; no larger than fits around the particle that is farthest from the edge of the image.
pub(super) fn half_width(scan: &Scan, background: Background, candidates: &[Candidate]) -> usize {
    let (mut farthest, mut largest) = (0, 0);
    for (k, candidate) in candidates.iter().enumerate().take(MAX_PARTICLES) {
        // Rings beyond half the distance to the nearest neighbor would include its light.
        let nearest = candidates
            .iter()
            .enumerate()
            .filter(|(j, _)| *j != k)
            .map(|(_, other)| libm::hypot(other.x - candidate.x, other.y - candidate.y))
            .fold(f64::INFINITY, f64::min);
        let room = [
            candidate.x,
            candidate.y,
            scan.width as f64 - 1.0 - candidate.x,
            scan.height as f64 - 1.0 - candidate.y,
        ];
        largest = largest.max(room.into_iter().fold(f64::INFINITY, f64::min).max(0.0) as usize);
        let most = room.into_iter().fold(0.5 * nearest, f64::min).min(MAX_HALF_WIDTH as f64) as usize;
        for plane in &scan.planes {
            let mut rings = vec![(0.0, 0usize); most + 1];
            let (x0, y0) = (candidate.x as isize, candidate.y as isize);
            let reach = most as isize;
            for dy in -reach..=reach {
                for dx in -reach..=reach {
                    let ring = libm::round(libm::sqrt((dx * dx + dy * dy) as f64)) as usize;
                    if ring <= most {
                        let at = (y0 + dy) as usize * scan.width + (x0 + dx) as usize;
                        rings[ring].0 += f64::from(plane[at]) - background.mean;
                        rings[ring].1 += 1;
                    }
                }
            }
            let lit = |&(sum, n): &(f64, usize)| sum > RING_SD * background.noise * libm::sqrt(n as f64);
            // A single ring may be lit by chance; two consecutive rings rarely are.
            let last = rings.windows(2).rposition(|pair| pair.iter().all(lit)).map_or(0, |i| i + 1);
            farthest = farthest.max(last);
        }
    }
    (farthest + WINDOW_MARGIN).min(largest.max(SMALLEST_HALF_WIDTH)).min(MAX_HALF_WIDTH)
}

/// Half the distance to the nearest other particle, px, that a quarter of the particles exceed; not less than the smallest
/// half width.
pub(super) fn half_spacing(candidates: &[Candidate]) -> usize {
    let nearest = |k: usize| {
        let away = |other: &Candidate| libm::hypot(other.x - candidates[k].x, other.y - candidates[k].y);
        let others = candidates.iter().enumerate().filter(|(j, _)| *j != k);
        others.map(|(_, other)| away(other)).fold(f64::INFINITY, f64::min)
    };
    let mut spacing: Vec<f64> = (0..candidates.len()).map(nearest).collect();
    spacing.sort_by(f64::total_cmp);
    let half = spacing.get(3 * spacing.len() / 4).map_or(f64::INFINITY, |px| 0.5 * px);
    (half as usize).max(SMALLEST_HALF_WIDTH)
}

/// Windows around the usable particles.
///
/// # Errors
/// [`Error::Input`] if there are none because windows are cut by the edge, overlap neighbors, or are
/// saturated.
pub(super) fn windows(scan: &Scan, candidates: &[Candidate], half: usize) -> Result<Windows> {
    let (mut cut, mut crowded, mut saturated) = (0, 0, 0);
    let mut particles = Vec::new();
    for (k, candidate) in candidates.iter().enumerate() {
        let (column, row) = (candidate.x.round() as usize, candidate.y.round() as usize);
        if column < half || row < half || column + half >= scan.width || row + half >= scan.height {
            cut += 1;
            continue;
        }
        let window = window(scan, candidates, k, half);
        let side = (2 * half + 1) as f64;
        if (window.pixels.len() as f64) < (1.0 - MAX_LOST) * side * side {
            crowded += 1;
            continue;
        }
        let full = |plane: &Vec<u16>| {
            window.pixels.iter().filter(|(at, _)| plane[*at] >= scan.full_scale).count() >= SATURATED_PIXELS
        };
        if scan.planes.iter().any(full) {
            saturated += 1;
            continue;
        }
        particles.push(window);
        if particles.len() == MAX_PARTICLES {
            break;
        }
    }
    if particles.is_empty() {
        let n = candidates.len();
        if saturated == n {
            let counts = scan.full_scale;
            return Err(Error::input(format!(
                "all {n} particles are saturated (3 or more pixels at {counts} counts): reduce the exposure"
            )));
        }
        let what = format!(
            "none of {n} particles can be used with windows of {0} x {0} px: {cut} are cut by the edge of the image, \
             {crowded} overlap neighbors, {saturated} are saturated; ",
            2 * half + 1
        );
        return Err(Error::option(smaller(what)));
    }
    Ok(Windows { half, particles })
}

fn window(scan: &Scan, candidates: &[Candidate], k: usize, half: usize) -> Window {
    let own = &candidates[k];
    let (column, row) = (own.x.round() as usize, own.y.round() as usize);
    let reach = half as isize;
    let near = half as f64;
    let others: Vec<&Candidate> =
        candidates.iter().enumerate().filter(|(j, _)| *j != k).map(|(_, c)| c).collect();
    let pixels = (-reach..=reach)
        .flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy)))
        .filter(|&(dx, dy)| {
            let (x, y) = (column as f64 + dx as f64, row as f64 + dy as f64);
            !others.iter().any(|other| libm::hypot(x - other.x, y - other.y) < near)
        })
        .map(|(dx, dy)| {
            let at = (row as isize + dy) as usize * scan.width + (column as isize + dx) as usize;
            (at, [dx as f64, dy as f64])
        })
        .collect();
    Window::new([column, row], pixels)
}
