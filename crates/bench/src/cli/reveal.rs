//! `microsig reveal`: publishes the truth of a challenge after its deadline.

use std::path::PathBuf;

use clap::Args;

use super::Common;
use super::output::{summarize, warn};
use arena::release::{RevealOptions, reveal};
use generator::runner::{RECORD, SuiteRecord};
use storage::error::{Error, Result};

/// Write the truth of a challenge for publication, after its deadline
#[derive(Debug, Args)]
#[command(
    long_about = "Write the truth of a challenge for publication, after its deadline.\n\nThe folder has the truth of the test split with its \
    scenario and secret key, the salt, and a copy of the commitment, which both match: it is what was promised, or nothing is written.",
    after_help = "Example: microsig reveal challenges/quickstart --out challenges/quickstart-truth"
)]
pub(super) struct Reveal {
    /// Folder of the challenge, with public and withheld, or of a released suite
    challenge: PathBuf,
    #[command(flatten)]
    options: RevealOptions,
}

impl Reveal {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        if self.challenge.join(RECORD).is_file() {
            return self.reveal_suite(common);
        }
        let revealed = reveal(&self.challenge, &self.options)?;
        warn(&revealed.warning, common);
        let (name, out) = (&revealed.name, revealed.out.display());
        let text =
            format!("truth of {name}, which matches commitment {}; publish {out}", revealed.commitment);
        summarize(&text, &revealed, common)
    }

    /// The truth of every case of a released suite: OUT/TRACK/CASE.
    fn reveal_suite(&self, common: &Common) -> Result<()> {
        let record = SuiteRecord::read(&self.challenge)?;
        let mut all = Vec::new();
        for case in record.images_sha256.keys() {
            let out = self.options.out.join(case);
            let above = out.parent().unwrap_or(&self.options.out);
            std::fs::create_dir_all(above).map_err(Error::write(above))?;
            let options = RevealOptions { out, ..self.options.clone() };
            let revealed = reveal(&self.challenge.join(case), &options)?;
            warn(&revealed.warning, common);
            all.push(revealed);
        }
        let out = self.options.out.display();
        let text = format!(
            "truth of {}: {} cases, which match their commitments; publish {out}",
            record.edition(),
            all.len()
        );
        summarize(&text, &all, common)
    }
}
