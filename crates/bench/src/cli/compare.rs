//! `microsig compare`: makes a leaderboard.

use std::path::PathBuf;

use clap::Args;

use super::Common;
use super::options::Replace;
use super::output::summarize;
use arena::report::compare;
use storage::InputFile;
use storage::argument::{folder, input};
use storage::error::Result;

/// Rank several scores in a leaderboard
#[derive(Debug, Args)]
#[command(after_help = "Example: microsig compare scores/mine scores/theirs --out scores/leaderboard")]
pub(super) struct Compare {
    /// score.json files, or folders that contain one
    #[arg(required = true, value_parser = input())]
    scores: Vec<InputFile>,
    /// Folder for leaderboard.csv, curves.csv and leaderboard.html
    #[arg(long, short, value_name = "DIR", value_parser = folder())]
    out: PathBuf,
    #[command(flatten)]
    replace: Replace,
}

impl Compare {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        let compared = compare(&self.scores, &self.out, self.replace.force)?;
        summarize(compared.text.trim_end(), &compared, common)
    }
}
