//! Integration tests, one file per subject, in one binary: `cargo test -p microsig-flows --test all NAME::` runs one of them.

mod cloud;
mod compositions;
mod conformance;
mod exposure;
mod hindered;
mod motion;
mod tracks;
mod walls;

use flows::{Brownian, Frame, RecordingStart, Region, Scene};
use glam::DVec3;
use microsig_core::stream::Streams;

/// Times of frames, s.
fn times(frames: u32, dt_s: f64) -> Vec<f64> {
    (0..frames).map(|k| dt_s * f64::from(k)).collect()
}

/// The frames of a recording.
fn frames(scene: &Scene<'_>, times: &[f64], seed: u64) -> Vec<Frame> {
    scene.record(times, Streams::new(seed), RecordingStart::default()).unwrap().map(Result::unwrap).collect()
}

/// Brownian motion in water with a different viscosity, Pa s.
fn brownian(viscosity_pa_s: f64, substeps: u32) -> Brownian {
    Brownian { viscosity_pa_s, substeps, ..Brownian::default() }
}

fn water(substeps: u32) -> Brownian {
    Brownian { substeps, ..Brownian::default() }
}

/// Chi-square of the counts in 20 equal bins along an axis against a Poisson process of `expected` in total.
fn chi_square(positions: impl Iterator<Item = DVec3>, room: &Region, axis: usize, expected: f64) -> f64 {
    let mut counts = [0.0; 20];
    for x in positions {
        let place = (x[axis] - room.min()[axis]) / room.size()[axis];
        // A center may be exactly one radius from the upper wall.
        counts[((place * 20.0) as usize).min(19)] += 1.0;
    }
    counts.iter().map(|n| (n - expected / 20.0) * (n - expected / 20.0) / (expected / 20.0)).sum()
}

/// Exceeded with probability 1e-5 by chi-square of 20 degrees of freedom (the total is random too).
const LIMIT: f64 = 59.0;
