//! Noise of the frames of a recording, from its manifest: the stacks of a recording are averages, whose noise
//! tells nothing about a frame's.

use super::denoise::PixelNoise;
use generator::runner::DatasetPlace;
use storage::dataset::manifest::RECORDING;
use storage::error::Result;

#[derive(Debug, Clone, Copy)]
pub(super) struct RecordedNoise {
    /// Noise of a frame; `None` for the light if the scan did not show it.
    frame: [Option<f64>; 2],
    /// Number of images of which a calibration image is the average, at least.
    averaged: f64,
}

impl RecordedNoise {
    /// The noise of a recording; `None` of a generated dataset.
    pub(super) fn read(dataset: &DatasetPlace) -> Result<Option<Self>> {
        let manifest = dataset.manifest()?;
        let facts = &manifest.microsig;
        let Some(noise) = facts.noise.as_ref().filter(|_| facts.kind.as_deref() == Some(RECORDING)) else {
            return Ok(None);
        };
        let particles =
            facts.calibration_places.iter().filter_map(|place| place.particles).min().unwrap_or(1);
        let term = |k: usize| noise.variance.get(k).copied().filter(|v| v.is_finite() && *v >= 0.0);
        let averaged = f64::from(particles.max(1)) * f64::from(noise.repeats.max(1));
        Ok(Some(RecordedNoise { frame: [term(0), term(1)], averaged }))
    }

    /// Noise of a frame; `stack`: noise of the calibration images.
    pub(super) fn frame_noise(self, stack: PixelNoise) -> PixelNoise {
        let of =
            |term: Option<f64>, stack: f32| term.map_or(stack * self.averaged as f32, |term| term as f32);
        PixelNoise::new(of(self.frame[0], stack.dark), of(self.frame[1], stack.gain))
    }

    /// Noise of a calibration image, if a frame's is known.
    pub(super) fn stack_noise(self) -> Option<PixelNoise> {
        let [dark, gain] = self.frame;
        let averaged = |term: f64| (term / self.averaged) as f32;
        dark.zip(gain).map(|(dark, gain)| PixelNoise::new(averaged(dark), averaged(gain)))
    }
}
