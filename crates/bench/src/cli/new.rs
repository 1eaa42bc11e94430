//! `microsig new`: writes a scenario to start from.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::json;

use super::Common;
use super::options::Replace;
use super::output::{report, summarize};
use scenario::{self, SHIPPED, SUITE, Shipped, nearest, shipped, shipped_suites};
use storage::OutputFile;
use storage::argument::output;
use storage::error::{Error, Result};
use storage::save_result;

/// Write a commented scenario to start from: a template with every key, or a shipped scenario
#[derive(Debug, Args)]
#[command(after_help = "Example: microsig new mine.ron && microsig generate mine.ron\n\
         Example: microsig new --from odpc1 | less\n\
         Example: microsig new --list\n\
         Example: microsig new drop.ron --from coffee_ring")]
pub(super) struct New {
    /// Output file [default: standard output]
    #[arg(value_parser = output())]
    file: Option<OutputFile>,
    /// Start from a shipped scenario, sweep or suite
    #[arg(long, value_name = "NAME", conflicts_with = "list")]
    from: Option<String>,
    /// List the shipped scenarios, sweeps and suites
    #[arg(long, conflicts_with = "file")]
    list: bool,
    #[command(flatten)]
    replace: Replace,
}

fn is_shipped(name: &str) -> bool {
    Shipped::named(name).is_some() || shipped_suites().contains(&name)
}

impl New {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        if self.list {
            return list(common);
        }
        let file = self.file.clone().unwrap_or_else(|| OutputFile::argument("-"));
        if let (None, Some(name)) = (&self.from, file.to_str().filter(|name| is_shipped(name))) {
            return Err(Error::input(format!(
                "{name} is the name of a shipped scenario, sweep or suite: `microsig new --from {name}` prints it, `microsig new \
                 {name}.ron --from {name}` copies it; for a template of this name, write ./{name}"
            )));
        }
        // The files that the scenario refers to, and the scenario itself.
        let mut files = Vec::new();
        let (text, verb) = match &self.from {
            None => (scenario::template()?, "generate"),
            Some(name) if shipped_suites().contains(&name.as_str()) => {
                let suite = SHIPPED.get_dir(name).map(|folder| folder.files()).into_iter().flatten();
                let own = format!("{name}/{SUITE}");
                let beside = file.parent().map_or_else(PathBuf::new, PathBuf::from);
                let others = suite.filter(|other| other.path() != Path::new(&own));
                let path = |other: &Path| beside.join(other.file_name().unwrap_or_default());
                files.extend(others.map(|other| (path(other.path()), other.contents().to_vec())));
                let text = SHIPPED.get_file(&own).and_then(|file| file.contents_utf8()).unwrap_or_default();
                (text.to_owned(), "suite list")
            }
            Some(name) => {
                let found = Shipped::named(name).ok_or_else(|| unknown(name))?;
                let beside = file.parent().map_or_else(PathBuf::new, PathBuf::from);
                files.extend(
                    found.files().map(|other| (beside.join(other.path()), other.contents().to_vec())),
                );
                (found.text.to_owned(), if found.is_sweep() { "sweep" } else { "generate" })
            }
        };
        if file.is_standard() {
            return report(text.trim_end(), &json!({ "text": text, "files": [] }), common);
        }
        files.push((file.to_path_buf(), text.into_bytes()));
        if let Some((existing, _)) = files.iter().find(|(path, _)| path.exists() && !self.replace.force) {
            return Err(Error::exists(existing));
        }
        for (path, bytes) in &files {
            save_result(path, self.replace.force, bytes)?;
        }
        let text = format!("{0} written; edit it, then run `microsig {verb} {0}`", file.display());
        summarize(
            &text,
            &json!({ "file": &*file, "files": files.iter().map(|(path, _)| path).collect::<Vec<_>>() }),
            common,
        )
    }
}

fn list(common: &Common) -> Result<()> {
    let all: Vec<_> = shipped().iter().map(|shipped| (shipped.name, shipped.question())).collect();
    let suites = shipped_suites().into_iter().map(|name| (name, "a suite: see `microsig suite list`"));
    let all: Vec<_> = all.into_iter().chain(suites).collect();
    let width = all.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
    let lines: Vec<String> =
        all.iter().map(|(name, question)| format!("{name:width$}  {question}")).collect();
    let objects: Vec<_> =
        all.iter().map(|(name, question)| json!({ "name": name, "question": question })).collect();
    report(&lines.join("\n"), &objects, common)
}

fn unknown(name: &str) -> Error {
    let names: Vec<&str> = shipped().iter().map(|shipped| shipped.name).collect();
    let near = nearest(name, names.iter().copied());
    let hint = near.map(|near| format!("did you mean `{near}`? ")).unwrap_or_default();
    Error::input(format!("--from {name}: {hint}expected one of {}", names.join(", ")))
}
