//! Messages that name options: data until an interface prints them, each in its own words.

use std::borrow::Cow;
use std::fmt::{self, Display};

/// An option that a message names, by its key: `gate_xy_px`, with a unit if it has one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Named {
    key: Cow<'static, str>,
    value: Value,
}

/// The value that a message gives to an option.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Value {
    None,
    /// That of a flag.
    Set,
    /// The name of a variant.
    Word(String),
    Other(String),
}

/// An option by its key.
pub const fn option(key: &'static str) -> Named {
    Named { key: Cow::Borrowed(key), value: Value::None }
}

/// A flag that is set.
pub const fn flag(key: &'static str) -> Named {
    Named { key: Cow::Borrowed(key), value: Value::Set }
}

impl Named {
    /// An option of the command without units by its name: `gate` for `--gate`.
    pub fn from_command(name: &str) -> Self {
        Named { key: Cow::Owned(name.replace('-', "_")), value: Value::None }
    }

    /// The option with one of its variants.
    #[must_use]
    pub fn is(self, variant: &str) -> Self {
        Named { value: Value::Word(variant.to_owned()), ..self }
    }

    /// The option with a number or path.
    #[must_use]
    pub fn of(self, value: impl Display) -> Self {
        Named { value: Value::Other(value.to_string()), ..self }
    }

    /// The argument of a function in Python: `y="up"`, `dims = 2`.
    pub fn argument(&self) -> String {
        match &self.value {
            Value::None => self.key.to_string(),
            Value::Set => format!("{}=True", self.key),
            Value::Word(word) => format!("{}=\"{word}\"", self.key),
            Value::Other(value) => format!("{} = {value}", self.key),
        }
    }
}

/// The option of the command: `--y up`.
impl Display for Named {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&option_of(&self.key))?;
        match &self.value {
            Value::None | Value::Set => Ok(()),
            Value::Word(value) | Value::Other(value) => write!(f, " {value}"),
        }
    }
}

/// The option of the command for a key: `--gate-xy` for `gate_xy_px`. The command states units in its help.
pub fn option_of(key: &str) -> String {
    let units = ["_um", "_px", "_s"].into_iter().filter(|_| !key.contains("_per_"));
    let stem = units.filter_map(|unit| key.strip_suffix(unit)).next().unwrap_or(key);
    format!("--{}", stem.replace('_', "-"))
}

/// A part of a message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Part {
    /// Words.
    Text(String),
    /// The name of an option.
    Option(Named),
}

impl From<Named> for Part {
    fn from(option: Named) -> Self {
        Part::Option(option)
    }
}

impl From<&str> for Part {
    fn from(text: &str) -> Self {
        Part::Text(text.to_owned())
    }
}

impl From<String> for Part {
    fn from(text: String) -> Self {
        Part::Text(text)
    }
}

/// A message; displayed with the options of the command.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Advice(pub Vec<Part>);

impl Advice {
    /// The message with the arguments of Python.
    pub fn in_python(&self) -> String {
        let said = |part: &Part| match part {
            Part::Text(text) => text.clone(),
            Part::Option(option) => option.argument(),
        };
        self.0.iter().map(said).collect()
    }
}

impl Display for Advice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|part| match part {
            Part::Text(text) => f.write_str(text),
            Part::Option(option) => option.fmt(f),
        })
    }
}

/// A message from texts and options.
#[macro_export]
macro_rules! advice {
    ($($part:expr),+ $(,)?) => { $crate::advice::Advice(vec![$($crate::advice::Part::from($part)),+]) };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_interface_has_its_own_words_for_options() {
        for (named, command, python) in [
            (option("gate_xy_px"), "--gate-xy", "gate_xy_px"),
            (option("um_per_px"), "--um-per-px", "um_per_px"),
            (flag("force"), "--force", "force=True"),
            (option("y").is("up"), "--y up", "y=\"up\""),
            (option("dims").of(2), "--dims 2", "dims = 2"),
        ] {
            let message = advice!("see ", named);
            assert_eq!(message.to_string(), format!("see {command}"));
            assert_eq!(message.in_python(), format!("see {python}"));
        }
    }
}
