//! `microsig man`: writes the manual pages, for packages.

use std::path::PathBuf;

use clap::{Args, CommandFactory};

use super::Cli;
use super::argument::folder;
use storage::error::{Error, Result};

/// Write the manual pages, one for each command, into a folder
#[derive(Debug, Args)]
#[command(hide = true, after_help = "Example: microsig man share/man/man1")]
pub(super) struct Man {
    /// Output folder; existing pages are replaced
    #[arg(value_parser = folder())]
    out: PathBuf,
}

impl Man {
    pub(super) fn run(&self) -> Result<()> {
        std::fs::create_dir_all(&self.out).map_err(Error::write(&self.out))?;
        clap_mangen::generate_to(Cli::command(), &self.out).map_err(Error::write(&self.out))
    }
}
