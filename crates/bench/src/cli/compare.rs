//! `microsig compare`: makes a leaderboard.

use std::path::PathBuf;

use clap::Args;

use super::Common;
use super::output::report;
use crate::report::compare;
use storage::error::Result;

/// Rank several scores in a leaderboard
#[derive(Debug, Args)]
#[command(after_help = "Example: microsig compare scores/mine scores/theirs --out scores/leaderboard")]
pub(super) struct Compare {
    /// score.json files, or folders that contain one
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
