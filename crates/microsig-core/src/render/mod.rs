//! Particles to images.
//!
//! [`rays`] is the paper's method, counts of discrete rays, fast; [`exact`] is the same in plain f64, ray by ray, and
//! what the fast kernel is held against.

pub mod exact;
mod fan;
mod kernel;
mod patch;
pub mod rays;

pub use patch::Patch;
pub use rays::RayRenderer;
