//! `microsig reveal`: publishes the truth of a challenge after its deadline.

use std::path::PathBuf;
use std::time::SystemTime;

use clap::Args;

use super::Common;
use super::argument::folder;
use super::options::Replace;
use super::output::{summarize, warn};
use arena::release::{RevealOptions, reveal};
use storage::error::Result;

/// Write the truth of a challenge for publication, after its deadline
#[derive(Debug, Args)]
#[command(
    long_about = "Write the truth of a challenge for publication, after its deadline.\n\nThe folder has the truth of the test split with its \
    scenario and secret key, the salt, and a copy of the commitment, which both match: it is what was promised, or nothing is written.",
    after_help = "Example: microsig reveal challenges/quickstart --out challenges/quickstart-truth"
)]
pub(super) struct Reveal {
    /// Folder of the challenge, with public and withheld
    challenge: PathBuf,
    /// Folder to be published
    #[arg(long, short, value_name = "DIR", value_parser = folder())]
    out: PathBuf,
    /// Also before the deadline, or without one
    #[arg(long)]
    early: bool,
    #[command(flatten)]
    replace: Replace,
}

impl Reveal {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        let (out, force) = (self.out.clone(), self.replace.force);
        let options = RevealOptions { out, force, early: self.early, now: SystemTime::now() };
        let revealed = reveal(&self.challenge, &options)?;
        warn(&revealed.warning, common);
        let (name, out) = (&revealed.name, revealed.out.display());
        let text =
            format!("truth of {name}, which matches commitment {}; publish {out}", revealed.commitment);
        summarize(&text, &revealed, common)
    }
}
