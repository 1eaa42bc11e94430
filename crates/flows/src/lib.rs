//! Velocity fields that carry tracer particles: seeded clouds, exact trajectories, frame after frame.
//!
//! # Axes and units
//!
//! Lengths in um, times in s, velocities in um/s. x points along image columns (right), y along image rows (down), z along
//! the optical axis away from the lens; the origin is at the centre of the sensor in the paraxial object plane. The axes
//! are right-handed, and because y points down, a rotation with positive z vorticity looks clockwise on the screen.
//! Pixels occur only in [`scale`].
//!
//! # Parts
//!
//! - A [`VelocityField`] answers for velocity, gradient and, where there is one, the closed form of its trajectories;
//!   those on offer are in [`fields`], listed in [`registry`], and one more can be read from a file ([`grid`]).
//! - [`integrate::advance`] follows a trajectory forward or backward, by the closed form or by DOPRI5(4).
//! - A [`Domain`] is the box that holds the tracers, with open faces, walls and periodic faces, and [`Body`] what stands in it;
//!   [`Seeding`] and [`Diameters`] fill it.
//! - Tracers may diffuse ([`Brownian`]), settle ([`Settling`]), be [`Spheroids`] that turn ([`orientation`]), and differ in
//!   brightness ([`Intensities`]).
//! - A [`Scene`] joins the three, and its recordings are the clouds at given times ([`sequence`]): uniform ones stay
//!   uniform, ids are never reused, and the numbers depend on nothing but the seed.
//!
//! # Example
//!
//! Five frames of the flow in a channel 100 um deep, seen by a sensor of 752 x 366 px with 0.645 um per pixel; the fastest
//! particles move by 10 px from frame to frame.
//!
//! ```
//! use flows::fields::Poiseuille;
//! use flows::scale::Scale;
//! use flows::{Boundary, Diameters, Domain, Scene, Seeding, Start};
//! use microsig_core::stream::Streams;
//!
//! # fn main() -> Result<(), flows::Error> {
//! let flow = Poiseuille::new(1290.0, -80.0, 20.0, 0.0)?;
//! let scale = Scale::new(0.645, 752, 366, 1.0)?;
//!
//! // Particles just beyond the edge still shed light onto the sensor: the domain is 40 px larger than the view.
//! let domain = Domain::new(scale.view(-80.0, 20.0, 40.0)?, [Boundary::Open, Boundary::Open, Boundary::Wall]);
//! let seeding = Seeding::count_in_view(115, scale.view(-80.0, 20.0, 0.0)?, Diameters::equal(2.0)?);
//! let scene = Scene::new(&flow, &domain, &seeding)?;
//!
//! let times_s: Vec<f64> = (0..5).map(|k| 0.005 * f64::from(k)).collect();
//! let frames = scene.record(&times_s, Streams::new(7), Start::default())?.collect::<Result<Vec<_>, _>>()?;
//!
//! for (now, next) in frames[0].links(&frames[1]) {
//!     let step = scale.displacement_to_image(next.position - now.position);
//!     assert!(step.dx_px > 0.0 && step.dx_px < 10.0 + 1e-9 && step.dy_px == 0.0);
//! }
//! # Ok(())
//! # }
//! ```

pub mod body;
pub mod brownian;
pub mod diameters;
pub mod domain;
mod drift;
mod dual;
pub mod error;
pub mod eulerian;
pub mod exposure;
pub mod field;
pub mod fields;
pub mod frame;
pub mod grid;
pub mod illumination;
pub mod integrate;
pub mod intensities;
pub mod orientation;
pub mod params;
pub mod region;
pub mod registry;
pub mod scale;
pub mod seeding;
pub mod sequence;
pub mod sincos;
pub mod special;
pub mod tracks;

pub use body::Body;
pub use brownian::{Brownian, Settling};
pub use diameters::Diameters;
pub use domain::{Boundary, Domain};
pub use error::{Error, Result};
pub use exposure::Shutter;
pub use field::VelocityField;
pub use frame::{Displacement, Frame, Tracer};
pub use illumination::Illumination;
pub use intensities::Intensities;
pub use orientation::{Orientations, Spheroids};
pub use region::{Axis, Region};
pub use seeding::Seeding;
pub use sequence::{Scene, Sequence, Start};
pub use tracks::Tracks;
