//! What the manifest says of recordings, and of calibration stacks at several places of the field of view.

use serde::{Deserialize, Serialize};

/// The kind of a folder with recorded images.
pub const RECORDING: &str = "recording";

/// What is known of the particles of a recording.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct KnownFacts {
    /// Number of frames in which all particles are in a plane of known height (`truth/planes.csv`).
    pub planes: u32,
    /// Number of known positions of particles (`truth/tracks.csv`).
    pub particles: u64,
    /// Whether these are all particles of the frames in which there are any.
    pub all_particles: bool,
}

/// Noise of the images of a recording.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct NoiseFacts {
    /// Mean of the background, counts.
    pub background_counts: f64,
    /// Variance of a pixel of one frame as a polynomial in its signal s above the background: the
    /// coefficients of 1 (counts^2), s (counts) and s^2; the last two are left out if they are unknown.
    pub variance: Vec<f64>,
    /// Number of repeated frames per plane of the scan from which it was estimated; 1 if there are none.
    pub repeats: u32,
    /// How it was estimated.
    pub definition: String,
}

/// The place of a calibration stack in the field of view.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PlaceFacts {
    /// Number of the place, from 0, row by row.
    pub place: u32,
    /// Column in the frames; the first pixel's center is 1.
    pub x_px: f64,
    /// Row in the frames; the first pixel's center is 1.
    pub y_px: f64,
    /// Number of particles of which the stack is the average; left out for generated stacks.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub particles: Option<u32>,
}
