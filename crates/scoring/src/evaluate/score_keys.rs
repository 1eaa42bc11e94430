//! Definitions and ranges of the keys of `score.json`, derived from the JSON Schema of its types.

use std::fmt::Write;

use schemars::generate::SchemaSettings;
use serde_json::Value;

use super::score::Score;

/// The JSON Schema of `score.json`, with all subschemas inlined.
fn score_schema() -> Value {
    let settings = SchemaSettings::draft2020_12().with(|s| s.inline_subschemas = true);
    settings.into_generator().into_root_schema_for::<Score>().to_value()
}

/// A key of `score.json`.
#[derive(Debug, Clone, PartialEq)]
pub struct ScoreKey {
    /// Dotted path; `[]` denotes every item of a list, `*` every name in a map.
    pub path: String,
    /// Definition, with formula and reference.
    pub meaning: String,
    /// Smallest and largest allowed value.
    pub range: (Option<f64>, Option<f64>),
    /// Whether it is a number that is not always whole, or a list of such numbers.
    pub is_float: bool,
}

impl ScoreKey {
    /// The unit; empty for numbers without.
    pub fn unit(&self) -> &'static str {
        unit(&self.path)
    }
}

/// All keys, in the order of the file.
pub fn score_keys() -> Vec<ScoreKey> {
    let mut keys = Vec::new();
    collect("", &score_schema(), &mut keys);
    keys
}

/// The text of docs/score_keys.md, with a section for each group of keys.
pub fn markdown() -> String {
    let mut text = "# Keys of `score.json`\n\n\
        Formula, unit and range of every key. The changelog names keys that are renamed; files of earlier versions \
        remain readable. Undefined scores are null. [Scoring](scoring.md) explains how they are computed.\n\n\
        This page is generated: `UPDATE_DOCS=1 cargo test -p suite scoring_keys`.\n"
        .to_owned();
    let keys = score_keys();
    let group = |key: &ScoreKey| key.path.split(['.', '[']).next().unwrap_or_default().to_owned();
    let mut groups: Vec<String> = keys.iter().map(group).collect();
    groups.dedup();
    let (single, several): (Vec<_>, Vec<_>) =
        groups.into_iter().partition(|name| keys.iter().filter(|key| group(key) == *name).count() == 1);
    let of = |names: &[String]| keys.iter().filter(|key| names.contains(&group(key))).collect::<Vec<_>>();
    table(&mut text, "General", &of(&single));
    for name in several {
        table(&mut text, &format!("`{name}`"), &of(&[name]));
    }
    text
}

/// Appends a section with a table.
fn table(text: &mut String, title: &str, keys: &[&ScoreKey]) {
    *text += &format!("\n## {title}\n\n| key | definition | unit | range |\n|---|---|---|---|\n");
    for key in keys {
        let range = match key.range {
            (None, None) => String::new(),
            (Some(low), Some(high)) => format!("{low} to {high}"),
            (Some(low), None) => format!(">= {low}"),
            (None, Some(high)) => format!("<= {high}"),
        };
        let (path, meaning) = (&key.path, key.meaning.replace('|', "\\|"));
        // Writing to a string cannot fail.
        let _ = writeln!(text, "| `{path}` | {meaning} | {} | {range} |", key.unit());
    }
}

/// The unit: the first of these endings that the key has.
fn unit(path: &str) -> &'static str {
    const UNITS: [(&str, &str); 26] = [
        ("isbi.rmse", "px"),
        ("isbi_2d.rmse", "px"),
        ("interval.rmse", "px"),
        ("_distance", "px"),
        ("motp", "px"),
        ("uncertainty.z.bins[].claimed_rms", "um"),
        ("uncertainty.z.bins[].error_rms", "um"),
        ("bins[].claimed_rms", "px"),
        ("bins[].error_rms", "px"),
        ("over_height[].from", "um"),
        ("over_height[].to", "um"),
        ("over_radius[].from", "px"),
        ("over_radius[].to", "px"),
        // Differences of displacements, px, over distances, px.
        ("vorticity_rms", "px/px"),
        ("divergence_rms", "px/px"),
        ("strain_rms", "px/px"),
        ("_um_s2", "um/s^2"),
        ("_um_s", "um/s"),
        ("_per_100px", "px per 100 px"),
        ("acceleration_rms_px", "px/frame^2"),
        ("_px3", "px^3"),
        ("_px", "px"),
        ("_um", "um"),
        ("_deg", "degree"),
        ("_px[]", "px"),
        ("_px_now", "px"),
    ];
    UNITS.iter().find(|(end, _)| path.ends_with(end)).map_or("", |(_, unit)| unit)
}

