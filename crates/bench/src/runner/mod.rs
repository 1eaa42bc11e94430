//! Doing the work: images in parallel, datasets whole or not at all.

mod camera;
mod generate;
mod progress;
mod recording;
mod render;
mod shard;
mod sweep;

pub use camera::Camera;
pub use generate::{Generated, Options as GenerateOptions, generate, is_made};
pub use progress::Progress;
pub use render::{Options as RenderOptions, Rendered, render};
pub use shard::Shard;
pub use sweep::{Options as SweepOptions, Swept, collect, sweep};
