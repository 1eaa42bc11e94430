//! Generates, renders, sweeps and verifies: images in parallel, folders written atomically.

mod cost;
mod frames;
mod generate;
mod memory;
mod plausibility;
mod recording;
mod render;
mod shard;
mod suite;
mod sweep;
mod verify;

pub use cost::Cost;
pub(crate) use generate::camera;
pub use generate::{GenerateOptions, Generated, generate, generate_or_find};
pub use memory::{Calibration, MemoryDataset};
pub use recording::Frames;
pub use render::{RenderOptions, Rendered, render, render_particles};
pub use shard::Shard;
pub use suite::{
    FROZEN, Frozen, FrozenDataset, RECORD, SuiteCheck, SuiteOptions, SuiteRecord, SuiteSelection,
    check_rules, check_suite, digests, generate_suite, same_dataset,
};
pub use sweep::{SweepOptions, Swept, collect, sweep};
pub use verify::{Verified, verify};
