//! Scenarios: as written ([`spec`]), as read ([`parse()`]), as checked and filled ([`resolve()`]).

pub mod keys;
mod parse;
mod resolve;
pub mod spec;

pub use parse::{compact, parse, write};
pub use resolve::{Input, Recordings, Scenario, resolve};
