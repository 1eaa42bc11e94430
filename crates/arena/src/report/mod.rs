//! Presentation of scores: terminal table, JSON, CSV, and an HTML report with plots.

mod compare;
mod field_page;
mod field_plots;
mod figure;
mod files;
mod fit_page;
mod for_team;
mod leaderboard;
mod page;
mod particle_plots;
mod plane_plots;
mod plots;
mod score_file;
mod sweep_plots;
mod table;
mod tiles;
mod twin_page;

use std::path::{Path, PathBuf};

use scoring::evaluate::{Evaluation, UnitScores};
use serde::Serialize;
use storage::error::{Error, Result};
use storage::folder::{Earlier, Partial, check_replaceable};
use storage::{OutputFolder, outside_datasets};

pub use compare::{Comparison, Named, Ranking, compare, compare_sweep, ranking};
pub use field_page::field_page;
pub(crate) use figure::{figure_of, names};
pub use files::SCORE;
use files::UNITS;
pub use fit_page::fit_page;
pub(crate) use for_team::{FEWEST, published_files, redacted};
pub use leaderboard::Entry;
pub(crate) use page::document;
pub(crate) use plots::is_logarithmic;
pub(crate) use plots::{AxisLabels, Series, lines, lines_over_log, log_lines};
pub use plots::{MOST_LINES, log_ticks, markers, sign};
pub use score_file::{parse as parse_score, parse_units};
pub use table::{summary, table};
pub use twin_page::{OnBoth, TrackerScores, TwinAbout, TwinScore, twin_page};

/// The report's file.
pub(crate) const REPORT: &str = "report.html";

/// Checks that the files of an evaluation may be written into a folder.
/// Errors: a folder in a dataset; an existing one, unless `force` replaces it.
pub fn check(out: &Path, force: bool) -> Result<Earlier> {
    let earlier = Earlier::new(SCORE, force);
    outside_datasets(out)?;
    check_replaceable(out, earlier)?;
    Ok(earlier)
}

/// The folder of an evaluation.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WrittenReport {
    pub files: Vec<PathBuf>,
    /// Warning of a file system without locks.
    pub warning: Option<String>,
}

/// Writes the folder of an evaluation: `score.json`, `units.json`, `per_frame.csv`, `curves.csv`,
/// `matches.csv` of particles, `vectors.csv` of a field, and `report.html` if asked for.
///
/// For a test split generated with a secret key these files reveal the truth; what may be sent to the
/// participants is in the folder `for_team`.
/// Errors: an existing folder, unless `force`; an I/O error.
pub fn write(out: &Path, evaluation: &Evaluation, html: bool, force: bool) -> Result<WrittenReport> {
    let earlier = check(out, force)?;
    let partial = Partial::start(out)?;
    let warning = partial.warning().map(str::to_owned);
    let names = write_into(partial.folder(), evaluation, html)?;
    partial.finish(earlier)?;
    Ok(WrittenReport { files: names.iter().map(|n| out.join(n)).collect(), warning })
}

/// Writes the files of an evaluation into a folder that exists; returns their names.
pub(crate) fn write_into(folder: &OutputFolder, evaluation: &Evaluation, html: bool) -> Result<Vec<String>> {
    let mut names = vec![SCORE, UNITS];
    folder.save_bytes(SCORE, json(&evaluation.score)?)?;
    folder.save_bytes(UNITS, units_json(&evaluation.units)?)?;
    if let Some(particles) = &evaluation.particles {
        files::rows(folder, "per_frame.csv", files::frames(particles))?;
        files::rows(folder, "matches.csv", files::matches(particles))?;
        files::rows(folder, "curves.csv", files::curves(evaluation))?;
        names.extend(["per_frame.csv", "matches.csv", "curves.csv"]);
    }
    if !evaluation.vectors.is_empty() {
        files::rows(folder, "vectors.csv", files::vectors(evaluation))?;
        names.push("vectors.csv");
    }
    if !evaluation.plane_points.is_empty() {
        files::rows(folder, "planes.csv", evaluation.plane_points.iter())?;
        names.push("planes.csv");
    }
    if html {
        folder.save_bytes(REPORT, page::page(evaluation, true)?)?;
        names.push(REPORT);
    }
    let mut names: Vec<String> = names.into_iter().map(str::to_owned).collect();
    if evaluation.score.truth_is_secret {
        names.push(for_team::write(folder, &evaluation.score)?);
    }
    Ok(names)
}

/// The input of the paired comparison with other results, as JSON.
pub fn units_json(units: &UnitScores) -> Result<String> {
    serde_json::to_string(units).map_err(|e| Error::input(e.to_string()))
}

/// All scores as JSON.
pub fn json(score: &impl Serialize) -> Result<String> {
    let text = serde_json::to_string_pretty(score).map_err(|e| Error::input(e.to_string()))?;
    Ok(text + "\n")
}
