//! MicroSIG's optical model: images of defocused and astigmatic tracer particles by tracing rays.
//!
//! The model is that of M. Rossi, "Synthetic image generator for defocusing and astigmatic PIV/PTV", Meas. Sci.
//! Technol. 31 (2020) 017003, with what its published program does where the paper is silent.
//!
//! # Axes and units
//! Image coordinates are px: the centre of the top-left pixel is (1, 1), x points right along columns, y points down
//! along rows. Depth z is um, zero in the paraxial object plane, and grows away from the lens. Angles are rad,
//! intensities counts. A particle at (x, y) is drawn with its centroid at (x, y).
//!
//! # Example
//! ```
//! use microsig_core::emission::SpheroidLaw;
//! use microsig_core::render::RayRenderer;
//! use microsig_core::sensor::Sensor;
//! use microsig_core::stream::{Purpose, Streams};
//! use microsig_core::{Particle, Settings};
//!
//! let settings = Settings { pixel_dim_x: 81, pixel_dim_y: 81, ..Settings::setting1() };
//! let renderer = RayRenderer::new(&settings, SpheroidLaw::Original)?;
//! let streams = Streams::new(1);
//!
//! let particles = [Particle::sphere(41.0, 41.0, -30.0, 2.0)];
//! let light = renderer.light(&particles, &streams, Purpose::Rays, 0);
//! let image = Sensor::new(&settings).expose(&light, &streams, Purpose::BackgroundNoise, 0);
//! assert!(image.counts[40 * 81 + 40] > 500, "bright in the middle");
//! # Ok::<(), microsig_core::Error>(())
//! ```
//!
//! The crate opens no path, reads no clock and no environment, and prints nothing.

pub mod emission;
mod error;
pub mod formats;
pub mod optics;
mod particle;
mod philox;
pub mod random;
pub mod render;
pub mod sensor;
mod settings;
pub mod shelf;
pub mod stream;

pub use error::{Error, Fault};
pub use particle::{Particle, Spheroid};
pub use settings::{KEYS, Key, Settings};
