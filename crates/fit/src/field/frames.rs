//! Repeated frames of a scan: their means, and the noise of one frame from their differences.

use crate::background::Background;
use crate::noise::ROUNDING;
use crate::repeats::noise_of_repeats;
use crate::scan::{Level, Scan};
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
    /// Whether the noise was measured from repeated frames; otherwise from the background alone.
    pub(super) is_noise_measured: bool,
}

impl Frames {
    /// Frames at the same stage position are repeats.
    pub(super) fn of(scan: &Scan) -> Frames {
        let background = Background::of(&scan.planes);
        let levels = scan.levels();
        let mean = |level: &Level| -> Vec<f64> {
            let sum =
                |at: usize| level.planes.iter().map(|plane| f64::from(scan.planes[*plane][at])).sum::<f64>();
            (0..scan.width * scan.height).map(|at| sum(at) / level.planes.len() as f64).collect()
        };
        let measured = noise_of_repeats(scan, background.mean).map(|terms| {
            let term = |i: usize| terms.get(i).copied().unwrap_or(0.0);
            Noise { background2: term(0).max(ROUNDING), per_count: term(1), per_count2: term(2) }
        });
        let of_background = background.noise * background.noise + ROUNDING;
        Frames {
            stage_um: levels.iter().map(|level| level.z_um).collect(),
            repeats: levels.iter().map(|level| level.planes.len()).collect(),
            planes: levels.iter().map(mean).collect(),
            background: background.mean,
            noise: measured.unwrap_or(Noise { background2: of_background, per_count: 0.0, per_count2: 0.0 }),
            is_noise_measured: measured.is_some(),
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
