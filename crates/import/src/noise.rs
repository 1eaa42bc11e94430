//! Noise of the camera, as the manifest states it.

use fit::{Scan, noise_of_repeats};
use storage::dataset::manifest::NoiseFacts;

/// The noise of a frame of the scan, whose background has this mean and standard deviation.
pub(crate) fn of_scan(scan: &Scan, background: [f64; 2]) -> NoiseFacts {
    let repeats = scan.levels().iter().map(|level| level.planes.len()).max().unwrap_or(1) as u32;
    let (variance, definition) = match noise_of_repeats(scan, background[0]) {
        Some(variance) => (
            variance,
            "variance of each pixel over repeated frames of a plane against its mean signal above the background, fitted \
             over classes of signal",
        ),
        None => (
            vec![background[1] * background[1]],
            "variance of the background over pixels; the scan has no repeated frames, which would show how noise grows with \
             the signal",
        ),
    };
    NoiseFacts { background_counts: background[0], variance, repeats, definition: definition.to_owned() }
}
