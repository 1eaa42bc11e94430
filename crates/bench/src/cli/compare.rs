//! `microsig compare`: makes a leaderboard.

use std::path::PathBuf;

use clap::Args;

use super::Common;
use super::output::report;
use crate::report::compare;
use storage::error::Result;

/// A leaderboard of several scores
#[derive(Debug, Args)]
#[command(after_help = "Example: microsig compare scores/mine scores/theirs --out scores/leaderboard")]
pub(super) struct Compare {
    /// Files score.json, or folders that hold one
    #[arg(required = true)]
    scores: Vec<PathBuf>,
    /// Folder for leaderboard.csv, curves.csv and leaderboard.html
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

impl Compare {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        let compared = compare(&self.scores, &self.out, common.force)?;
        report(compared.text.trim_end(), &compared, common)
    }
}