/// Collects the keys of a schema below a path. Keys under `field.truths` repeat those under `field` and are
/// skipped.
fn collect(path: &str, schema: &Value, keys: &mut Vec<ScoreKey>) {
    let node = Node::of(schema);
    for (name, below) in node.properties() {
        let path = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
        let of = Node::of(below);
        keys.push(ScoreKey {
            path: path.clone(),
            meaning: of.meaning(),
            range: of.range(),
            is_float: of.is_float(),
        });
        if path != "field.truths" {
            collect(&path, below, keys);
        }
    }
    if let Some(items) = node.items() {
        collect(&format!("{path}[]"), items, keys);
    }
}

/// Values of a score outside the ranges of their keys, as `path = value: expected ...`.
pub fn beyond_ranges(score: &Value) -> Vec<String> {
    let mut problems = Vec::new();
    check("", score, &score_schema(), &mut problems);
    problems
}

fn check(path: &str, value: &Value, schema: &Value, problems: &mut Vec<String>) {
    let node = Node::of(schema);
    match value {
        Value::Number(number) => {
            let (low, high) = node.range();
            let v = number.as_f64().unwrap_or(f64::NAN);
            if !(low.is_none_or(|low| v >= low) && high.is_none_or(|high| v <= high)) {
                let range = match high {
                    Some(high) => format!("from {} to {high}", low.unwrap_or(f64::NEG_INFINITY)),
                    None => format!("a number >= {}", low.unwrap_or(f64::NEG_INFINITY)),
                };
                problems.push(format!("{path} = {value}: expected {range}, or null"));
            }
        }
        Value::Object(parts) => {
            for (name, part) in parts {
                let path = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
                if let Some(below) = node.property(name) {
                    check(&path, part, below, problems);
                }
            }
        }
        Value::Array(parts) => {
            let Some(items) = node.items() else { return };
            // Intervals are the only pairs of numbers in a score.
            if node.is_pair()
                && let [low, high] = parts.as_slice()
                && low.as_f64().zip(high.as_f64()).is_none_or(|(low, high)| low > high)
            {
                problems.push(format!("{path} = {value}: expected [low, high], or null"));
            }
            for (i, part) in parts.iter().enumerate() {
                check(&format!("{path}[{i}]"), part, items, problems);
            }
        }
        _ => {}
    }
}

/// A node of a schema; nullable values are wrapped in `anyOf`.
struct Node<'a> {
    own: &'a Value,
    inner: &'a Value,
}

impl<'a> Node<'a> {
    fn of(schema: &'a Value) -> Self {
        let choices = schema.get("anyOf").and_then(Value::as_array).into_iter().flatten();
        let mut known = choices.filter(|s| s.get("type").and_then(Value::as_str) != Some("null"));
        Node { own: schema, inner: known.next().unwrap_or(schema) }
    }

    fn properties(&self) -> impl Iterator<Item = (&'a String, &'a Value)> + use<'a> {
        self.inner.get("properties").and_then(Value::as_object).into_iter().flatten()
    }

    fn property(&self, name: &str) -> Option<&'a Value> {
        let named = self.inner.get("properties").and_then(|p| p.get(name));
        named.or_else(|| self.inner.get("additionalProperties").filter(|s| s.is_object()))
    }

    fn items(&self) -> Option<&'a Value> {
        self.inner.get("items").filter(|s| s.is_object())
    }

    fn is_pair(&self) -> bool {
        self.inner.get("maxItems").and_then(Value::as_u64) == Some(2)
    }

    fn is_float(&self) -> bool {
        let is = |schema: &Value| match schema.get("type") {
            Some(Value::Array(types)) => types.iter().any(|of| of == "number"),
            of => of.is_some_and(|of| of == "number"),
        };
        is(self.inner) || self.items().is_some_and(is)
    }

    fn meaning(&self) -> String {
        let text = |schema: &Value| {
            schema.get("description").and_then(Value::as_str).unwrap_or_default().replace('\n', " ")
        };
        let own = text(self.own);
        if own.is_empty() { text(self.inner) } else { own }
    }

    fn range(&self) -> (Option<f64>, Option<f64>) {
        let end = |key: &str| self.inner.get(key).and_then(Value::as_f64);
        let of_items = |key: &str| self.items().and_then(|s| s.get(key)).and_then(Value::as_f64);
        match (end("minimum"), end("maximum")) {
            (None, None) => (of_items("minimum"), of_items("maximum")),
            range => range,
        }
    }
}
