//! Repeated frames of a scan: their means, and the noise of one frame from their differences.

use crate::background::Background;
use crate::scan::Scan;
use crate::state::Noise;

/// The planes of a scan, each the mean of its repeated frames.
#[derive(Debug, Clone)]
pub(super) struct Frames {
    /// Mean counts of each plane, row by row.
    pub(super) planes: Vec<Vec<f64>>,
    pub(super) stage_um: Vec<f64>,
    /// Number of frames of each plane.
    pub(super) repeats: Vec<usize>,
    /// Mean background, counts.
    pub(super) background: f64,
    /// Variance of a count in one frame.
    pub(super) noise: Noise,
    /// Whether the noise is that of repeated frames; otherwise that of the background alone.
    pub(super) is_noise_measured: bool,
}

/// Number of bins of light in which variances are averaged.
const BINS: usize = 24;

/// Smallest number of pixels of a bin.
const FEWEST: usize = 40;

impl Frames {
    /// Frames at the same stage position are repeats.
    pub(super) fn of(scan: &Scan) -> Frames {
        let background = Background::of(&scan.planes);
        let mut groups: Vec<(f64, Vec<&Vec<u16>>)> = Vec::new();
        for (plane, stage_um) in scan.planes.iter().zip(&scan.stage_um) {
            match groups.last_mut() {
                Some((at, frames)) if *at == *stage_um => frames.push(plane),
                _ => groups.push((*stage_um, vec![plane])),
            }
        }
        let mean = |frames: &[&Vec<u16>]| -> Vec<f64> {
            let sum = |at: usize| frames.iter().map(|frame| f64::from(frame[at])).sum::<f64>();
            (0..scan.width * scan.height).map(|at| sum(at) / frames.len() as f64).collect()
        };
        let planes: Vec<Vec<f64>> = groups.iter().map(|(_, frames)| mean(frames)).collect();
        let measured = noise(&groups, &planes, background.mean);
        let of_background = background.noise * background.noise;
        Frames {
            stage_um: groups.iter().map(|(stage_um, _)| *stage_um).collect(),
            repeats: groups.iter().map(|(_, frames)| frames.len()).collect(),
            planes,
            background: background.mean,
            noise: measured.unwrap_or(Noise { background2: of_background, per_count: 0.0, per_count2: 0.0 }),
            is_noise_measured: measured.is_some(),
        }
    }

    /// Variance of the mean of a plane's frames at a pixel.
    pub(super) fn variance(&self, plane: usize, at: usize) -> f64 {
        self.noise.variance(self.planes[plane][at] - self.background) / self.repeats[plane] as f64
    }
}

/// A parabola through the variances of repeated frames as a function of light; `None` without repeats.
fn noise(groups: &[(f64, Vec<&Vec<u16>>)], means: &[Vec<f64>], background: f64) -> Option<Noise> {
    let mut pixels: Vec<(f64, f64, f64)> = Vec::new();
    for ((_, frames), mean) in groups.iter().zip(means).filter(|((_, frames), _)| frames.len() > 1) {
        let freedom = (frames.len() - 1) as f64;
        for (at, mean) in mean.iter().enumerate() {
            let square = |frame: &&Vec<u16>| {
                let from_mean = f64::from(frame[at]) - mean;
                from_mean * from_mean
            };
            pixels.push((mean - background, frames.iter().map(square).sum::<f64>() / freedom, freedom));
        }
    }
    let brightest = pixels.iter().map(|pixel| pixel.0).fold(0.0, f64::max);
    // Bins of equal width in the square root of light, where many pixels are dim.
    let bin = |light: f64| {
        let place = libm::sqrt((light / brightest).max(0.0)) * BINS as f64;
        (place as usize).min(BINS - 1)
    };
    let mut bins = [(0.0, 0.0, 0.0, 0usize); BINS];
    for (light, variance, freedom) in pixels {
        let sums = &mut bins[bin(light)];
        sums.0 += freedom * light.max(0.0);
        sums.1 += freedom * variance;
        sums.2 += freedom;
        sums.3 += 1;
    }
    let points: Vec<[f64; 3]> = bins
        .iter()
        .filter(|bin| bin.3 >= FEWEST)
        .map(|(light, variance, freedom, _)| [light / freedom, variance / freedom, *freedom])
        .collect();
    if points.is_empty() {
        return None;
    }
    Some(parabola(&points))
}

/// The parabola with coefficients >= 0 that is nearest to points (light, variance, degrees of freedom), whose
/// errors are relative: terms that would be negative are left out.
fn parabola(points: &[[f64; 3]]) -> Noise {
    let mut terms = vec![0, 1, 2];
    loop {
        let n = terms.len();
        let mut system = crate::linear::Symmetric::zeros(n);
        let mut right = vec![0.0; n];
        for [light, variance, freedom] in points {
            let weight = freedom / (variance * variance);
            let power = |term: usize| libm::pow(*light, f64::from(term as u32));
            for i in 0..n {
                right[i] += weight * variance * power(terms[i]);
                (0..n).for_each(|j| system.add(i, j, weight * power(terms[i]) * power(terms[j])));
            }
        }
        (0..n).for_each(|i| system.add(i, i, 1e-12 * system.at(i, i)));
        let solution = system.solve(&right).unwrap_or_else(|| vec![0.0; n]);
        let worst =
            (0..n).filter(|i| solution[*i] < 0.0).min_by(|a, b| solution[*a].total_cmp(&solution[*b]));
        match worst {
            Some(i) if n > 1 => {
                terms.remove(i);
            }
            _ => {
                let of =
                    |term: usize| terms.iter().position(|t| *t == term).map_or(0.0, |i| solution[i].max(0.0));
                return Noise { background2: of(0), per_count: of(1), per_count2: of(2) };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_that_between_repeated_frames() {
        let (width, height) = (60, 40);
        let mut state = 1u64;
        let mut normal = || {
            let mut sum = 0.0;
            for _ in 0..12 {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                sum += (state >> 33) as f64 / f64::from(1u32 << 31);
            }
            sum - 6.0
        };
        let mut planes = Vec::new();
        for _ in 0..8 * 3 {
            let count = |i: usize| {
                let light = if i.is_multiple_of(7) { 3000.0 * (i % 31) as f64 / 30.0 } else { 0.0 };
                (100.0 + light + libm::sqrt(16.0 + 0.1 * light) * normal()).round() as u16
            };
            planes.push((0..width * height).map(count).collect());
        }
        let stage_um = (0..8).flat_map(|i| [f64::from(i); 3]).collect();
        let scan = Scan { width, height, planes, stage_um, full_scale: u16::MAX, warnings: Vec::new() };
        let frames = Frames::of(&scan);
        assert_eq!((frames.planes.len(), frames.repeats[0], frames.is_noise_measured), (8, 3, true));
        assert!((frames.noise.background2 - 16.1).abs() < 0.5, "{:?}", frames.noise);
        let at_1500 = frames.noise.variance(1500.0);
        assert!((at_1500 - 166.0).abs() < 8.0, "{:?} {at_1500}", frames.noise);
    }
}
