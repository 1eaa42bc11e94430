//! Parsers of arguments that several verbs share; their messages state which values are allowed.

use std::ffi::OsStr;
use std::marker::PhantomData;
use std::path::PathBuf;

use clap::builder::{PathBufValueParser, PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Arg, Command};
use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::{InputFile, OutputFile};

/// A seed.
pub fn seed(text: &str) -> Result<u64, String> {
    text.parse().map_err(|_| format!("expected an integer from 0 to {}", u64::MAX))
}

/// A file that is read; `-` is standard input.
pub fn input() -> impl TypedValueParser<Value = InputFile> {
    PathBufValueParser::new().map(InputFile::argument)
}

/// A file that is written; `-` is standard output.
pub fn output() -> impl TypedValueParser<Value = OutputFile> {
    PathBufValueParser::new().map(OutputFile::argument)
}

/// A folder to be made: not `-`, which stands for standard output.
pub fn folder() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(|path| {
        if path.as_os_str() == "-" { Err("expected a folder; `./-` is one of this name") } else { Ok(path) }
    })
}

/// A file for a plot. Names without an extension are allowed, as devices and pipes have none.
pub fn plot_file() -> impl TypedValueParser<Value = OutputFile> {
    PathBufValueParser::new().try_map(|path| {
        let is = |known: &str| path.extension().is_none_or(|extension| extension.eq_ignore_ascii_case(known));
        if is("svg") || is("png") {
            Ok(OutputFile::argument(path))
        } else {
            Err("plots are SVG or PNG: expected a name that ends in .svg or .png")
        }
    })
}

/// Parser of the variants of an enum without fields; names and descriptions come from its schema.
#[derive(Debug, Clone)]
pub struct Choice<T>(PhantomData<T>);

/// See [`Choice`].
pub fn choice<T>() -> Choice<T> {
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
    fn plots_have_the_extension_of_their_format() {
        let parse = |name: &str| plot_file().parse_ref(&Command::new("x"), None, name.as_ref());
        for name in ["a.svg", "folder.pdf/A.SVG", "a.png", "/dev/stdout"] {
            assert_eq!(parse(name).ok(), Some(OutputFile::from(name)));
        }
        for name in ["a.jpg", "a.svg.pdf"] {
            let said = parse(name).unwrap_err().to_string();
            assert!(
                said.contains("plots are SVG or PNG: expected a name that ends in .svg or .png"),
                "{said}"
            );
        }
    }

    #[test]
    fn options_have_the_names_and_meanings_of_keys() {
        let parser = choice::<Lens>();
        let values: Vec<_> = parser.possible_values().into_iter().flatten().collect();
        let names: Vec<&str> = values.iter().map(PossibleValue::get_name).collect();
        assert_eq!(names, ["microsig", "aplanatic"]);
        assert!(values[1].get_help().is_some_and(|help| help.to_string().contains("sine condition")));
        let parsed = parser.parse_ref(&Command::new("x"), None, "aplanatic".as_ref());
        assert_eq!(parsed.ok(), Some(Lens::Aplanatic));
    }
}
