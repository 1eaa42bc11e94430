//! `--export`: the pages in a single file that opens without the program.
//!
//! The file contains the page's code and the responses that the server would give for the selected frames.

use std::path::PathBuf;

use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;
use serde::Serialize;
use serde_json::{Map, Value, json};

use super::dataset::OpenDataset;
use super::state::App;
use super::subject::Subject;
use super::{board, routes};
use storage::OutputFile;
use storage::error::{Error, Result};

#[derive(Debug, Clone)]
pub struct ExportOptions {
    pub out: OutputFile,
    pub force: bool,
    /// The frames; empty: the first ones.
    pub frames: Vec<u32>,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Exported {
    pub out: PathBuf,
    /// Size of the file, bytes.
    pub bytes: usize,
    /// Maximum size of the file, bytes.
    pub limit_bytes: usize,
    pub frames: Vec<u32>,
    /// Requested frames that are omitted, because the file would exceed its maximum size.
    pub left_out: Vec<u32>,
}

/// Maximum size of the file, bytes.
const LARGEST: usize = 64 << 20;

/// Number of frames that are exported by default.
const FRAMES: u32 = 4;

/// Modules of the page, in order of dependency: each uses only earlier ones.
pub(super) const MODULES: [&str; 11] = [
    "api.js",
    "dom.js",
    "colors.js",
    "viewer.js",
    "plots.js",
    "ron.js",
    "editor.js",
    "scenario.js",
    "dataset.js",
    "result.js",
    "board.js",
];

/// Writes datasets and results to a single page.
pub fn export(subject: Subject, options: &ExportOptions) -> Result<Exported> {
    options.out.may_write(options.force)?;
    if subject.datasets.is_empty() {
        return Err(Error::input("--export: expected a dataset or a sweep's folder"));
    }
    let app = App::new(subject, 0)?;
    let mut answers = Answers::default();
    answers.put("about", board::about(&app));
    let (datasets, trackers) = (app.subject.datasets.len(), app.subject.trackers.len());
    for dataset in 0..datasets {
        for tracker in 0..trackers {
            if let Some(entry) = board::entry(&app, dataset, tracker)? {
                answers.put(&format!("board/{dataset}/{tracker}"), entry);
            }
        }
    }
    let (frames, left_out) = dataset_parts(&app, &options.frames, &mut answers)?;
    if answers.bytes > LARGEST {
        return Err(Error::input(format!("--export: would be larger than {} MiB", LARGEST >> 20)));
    }
    let page = document(&Value::Object(answers.all))?;
    options.out.save(options.force, &page)?;
    Ok(Exported { out: options.out.to_path_buf(), bytes: page.len(), limit_bytes: LARGEST, frames, left_out })
}

/// Responses of the server by their paths.
#[derive(Default)]
struct Answers {
    all: Map<String, Value>,
    bytes: usize,
}

impl Answers {
    fn put(&mut self, path: &str, answer: Value) {
        let bytes = answer.to_string().len();
        if self.all.insert(path.to_owned(), answer).is_none() {
            self.bytes += bytes;
        }
    }
}

/// Adds the first dataset with its results for the selected frames; returns the included and the omitted
/// frames.
fn dataset_parts(app: &App, wanted: &[u32], answers: &mut Answers) -> Result<(Vec<u32>, Vec<u32>)> {
    let Some(open) = app.dataset(0)? else { return Ok((Vec::new(), Vec::new())) };
    let mut about = open.about()?;
    let frames = open.frames() as u32;
    if let Some(beyond) = wanted.iter().find(|frame| **frame >= frames) {
        return Err(Error::input(format!(
            "--frames {beyond}: expected frames from 0 to {}",
            frames.max(1) - 1
        )));
    }
    let mut wanted = if wanted.is_empty() { (0..frames.min(FRAMES)).collect() } else { wanted.to_vec() };
    wanted.sort_unstable();
    wanted.dedup();
    // Fails for a test split, whose scenario is withheld.
    if let Ok(depth) = open.depth() {
        answers.put("dataset/0/depth", depth);
    }
    for tracker in 0..app.subject.trackers.len() {
        if let Some(result) = app.result(0, tracker)? {
            answers.put(&format!("dataset/0/result/{tracker}"), result.about());
        }
    }
    let (mut included, mut left_out) = (Vec::new(), Vec::new());
    for frame in wanted {
        let frame_parts = frame_parts(app, &open, frame, open.are_pairs())?;
        if answers.bytes + frame_parts.bytes > LARGEST * 9 / 10 {
            left_out.push(frame);
            continue;
        }
        frame_parts.all.into_iter().for_each(|(path, answer)| answers.put(&path, answer));
        included.push(frame);
    }
    about["exported_frames"] = json!(included);
    answers.put("dataset/0", about);
    Ok((included, left_out))
}

fn frame_parts(app: &App, open: &OpenDataset, frame: u32, are_pairs: bool) -> Result<Answers> {
    let mut answers = Answers::default();
    let counts = open.counts(frame as usize)?.unwrap_or_default();
    answers.put(&format!("dataset/0/frame/{frame}"), json!({ "base64": BASE64.encode(&counts) }));
    answers.put(&format!("dataset/0/truth/{frame}"), open.truth(frame)?);
    let pair = if are_pairs { frame / 2 } else { frame };
    answers.put(&format!("dataset/0/field/{pair}"), open.field(pair)?);
    for tracker in 0..app.subject.trackers.len() {
        if let Some(result) = app.result(0, tracker)? {
            let path = format!("dataset/0/result/{tracker}");
            answers.put(&format!("{path}/frame/{frame}"), result.frame(frame));
            answers.put(&format!("{path}/vectors/{pair}"), result.vectors(pair));
        }
    }
    Ok(answers)
}

/// The page with its code, styles and answers in one file.
fn document(answers: &Value) -> Result<String> {
    let file = |name: &str| -> Result<&str> {
        let (bytes, _) =
            routes::file(name).ok_or_else(|| Error::input(format!("page: {name} is missing")))?;
        std::str::from_utf8(bytes).map_err(|e| Error::input(format!("page: {name}: {e}")))
    };
    let mut code = String::new();
    for module in MODULES.iter().chain(&["app.js"]) {
        code += &joined(file(module)?);
    }
    // `</script>` in a string would end the element.
    let data = answers.to_string().replace('<', "\\u003c");
    let (head, body) = file("index.html")?.split_once("<!-- files -->").unwrap_or_default();
    let (_, body) = body.split_once("<!-- end of files -->").unwrap_or_default();
    Ok(format!(
        "{head}<style>{}{}</style>\n<script>{}</script>\n<script>window.MICROSIG_EXPORT = {data};</script>\n\
         <script type=\"module\">\n{code}</script>{body}",
        file("uPlot.min.css")?,
        file("style.css")?,
        file("uPlot.iife.min.js")?,
    ))
}

/// A module as part of a single script: without imports and `export` keywords.
fn joined(module: &str) -> String {
    let mut code = String::with_capacity(module.len());
    for line in module.lines().filter(|line| !line.starts_with("import ")) {
        code += line.strip_prefix("export ").unwrap_or(line);
        code.push('\n');
    }
    code
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    /// Names that a module declares at its top level.
    fn declared(module: &str) -> Vec<&str> {
        let words = ["const ", "let ", "function ", "function* ", "class "];
        let names = module.lines().filter_map(|line| {
            let line = line.strip_prefix("export ").unwrap_or(line);
            let line = line.strip_prefix("async ").unwrap_or(line);
            let rest = words.iter().find_map(|word| line.strip_prefix(word))?;
            rest.split(|c: char| !(c.is_alphanumeric() || c == '_')).find(|word| !word.is_empty())
        });
        names.collect()
    }

    /// In a single script, all modules share one namespace, so names must be unique.
    #[test]
    fn modules_can_be_joined() {
        let mut seen: BTreeMap<&str, &str> = BTreeMap::new();
        for module in MODULES.iter().chain(&["app.js"]) {
            let text = std::str::from_utf8(routes::file(module).unwrap().0).unwrap();
            for name in declared(text) {
                let before = seen.insert(name, module);
                assert!(
                    before.is_none(),
                    "{name} is declared in {} and {module}",
                    before.unwrap_or_default()
                );
            }
            for line in text.lines().filter(|line| line.starts_with("import ")) {
                let is_plain = line.ends_with(';') && line.contains("from \"./") && !line.contains(" as ");
                assert!(is_plain, "{module}: {line}");
                let from = line.split("\"./").nth(1).unwrap().trim_end_matches("\";");
                let is_before =
                    MODULES.iter().take_while(|other| *other != module).any(|other| *other == from);
                assert!(is_before, "{module} uses {from}, which comes after it");
            }
        }
        let modules =
            routes::PAGE.files().filter(|f| f.path().extension().is_some_and(|end| end == "js")).count();
        assert_eq!(modules, MODULES.len() + 2, "a module is missing in MODULES (besides app.js and uPlot)");
    }

    #[test]
    fn a_joined_module_has_no_imports_and_exports() {
        let text = "import { a } from \"./a.js\";\nexport function b() {\n  return a;\n}\n";
        assert_eq!(joined(text), "function b() {\n  return a;\n}\n");
    }
}
