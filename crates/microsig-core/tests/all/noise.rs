//! Statistics of the background noise: its distribution, and the independence of the noise of different
//! images.
//!
//! All seeds are fixed. Limits are five standard errors: with about 500 statistics, one correct generator in
//! 3,000 would fail.

use microsig_core::Settings;
use microsig_core::sensor::{Light, Sensor};
use microsig_core::stream::{Purpose, Streams};

const SIDE: usize = 512;
const MEAN: f64 = 1000.0;
const STANDARD_ERRORS: f64 = 5.0;

/// The noise of a dark image of [`SIDE`] rows.
fn noise(sigma: f64, streams: &Streams, purpose: Purpose, frame: u32) -> Vec<f64> {
    let settings = Settings {
        pixel_dim_x: SIDE as u32,
        pixel_dim_y: SIDE as u32,
        background_mean: MEAN,
        background_noise: sigma,
        ..Settings::setting1()
    };
    let image = Sensor::new(&settings).expose(&Light::dark(&settings), streams, purpose, frame);
    image.counts.values().map(|count| count - MEAN).collect()
}

fn frame(seed: u64, frame: u32) -> Vec<f64> {
    noise(10.0, &Streams::new(seed), Purpose::BackgroundNoise, frame)
}

/// Correlation of the pixels of `a` with the pixels of `b`, shifted by `right` columns and `down` rows, in standard
/// errors.
fn correlation(a: &[f64], b: &[f64], right: usize, down: usize) -> f64 {
    let (mut ab, mut aa, mut bb, mut n) = (0.0, 0.0, 0.0, 0.0);
    for y in 0..SIDE - down {
        let (a, b) = (&a[y * SIDE..][..SIDE - right], &b[(y + down) * SIDE + right..]);
        for (p, q) in a.iter().zip(b) {
            (ab, aa, bb, n) = (ab + p * q, aa + p * p, bb + q * q, n + 1.0);
        }
    }
    ab / f64::sqrt(aa * bb) * f64::sqrt(n)
}

/// Chi-square over all values with an expectation of 20 or more, with the tails merged.
#[test]
fn counts_are_as_frequent_as_rounded_normal_numbers() {
    for sigma in [0.4, 2.0, 10.0, 40.0] {
        let values = noise(sigma, &Streams::new(4), Purpose::BackgroundNoise, 1);
        let n = values.len() as f64;
        let below = |x: f64| 0.5 * libm::erfc(-x / (sigma * std::f64::consts::SQRT_2));
        let (mut chi2, mut classes, mut rest) = (0.0, 0.0, (n, n));
        let mut class = |found: f64, expected: f64| {
            chi2 += (found - expected) * (found - expected) / expected;
            classes += 1.0;
        };
        let reach = (6.0 * sigma) as i32 + 1;
        for k in (-reach..=reach).map(f64::from) {
            let expected = n * (below(k + 0.5) - below(k - 0.5));
            if expected >= 20.0 {
                let found = values.iter().filter(|v| **v == k).count() as f64;
                class(found, expected);
                rest = (rest.0 - found, rest.1 - expected);
            }
        }
        if rest.1 >= 5.0 {
            class(rest.0, rest.1);
        }
        // Mean and variance of chi-square are its degrees of freedom and twice that.
        let freedom: f64 = classes - 1.0;
        let deviation = (chi2 - freedom) / f64::sqrt(2.0 * freedom);
        assert!(deviation.abs() < STANDARD_ERRORS, "sigma {sigma}: {chi2} for {freedom} degrees of freedom");
    }
}

#[test]
fn neighbors_and_rows_are_uncorrelated() {
    let image = frame(5, 0);
    for (right, down) in (0..=8).flat_map(|down| (0..=8).map(move |right| (right, down))).skip(1) {
        let found = correlation(&image, &image, right, down);
        assert!(found.abs() < STANDARD_ERRORS, "{right} to the right, {down} down: {found} standard errors");
    }
    // No two rows of an image have the same noise, however far apart they are.
    let rows: Vec<&[f64]> = image.chunks(SIDE).collect();
    assert!((1..SIDE).all(|k| rows[..k].iter().all(|row| *row != rows[k])));
}

/// Shifts are tested too: if the parts of an address were added instead of kept separate, one image would be
/// a shifted copy of another.
#[test]
fn frames_seeds_and_purposes_are_uncorrelated() {
    let here = frame(7, 3);
    let calibration = noise(10.0, &Streams::new(7), Purpose::CalibrationNoise, 3);
    let secret = noise(10.0, &Streams::secret([7; 32]), Purpose::BackgroundNoise, 3);
    for (what, other) in [
        ("the next frame", frame(7, 4)),
        ("256 frames on", frame(7, 259)),
        ("65,536 frames on", frame(7, 3 + 65_536)),
        ("the next seed", frame(8, 3)),
        ("2^32 seeds on", frame(7 + (1 << 32), 3)),
        ("seed and frame exchanged", frame(3, 7)),
        ("the calibration stack", calibration),
        ("secret streams", secret),
    ] {
        for (right, down) in (0..=4).flat_map(|down| (0..=4).map(move |right| (right, down))) {
            for found in [correlation(&here, &other, right, down), correlation(&other, &here, right, down)] {
                assert!(found.abs() < STANDARD_ERRORS, "{what}, {right} right, {down} down: {found}");
            }
        }
    }
}
