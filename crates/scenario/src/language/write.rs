//! Values and whole scenarios as RON.

use ron::extensions::Extensions;
use serde::Serialize;
use serde_json::Value;

use super::schema::{Schema, ValueKind};
use storage::error::{Error, Result};

/// RON options: `Some` and the inner brackets of a variant are omitted.
fn options() -> ron::Options {
    ron::Options::default().with_default_extension(
        Extensions::IMPLICIT_SOME | Extensions::UNWRAP_VARIANT_NEWTYPES | Extensions::UNWRAP_NEWTYPES,
    )
}

/// Writes a scenario; reading it back gives the same scenario.
pub fn write(spec: &impl Serialize) -> Result<String> {
    let pretty = ron::ser::PrettyConfig::new().struct_names(false).new_line("\n");
    let text =
        options().to_string_pretty(spec, pretty).map_err(|e| Error::input(format!("scenario: {e}")))?;
    Ok(text + "\n")
}

/// Part of a scenario on one line.
pub fn compact(part: &impl Serialize) -> Result<String> {
    options().to_string(part).map_err(|e| Error::input(format!("scenario: {e}")))
}

/// A JSON value as RON; the schema tells variants, tuples and lists apart.
pub fn ron(value: &Value, schema: Schema<'_>) -> String {
    let join = |items: Vec<String>| items.join(", ");
    match (schema.kind(), value) {
        (_, Value::Null) if schema.attribute("x-infinite").is_some() => "inf".to_owned(),
        (_, Value::Null) => "None".to_owned(),
        (ValueKind::Choice, Value::String(name)) => name.clone(),
        (ValueKind::Choice, Value::Object(one)) => one.iter().fold(String::new(), |_, (name, content)| {
            let inner = schema.child(name).and_then(|entry| entry.schema);
            let content = inner.map_or_else(String::new, |inner| ron(content, inner));
            if content.starts_with('(') { format!("{name}{content}") } else { format!("{name}({content})") }
        }),
        (ValueKind::Section, Value::Object(fields)) => {
            let field = |(key, value): (&String, &Value)| {
                let inner = schema.child(key)?.schema?;
                (!value.is_null() || inner.attribute("x-infinite").is_some())
                    .then(|| format!("{key}: {}", ron(value, inner)))
            };
            format!("({})", join(fields.iter().filter_map(field).collect()))
        }
        (ValueKind::Tuple(types), Value::Array(items)) => {
            format!("({})", join(items.iter().zip(types).map(|(item, schema)| ron(item, schema)).collect()))
        }
        (ValueKind::List(inner), Value::Array(items)) => {
            format!("[{}]", join(items.iter().map(|item| ron(item, inner)).collect()))
        }
        (ValueKind::Raw, Value::String(text)) => text.clone(),
        (_, value) => value.to_string(),
    }
}
