//! `microsig schema`: prints the JSON Schema of scenarios, sweeps or suites.

use clap::{Args, ValueEnum};

use super::Common;
use super::output::report;
use scenario::{SuiteSpec, SweepSpec, schema_of, spec::Spec};
use storage::error::{Error, Result};

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
