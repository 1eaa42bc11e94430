//! Values of scenarios without a schema, for programs that only show them.

use std::sync::Arc;

use microsig_core::problem::Source;
use serde::{Serialize, Serializer};

use super::text::{self, Content, Node};

/// A value as written in a scenario. It serializes as a number, a flag, none, a text (also a word without
/// quotes, and text that is not a value), a sequence, or a map; a variant is a map of one key.
#[derive(Debug, Clone)]
pub struct Literal(Result<Node, String>);

impl Literal {
    /// Reads the value of a text.
    pub fn of(text: &str) -> Self {
        Literal(text::parse(&Arc::new(Source::file("", text))).map_err(|_| text.to_owned()))
    }
}

impl Serialize for Literal {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        match &self.0 {
            Ok(node) => node.serialize(to),
            Err(text) => to.serialize_str(text),
        }
    }
}

impl Serialize for Node {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        match &self.unwrapped().content {
            Content::Word(word) => match word.as_str() {
                "None" | "null" => to.serialize_none(),
                "true" | "false" => to.serialize_bool(word == "true"),
                word => {
                    if let Ok(whole) = ron::from_str::<i64>(word) {
                        to.serialize_i64(whole)
                    } else if let Ok(whole) = ron::from_str::<u64>(word) {
                        to.serialize_u64(whole)
                    } else if let Ok(real) = ron::from_str::<f64>(word) {
                        to.serialize_f64(real)
                    } else {
                        to.serialize_str(word)
                    }
                }
            },
            Content::Text(text) => to.serialize_str(text),
            Content::Variant(name, inner) => to.collect_map([(name, inner)]),
            Content::Fields(fields) => to.collect_map(fields.iter().map(|field| (&field.key, &field.value))),
            Content::Items(items) => to.collect_seq(items),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_those_of_the_text() {
        for (text, expected) in [
            ("0.5", "0.5"),
            ("1_000", "1000"),
            ("0x10", "16"),
            ("None", "null"),
            ("Some(true)", "true"),
            ("(1, 2.0)", "[1,2.0]"),
            ("\"a b\"", "\"a b\""),
            ("open", "\"open\""),
            ("uniform(low: 1, high: [2])", "{\"uniform\":{\"low\":1,\"high\":[2]}}"),
            ("a b", "\"a b\""),
        ] {
            assert_eq!(serde_json::to_string(&Literal::of(text)).unwrap(), expected, "{text}");
        }
    }
}
