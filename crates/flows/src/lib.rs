//! Velocity fields that carry tracer particles: seeded clouds, exact trajectories, frame after frame.
//!
//! # Axes and units
//!
//! Lengths in um, times in s, velocities in um/s. x points along image columns (right), y along image rows
//! (down), z along the optical axis away from the lens; the origin is at the center of the sensor in the
//! paraxial object plane. The axes are right-handed, and because y points down, a rotation with positive z
//! vorticity looks clockwise on the screen. Pixels occur only in [`scale`].
//!
//! # Parts
//!
//! - A [`VelocityField`] gives the velocity, its gradient, the walls of the field and, where one is known, a
//!   closed form of its trajectories. The built-in fields are in [`fields`] and listed in [`registry`];
//!   sampled fields are read from files ([`velocity_grid`]).
//! - [`integrate::advance`] follows a trajectory forward or backward, by the closed form or by DOPRI5(4).
//! - A [`Domain`] is the box that holds the tracers, with open, solid and periodic faces; a [`Body`] is an
//!   obstacle in it. The [`FluidRegion`] is the part of the box outside all bodies and walls of the field.
//!   [`Seeding`] and [`Diameters`] fill it.
//! - Tracers may diffuse ([`Brownian`]) and settle ([`Settling`]), be [`Spheroids`] that
//!   rotate ([`orientation`]) and whose friction differs along and across their axis ([`friction`]), and
//!   differ in brightness ([`Intensities`]). Walls may slow them ([`hindered`]).
//! - A [`Scene`] joins these parts; a recording of it is the tracer cloud at a series of times
//!   ([`sequence`]). A uniform cloud stays uniform in a divergence-free field ([`divergence`] treats the
//!   others), ids are never reused, and all random numbers follow from the seed.
//!
//! # Example
//!
//! Five frames of the flow in a channel 100 um deep, imaged on 752 x 366 px at 0.645 um per pixel; the
//! fastest particles move by 10 px between frames.
//!
//! ```
//! use flows::fields::Poiseuille;
//! use flows::scale::Scale;
//! use flows::{Boundary, Diameters, Domain, Scene, Seeding, RecordingStart};
//! use microsig_core::stream::Streams;
//!
//! # fn main() -> Result<(), flows::Error> {
//! let flow = Poiseuille::new(1290.0, -80.0, 20.0, 0.0)?;
//! let scale = Scale::new(0.645, 752, 366, 1.0)?;
//!
//! // Particles just outside the view still contribute light to the sensor: the domain is 40 px larger.
//! let faces = [Boundary::Open, Boundary::Open, Boundary::Wall];
//! let domain = Domain::new(scale.view(-80.0, 20.0, 40.0)?, faces);
//! let seeding = Seeding::count_in_view(115, scale.view(-80.0, 20.0, 0.0)?, Diameters::equal(2.0)?);
//! let scene = Scene::new(&flow, &domain, &seeding)?;
//!
//! let times_s: Vec<f64> = (0..5).map(|k| 0.005 * f64::from(k)).collect();
//! let recording = scene.record(&times_s, Streams::new(7), RecordingStart::default())?;
//! let frames = recording.collect::<Result<Vec<_>, _>>()?;
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
pub mod divergence;
pub mod domain;
mod drift;
mod dual;
mod entry;
pub mod error;
pub mod eulerian;
pub mod exposure;
pub mod field;
pub mod fields;
pub mod fluid;
pub mod frame;
pub mod friction;
pub mod hindered;
mod hindered_brownian;
pub mod illumination;
pub mod integrate;
pub mod intensities;
mod near_walls;
pub mod orientation;
pub mod params;
mod path;
pub mod region;
pub mod registry;
pub mod scale;
pub mod scene;
pub mod seeding;
pub mod sequence;
pub mod sincos;
pub mod special;
pub mod step_estimate;
pub mod tracks;
pub mod velocity_grid;
pub mod wall;

pub use body::Body;
pub use brownian::{Brownian, Settling};
pub use diameters::Diameters;
pub use domain::{Boundary, Domain};
pub(crate) use error::ParameterCheck;
pub use error::{Error, Result};
pub use exposure::Shutter;
pub use field::VelocityField;
pub use fluid::{FluidFractionCache, FluidRegion};
pub use frame::{Displacement, Frame, RecordingStart, Streak, StreakPoint, Tracer};
pub use friction::SpheroidFriction;
pub use illumination::Illumination;
pub use intensities::Intensities;
pub use orientation::{Orientation, Spheroids};
pub use region::{Axis, Region};
pub use scene::Scene;
pub use seeding::Seeding;
pub use sequence::Sequence;
pub use tracks::RecordedTracks;
pub use wall::Wall;
