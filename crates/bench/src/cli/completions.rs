//! `microsig completions`: prints shell completions.

use std::io::Write;
use std::path::Path;

use clap::{Args, CommandFactory};
use clap_complete::Shell;

use super::{Cli, Common};
use storage::error::{Error, Result};

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
    pub(super) fn run(&self, _: &Common) -> Result<()> {
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut Cli::command(), "microsig", &mut script);
        match std::io::stdout().lock().write_all(&script) {
            Err(e) if e.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
            written => written.map_err(Error::write(Path::new("standard output"))),
        }
    }
}
