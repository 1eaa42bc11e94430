//! Problems in a scenario or an assignment: position, key, value found, values allowed.

use std::borrow::Cow;
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

    /// The part of the line around the start of the place, with an ellipsis where the line is cut, and the
    /// position of the place in it. For a place that spans several lines, the first line.
    fn excerpt(&self) -> (String, Range<usize>) {
        let (text, Range { start, end }) = (&self.source.text, self.span.clone());
        let line_start = text[..start].rfind('\n').map_or(0, |i| i + 1);
        let line_end = text[start..].find('\n').map_or(text.len(), |i| start + i);
        let line_end = if text[..line_end].ends_with('\r') { (line_end - 1).max(start) } else { line_end };
        let is_long = text[line_start..line_end].char_indices().nth(SHOWN_BEFORE + SHOWN_FROM).is_some();
        if !is_long {
            let moved = |at: usize| at.min(line_end) - line_start;
            return (text[line_start..line_end].to_owned(), moved(start)..moved(end.max(start)));
        }
        let from = text[line_start..start].char_indices().rev().nth(SHOWN_BEFORE - 1);
        let from = from.map_or(line_start, |(i, _)| line_start + i);
        let to = text[start..line_end].char_indices().nth(SHOWN_FROM);
        let to = to.map_or(line_end, |(i, _)| start + i);
        let before = if from > line_start { "... " } else { "" };
        let after = if to < line_end { " ..." } else { "" };
        let moved = |at: usize| at.min(to) - from + before.len();
        (format!("{before}{}{after}", &text[from..to]), moved(start)..moved(end.max(start)))
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
            Fault::UnknownVariant { found, allowed } => {
                // The hint precedes the list of variants, which may be long.
                let hint = self.hint.as_ref().map_or(String::new(), |hint| format!("{hint} "));
                return in_path(&format!("unknown variant `{}`: {hint}expected {allowed}", clipped(found)));
            }
            Fault::Missing(key) => in_path(&format!("`{key}` is missing")),
            Fault::Other(text) => in_path(text),
        };
        match &self.hint {
            Some(hint) => format!("{text}; {hint}"),
            None => text,
        }
    }

    /// The message, followed by the line of the file with carets below the faulty text.
    pub fn rendered(&self) -> String {
        let title = self.to_string();
        let Some(place) = self.place.as_ref().filter(|place| place.source.is_file) else { return title };
        let (line, span) = place.excerpt();
        // Only the line: given all text, the renderer would scan it for every problem.
        let snippet = Snippet::source(line.as_str())
            .line_start(place.line_and_column().0)
            .annotation(AnnotationKind::Primary.span(span));
        let report = [Level::ERROR.no_name().primary_title(title.as_str()).element(snippet)];
        Renderer::plain().render(&report)
    }
}

/// Number of characters of a long line that are shown before and after the start of the faulty text.
const SHOWN_BEFORE: usize = 42;
const SHOWN_FROM: usize = 80;

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_line_is_shown_around_the_problem() {
        let text = format!("(\n{}bad: µ1{}\n)", "a: 1, ".repeat(100_000), ", b: 2".repeat(100_000));
        let start = text.find("bad").unwrap();
        let source = Arc::new(Source::file("s.ron", &text));
        let place = Place { source, span: start..start + "bad: µ1".len() };
        let shown = Problem::other("bad", "is wrong").at(&place).rendered();
        let lines: Vec<&str> = shown.lines().collect();
        assert_eq!(lines[0], "s.ron:2:600001: bad: is wrong");
        assert_eq!(
            lines[2],
            format!("2 | ... {}bad: µ1{} ...", "a: 1, ".repeat(7), &", b: 2".repeat(16)[..73])
        );
        assert_eq!(lines[3].trim_end(), format!("  |     {}^^^^^^^", " ".repeat(42)));
        // A value that extends beyond the line, or beyond the part of the line that is shown.
        let whole = Place { span: 0..text.len(), ..place.clone() };
        assert!(Problem::other("", "a").at(&whole).rendered().ends_with("1 | (\n  | ^"));
        let long = Place { span: start..text.len(), ..place };
        assert_eq!(Problem::other("", "a").at(&long).rendered().matches('^').count(), SHOWN_FROM);
    }

    #[test]
    fn long_names_are_cut() {
        let message = Problem::unknown_key(&"k".repeat(10_000)).message();
        assert_eq!(message, format!("unknown key `{} ...`", "k".repeat(200)));
    }
}
