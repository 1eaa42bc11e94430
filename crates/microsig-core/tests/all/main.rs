//! Integration tests, one file per subject, in one binary: `cargo test -p microsig-core --test all NAME::` runs one of them.

mod cylinder;
mod expected_limits;
mod noise;
mod same_bytes;
mod single_images;
mod waves;
