//! The leaderboard: its columns, and the scores of each tracker on each dataset.

use serde_json::{Value, json};

use super::state::App;
use super::subject::Tracker;
use scenario::number;
use scoring::ranking::{SCORES, ScoreDef};
use storage::error::Result;

fn columns() -> impl Iterator<Item = &'static ScoreDef> {
    SCORES.iter().filter(|def| !def.path.is_empty())
}

/// The datasets, trackers and columns that the page can show.
pub(super) fn about(app: &App) -> Value {
    let subject = &app.subject;
    let has = |tracker: &Tracker| tracker.results.iter().map(Option::is_some).collect::<Vec<_>>();
    let columns = columns()
        .map(|def| json!({ "path": def.path, "label": def.label, "unit": def.unit, "better": def.better }));
    let columns: Vec<Value> = columns.collect();
    let datasets = subject.datasets.iter().map(|d| {
        let numbers: Vec<Option<f64>> = d.values.iter().map(|value| number(value)).collect();
        json!({ "name": d.name, "values": d.values, "numbers": numbers })
    });
    let datasets: Vec<Value> = datasets.collect();
    json!({
        "title": app.title(), "version": storage::VERSION, "may_save": subject.scenario.is_some(),
        "is_sweep": subject.sweep.is_some(), "axes": subject.axes, "columns": columns,
        "datasets": datasets,
        "trackers": subject.trackers.iter().map(|t| json!({ "name": t.name, "has": has(t) })).collect::<Vec<_>>(),
    })
}

/// The scores of a tracker on a dataset, by path; `None` if it has no result for it.
pub(super) fn entry(app: &App, dataset: usize, tracker: usize) -> Result<Option<Value>> {
    let Some(open) = app.result(dataset, tracker)? else { return Ok(None) };
    let scores = columns().map(|def| (def.path.to_owned(), def.measured(&open.score).0.into()));
    Ok(Some(json!({ "scores": Value::Object(scores.collect()) })))
}
