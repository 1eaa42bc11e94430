//! `docs/scenario.md` and a page for each section below `docs/scenario/`: every key with unit, default, range
//! and meaning, and pictures of the effect of single keys.

use serde::Deserialize;
use serde_json::Value;

use super::schema::{Entry, Schema};
use super::write::ron;

/// A row of images of the same scene with different values of a key.
#[derive(Debug, Clone, Deserialize)]
pub struct Picture {
    /// The key.
    pub key: String,
    /// The imaged scene.
    pub scene: Scene,
    /// Assignments (`path=value`, separated by `;`) of each image, from left to right.
    pub images: Vec<String>,
    /// Caption with the values.
    pub caption: String,
}

/// The imaged scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Scene {
    /// Three particles at z = -70, -25 and +15 um side by side.
    Ladder,
    /// Particles throughout the default channel.
    Channel,
    /// Many small particles slightly below focus.
    Dense,
    /// Particles in one plane slightly below focus, in fast flow.
    Fast,
    /// The dense scene in the second frame of a pair, 0.1 s after the first.
    Later,
}

impl Picture {
    /// File name of the picture.
    pub fn file(&self) -> String {
        format!("{}.png", self.key.replace('.', "_"))
    }

    /// Reads the list of pictures in `docs/scenario/pictures.ron`.
    pub fn list(text: &str) -> Result<Vec<Picture>, ron::error::SpannedError> {
        ron::from_str(text)
    }
}

/// Path of the velocity fields.
const FIELD: &str = "motion.flow.field.";

/// A page of the reference.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Page {
    /// Its file below `docs/`.
    pub file: String,
    /// The text.
    pub text: String,
}

const TABLE: &str = "| key | unit | default | range | meaning |\n|---|---|---|---|---|\n";

/// The pages, the one with the list of sections first. `values` is a scenario with all defaults filled in.
pub(crate) fn document(schema: Schema<'_>, values: &Value, header: &str, pictures: &[Picture]) -> Vec<Page> {
    let keys = schema.keys();
    let (mut sections, mut single, mut pages) = (String::new(), String::new(), Vec::new());
    for top in schema.children() {
        let own = |path: &str| path.split('.').next() == Some(top.name) && !path.starts_with(FIELD);
        let rows: Vec<String> = keys
            .iter()
            .filter(|(path, _)| own(path))
            .map(|(path, entry)| row(path, path, entry, values, schema))
            .collect();
        // Keys without subkeys are on the first page.
        if rows.len() == 1 {
            single += &rows.concat();
            continue;
        }
        let (name, about) = (top.name, top.meaning());
        sections += &format!("- [`{name}`](scenario/{name}.md): {about}\n");
        let mut text = format!("# `{name}`\n\n{about} {NOTATION}\n\n{TABLE}{}", rows.concat());
        for picture in pictures.iter().filter(|picture| own(&picture.key)) {
            let Picture { key, caption, .. } = picture;
            text += &format!("\n`{key}`: {caption}\n\n![{key}]({})\n", picture.file());
        }
        pages.push(Page { file: format!("scenario/{name}.md"), text });
    }
    sections += "- [`motion.flow.field`](scenario/fields.md): Velocity fields and their parameters.\n";
    pages.push(Page { file: "scenario/fields.md".to_owned(), text: fields(schema, values) });
    let text = format!("{header}\n## Sections\n\n{sections}\n## Keys without a section\n\n{TABLE}{single}");
    pages.insert(0, Page { file: "scenario.md".to_owned(), text });
    pages
}

/// What a reader of a single page must know.
const NOTATION: &str = "Notation and pictures are explained [here](../scenario.md).";

/// The page of velocity fields.
fn fields(schema: Schema<'_>, values: &Value) -> String {
    let mut text = format!(
        "# Velocity fields\n\nThe values of `motion.flow.field`. The [gallery](../flows/README.md) shows a plot of each field; \
         `microsig flows NAME` prints its parameters. {NOTATION}\n\n{TABLE}"
    );
    for (path, entry) in &schema.keys() {
        let Some(name) = path.strip_prefix(FIELD) else { continue };
        if name.contains('.') || !entry.is_variant {
            let key = name.split_once('.').map_or(name, |(_, key)| key);
            text += &row(path, key, entry, values, schema);
        } else {
            text += &format!(
                "| **[{name}](../flows/README.md#{name})** | | | | `{}` |\n",
                cell(&entry.meaning())
            );
        }
    }
    text
}

fn row(path: &str, shown: &str, entry: &Entry<'_>, values: &Value, schema: Schema<'_>) -> String {
    let name = match shown.rsplit_once('.') {
        Some((parent, last)) if entry.is_variant => format!("`{parent}.`*`{last}`*"),
        _ => format!("`{shown}`"),
    };
    let inner = entry.schema;
    let unit = inner.and_then(|schema| schema.words("x-unit")).unwrap_or_default();
    let range = inner.map(|schema| schema.range()).unwrap_or_default();
    let default = if entry.is_variant { String::new() } else { default(path, entry, values, schema) };
    format!("| {name} | {unit} | {default} | {} | {} |\n", cell(&range), cell(&entry.meaning()))
}

/// The default of a key as a cell.
fn default(path: &str, entry: &Entry<'_>, values: &Value, schema: Schema<'_>) -> String {
    let Some(inner) = entry.schema else { return String::new() };
    let (parent, name) = path.rsplit_once('.').unwrap_or(("", path));
    let section = if parent.is_empty() { Some(schema) } else { schema.find(parent).and_then(|e| e.schema) };
    if section.is_some_and(|section| section.required().any(|key| key == name)) {
        return "*required*".to_owned();
    }
    let given = path.split('.').try_fold(values, |value, step| value.get(step));
    let value = given.or(entry.attribute("default")).filter(|value| !value.is_null());
    let written =
        value.map(|value| ron(value, inner)).filter(|text| text.len() <= 40 && !text.contains(": "));
    let written = written.or_else(|| inner.attribute("x-infinite").map(|_| "inf".to_owned()));
    match (entry.words("x-default"), written) {
        (Some(words), _) => cell(words),
        (None, Some(text)) => format!("`{text}`"),
        (None, None) if value.is_some() => String::new(),
        (None, None) => "\u{2013}".to_owned(),
    }
}

fn cell(text: &str) -> String {
    text.replace('|', "\\|")
}
