//! Cubic interpolation of modes between the radii at which they are computed.

use super::modes::Modes;
use super::pupil::{Pupil, Radii};

/// Number of radii, evenly spaced in sigma.
pub(super) const RADII: usize = 256;

/// Number of points of the interpolation.
const TAPS: usize = 4;

/// The number of fields of a table is a multiple of this.
const LANES: usize = 8;

/// The radii around a position, and their weights.
#[derive(Debug, Clone, Copy)]
pub(super) struct Around {
    first: usize,
    weights: [f64; TAPS],
}

impl Around {
    /// The interpolated value of one function.
    pub(super) fn value(&self, known: &[f64]) -> f64 {
        let Around { first, weights: w } = *self;
        (w[0] * known[first] + w[1] * known[first + 1]) + (w[2] * known[first + 2] + w[3] * known[first + 3])
    }
}

/// The radii up to `end` of the lens plane.
pub(super) fn radii(pupil: &Pupil, end: f64) -> Radii {
    let step = pupil.sigma(end) / (RADII - 1) as f64;
    pupil.radii((0..RADII).map(|i| pupil.q(step * i as f64).min(end)).collect(), end)
}

/// Weights of the radii in an integral over sigma d sigma.
pub(super) fn weights(radii: &Radii) -> Vec<f64> {
    let step = radii.sigma[1] - radii.sigma[0];
    let trapezoid = |i: usize| if i == RADII - 1 { 0.5 } else { 1.0 };
    radii.sigma.iter().enumerate().map(|(i, sigma)| trapezoid(i) * step * sigma).collect()
}

/// The radii around a position, given in units of the last radius.
pub(super) fn around(place: f64) -> Around {
    // There is no light beyond the last radius.
    let place = place.min(1.0) * (RADII - 1) as f64;
    let first = (libm::floor(place) as usize).saturating_sub(1).min(RADII - TAPS);
    let t = place - first as f64;
    let (a, b, c, d) = (t, t - 1.0, t - 2.0, t - 3.0);
    Around { first, weights: [-b * c * d / 6.0, a * c * d / 2.0, -a * b * d / 2.0, a * b * c / 6.0] }
}

/// A table with the phase and all modes (real and imaginary parts) at each radius.
#[inline(always)]
pub(super) fn table(modes: &Modes) -> Vec<f64> {
    let fields = (1 + 2 * modes.modes.len()).next_multiple_of(LANES);
    let mut known = vec![0.0; RADII * fields];
    for (i, known) in known.chunks_exact_mut(fields).enumerate() {
        known[0] = modes.phase[i];
        for (mode, known) in modes.modes.iter().zip(known[1..].chunks_exact_mut(2)) {
            known.copy_from_slice(&mode.values[i]);
        }
    }
    known
}

/// Interpolates all fields of a table at one position.
#[inline(always)]
pub(super) fn interpolate(known: &[f64], around: &Around, here: &mut [f64]) {
    let fields = here.len();
    let rows = &known[around.first * fields..][..TAPS * fields];
    let (a, rest) = rows.split_at(fields);
    let (b, rest) = rest.split_at(fields);
    let (c, d) = rest.split_at(fields);
    let w = around.weights;
    for ((((here, a), b), c), d) in here.iter_mut().zip(a).zip(b).zip(c).zip(d) {
        *here = (w[0] * a + w[1] * b) + (w[2] * c + w[3] * d);
    }
}
