//! Criteria by which fits are accepted as particles, and the warning if none is accepted.

use super::fit::ParticleFit;

/// Minimum significance of a particle: integrated signal in standard deviations of the noise.
pub(super) const LEAST_SIGNIFICANCE: f64 = 8.0;

/// Minimum correlation of a particle with its template.
pub(super) const LEAST_CORRELATION: f64 = 0.5;

/// Allowed brightness relative to the calibration particle. Bright parts of large images resemble faint small
/// images.
pub(super) const LEAST_BRIGHTNESS: f64 = 0.25;
const LARGEST_BRIGHTNESS: f64 = 4.0;
pub(super) const BRIGHTNESS: std::ops::RangeInclusive<f64> = LEAST_BRIGHTNESS..=LARGEST_BRIGHTNESS;

/// The same for a particle that is known to be there, which may be a cluster.
const LEAST_KNOWN_SIGNIFICANCE: f64 = 5.0;
const LEAST_KNOWN_CORRELATION: f64 = 0.25;
pub(super) const LEAST_KNOWN_BRIGHTNESS: f64 = 0.05;
const KNOWN_BRIGHTNESS: std::ops::RangeInclusive<f64> = LEAST_KNOWN_BRIGHTNESS..=20.0;

/// Classification of a fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    Particle,
    Faint,
    Unlike,
    OtherBrightness,
}

/// Whether a fit is accepted as a particle, or why it is not.
pub(super) fn verdict(fit: &ParticleFit) -> Verdict {
    let (significance, correlation, brightness) = match fit.given {
        None => (LEAST_SIGNIFICANCE, LEAST_CORRELATION, BRIGHTNESS),
        Some(_) => (LEAST_KNOWN_SIGNIFICANCE, LEAST_KNOWN_CORRELATION, KNOWN_BRIGHTNESS),
    };
    if fit.chi2_reduction <= significance.powi(2) {
        Verdict::Faint
    } else if fit.correlation <= correlation {
        Verdict::Unlike
    } else if !brightness.contains(&fit.amplitude) {
        Verdict::OtherBrightness
    } else {
        Verdict::Particle
    }
}

/// Numbers of candidates that are not particles.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Rejections {
    faint: usize,
    unlike: usize,
    other_brightness: usize,
}

impl Rejections {
    pub(super) fn count(&mut self, verdict: Verdict) {
        match verdict {
            Verdict::Particle => {}
            Verdict::Faint => self.faint += 1,
            Verdict::Unlike => self.unlike += 1,
            Verdict::OtherBrightness => self.other_brightness += 1,
        }
    }

    pub(super) fn add(&mut self, other: Self) {
        self.faint += other.faint;
        self.unlike += other.unlike;
        self.other_brightness += other.other_brightness;
    }

    /// The reason why no particle is found, and possible remedies.
    pub(super) fn warning(&self) -> String {
        let all = self.faint + self.unlike + self.other_brightness;
        if all == 0 {
            return format!(
                "no particles found: nothing in the images resembles the calibration images and exceeds \
                 {LEAST_SIGNIFICANCE} standard deviations of the noise; more light or less noise would help"
            );
        }
        format!(
            "no particles found: of {all} candidates, {} do not exceed {LEAST_SIGNIFICANCE} standard deviations of the \
             noise, {} do not resemble the calibration images (correlation below {LEAST_CORRELATION}), {} are not \
             {LEAST_BRIGHTNESS} to {LARGEST_BRIGHTNESS} times as bright as the calibration particle; more light, fewer \
             particles, or calibration images of such particles would help",
            self.faint, self.unlike, self.other_brightness
        )
    }
}
