//! The fields on offer, one family a file.
//!
//! To add one, read `poiseuille.rs` (the shortest) or `lamb_oseen.rs` (time-dependent, with an exact trajectory), and
//! enter it in the table of `tests/conformance.rs`.

mod lamb_oseen;
mod linear;
mod poiseuille;

pub use lamb_oseen::LambOseen;
pub use linear::Linear;
pub use poiseuille::Poiseuille;

/// Factor on a bound of the speed that is sharp in exact arithmetic, so that rounding cannot make it too small.
const ROUNDING_MARGIN: f64 = 1.0 + 1e-12;
