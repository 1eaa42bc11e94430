//! End-to-end tests of the workspace, one file per subject: `cargo test -p suite NAME::` runs one of them.
#![expect(clippy::print_stdout, reason = "the margins of a test are shown when it fails, or on request")]

mod baselines;
mod boxes;
mod centroid;
mod challenge;
mod codabench;
mod command;
mod exact;
mod expected;
mod export;
mod extremes;
mod fit;
mod golden;
mod house;
mod image_format;
mod maxima;
mod microscope;
mod motion;
mod orientation;
mod reference;
mod release;
mod robust;
mod scoring;
mod scoring_fields;
mod scoring_formats;
mod scoring_hints;
mod scoring_keys;
mod scoring_mutations;
mod scoring_results;
mod shipped;
mod spheroids;
mod suites;
mod sweep;
mod trial;
mod truth;
mod web;
