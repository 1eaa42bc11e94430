//! Fits of calibration scans compared with known truth: `cargo validate DIR`.
#![expect(clippy::print_stdout, reason = "a comparison reports its result")]

mod fit;

fn main() -> anyhow::Result<std::process::ExitCode> {
    fit::run(&clap::Parser::parse())
}
