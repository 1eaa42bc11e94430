//! `microsig flows`: what there is to choose from.

use bench::{Error, Result, flow_plot};
use flows::registry::{self, Entry};
use serde_json::{Value, json};

use crate::cli::{Common, Flows};
use crate::report;

/// Lists all fields, describes one, or draws it.
pub(crate) fn run_flows(arguments: &Flows, common: &Common) -> Result<()> {
    let Some(name) = &arguments.name else {
        let width = registry::ENTRIES.iter().map(|e| e.name.len()).max().unwrap_or(0);
        let lines: Vec<String> =
            registry::ENTRIES.iter().map(|e| format!("{:width$}  {}", e.name, e.formula)).collect();
        return report(
            &lines.join("\n"),
            &registry::ENTRIES.iter().map(described).collect::<Vec<_>>(),
            common,
        );
    };
    let entry = registry::find(name).ok_or_else(|| {
        let names: Vec<&str> = registry::ENTRIES.iter().map(|e| e.name).collect();
        let hint = bench::scenario::keys::nearest(name, names.iter().copied());
        let hint = hint.map(|hint| format!("did you mean `{hint}`? ")).unwrap_or_default();
        Error::input(format!("`{name}`: {hint}expected one of {}", names.join(", ")))
    })?;
    if let Some(file) = &arguments.plot {
        if file.exists() && !common.force {
            return Err(Error::Exists(file.clone()));
        }
        std::fs::write(file, flow_plot::svg(entry)?).map_err(Error::write(file))?;
    }
    report(&description(entry), &described(entry), common)
}

fn description(entry: &Entry) -> String {
    let mut text = format!("{}\n  {}\n  source: {}\n", entry.name, entry.formula, entry.source);
    if !entry.parameters.is_empty() {
        let column = |f: &dyn Fn(&flows::params::Parameter) -> usize| {
            entry.parameters.iter().map(f).max().unwrap_or(0)
        };
        let (names, defaults) = (column(&|p| p.name.len()), column(&|p| p.default_text().len()));
        let ranges = column(&|p| p.range.len());
        text += "\n  parameter, default, range, meaning\n";
        for p in entry.parameters {
            let default = p.default_text();
            text +=
                &format!("  {:names$}  {default:defaults$}  {:ranges$}  {}\n", p.name, p.range, p.meaning());
        }
    }
    text.trim_end().to_owned()
}

fn described(entry: &Entry) -> Value {
    let parameters: Vec<Value> = entry
        .parameters
        .iter()
        .map(|p| json!({ "name": p.name, "default": p.default_text(), "range": p.range, "meaning": p.meaning() }))
        .collect();
    json!({ "name": entry.name, "formula": entry.formula, "source": entry.source, "parameters": parameters })
}
