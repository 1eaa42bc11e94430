//! Parsers of arguments that several verbs share; their messages state which values are allowed.

use std::path::PathBuf;

use clap::builder::{PathBufValueParser, TypedValueParser};
use storage::{InputFile, OutputFile};

/// A seed.
pub(super) fn seed(text: &str) -> Result<u64, String> {
    text.parse().map_err(|_| format!("expected an integer from 0 to {}", u64::MAX))
}

/// A file that is read; `-` is standard input.
pub(super) fn input() -> impl TypedValueParser<Value = InputFile> {
    PathBufValueParser::new().map(InputFile::argument)
}

/// A file that is written; `-` is standard output.
pub(crate) fn output() -> impl TypedValueParser<Value = OutputFile> {
    PathBufValueParser::new().map(OutputFile::argument)
}

/// A folder to be made: not `-`, which stands for standard output.
pub(super) fn folder() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(|path| {
        if path.as_os_str() == "-" { Err("expected a folder; `./-` is one of this name") } else { Ok(path) }
    })
}

/// A file for a plot. Names without an extension are allowed, as devices and pipes have none.
pub(super) fn plot_file() -> impl TypedValueParser<Value = OutputFile> {
    PathBufValueParser::new().try_map(|path| {
        let is = |known: &str| path.extension().is_none_or(|extension| extension.eq_ignore_ascii_case(known));
        if is("svg") || is("png") {
            Ok(OutputFile::argument(path))
        } else {
            Err("plots are SVG or PNG: expected a name that ends in .svg or .png")
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plots_have_the_extension_of_their_format() {
        let parse = |name: &str| plot_file().parse_ref(&clap::Command::new("x"), None, name.as_ref());
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
}
