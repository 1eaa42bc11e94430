//! Problems in a scenario or an assignment: position, key, value found, values allowed.

use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use annotate_snippets::{AnnotationKind, Level, Renderer, Snippet};
use microsig_core::shown;

/// Source text of values: a file or a command-line assignment.
#[derive(Debug, PartialEq, Eq)]
pub struct Source {
    /// Name used in messages: the path of a file, or an assignment `path=value`.
    pub name: String,
    /// The text.
    pub text: String,
    /// Byte offset of the value: 0 in a file, after the `=` of an assignment.
    pub value_at: usize,
    /// Whether it is a file, so that messages give line and column.
    pub is_file: bool,
}

impl Source {
    /// The text of a file.
    pub fn file(name: &str, text: &str) -> Self {
        Source { name: name.to_owned(), text: text.to_owned(), value_at: 0, is_file: true }
    }

    /// An assignment `path=value`.
    pub fn assignment(path: &str, value: &str) -> Self {
        let text = format!("{path}={value}");
        Source { name: text.clone(), text, value_at: path.len() + 1, is_file: false }
    }
}

/// A range of bytes in a source text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// The source text.
    pub source: Arc<Source>,
    /// Byte range.
    pub span: Range<usize>,
}

impl Place {
    /// The text of the span.
    pub fn text(&self) -> &str {
        &self.source.text[self.span.clone()]
    }

    /// Line and column (in characters), both from 1.
    pub fn line_and_column(&self) -> (usize, usize) {
        let before = &self.source.text[..self.span.start];
        let line_start = before.rfind('\n').map_or(0, |i| i + 1);
        (before.matches('\n').count() + 1, before[line_start..].chars().count() + 1)
    }
}

/// A problem in an input.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// Path of the key; empty for the whole text.
    pub path: Box<str>,
    /// The kind of problem.
    pub fault: Fault,
    /// A suggestion, such as the key that was probably meant.
    pub hint: Option<Box<str>>,
    /// Position in the source text, if known.
    pub place: Option<Place>,
}

/// Kinds of problems with a key or its value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Fault {
    /// The value has the wrong type or is out of range.
    Value {
        /// As written.
        found: String,
        /// Type, range and unit.
        allowed: String,
    },
    /// The key does not exist.
    UnknownKey,
    /// The variant does not exist.
    UnknownVariant {
        /// As written.
        found: String,
        /// The existing variants.
        allowed: String,
    },
    /// A key of this section is required.
    Missing(String),
    /// Anything else, as a sentence.
    Other(String),
}

impl Problem {
    fn new(path: &str, fault: Fault) -> Self {
        Problem { path: path.into(), fault, hint: None, place: None }
    }

    /// A value of the wrong type or out of range.
    pub fn value(path: &str, found: impl fmt::Display, allowed: &str) -> Self {
        Problem::new(path, Fault::Value { found: shown(found), allowed: allowed.to_owned() })
    }

    /// A key that does not exist.
    pub fn unknown_key(path: &str) -> Self {
        Problem::new(path, Fault::UnknownKey)
    }

    /// A variant that does not exist.
    pub fn unknown_variant(path: &str, found: &str, allowed: String) -> Self {
        Problem::new(path, Fault::UnknownVariant { found: found.to_owned(), allowed })
    }

    /// A required key that is missing from the section at `path`.
    pub fn missing(path: &str, key: &str) -> Self {
        Problem::new(path, Fault::Missing(key.to_owned()))
    }

    /// Anything else.
    pub fn other(path: &str, message: impl Into<String>) -> Self {
        Problem::new(path, Fault::Other(message.into()))
    }

    /// Adds the position.
    #[must_use]
    pub fn at(mut self, place: &Place) -> Self {
        self.place = Some(place.clone());
        self
    }

    /// Adds a hint.
    #[must_use]
    pub fn hinted(mut self, hint: Option<String>) -> Self {
        self.hint = hint.map(String::into_boxed_str);
        self
    }

    /// Whether the problem is an unknown key.
    pub fn is_of_keys(&self) -> bool {
        matches!(self.fault, Fault::UnknownKey)
    }

    /// The message without the position.
    pub fn message(&self) -> String {
        let Problem { path, fault, .. } = self;
        let in_path = |text: &str| if path.is_empty() { text.to_owned() } else { format!("{path}: {text}") };
        let text = match fault {
            Fault::Value { found, allowed } if path.is_empty() => format!("{found}: expected {allowed}"),
            Fault::Value { found, allowed } => format!("{path} = {found}: expected {allowed}"),
            Fault::UnknownKey => format!("unknown key `{path}`"),
            Fault::UnknownVariant { found, allowed } => {
                in_path(&format!("unknown variant `{found}`: expected {allowed}"))
            }
            Fault::Missing(key) => in_path(&format!("`{key}` is missing")),
            Fault::Other(text) => in_path(text),
        };
        match (&self.hint, fault) {
            // The hint precedes the list of variants, which may be long.
            (Some(hint), Fault::UnknownVariant { found, allowed }) => {
                in_path(&format!("unknown variant `{found}`: {hint} expected {allowed}"))
            }
            (Some(hint), _) => format!("{text}; {hint}"),
            (None, _) => text,
        }
    }

    /// The message, followed by the line of the file with carets below the faulty text.
    pub fn rendered(&self) -> String {
        let title = self.to_string();
        let Some(place) = self.place.as_ref().filter(|place| place.source.is_file) else { return title };
        // Only the first line of a multi-line value is shown.
        let end = place.text().find('\n').map_or(place.span.end, |end| place.span.start + end);
        let snippet = Snippet::source(place.source.text.as_str())
            .annotation(AnnotationKind::Primary.span(place.span.start..end));
        let report = [Level::ERROR.no_name().primary_title(title.as_str()).element(snippet)];
        Renderer::plain().render(&report)
    }
}

/// The message on one line, preceded by file, line and column.
impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let message = self.message();
        let Some(place) = &self.place else { return f.write_str(&message) };
        let Source { name, is_file, .. } = place.source.as_ref();
        if *is_file {
            let (line, column) = place.line_and_column();
            return write!(f, "{name}:{line}:{column}: {message}");
        }
        // An assignment already shows path and value.
        let is_own = name.strip_prefix(&*self.path).is_some_and(|rest| rest.starts_with('='));
        let prefixes = [format!("{} = {}: ", self.path, place.text()), format!("{}: ", self.path)];
        let rest =
            prefixes.iter().filter(|_| is_own).find_map(|prefix| message.strip_prefix(prefix.as_str()));
        write!(f, "{name}: {}", rest.unwrap_or(&message))
    }
}
