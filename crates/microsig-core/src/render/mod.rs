//! Particle images.
//!
//! A [`Renderer`] is one of: [`rays`], the paper's method, fast counting of discrete rays; [`expected`], its
//! limit of infinitely many rays, without ray noise; [`waves`], wave optics with diffraction at the lens;
//! [`gaussian`], classical in-focus spots. [`exact`] traces every ray in plain f64 and is the reference for
//! the fast kernel.

mod depth_table;
pub mod exact;
pub mod expected;
mod field;
mod field_nodes;
pub mod gaussian;
mod gradient;
mod image_sum;
mod instructions;
mod interface;
mod lanes;
mod node_layout;
mod patch;
pub mod rays;
mod refinement;
mod renderer;
mod shape;
mod spline;
mod store;
mod tabled;
mod tables;
pub mod waves;

pub use expected::ExpectedRenderer;
pub use gaussian::{GaussianRenderer, GaussianSpot};
pub use gradient::Gradient;
pub use instructions::InstructionSet;
pub use interface::{Description, ImageStreams, Render, Tables, Traits};
pub use patch::{ExpectedPatch, Patch, Window};
pub use rays::RayRenderer;
pub use renderer::{RenderMethod, Renderer, RendererSpec};
pub use shape::ShapeGradient;
pub use store::{Context, Kernels, TableStore};
pub use tabled::TabledRenderer;
pub use tables::TablesState;
pub use waves::{WaveOptics, WavesRenderer};
