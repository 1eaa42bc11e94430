//! JSON files: messages name key, value and expectation, in words that do not depend on the program's types.

use serde::de::DeserializeOwned;
use serde_json::Value;
use serde_path_to_error::Segment;

/// Reads a value. Errors: the problem: line and column of a text that is not JSON, or the path of a key with
/// its value.
pub fn parse<T: DeserializeOwned>(text: &str) -> Result<T, String> {
    // The tree is built for messages only: for a large manifest, it takes several times the memory of the
    // text.
    let error = match serde_json::from_str(text) {
        Ok(value) => return Ok(value),
        Err(error) => error,
    };
    if let Ok(value) = serde_json::from_str::<Value>(text)
        && let Err(error) = serde_path_to_error::deserialize::<_, T>(&value)
    {
        return Err(mistyped(&value, &error));
    }
    Err(error.to_string())
}

/// Message for a value of the wrong type in a tree: path, value and what is expected.
pub fn mistyped(whole: &Value, error: &serde_path_to_error::Error<serde_json::Error>) -> String {
    let mut value = Some(whole);
    for segment in error.path() {
        value = value.and_then(|v| match segment {
            Segment::Seq { index } => v.get(index),
            Segment::Map { key } => v.get(key),
            _ => None,
        });
    }
    let (path, reason) = (error.path().to_string(), error.inner().to_string());
    let within = |text: &str| if path == "." { text.to_owned() } else { format!("{path}: {text}") };
    match (value, reason.rsplit_once(", expected ")) {
        (Some(value), Some((before, expected))) if before.starts_with("invalid") => {
            let shown = value.to_string();
            let shown = match shown.char_indices().nth(60) {
                Some((end, _)) => format!("{} ...", &shown[..end]),
                None => shown,
            };
            let expected = in_words(expected);
            if path == "." {
                format!("{shown}: expected {expected}")
            } else {
                format!("{path} = {shown}: expected {expected}")
            }
        }
        _ => within(&reason.replace("missing field", "no key").replace("unknown field", "unknown key")),
    }
}

/// The JSON name of a type of the program.
fn in_words(expected: &str) -> &str {
    match expected {
        _ if expected.starts_with("struct ") || expected == "a map" => "an object, {...}",
        "a sequence" => "a list, [...]",
        "u8" | "u16" | "u32" | "u64" | "usize" => "a whole number >= 0",
        "i8" | "i16" | "i32" | "i64" => "a whole number",
        "f32" | "f64" => "a number",
        "a string" | "str" => "a text",
        "a boolean" => "true or false",
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Debug, Deserialize)]
    struct Inner {
        #[expect(dead_code, reason = "only read")]
        frames: u32,
    }

    #[derive(Debug, Deserialize)]
    struct Outer {
        #[expect(dead_code, reason = "only read")]
        name: String,
        #[expect(dead_code, reason = "only read")]
        inner: Vec<Inner>,
    }

    #[test]
    fn messages_name_keys_and_no_types() {
        let good = r#"{"name": "a", "inner": [{"frames": 3}]}"#;
        parse::<Outer>(good).unwrap();
        for (from, to, expected) in [
            (r#"{"frames": 3}"#, "7", "inner[0] = 7: expected an object, {...}"),
            (r#"[{"frames": 3}]"#, "\"x\"", "inner = \"x\": expected a list, [...]"),
            ("3", "-3", "inner[0].frames = -3: expected a whole number >= 0"),
            (r#""a""#, "null", "name = null: expected a text"),
            (r#""name": "a", "#, "", "no key `name`"),
            (good, "[]", "[]: expected "),
            (good, "3", "3: expected an object, {...}"),
            ("3}", "3", "expected `,` or `}` at line 1 column 37"),
        ] {
            let message = parse::<Outer>(&good.replace(from, to)).unwrap_err();
            assert!(message.contains(expected), "{to}: {message}");
            assert!(!message.contains("struct") && !message.contains("Outer"), "{message}");
        }
    }
}
