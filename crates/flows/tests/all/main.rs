//! Integration tests, one file per subject, in one binary: `cargo test -p microsig-flows --test all NAME::` runs one of them.

mod cloud;
mod compositions;
mod conformance;
mod exposure;
mod hindered;
mod motion;
mod tracks;
mod walls;
