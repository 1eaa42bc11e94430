//! `cargo xtask man`: manual pages of the command, one for each verb.

use std::path::Path;

use clap::CommandFactory;

/// Writes `microsig.1` and `microsig-VERB.1` into a folder.
pub(crate) fn run(out: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(out)?;
    clap_mangen::generate_to(::bench::cli::Cli::command(), out)?;
    println!("{}", out.display());
    Ok(())
}
