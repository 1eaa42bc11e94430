//! Finds the particles of a scan: maxima over depth of band-pass filtered planes, in which the sharp image of
//! a particle stands out and the wide ones of others do not. All particles are in one plane, so maxima at other
//! depths are parts of defocused images, such as bright rings.

use fit::{Level, Scan};
use rayon::prelude::*;
use storage::error::{Error, Result};
use tracking::{GrayImage, weighted_median};

/// Standard deviations of the Gaussian filters whose difference is the band-pass filter, px.
const NARROW_PX: f32 = 1.2;
const WIDE_PX: f32 = 5.0;

/// A maximum must be this many standard deviations above the noise of the map, and reach this share of the
/// median maximum.
const ABOVE_NOISE: f32 = 12.0;
const OF_MEDIAN: f32 = 0.15;

/// Largest distance in depth between a maximum and most of the light, as a share of the length of the scan.
const OF_DEPTHS: f64 = 0.15;

/// No other maximum is this close, px.
const APART_PX: usize = 3;

/// Where the particles of a scan are.
#[derive(Debug, Clone)]
pub(crate) struct Located {
    /// Columns and rows of the particles, px from 0, most contrast first.
    pub(crate) places: Vec<[f64; 2]>,
    /// The number of the depth in which each is sharpest.
    pub(crate) sharpest: Vec<usize>,
    /// Mean of the background, counts.
    pub(crate) background: f64,
    /// Standard deviation of the background, counts.
    pub(crate) background_noise: f64,
}

impl Located {
    /// Finds the particles.
    pub(crate) fn of(scan: &Scan, levels: &[Level]) -> Result<Self> {
        let size = (scan.width, scan.height);
        let plane = |level: &Level| {
            let counts = &scan.planes[level.planes[0]];
            GrayImage::from_fn(size, |x, y| f32::from(counts[y * size.0 + x]))
        };
        let backgrounds: Vec<(f32, f32)> = levels.par_iter().map(|level| plane(level).background()).collect();
        let filtered = |(depth, level): (usize, &Level)| {
            let image = plane(level);
            let (mut narrow, wide) = (image.smoothed(NARROW_PX), image.smoothed(WIDE_PX));
            narrow.counts.iter_mut().zip(&wide.counts).for_each(|(n, w)| *n -= w);
            narrow.counts.into_iter().map(|count| (count, depth)).collect::<Vec<_>>()
        };
        let nothing = || vec![(f32::MIN, 0); size.0 * size.1];
        // Of equal values the first, so that the result does not depend on the order of the threads.
        let is_larger = |a: (f32, usize), b: (f32, usize)| a.0 > b.0 || (a.0 == b.0 && a.1 < b.1);
        let larger = |mut a: Vec<(f32, usize)>, b: Vec<(f32, usize)>| {
            a.iter_mut().zip(b).filter(|(a, b)| is_larger(*b, **a)).for_each(|(a, b)| *a = b);
            a
        };
        let sharpest = levels.par_iter().enumerate().map(filtered).reduce(nothing, larger);
        let counts = sharpest.iter().map(|(count, _)| *count).collect();
        let map = GrayImage { width: size.0, height: size.1, counts };
        let (level, noise) = map.background();
        let mut found = maxima(&map, level + ABOVE_NOISE * noise.max(f32::MIN_POSITIVE));
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        let depth = |at: &[f64; 2]| sharpest[at[1].round() as usize * size.0 + at[0].round() as usize].1;
        let z_um = |at: &[f64; 2]| levels[depth(at)].z_um;
        if let Some(plane_um) =
            weighted_median(found.iter().map(|(value, at)| (z_um(at), f64::from(*value))).collect())
        {
            let range_um = levels[levels.len() - 1].z_um - levels[0].z_um;
            found.retain(|(_, at)| (z_um(at) - plane_um).abs() <= OF_DEPTHS * range_um);
        }
        let least = found.get(found.len() / 2).map_or(0.0, |(median, _)| OF_MEDIAN * median);
        found.retain(|(value, _)| *value >= least);
        if found.is_empty() {
            let what = "no particle found: nothing sharp stands out of the noise in any plane";
            return Err(Error::input(what.to_owned()));
        }
        let median = |of: fn(&(f32, f32)) -> f32| {
            let mut values: Vec<f32> = backgrounds.iter().map(of).collect();
            values.sort_by(f32::total_cmp);
            f64::from(values[values.len() / 2])
        };
        Ok(Located {
            sharpest: found.iter().map(|(_, at)| depth(at)).collect(),
            places: found.into_iter().map(|(_, at)| at).collect(),
            background: median(|b| b.0),
            background_noise: median(|b| b.1),
        })
    }
}

/// Local maxima above a threshold, with their values.
fn maxima(map: &GrayImage, least: f32) -> Vec<(f32, [f64; 2])> {
    let (w, h) = (map.width, map.height);
    let is_maximum = |x: usize, y: usize| {
        let here = map.counts[y * w + x];
        let columns = x.saturating_sub(APART_PX)..(x + APART_PX + 1).min(w);
        here > least
            && (y.saturating_sub(APART_PX)..(y + APART_PX + 1).min(h))
                .flat_map(|v| columns.clone().map(move |u| (u, v)))
                .all(|(u, v)| {
                    let there = map.counts[v * w + u];
                    there < here || (there == here && (v, u) >= (y, x))
                })
    };
    // The vertex of the parabola through three pixels.
    let vertex = |i: usize, at: usize, size: usize, step: usize| {
        if at == 0 || at + 1 == size {
            return at as f64;
        }
        let [before, here, after] = [i - step, i, i + step].map(|i| f64::from(map.counts[i]));
        let curvature = (2.0 * here - before - after).max(f64::MIN_POSITIVE);
        at as f64 + (0.5 * (after - before) / curvature).clamp(-0.49, 0.49)
    };
    let pixels = (0..w * h).filter(|&i| is_maximum(i % w, i / w));
    pixels.map(|i| (map.counts[i], [vertex(i, i % w, w, 1), vertex(i, i / w, h, w)])).collect()
}
