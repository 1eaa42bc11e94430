//! The JSON Schema of the language, derived from the structs of `spec`.
//!
//! A key is defined only by a field of a struct: its doc comment is the description, `serde` gives the
//! default, `schemars` the range (`range(min = .., max = ..)`), and `example` a value for a key without
//! default or for the content of a variant. Extensions:
//!
//! - `x-unit`: the unit, if the key's name does not end with it;
//! - `x-range`: the range in words (`> 0 and <= 1e9`), from which bounds are derived;
//! - `x-default`: description of a default that depends on other keys;
//! - `x-formerly`: former names of the key, which are still read;
//! - `x-infinite`: `inf` is allowed, and `null` in JSON;
//! - `x-quoted`: a choice that is written in quotes.

use schemars::JsonSchema;
use schemars::generate::SchemaSettings;
use serde_json::{Map, Value};

/// The JSON Schema of a type, completed: units from key names, bounds from ranges in words, no additional
/// keys.
pub fn schema_of<T: JsonSchema>() -> Value {
    let schema = SchemaSettings::draft2020_12().into_generator().into_root_schema_for::<T>();
    let mut root = schema.to_value();
    complete(&mut root);
    root
}

/// Completes a schema and all schemas in it.
fn complete(schema: &mut Value) {
    let Some(schema) = schema.as_object_mut() else {
        if let Some(items) = schema.as_array_mut() {
            items.iter_mut().for_each(complete);
        }
        return;
    };
    if let Some(properties) = schema.get_mut("properties").and_then(Value::as_object_mut) {
        for (name, key) in properties {
            let Some(key) = key.as_object_mut() else { continue };
            if let Some(unit) = unit_of(name).filter(|_| !key.contains_key("x-unit")) {
                key.insert("x-unit".to_owned(), unit.into());
            }
        }
        schema.insert("additionalProperties".to_owned(), false.into());
    }
    if let Some(words) = schema.get("x-range").and_then(Value::as_str) {
        let bounds = bounds(words);
        schema.extend(bounds);
    }
    // Bounds of a tuple or list apply to its elements.
    for bound in BOUNDS {
        let is_list = ["prefixItems", "items"].iter().any(|items| schema.contains_key(*items));
        let Some(value) = is_list.then(|| schema.remove(bound)).flatten() else { continue };
        let items = schema.get_mut("prefixItems").and_then(Value::as_array_mut);
        for item in items.into_iter().flatten().filter_map(Value::as_object_mut) {
            item.insert(bound.to_owned(), value.clone());
        }
        let items = schema.get_mut("items").and_then(Value::as_object_mut);
        items.into_iter().for_each(|item| drop(item.insert(bound.to_owned(), value.clone())));
    }
    schema.values_mut().for_each(complete);
}

const BOUNDS: [&str; 5] = ["minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum", "enum"];

/// The bounds in words such as `a number > 0 and < 1 (...)`, `0 to 0.5`, `1 or more, ...`, `2 or 3`; of lists, `each > 0`.
fn bounds(words: &str) -> Map<String, Value> {
    let words = words.strip_prefix("each ").unwrap_or(words);
    let words = words.split(['(', ';']).next().unwrap_or_default();
    let words = words.replace(" and ", ",");
    let mut bounds = Map::new();
    for clause in words.split(',') {
        let tokens: Vec<&str> = clause.split_whitespace().collect();
        let value = |i: usize| tokens.get(i).and_then(|token| serde_json::from_str::<Value>(token).ok());
        let mut add = |name: &str, i| {
            drop(value(i).filter(Value::is_number).map(|v| bounds.insert(name.to_owned(), v)))
        };
        match tokens[..] {
            // Beside an alternative such as "or negative", a range is no bound.
            ["or", ..] => return Map::new(),
            [">", _] => add("exclusiveMinimum", 1),
            [">=", _] => add("minimum", 1),
            ["<", _] => add("exclusiveMaximum", 1),
            ["<=", _] => add("maximum", 1),
            [_, "to", _] => {
                add("minimum", 0);
                add("maximum", 2);
            }
            [_, "or", "more"] => add("minimum", 0),
            [_, "or", _] => {
                let choices: Vec<Value> = [value(0), value(2)].into_iter().flatten().collect();
                if choices.len() == 2 && choices.iter().all(Value::is_number) {
                    bounds.insert("enum".to_owned(), choices.into());
                }
            }
            _ => {}
        }
    }
    bounds
}

/// The unit given by the end of a key's name.
fn unit_of(name: &str) -> Option<&'static str> {
    const SUFFIXES: &[(&str, &str)] = &[
        ("_counts_per_e", "counts/e"),
        ("_um2_s3", "um\u{b2}/s\u{b3}"),
        ("_um2_s", "um\u{b2}/s"),
        ("_um3_s", "um\u{b3}/s"),
        ("_um_s2", "um/s\u{b2}"),
        ("_um_s", "um/s"),
        ("_rad_um", "rad/um"),
        ("_per_um3", "1/um\u{b3}"),
        ("_per_um", "1/um"),
        ("_um", "um"),
        ("_nm", "nm"),
        ("_px", "px"),
        ("_rad_s", "rad/s"),
        ("_rad", "rad"),
        ("_pa_s", "Pa s"),
        ("_kg_m3", "kg/m\u{b3}"),
        ("_j_m3", "J/m\u{b3}"),
        ("_per_s", "1/s"),
        ("_hz", "Hz"),
        ("_counts", "counts"),
        ("_e", "e"),
        ("_k", "K"),
        ("_s", "s"),
    ];
    // N_S is a fraction, not in seconds.
    let name = if name == "n_s" { "" } else { name };
    SUFFIXES.iter().find(|(suffix, _)| name.ends_with(suffix) || name == &suffix[1..]).map(|(_, unit)| *unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_are_read_from_words() {
        let of = |words| serde_json::to_string(&bounds(words)).unwrap();
        for (words, expected) in [
            ("> 0", r#"{"exclusiveMinimum":0}"#),
            (">= 0, 0 or several wavelengths", r#"{"minimum":0}"#),
            ("> 0; unless given, half the depth range", r#"{"exclusiveMinimum":0}"#),
            ("0 to 0.5", r#"{"minimum":0,"maximum":0.5}"#),
            ("1 or more, 2 pi half_waves depth / width at most 600", r#"{"minimum":1}"#),
            ("2 or 3", r#"{"enum":[2,3]}"#),
            ("0.01 to 1e7, or negative", "{}"),
            ("> 1.05 radius_um", "{}"),
            ("finite, floor below ceiling", "{}"),
            ("x, y or z", "{}"),
            ("> 0 and < 1 (a note)", r#"{"exclusiveMinimum":0,"exclusiveMaximum":1}"#),
            ("> 0; < 1, or with an option more", r#"{"exclusiveMinimum":0}"#),
            ("1 to 32768", r#"{"minimum":1,"maximum":32768}"#),
        ] {
            assert_eq!(of(words), expected, "{words}");
        }
    }

    #[test]
    fn units_follow_from_names() {
        for (name, unit) in [
            ("dt_s", Some("s")),
            ("n_s", None),
            ("speed_um_s", Some("um/s")),
            ("ramp_per_um", Some("1/um")),
            ("dark_e", Some("e")),
            ("gain_counts_per_e", Some("counts/e")),
            ("e_p", None),
            ("number", None),
        ] {
            assert_eq!(unit_of(name), unit, "{name}");
        }
    }
}
