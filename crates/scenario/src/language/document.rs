//! `docs/scenario.md`: every key with unit, default, range and meaning, and pictures of the effect of single
//! keys.

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
    ///
    /// # Errors
    /// A list that cannot be parsed.
    pub fn list(text: &str) -> Result<Vec<Picture>, ron::error::SpannedError> {
        ron::from_str(text)
    }
}

/// Path of the velocity fields.
const FIELD: &str = "motion.flow.field.";

/// The document. `values` is a scenario with all defaults filled in.
pub(crate) fn document(schema: Schema<'_>, values: &Value, header: &str, pictures: &[Picture]) -> String {
    let mut text = header.to_owned();
    let keys = schema.keys();
    let table = "| key | unit | default | range | meaning |\n|---|---|---|---|---|\n";
    let mut is_open = false;
    for top in schema.below() {
        let own = |path: &str| path.split('.').next() == Some(top.name) && !path.starts_with(FIELD);
        // Keys without subkeys share the first table.
        let is_section = keys.iter().filter(|(path, _)| own(path)).count() > 1;
        if is_section || !is_open {
            let (title, about) = match is_section {
                true => (format!("`{}`", top.name), top.meaning()),
                false => ("The scenario itself".to_owned(), "Name, license and seed.".to_owned()),
            };
            text += &format!("\n## {title}\n\n{about}\n\n{table}");
            is_open = true;
        }
        for (path, entry) in keys.iter().filter(|(path, _)| own(path)) {
            text += &row(path, path, entry, values, schema);
        }
        for picture in pictures.iter().filter(|picture| own(&picture.key)) {
            let Picture { key, caption, .. } = picture;
            text += &format!("\n`{key}`: {caption}\n\n![{key}](scenario/{})\n", picture.file());
        }
    }
    text += &format!(
        "\n## Velocity fields\n\nThe values of `motion.flow.field`. The [gallery](flows/README.md) shows a plot of each field; \
         `microsig flows NAME` prints its parameters.\n\n{table}"
    );
    for (path, entry) in &keys {
        let Some(name) = path.strip_prefix(FIELD) else { continue };
        if name.contains('.') || !entry.is_variant {
            let key = name.split_once('.').map_or(name, |(_, key)| key);
            text += &row(path, key, entry, values, schema);
        } else {
            text +=
                &format!("| **[{name}](flows/README.md#{name})** | | | | `{}` |\n", cell(&entry.meaning()));
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
    let is_raw = inner.is_some_and(|schema| schema.range() == "any" || schema.range() == "finite");
    let range = inner.filter(|_| !is_raw).map(|schema| schema.range()).unwrap_or_default();
    let range = range.split("; unless given").next().unwrap_or_default();
    let default = if entry.is_variant { String::new() } else { default(path, entry, values, schema) };
    format!("| {name} | {unit} | {default} | {} | {} |\n", cell(range), cell(&entry.meaning()))
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
        // A field parameter without a default is derived from the depth range, as the text of its range
        // states.
        (None, None) if path.starts_with(FIELD) => {
            let words = inner.range();
            words
                .split_once("unless given, ")
                .map_or_else(|| "\u{2013}".to_owned(), |(_, default)| default.to_owned())
        }
        (None, None) => "\u{2013}".to_owned(),
    }
}

fn cell(text: &str) -> String {
    text.replace('|', "\\|")
}
