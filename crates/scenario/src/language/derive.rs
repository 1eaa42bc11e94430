//! The JSON Schema of the language, derived from the structs of `spec`.
//!
//! A key is defined only by a field of a struct: its doc comment is the description, `serde` gives the
//! default, `schemars` the range (`range(min = .., max = ..)`, `exclusiveMinimum`), and `example` a value for a key without
//! default or for the content of a variant. Extensions:
//!
//! - `x-unit`: the unit, if the key's name does not end with it;
//! - `x-condition`: what is required besides the range, in words;
//! - `x-default`: description of a default that depends on other keys;
//! - `x-formerly`: former names of the key, which are still read;
//! - `x-infinite`: `inf` is allowed, and `null` in JSON;
//! - `x-quoted`: a choice that is written in quotes.

use schemars::JsonSchema;
use schemars::generate::SchemaSettings;
use serde_json::Value;

/// The JSON Schema of a type, completed: units from key names, bounds of lists at their items, no additional
/// keys.
pub fn schema_of<T: JsonSchema>() -> Value {
    let schema = SchemaSettings::draft2020_12().into_generator().into_root_schema_for::<T>();
    let mut root = schema.to_value();
    complete(&mut root);
    root
}

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

const BOUNDS: [&str; 4] = ["minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum"];

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
