//! Problems as they are printed: with the line of the file.

use std::ops::Range;

use annotate_snippets::{AnnotationKind, Level, Renderer, Snippet};
use microsig_core::problem::{Place, Problem};

/// The message of a problem, followed by the line of the file with carets below the faulty text.
pub(crate) fn rendered(problem: &Problem) -> String {
    let title = problem.to_string();
    let Some(place) = problem.place.as_ref().filter(|place| place.source.is_file) else { return title };
    let (line, span) = excerpt(place);
    // Only the line: given all text, the renderer would scan it for every problem.
    let snippet = Snippet::source(line.as_str())
        .line_start(place.line_and_column().0)
        .annotation(AnnotationKind::Primary.span(span));
    let report = [Level::ERROR.no_name().primary_title(title.as_str()).element(snippet)];
    Renderer::plain().render(&report)
}

/// Number of characters of a long line that are shown before and after the start of the faulty text.
const SHOWN_BEFORE: usize = 42;
const SHOWN_FROM: usize = 80;

/// The part of the line around the start of the place, with an ellipsis where the line is cut, and the
/// position of the place in it. For a place that spans several lines, the first line.
fn excerpt(place: &Place) -> (String, Range<usize>) {
    let (text, Range { start, end }) = (&place.source.text, place.span.clone());
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

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use microsig_core::problem::Source;

    use super::*;

    #[test]
    fn a_long_line_is_shown_around_the_problem() {
        let text = format!("(\n{}bad: µ1{}\n)", "a: 1, ".repeat(100_000), ", b: 2".repeat(100_000));
        let start = text.find("bad").unwrap();
        let source = Arc::new(Source::file("s.ron", &text));
        let place = Place { source, span: start..start + "bad: µ1".len() };
        let shown = rendered(&Problem::other("bad", "is wrong").at(&place));
        let lines: Vec<&str> = shown.lines().collect();
        assert_eq!(lines[0], "s.ron:2:600001: bad: is wrong");
        assert_eq!(
            lines[2],
            format!("2 | ... {}bad: µ1{} ...", "a: 1, ".repeat(7), &", b: 2".repeat(16)[..73])
        );
        assert_eq!(lines[3].trim_end(), format!("  |     {}^^^^^^^", " ".repeat(42)));
        // A value that extends beyond the line, or beyond the part of the line that is shown.
        let whole = Place { span: 0..text.len(), ..place.clone() };
        assert!(rendered(&Problem::other("", "a").at(&whole)).ends_with("1 | (\n  | ^"));
        let long = Place { span: start..text.len(), ..place };
        assert_eq!(rendered(&Problem::other("", "a").at(&long)).matches('^').count(), SHOWN_FROM);
    }
}
