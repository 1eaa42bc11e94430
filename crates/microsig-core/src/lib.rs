//! MicroSIG's optical model: ray-traced images of defocused and astigmatic tracer particles.
//!
//! The model is from M. Rossi, "Synthetic image generator for defocusing and astigmatic PIV/PTV", Meas.
//! Sci. Technol. 31 (2020) 017003, and, where the paper does not specify the details, that of its published
//! program.
//!
//! # Axes and units
//! Image coordinates are px: the center of the top-left pixel is (1, 1), x points right along columns, y
//! points down along rows. Depth z is in um, zero in the paraxial object plane, and positive away from the
//! lens. Angles are in rad, intensities in counts. The image of a particle at (x, y) is centered on (x, y).
//!
//! # Example
//! ```
//! use microsig_core::emission::SpheroidLaw;
//! use microsig_core::render::{RayRenderer, Render};
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
//! assert!(image.counts.whole()[40 * 81 + 40] > 500, "bright in the middle");
//! # Ok::<(), microsig_core::Error>(())
//! ```
//!
//! The crate opens no path, reads no clock and no environment, and prints nothing.

pub mod bspline;
pub mod cancel;
pub mod emission;
mod error;
pub mod formats;
mod interval;
pub mod linear;
pub mod optics;
mod particle;
mod philox;
pub mod pool;
pub mod problem;
pub mod quadrature;
pub mod random;
pub mod render;
pub mod sensor;
mod settings;
pub mod stream;
pub mod visibility;

pub use error::{Error, shown};
pub use interval::{Interval, short};
pub use particle::{Particle, Spheroid};
pub use settings::{KEYS, Key, Settings};
