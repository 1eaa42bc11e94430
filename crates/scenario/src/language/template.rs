//! The output of `microsig new`: every key of a schema with comments, and its default or an example.

use serde_json::Value;

use super::schema::{Entry, Schema, ValueKind};
use super::write::ron;

/// Width of comment lines, characters.
const WIDTH: usize = 118;

/// Maximum number of variants that are described one by one.
const MAX_VARIANTS: usize = 12;

/// A commented document with every key; `values` is a document with all defaults filled in.
pub(crate) fn template(schema: Schema<'_>, values: &Value, header: &str) -> String {
    let mut text = String::new();
    comment(&mut text, "", "", header);
    text.push_str("(\n");
    section(&mut text, schema, Some(values), 1, false);
    text + ")\n"
}

/// A valid value: an example, the default, or one composed of samples of its parts.
pub(crate) fn sample(schema: Schema<'_>) -> Option<Value> {
    let example = schema.attribute("examples").and_then(|examples| examples.get(0));
    if let Some(value) = example.or(schema.attribute("default").filter(|value| !value.is_null())) {
        return Some(value.clone());
    }
    let number = |name| schema.attribute(name).and_then(Value::as_f64);
    Some(match schema.kind() {
        ValueKind::Section => {
            let required =
                schema.required().map(|key| Some((key.to_owned(), sample(schema.child(key)?.schema?)?)));
            Value::Object(required.collect::<Option<_>>()?)
        }
        ValueKind::Choice => {
            let first = *schema.children().first()?;
            match first.schema {
                None => first.name.into(),
                Some(inner) => Value::Object([(first.name.to_owned(), sample(inner)?)].into_iter().collect()),
            }
        }
        ValueKind::List(_) => Value::Array(Vec::new()),
        ValueKind::Tuple(types) => types.into_iter().map(sample).collect::<Option<Vec<_>>>()?.into(),
        ValueKind::Number => {
            match (number("exclusiveMinimum"), number("maximum").or(number("exclusiveMaximum"))) {
                (Some(low), Some(high)) => 0.5 * (low + high),
                (low, _) => number("minimum").or(low.map(|low| low + 1.0)).unwrap_or(1.0),
            }
            .into()
        }
        ValueKind::Whole => number("minimum").map_or(1, |low| (low as u64).max(1)).into(),
        ValueKind::Flag => false.into(),
        ValueKind::Text => "text".into(),
        ValueKind::Raw => "1".into(),
    })
}

fn section(text: &mut String, schema: Schema<'_>, values: Option<&Value>, depth: usize, is_out: bool) {
    for entry in schema.children() {
        let Some(inner) = entry.schema else { continue };
        let value = values.and_then(|values| values.get(entry.name)).filter(|value| !value.is_null());
        let follows = entry.attribute("x-default").is_some() || inner.is_optional() && depth > 2;
        let is_infinite = inner.attribute("x-infinite").is_some();
        // A default that depends on other keys is commented out: a value that is written down would no longer
        // follow them.
        let out = is_out
            || value.is_none() && !is_infinite
            || follows && (depth > 2 || !matches!(inner.kind(), ValueKind::Choice));
        let written = value.cloned().or_else(|| if is_infinite { Some(Value::Null) } else { sample(inner) });
        let Some(written) = written else { continue };
        let indent = "    ".repeat(depth) + if out { "// " } else { "" };
        about(text, &entry, inner, depth, value.is_some() || is_out);
        let content = |text: &mut String, inner, value: &Value, name: &str| {
            *text += &format!("{indent}{}: {name}(\n", entry.name);
            section(text, inner, Some(value), depth + 1, out);
            *text += &format!("{indent}),\n");
        };
        let variant = written.as_object().and_then(|one| one.iter().next());
        let variant = variant.filter(|_| matches!(inner.kind(), ValueKind::Choice));
        let variant_value = variant.and_then(|(name, value)| Some((name, value, inner.child(name)?.schema?)));
        match (inner.kind(), variant_value) {
            (ValueKind::Section, _) => content(text, inner, &written, ""),
            (_, Some((name, value, schema))) if matches!(schema.kind(), ValueKind::Section) => {
                content(text, schema, value, name);
            }
            _ => *text += &format!("{indent}{}: {},\n", entry.name, ron(&written, inner)),
        }
        if depth == 1 && matches!(inner.kind(), ValueKind::Section) {
            text.push('\n');
        }
    }
}

/// Writes meaning, unit, range and variants of a key as comments.
fn about(text: &mut String, entry: &Entry<'_>, schema: Schema<'_>, depth: usize, is_given: bool) {
    let indent = "    ".repeat(depth) + "// ";
    let (unit, range) = (schema.words("x-unit").unwrap_or_default(), schema.range());
    let default = match entry.words("x-default") {
        Some(words) => format!("default: {words}"),
        None if !is_given && schema.is_optional() => "default: none".to_owned(),
        None => String::new(),
    };
    let is_number = matches!(schema.kind(), ValueKind::Number | ValueKind::Whole | ValueKind::Tuple(_));
    let range = if is_number || entry.words("x-quoted").is_some() { range } else { String::new() };
    let range = if unit.is_empty() || range.is_empty() {
        format!("{range}{unit}")
    } else {
        format!("{unit}, {range}")
    };
    let facts: Vec<String> = [range, default].into_iter().filter(|fact| !fact.is_empty()).collect();
    let facts = if facts.is_empty() { String::new() } else { format!(" [{}]", facts.join("; ")) };
    comment(text, &indent, "", &(entry.meaning() + &facts));
    let variants = if let ValueKind::Choice = schema.kind() { schema.children() } else { Vec::new() };
    if variants.len() > MAX_VARIANTS {
        let names: Vec<&str> = variants.iter().map(|variant| variant.name).collect();
        comment(text, &indent, "  ", &format!("One of {}.", names.join(", ")));
        return;
    }
    for variant in variants {
        comment(text, &indent, "  ", &format!("{}: {}", written(&variant), variant.meaning()));
    }
}

/// A variant with an example of its content, such as `ppp(0.0002)`.
pub(super) fn written(variant: &Entry<'_>) -> String {
    let example = variant.schema.and_then(sample).zip(variant.schema);
    let content = example.map_or_else(String::new, |(value, schema)| ron(&value, schema));
    let content =
        if content.is_empty() || content.starts_with('(') { content } else { format!("({content})") };
    format!("{}{content}", variant.name)
}

/// Writes a text as comment lines with hanging indentation.
fn comment(text: &mut String, indent: &str, hanging: &str, words: &str) {
    let indent = if indent.is_empty() { "// " } else { indent };
    let mut line = format!("{indent}{hanging}");
    let start = line.len();
    for word in words.split_whitespace() {
        if line.len() > start && line.chars().count() + word.chars().count() > WIDTH {
            *text += &format!("{}\n", line.trim_end());
            line = format!("{indent}{hanging}  ");
        }
        line += word;
        line.push(' ');
    }
    *text += &format!("{}\n", line.trim_end());
}
