//! Messages that name options in the words of each interface: `--gate-xy` for the command, `gate_xy_px` in
//! Python.

use std::fmt::{self, Display};

/// A message, or an option that is part of one; displayed with the options of the command.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Advice {
    command: String,
    /// With the arguments of Python.
    pub python: String,
}

/// An option by its key, with a unit if it has one.
pub fn option(key: &str) -> Advice {
    Advice { command: option_of(key), python: key.to_owned() }
}

/// A flag that is set.
pub fn flag(key: &str) -> Advice {
    Advice { command: option_of(key), python: format!("{key}=True") }
}

/// The option of the command for a key: `--gate-xy` for `gate_xy_px`. The command states units in its help.
pub fn option_of(key: &str) -> String {
    let units = ["_um", "_px", "_s"].into_iter().filter(|_| !key.contains("_per_"));
    let stem = units.filter_map(|unit| key.strip_suffix(unit)).next().unwrap_or(key);
    format!("--{}", stem.replace('_', "-"))
}

impl Advice {
    /// A message that differs between the interfaces.
    pub fn new(command: &str, python: &str) -> Self {
        Advice { command: command.to_owned(), python: python.to_owned() }
    }

    /// A message of several parts.
    pub fn joined(parts: impl IntoIterator<Item = Advice>) -> Self {
        let (command, python) = parts.into_iter().map(|part| (part.command, part.python)).unzip();
        Advice { command, python }
    }

    /// The option with one of its variants: `--y up`, `y="up"`.
    #[must_use]
    pub fn is(self, variant: &str) -> Self {
        Advice::joined([self, Advice::new(&format!(" {variant}"), &format!("=\"{variant}\""))])
    }

    /// The option with a number or path: `--dims 2`, `dims = 2`.
    #[must_use]
    pub fn of(self, value: impl Display) -> Self {
        Advice::joined([self, Advice::new(&format!(" {value}"), &format!(" = {value}"))])
    }
}

impl From<&str> for Advice {
    fn from(text: &str) -> Self {
        Advice::new(text, text)
    }
}

impl From<String> for Advice {
    fn from(text: String) -> Self {
        Advice::new(&text, &text)
    }
}

impl Display for Advice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.command)
    }
}

/// A message from texts and options.
#[macro_export]
macro_rules! advice {
    ($($part:expr),+ $(,)?) => { $crate::advice::Advice::joined([$($crate::advice::Advice::from($part)),+]) };
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
            assert_eq!(message.python, format!("see {python}"));
        }
    }
}
