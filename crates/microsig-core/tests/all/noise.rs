//! Statistics of the background noise. The independence of its streams is a property of their generator (`stream`, `philox`).

use microsig_core::Settings;
use microsig_core::sensor::{Light, Sensor};
use microsig_core::stream::{Purpose, Streams};

const SIDE: usize = 512;
const MEAN: f64 = 1000.0;
const STANDARD_ERRORS: f64 = 5.0;

/// The noise of a dark image of [`SIDE`] rows.
fn noise(sigma: f64, frame: u32) -> Vec<f64> {
    let settings = Settings {
        pixel_dim_x: SIDE as u32,
        pixel_dim_y: SIDE as u32,
        background_mean: MEAN,
        background_noise: sigma,
        ..Settings::setting1()
    };
    let (dark, noise) = (Light::dark(&settings), Purpose::BackgroundNoise);
    let image = Sensor::new(&settings).expose(&dark, &Streams::new(4), noise, frame);
    image.counts.values().map(|count| count - MEAN).collect()
}

/// Chi-square over all values with an expectation of 20 or more, with the tails merged.
#[test]
fn counts_are_as_frequent_as_rounded_normal_numbers() {
    for sigma in [0.4, 2.0, 10.0, 40.0] {
        let values = noise(sigma, 1);
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

/// No two rows of an image have the same noise, however far apart they are, nor has another frame.
#[test]
fn rows_and_frames_have_noise_of_their_own() {
    let images = [noise(10.0, 0), noise(10.0, 1)].concat();
    let rows: Vec<&[f64]> = images.chunks(SIDE).collect();
    assert!((1..rows.len()).all(|k| rows[..k].iter().all(|row| *row != rows[k])));
}
