//! Noise-free particle images: a depth scan of a single particle, and the visibility of each particle of a
//! frame.

mod depth_scan;
mod noise_free;
mod outline;
mod overlap;
mod run_length;
mod spheroid;

pub use depth_scan::{DepthScan, ScanImage, vertex};
pub use noise_free::{NoiseFree, Patch, TOLERANCE};
pub use outline::Outline;
pub use overlap::{TracerImage, Visibility, visibility};
pub use run_length::RunLengths;
