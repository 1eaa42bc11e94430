//! The leaderboard: its columns, and the scores of each tracker on each dataset.

use serde_json::{Value, json};

use super::state::App;
use super::subject::Tracker;
use storage::error::Result;

/// Columns of the leaderboard: path in `score.json`, label, unit, whether higher is better.
const COLUMNS: [(&str, &str, &str, bool); 12] = [
    ("detection.f1", "F1", "", true),
    ("detection.recall", "recall", "", true),
    ("detection.precision", "precision", "", true),
    ("detection.rmse_xy_px", "RMSE x, y", "px", false),
    ("detection.rmse_z_um", "RMSE z", "um", false),
    ("gdpt.sigma_z_over_h", "sigma z / h", "", false),
    ("links.f1", "links F1", "", true),
    ("hota.hota", "HOTA", "", true),
    ("clear.mota", "MOTA", "", true),
    ("isbi.jsc", "JSC", "", true),
    ("field.valid_vector_probability", "valid vectors", "", true),
    ("field.aee_px", "AEE", "px", false),
];

/// The datasets, trackers and columns that the page can show.
pub(super) fn about(app: &App) -> Value {
    let subject = app.subject();
    let has = |tracker: &Tracker| tracker.results.iter().map(Option::is_some).collect::<Vec<_>>();
    let columns = COLUMNS.map(|(path, label, unit, more_is_better)| {
        json!({ "path": path, "label": label, "unit": unit, "more_is_better": more_is_better })
    });
    json!({
        "title": app.title(), "version": storage::VERSION, "may_save": subject.scenario.is_some(),
        "is_sweep": subject.sweep.is_some(), "axes": subject.axes, "columns": columns,
        "datasets": subject.datasets.iter().map(|d| json!({ "name": d.name, "values": d.values })).collect::<Vec<_>>(),
        "trackers": subject.trackers.iter().map(|t| json!({ "name": t.name, "has": has(t) })).collect::<Vec<_>>(),
    })
}

/// The scores of a tracker on a dataset, by path; `None` if it has no result for it.
///
/// # Errors
/// A result that cannot be scored.
pub(super) fn entry(app: &App, dataset: usize, tracker: usize) -> Result<Option<Value>> {
    let Some(open) = app.result(dataset, tracker)? else { return Ok(None) };
    let of = |path: &str| path.split('.').try_fold(open.score(), |value, step| value.get(step)).cloned();
    let scores = COLUMNS.iter().map(|(path, ..)| ((*path).to_owned(), of(path).unwrap_or(Value::Null)));
    let interval = of("detection.interval.f1").unwrap_or(Value::Null);
    Ok(Some(json!({ "scores": Value::Object(scores.collect()), "f1_interval": interval,
        "warnings": open.score().get("warnings") })))
}
