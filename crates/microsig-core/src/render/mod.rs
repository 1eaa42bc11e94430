//! Particles to images.
//!
//! A [`Renderer`] is one of: [`rays`], the paper's method, counts of discrete rays, fast; [`expected`], its limit of many
//! rays, without their noise; [`gaussian`], classical in-focus spots. [`exact`] is the method of rays in plain f64, ray by
//! ray, and what the fast kernel is held against.

pub mod exact;
pub mod expected;
mod fan;
pub mod gaussian;
mod instructions;
mod kernel;
mod lanes;
mod patch;
mod placing;
pub mod rays;
mod renderer;
mod sources;
mod strokes;
mod tally;

pub use expected::ExpectedRenderer;
pub use gaussian::{GaussianRenderer, Spot};
pub use instructions::InstructionSet;
pub use patch::{Patch, Window};
pub use rays::RayRenderer;
pub use renderer::Renderer;
