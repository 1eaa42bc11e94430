//! Problems in an input: position, key, value found, values allowed.

use std::borrow::Cow;
use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use crate::error::shown;

/// Source text of values: a file or a command-line assignment; or an input of which only the name is known.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Source {
    /// Name used in messages: the path of a file, or an assignment `path=value`.
    pub name: String,
    /// The text.
    pub text: String,
    /// Byte offset of the value: 0 in a file; in an assignment, the position after the `=`.
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

    /// A variant that does not exist. The hint precedes the list of variants, which may be long.
    pub fn unknown_variant(path: &str, found: &str, hint: Option<String>, allowed: &str) -> Self {
        let hint = hint.map_or(String::new(), |hint| format!("{hint} "));
        Problem::other(path, format!("unknown variant `{}`: {hint}expected {allowed}", clipped(found)))
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

    /// Adds what has the key, or the name of an input whose text is not kept, with the line if it has lines.
    #[must_use]
    pub fn within(self, name: impl Into<String>) -> Self {
        let source = Arc::new(Source { name: name.into(), ..Source::default() });
        self.at(&Place { source, span: 0..0 })
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
        self.worded(None)
    }

    /// The message. If an assignment to the path has been quoted before it, with this value, they are not
    /// repeated.
    fn worded(&self, quoted: Option<&str>) -> String {
        let Problem { path, fault, .. } = self;
        let path = clipped(path);
        let is_named = !path.is_empty() && quoted.is_none();
        let in_path = |text: &str| if is_named { format!("{path}: {text}") } else { text.to_owned() };
        let text = match fault {
            Fault::Value { found, allowed } if quoted == Some(found) => format!("expected {allowed}"),
            Fault::Value { found, allowed } if path.is_empty() => {
                format!("{}: expected {allowed}", clipped(found))
            }
            Fault::Value { found, allowed } => format!("{path} = {}: expected {allowed}", clipped(found)),
            Fault::UnknownKey => format!("unknown key `{path}`"),
            Fault::Other(text) => in_path(text),
        };
        match &self.hint {
            Some(hint) => format!("{text}; {hint}"),
            None => text,
        }
    }
}

/// Maximum number of characters of a key or value in a message.
const SHOWN_OF_VALUE: usize = 200;

/// The text, with its end replaced by an ellipsis if it is long.
fn clipped(text: &str) -> Cow<'_, str> {
    match text.char_indices().nth(SHOWN_OF_VALUE) {
        Some((end, _)) => format!("{} ...", &text[..end]).into(),
        None => text.into(),
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
        // An assignment `path=value` shows path and value.
        let is_own = place.source.text[..place.source.value_at.saturating_sub(1)] == *self.path;
        write!(f, "{name}: {}", self.worded(is_own.then(|| place.text())))
    }
}

/// Number of problems after which a reader may stop collecting them.
pub const MOST_COLLECTED: usize = 1_000;

/// Collects problems, so that all are reported at once.
#[derive(Debug, Default)]
pub struct Problems(pub Vec<Problem>);

impl Problems {
    /// Adds a problem; those beyond [`MOST_COLLECTED`] are dropped, which bounds the cost of a text with many
    /// problems.
    pub fn push(&mut self, problem: Problem) {
        if !self.is_full() {
            self.0.push(problem);
        }
    }

    /// Adds a value of the wrong type or out of range.
    pub fn value(&mut self, path: &str, found: impl fmt::Display, allowed: &str) {
        self.push(Problem::value(path, found, allowed));
    }

    /// Adds a value unless it is `fine`.
    pub fn unless(&mut self, fine: bool, path: &str, found: impl fmt::Display, allowed: &str) {
        if !fine {
            self.value(path, found, allowed);
        }
    }

    /// Adds anything else.
    pub fn other(&mut self, path: &str, message: impl Into<String>) {
        self.push(Problem::other(path, message));
    }

    /// Whether there are any.
    pub fn any(&self) -> bool {
        !self.0.is_empty()
    }

    /// Whether further problems are dropped.
    pub fn is_full(&self) -> bool {
        self.0.len() >= MOST_COLLECTED
    }

    /// The problems with the name of what has their keys.
    #[must_use]
    pub fn within(self, name: &str) -> Self {
        Problems(self.0.into_iter().map(|problem| problem.within(name)).collect())
    }

    /// The problems of assignments, which may be the cause of others, then the problems of the file in its order.
    pub fn sorted(mut self) -> Vec<Problem> {
        let order = |p: &Problem| p.place.as_ref().map_or((true, 0), |p| (p.source.is_file, p.span.start));
        self.0.sort_by_key(order);
        self.0.dedup();
        self.0
    }

    /// All problems as an error, if there are any.
    pub fn finish<E>(self, error: impl FnOnce(Vec<Problem>) -> E) -> Result<(), E> {
        if self.any() { Err(error(self.sorted())) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_names_are_cut() {
        let message = Problem::unknown_key(&"k".repeat(10_000)).message();
        assert_eq!(message, format!("unknown key `{} ...`", "k".repeat(200)));
    }
}
