//! Numerical methods that both trackers and scores use: Fourier transforms, nearby points, assignment on sparse graphs.

pub mod assignment;
pub mod cell_grid;
pub mod fourier;
