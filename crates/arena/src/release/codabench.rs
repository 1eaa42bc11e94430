//! `release --codabench`: a bundle for the benchmark platform Codabench, so that organizers need no server of
//! their own.
//!
//! ```text
//! codabench.zip
//!   competition.yaml  logo.png  overview.md  evaluation.md  data.md  terms.md
//!   reference_data.zip   test/: truth and scenario, without images and key
//!   scoring_program.zip  metadata.yaml, scoring.py, columns.json, and the wheel if one is given
//! ```
//!
//! The bundle contains the truth of the test split, so it belongs to the withheld part; the platform shows
//! reference data to the organizers only.

use std::path::Path;

use serde_json::Value;

use super::about::ReleaseTexts;
use super::submission;
use crate::package::Package;
use scoring::ranking::{Better, SCORES, ScoreDef, Subject};
use storage::advice;
use storage::advice::option;
use storage::dataset::manifest::ResultKind;
use storage::error::{Error, Result};
use storage::{OutputFolder, TemporaryFolder};

/// Name of the bundle.
const BUNDLE: &str = "codabench.zip";

/// The scoring program.
const SCORING: &str = include_str!("codabench/scoring.py");

/// Command with which the platform runs it.
const METADATA: &str = "command: python3 /app/program/scoring.py /app/input /app/output\n";

/// Columns of the leaderboard, which sorts by size: published scores, each of which is a key of `score.json`.
fn columns() -> impl Iterator<Item = &'static ScoreDef> {
    SCORES.iter().filter(|def| def.is_headline && def.published.is_some() && def.better != Better::NearZero)
}

/// Whether scoring needs a file of the test split: a field follows from the scenario. The key reveals more than
/// the truth.
fn is_needed(path: &str) -> bool {
    let left_out = ["images/", "particles/", "calibration/"];
    let files = ["secret_key.txt", "preview.png", "README.md"];
    !left_out.iter().any(|part| path.starts_with(part)) && !files.contains(&path)
}

/// Writes the bundle of a release. `test`: the withheld test split; `train`: for the logo; `wheel`: the
/// Python wheel of microsig.
pub(super) fn write(
    withheld: &OutputFolder,
    (train, test): (&Path, &Path),
    about: &ReleaseTexts<'_>,
    wheel: Option<&Path>,
) -> Result<()> {
    let place = TemporaryFolder::new()?;
    let parts = OutputFolder::existing(place.path());
    let mut reference = Package::default();
    let mut truth = Package::default();
    truth.copy_folder(test, is_needed)?;
    for path in truth.paths() {
        reference.copy(&format!("test/{path}"), test.join(&path));
    }
    if let Some((marker, text)) = submission::marker(&about.scored) {
        reference.write(marker, text);
    }
    let [reference_data, scoring_program] = ["reference_data.zip", "scoring_program.zip"];
    reference.zip("", &parts, reference_data)?;

    let mut program = Package::default();
    program.write("metadata.yaml", METADATA);
    program.write("scoring.py", SCORING);
    let paths: serde_json::Map<String, Value> =
        columns().map(|def| (def.name.to_owned(), def.path.into())).collect();
    program.write("columns.json", Value::Object(paths).to_string());
    if let Some(wheel) = wheel {
        let name = wheel.file_name().unwrap_or_default().to_string_lossy();
        if !wheel.is_file() || !name.ends_with(".whl") {
            let what = advice!(option("wheel").of(wheel.display()), ": expected a Python wheel (.whl)");
            return Err(Error::option(what));
        }
        program.copy(&name, wheel.to_owned());
    }
    program.zip("", &parts, scoring_program)?;

    let mut bundle = Package::default();
    bundle.write("competition.yaml", competition(about, wheel.is_some()));
    bundle.write("overview.md", about.readme());
    bundle.write("evaluation.md", evaluation(about.name));
    bundle.write("data.md", data(about.name));
    bundle.write("terms.md", about.license_text());
    let logo = train.join("preview.png");
    if logo.is_file() {
        bundle.copy("logo.png", logo);
    }
    for part in [reference_data, scoring_program] {
        bundle.copy(part, parts.join(part));
    }
    bundle.zip("", withheld, BUNDLE)
}

fn competition(about: &ReleaseTexts<'_>, has_wheel: bool) -> String {
    // A JSON string is a valid YAML string.
    let quoted = |text: &str| Value::from(text).to_string();
    let container = if has_wheel { "" } else { " # replace with a container in which microsig is installed" };
    let mut text = format!(
        "version: 2\ntitle: {title}\ndescription: {about}\nimage: logo.png\nregistration_auto_approve: true\n\
         docker_image: python:3.12-slim{container}\nterms: terms.md\n\n\
         pages:\n  - title: Overview\n    file: overview.md\n  - title: Evaluation\n    file: evaluation.md\n  - title: Data\n    file: data.md\n\n\
         tasks:\n  - index: 0\n    name: {title}\n    description: {what} of the test split\n    is_public: false\n    \
         reference_data: reference_data.zip\n    scoring_program: scoring_program.zip\n\n\
         # Set the dates before uploading; without an end date the phase stays open. Times are in UTC.\n\
         phases:\n  - index: 0\n    name: Test\n    description: Scores on the test split\n    start: 2000-01-01\n{end}    \
         max_submissions_per_day: 2\n    max_submissions: 20\n    execution_time_limit: 1800\n    tasks: [0]\n\n\
         leaderboards:\n  - index: 0\n    title: Results\n    key: main\n    submission_rule: Force_Last\n    columns:\n",
        title = quoted(&about.title),
        end = about
            .deadline
            .map_or_else(String::new, |day| format!("    end: {}\n", day.end().format("%Y-%m-%d %H:%M:%S"))),
        about = quoted(&format!("{}, by microsig", about.title)),
        what = match about.scored[..] {
            [ResultKind::Particles] => "Particles",
            [ResultKind::Fields] => "Displacement fields",
            _ => "Particles or displacement fields",
        },
    );
    let is_shown = |def: &&ScoreDef| match def.subject {
        Subject::Field => about.scored.contains(&ResultKind::Fields),
        Subject::Particles if def.path.starts_with("gdpt.") => !about.is_for_fields() && about.scores_depth(),
        Subject::Particles => !about.is_for_fields(),
        Subject::Planes => false,
    };
    for (i, def) in columns().filter(is_shown).enumerate() {
        let sorting = if def.better == Better::Smaller { "asc" } else { "desc" };
        let (key, title) = (def.name, quoted(&def.title()));
        text += &format!(
            "      - index: {i}\n        title: {title}\n        key: {key}\n        sorting: {sorting}\n"
        );
    }
    text
}

fn evaluation(name: &str) -> String {
    format!(
        "# Evaluation\n\nSubmit a zip archive with `results.csv` and `submission.json`, like the template in `{name}-test.zip`. It is \
        scored with `microsig evaluate`; docs/scoring.md defines the scores on the leaderboard. Check your submission before you \
        upload it:\n\n```sh\nmicrosig check-submission {name}-test SUBMISSION\nmicrosig evaluate {name}-val results_of_val.csv\n```\n"
    )
}

fn data(name: &str) -> String {
    format!(
        "# Data\n\nDownload `{name}-train.zip`, `{name}-val.zip` and `{name}-test.zip` from the release page and check them with \
         `sha256sum -c SHA256SUMS`. Train and val include their truth. Test includes images, calibration images and times only.\n"
    )
}
