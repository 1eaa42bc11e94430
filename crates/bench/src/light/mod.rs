//! Noise-free images of particles: what a single one looks like over depth, and how visible each one of a frame is.

mod noise_free;
mod seen;
mod stack;

pub use noise_free::{NoiseFree, Patch};
pub use seen::{Seen, look};
pub use stack::{Spot, Stack};
