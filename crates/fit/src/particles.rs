//! The particles of a scan: where they are, and the pixels around them that show nothing else.

use super::background::Background;
use super::scan::Scan;
use storage::error::{Error, Result};

/// Particles that a fit uses at most; more cost time and tell nothing new.
const MOST_PARTICLES: usize = 8;

/// Smoothing of the sum over all planes in which particles are sought, px.
const SMOOTHING_PX: f64 = 3.0;

/// A maximum must stand this many standard deviations above the background, and reach this share of the
/// brightest.
const THRESHOLD_SD: f64 = 8.0;
const THRESHOLD_SHARE: f64 = 0.15;

/// The mean count on a ring of a plane is light if it stands this many standard errors above the background.
const RING_SD: f64 = 3.0;

/// Added to the radius of the farthest light, px; the window's half width is at most the second number.
const WINDOW_MARGIN: usize = 4;
const WINDOW_MOST: usize = 64;

/// Pixels at the largest count that make a plane saturated.
const SATURATED_PIXELS: usize = 3;

/// A window that loses more than this share of its pixels to neighbors is of no use.
const MOST_LOST: f64 = 0.25;

/// A particle with the pixels that show it.
#[derive(Debug, Clone)]
pub(super) struct Candidate {
    /// Place of the maximum, from the middle of the first pixel, px.
    pub(super) x: f64,
    pub(super) y: f64,
    /// Light in the smoothed sum over planes, counts.
    pub(super) brightness: f64,
}

/// The windows about the particles of a scan.
#[derive(Debug)]
pub(super) struct Windows {
    /// Half the width less half a pixel, px.
    pub(super) half: usize,
    pub(super) particles: Vec<Window>,
}

/// A square of pixels about a particle; pixels nearer to another one are left out.
#[derive(Debug, Clone)]
pub(super) struct Window {
    /// Middle, px from the first pixel's middle.
    pub(super) column: usize,
    pub(super) row: usize,
    /// The pixels' indices in a plane and their offsets from the middle, px.
    pub(super) pixels: Vec<(usize, [f64; 2])>,
}

/// Counts of all planes added, smoothed by a normal distribution.
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
/// [`Error::Input`] if there is none, with the threshold and the best candidate.
pub(super) fn find(scan: &Scan, background: Background) -> Result<Vec<Candidate>> {
    let sum = smoothed_sum(scan, background);
    let (w, h) = (scan.width, scan.height);
    // Noise of the smoothed sum: a normal filter of width s averages 4 pi s^2 pixels.
    let averaged = 4.0 * std::f64::consts::PI * SMOOTHING_PX * SMOOTHING_PX;
    let noise = background.noise * libm::sqrt(scan.planes.len() as f64 / averaged);
    let brightest = sum.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let threshold = (THRESHOLD_SD * noise).max(THRESHOLD_SHARE * brightest);
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
        return Err(Error::input(format!(
            "no particle found: the brightest place, ({}, {}) px, has {:.0} counts above the background over all planes \
             (smoothed), the threshold is {threshold:.0}; name the particles with --particles FILE",
            best % w + 1,
            best / w + 1,
            sum[best]
        )));
    }
    Ok(found)
}

/// Particles at places that the user names, px, the first pixel's center at 1.
pub(super) fn given(places_px: &[[f64; 2]]) -> Vec<Candidate> {
    places_px.iter().map(|[x, y]| Candidate { x: x - 1.0, y: y - 1.0, brightness: 0.0 }).collect()
}

/// The largest radius at which the mean ring of any plane stands above the background, and the margin.
pub(super) fn half_width(scan: &Scan, background: Background, candidates: &[Candidate]) -> usize {
    let mut farthest = 0;
    for (k, candidate) in candidates.iter().enumerate().take(MOST_PARTICLES) {
        // Rings that a neighbor's half of the way reaches show its light.
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
        let most = room.into_iter().fold(0.5 * nearest, f64::min).min(WINDOW_MOST as f64) as usize;
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
            // A single ring may stand out by chance, two in a row hardly do.
            let last = rings.windows(2).rposition(|pair| pair.iter().all(lit)).map_or(0, |i| i + 1);
            farthest = farthest.max(last);
        }
    }
    (farthest + WINDOW_MARGIN).min(WINDOW_MOST)
}

/// Windows about the particles that can be used.
///
/// # Errors
/// [`Error::Input`] if none can: windows cut by the edge, hidden by neighbors, or saturated.
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
        if (window.pixels.len() as f64) < (1.0 - MOST_LOST) * side * side {
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
        if particles.len() == MOST_PARTICLES {
            break;
        }
    }
    if particles.is_empty() {
        let n = candidates.len();
        let reason = if saturated == n {
            format!(
                "all {n} particles are saturated (3 or more pixels at {} counts): expose less",
                scan.full_scale
            )
        } else {
            format!(
                "none of {n} particles can be used with windows of {0} x {0} px: {cut} are cut by the edge of the image, \
                 {crowded} overlap neighbors, {saturated} are saturated; leave out the planes with the largest images \
                 (--planes A-B) or set a smaller --window",
                2 * half + 1
            )
        };
        return Err(Error::Input(vec![reason]));
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
    Window { column, row, pixels }
}
