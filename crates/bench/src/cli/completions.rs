//! `microsig completions`: prints shell completions.

use clap::{Args, CommandFactory};
use clap_complete::Shell;

use super::Cli;
use storage::error::Result;

/// Print shell completions on standard output
#[derive(Debug, Args)]
#[command(
    after_help = "Example: microsig completions bash > ~/.local/share/bash-completion/completions/microsig"
)]
pub(super) struct Completions {
    /// The shell
    shell: Shell,
}

impl Completions {
    pub(super) fn run(&self) -> Result<()> {
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut Cli::command(), "microsig", &mut script);
        storage::print(&script)
    }
}
