//! `microsig flows`: lists and describes the velocity fields.

use ::flows::params::Parameter;
use ::flows::registry::{self, FieldEntry};
use clap::Args;
use serde_json::{Value, json};

use super::Common;
use super::options::Replace;
use super::output::{report, save_picture, written};
use crate::flow_plot;
use scenario;
use storage::OutputFile;
use storage::argument::plot_file;
use storage::error::{Error, Result};

/// List the velocity fields, or describe one: formula, parameters, units, defaults, source
#[derive(Debug, Args)]
#[command(after_help = "Example: microsig flows lamb_oseen --plot lamb_oseen.svg")]
pub(super) struct Flows {
    /// Name of a field
    name: Option<String>,
    /// Plot speed and streamlines of the field in the default scene (SVG)
    #[arg(long, value_name = "FILE", requires = "name", value_parser = plot_file())]
    plot: Option<OutputFile>,
    #[command(flatten)]
    replace: Replace,
}

impl Flows {
    /// Lists all fields, describes one, or plots it.
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        let Some(name) = &self.name else {
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
            let hint = scenario::nearest(name, names.iter().copied());
            let hint = hint.map(|hint| format!("did you mean `{hint}`? ")).unwrap_or_default();
            Error::input(format!("`{name}`: {hint}expected one of {}", names.join(", ")))
        })?;
        if let Some(file) = &self.plot {
            save_picture(file, self.replace.force, &flow_plot::svg(entry)?)?;
            return written(file, &description(entry), &described(entry), common);
        }
        report(&description(entry), &described(entry), common)
    }
}

fn description(entry: &FieldEntry) -> String {
    let mut text = format!("{}\n  {}\n  source: {}\n", entry.name, entry.formula, entry.source);
    if !entry.parameters.is_empty() {
        let column = |f: &dyn Fn(&Parameter) -> usize| entry.parameters.iter().map(f).max().unwrap_or(0);
        let (names, defaults) = (column(&|p| p.name.len()), column(&|p| p.default_text().len()));
        let ranges = column(&|p| p.allowed().len());
        text += "\n  parameter, default, range, meaning\n";
        for p in entry.parameters {
            let default = p.default_text();
            text += &format!(
                "  {:names$}  {default:defaults$}  {:ranges$}  {}\n",
                p.name,
                p.allowed(),
                p.meaning()
            );
        }
    }
    text.trim_end().to_owned()
}

fn described(entry: &FieldEntry) -> Value {
    let parameters: Vec<Value> = entry
        .parameters
        .iter()
        .map(|p| json!({ "name": p.name, "default": p.default_text(), "range": p.allowed(), "meaning": p.meaning() }))
        .collect();
    json!({ "name": entry.name, "formula": entry.formula, "source": entry.source, "parameters": parameters })
}
