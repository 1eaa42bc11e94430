//! End-to-end tests of the workspace, a file for each thing that must hold: `cargo test -p suite NAME::` runs one of them.
#![expect(clippy::print_stdout, reason = "the margins of a test are shown when it fails, or on request")]

mod baselines;
mod centroid;
mod command;
mod exact;
mod expected;
mod export;
mod golden;
mod maxima;
mod motion;
mod reference;
mod release;
mod robust;
mod scoring;
mod scoring_fields;
mod scoring_formats;
mod scoring_results;
mod shipped;
mod spheroids;
mod sweep;
mod truth;
