//! What the command says of itself: `microsig completions`, `man` and `schema`.

use std::path::PathBuf;

use clap::{Args, CommandFactory, ValueEnum};
use clap_complete::Shell;

use super::output::report;
use super::{Cli, Common};
use scenario::{SuiteSpec, SweepSpec, schema_of, spec::Spec};
use storage::argument::folder;
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
        storage::print(&script)
    }
}

/// Write the manual pages, one for each command, into a folder
#[derive(Debug, Args)]
#[command(hide = true, after_help = "Example: microsig man share/man/man1")]
pub(super) struct Man {
    /// Output folder; existing pages are replaced
    #[arg(value_parser = folder())]
    out: PathBuf,
}

impl Man {
    pub(super) fn run(&self, _: &Common) -> Result<()> {
        std::fs::create_dir_all(&self.out).map_err(Error::write(&self.out))?;
        clap_mangen::generate_to(Cli::command(), &self.out).map_err(Error::write(&self.out))
    }
}

/// Print the JSON Schema of a scenario, sweep or suite: types, units, ranges, defaults, meanings
#[derive(Debug, Args)]
#[command(
    long_about = "The keys of a scenario, sweep or suite as JSON Schema (draft 2020-12), for editors and programs that write scenarios as JSON.\n\n\
Extensions: x-unit, x-condition and x-default in words, x-infinite (null stands for inf).",
    after_help = "Example: microsig schema > scenario.schema.json"
)]
pub(super) struct Schema {
    /// The file to describe
    #[arg(value_enum, default_value_t = Language::Scenario)]
    language: Language,
}

/// The files that a schema describes.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum Language {
    /// A scenario, for `generate`
    Scenario,
    /// A sweep, for `sweep`
    Sweep,
    /// A suite, for `suite`
    Suite,
}

impl Schema {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        let schema = match self.language {
            Language::Scenario => schema_of::<Spec>(),
            Language::Sweep => schema_of::<SweepSpec>(),
            Language::Suite => schema_of::<SuiteSpec>(),
        };
        let text = serde_json::to_string_pretty(&schema).map_err(|e| Error::input(e.to_string()))?;
        report(&text, &schema, common)
    }
}
