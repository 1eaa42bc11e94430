//! Information on a key for the editor: meaning, range, default and subkeys.

use std::sync::LazyLock;

use serde_json::{Value, json};

use scenario::spec::Spec;
use scenario::{Entry, Schema, ValueKind, ron, schema_of};

/// Maximum number of steps in a path, because fields can be nested without limit.
const DEEPEST: usize = 60;

/// A key or variant with its subkeys; `None` if the path does not exist. The empty path is the scenario
/// itself.
pub(super) fn at(path: &str) -> Option<Value> {
    static LANGUAGE: LazyLock<Value> = LazyLock::new(schema_of::<Spec>);
    let root = Schema::root(&LANGUAGE);
    if path.is_empty() {
        return Some(json!({ "path": "", "below": below(root) }));
    }
    if path.split('.').count() > DEEPEST {
        return None;
    }
    let entry = root.find(path)?;
    let mut value = described(&entry);
    value["path"] = json!(path);
    value["below"] = entry.schema.map_or_else(|| json!([]), below);
    Some(value)
}

fn below(schema: Schema<'_>) -> Value {
    let required: Vec<&str> = schema.required().collect();
    let described = schema.children().into_iter().map(|entry| {
        let mut value = described(&entry);
        value["is_required"] = json!(required.contains(&entry.name));
        value
    });
    Value::Array(described.collect())
}

fn described(entry: &Entry<'_>) -> Value {
    let schema = entry.schema;
    let default = schema.and_then(|schema| schema.attribute("default").map(|value| ron(value, schema)));
    let example =
        schema.and_then(|schema| schema.attribute("examples").and_then(|all| Some(ron(all.get(0)?, schema))));
    let default = default.filter(|text| text != "None");
    json!({
        "name": entry.name,
        "is_variant": entry.is_variant,
        "kind": schema.map_or("", kind),
        "meaning": entry.meaning(),
        "unit": schema.and_then(|schema| schema.words("x-unit")),
        "range": schema.map(|schema| schema.range()).filter(|range| !range.is_empty()),
        "default": schema.and_then(|schema| schema.words("x-default").map(str::to_owned)).or(default.clone()),
        "insert": insert(entry, default.or(example)),
    })
}

fn kind(schema: Schema<'_>) -> &'static str {
    match schema.kind() {
        ValueKind::Section => "section",
        ValueKind::Choice => "choice",
        ValueKind::List(_) => "list",
        ValueKind::Tuple(_) => "tuple",
        ValueKind::Number => "number",
        ValueKind::Whole => "whole number",
        ValueKind::Flag => "true or false",
        ValueKind::Text => "text",
        ValueKind::Raw => "value",
    }
}

/// Text that completion inserts; `|` marks the position of the cursor.
fn insert(entry: &Entry<'_>, value: Option<String>) -> String {
    let kind = entry.schema.map(|schema| schema.kind());
    let (name, short) = (entry.name, value.filter(|text| text.len() <= 40));
    if entry.is_variant {
        return match kind {
            None => name.to_owned(),
            Some(_) => {
                format!("{name}({}|)", short.filter(|text| !text.starts_with('(')).unwrap_or_default())
            }
        };
    }
    match (kind, short) {
        (Some(ValueKind::Section), _) => format!("{name}: (|)"),
        (_, Some(value)) => format!("{name}: {value}|"),
        (Some(ValueKind::List(_)), _) => format!("{name}: [|]"),
        (Some(ValueKind::Tuple(_)), _) => format!("{name}: (|)"),
        (Some(ValueKind::Text), _) => format!("{name}: \"|\""),
        _ => format!("{name}: |"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_have_unit_range_and_meaning() {
        let gain = at("optics.gain").unwrap();
        assert_eq!((gain["kind"].as_str(), gain["range"].as_str()), (Some("number"), Some("0 to 1e6")));
        assert!(!gain["meaning"].as_str().unwrap().is_empty());
        let names = |path: &str| -> Vec<String> {
            let below = at(path).unwrap()["below"].as_array().unwrap().clone();
            below.iter().map(|entry| entry["name"].as_str().unwrap().to_owned()).collect()
        };
        assert!(names("").contains(&"motion".to_owned()) && names("motion").contains(&"flow".to_owned()));
        assert!(names("motion.flow.field.sum.0.sum.1").contains(&"poiseuille".to_owned()));
        assert!(at("optics.gian").is_none() && at(&"motion.flow.field.sum.".repeat(30)).is_none());
    }
}
