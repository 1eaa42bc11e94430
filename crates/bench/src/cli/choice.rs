//! Options whose values are the variants of an enum; names and descriptions come from its schema.

use std::ffi::OsStr;
use std::marker::PhantomData;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Arg, Command};
use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use serde_json::Value;

/// Parser of the variants of an enum without fields, under the names that they have in files.
#[derive(Debug, Clone)]
pub(crate) struct Choice<T>(PhantomData<T>);

/// See [`Choice`].
pub(crate) fn choice<T>() -> Choice<T> {
    Choice(PhantomData)
}

impl<T> Choice<T>
where
    T: JsonSchema,
{
    // Not cached: most runs never use a schema.
    fn variants() -> Vec<PossibleValue> {
        let schema = schemars::schema_for!(T);
        let variants = schema.get("oneOf").and_then(Value::as_array).into_iter().flatten();
        let named = variants.filter_map(|variant| {
            let meaning = variant.get("description").and_then(Value::as_str).unwrap_or_default();
            Some(
                PossibleValue::new(variant.get("const")?.as_str()?.to_owned())
                    .help(meaning.trim_end_matches('.').replace('\n', " ")),
            )
        });
        named.collect()
    }
}

/// Enums whose variants have names and descriptions.
pub trait Variants: JsonSchema + DeserializeOwned {}

impl<T: JsonSchema + DeserializeOwned> Variants for T {}

/// All variants.
pub fn variants<T: Variants>() -> Vec<T> {
    let named =
        |value: PossibleValue| serde_json::from_value(Value::String(value.get_name().to_owned())).ok();
    Choice::<T>::variants().into_iter().filter_map(named).collect()
}

/// The variant of this name.
pub fn variant<T: Variants>(name: &str) -> Result<T, String> {
    serde_json::from_value(Value::String(name.to_owned())).map_err(|_| {
        let variants = Choice::<T>::variants();
        let names: Vec<&str> = variants.iter().map(PossibleValue::get_name).collect();
        format!("expected one of {}", names.join(", "))
    })
}

impl<T> TypedValueParser for Choice<T>
where
    T: JsonSchema + DeserializeOwned + Clone + Send + Sync + 'static,
{
    type Value = T;

    fn parse_ref(&self, command: &Command, arg: Option<&Arg>, value: &OsStr) -> Result<T, clap::Error> {
        PossibleValuesParser::new(Self::variants())
            .try_map(|name| serde_json::from_value(Value::String(name)))
            .parse_ref(command, arg, value)
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(Self::variants().into_iter()))
    }
}

#[cfg(test)]
mod tests {
    use microsig_core::render::waves::Lens;

    use super::*;

    #[test]
    fn options_have_the_names_and_meanings_of_keys() {
        let parser = choice::<Lens>();
        let values: Vec<_> = parser.possible_values().into_iter().flatten().collect();
        let names: Vec<&str> = values.iter().map(PossibleValue::get_name).collect();
        assert_eq!(names, ["microsig", "aplanatic"]);
        assert!(values[1].get_help().is_some_and(|help| help.to_string().contains("sine condition")));
        let parsed = parser.parse_ref(&clap::Command::new("x"), None, "aplanatic".as_ref());
        assert_eq!(parsed.ok(), Some(Lens::Aplanatic));
    }
}
