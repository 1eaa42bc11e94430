//! Parser of RON and JSON texts to trees of values with their positions.
//!
//! One parser reads both: JSON objects are RON maps, and a variant is `name(content)` in RON, `{"name":
//! content}` in JSON. [`super::read`] interprets the values by the schema.

use std::ops::Range;
use std::sync::Arc;

use microsig_core::problem::{Place, Problem, Problems, Source};

/// Nesting beyond this depth is refused before it can exhaust the stack.
const MAX_DEPTH: usize = 100;

/// A value and its position in a text.
#[derive(Debug, Clone)]
pub(crate) struct Node {
    /// Its range in the text, including brackets.
    pub place: Place,
    /// The value as parsed, not yet interpreted.
    pub content: Content,
}

/// A parsed value, not yet interpreted.
#[derive(Debug, Clone)]
pub(crate) enum Content {
    /// A number, or a word without quotes: `1e-3`, `true`, `open`.
    Word(String),
    /// A string in quotes, decoded.
    Text(String),
    /// `name(content)`; `name(a, b)` holds [`Content::Items`], `name()` empty [`Content::Fields`].
    Variant(String, Box<Node>),
    /// `(key: value)` or `{"key": value}`.
    Fields(Vec<Field>),
    /// `(a, b)` or `[a, b]`.
    Items(Vec<Node>),
}

/// A key and its value.
#[derive(Debug, Clone)]
pub(crate) struct Field {
    /// The key.
    pub key: String,
    /// Position of the key.
    pub place: Place,
    /// Its value.
    pub value: Node,
}

pub(crate) fn parse(source: &Arc<Source>) -> Result<Node, Problem> {
    let mut reader = Reader { source, at: source.value_at };
    reader.skip();
    while reader.rest().starts_with("#!") {
        // An attribute: `#![enable(implicit_some)]`.
        reader.at += reader.rest().find(']').map_or(reader.rest().len(), |end| end + 1);
        reader.skip();
    }
    let node = reader.value(0)?;
    reader.skip();
    match reader.rest() {
        "" => Ok(node),
        _ => Err(reader.fault(reader.at, "expected nothing after the value")),
    }
}

/// The finite number that a text is, as scenarios write it (also `1_000`, `0x10`); `None` for a word, a vector and the like.
pub fn number(text: &str) -> Option<f64> {
    let whole = || ron::from_str::<u64>(text).ok().map(|whole| whole as f64);
    ron::from_str(text).ok().or_else(whole).filter(|number: &f64| number.is_finite())
}

impl Node {
    /// A node without text of its own, reported at `place`.
    pub(crate) fn new(place: &Place, content: Content) -> Self {
        Node { place: place.clone(), content }
    }

    /// The text as written, on one line, truncated after 60 characters.
    pub(crate) fn written(&self) -> String {
        let text = self.place.text().split_whitespace().collect::<Vec<_>>().join(" ");
        match text.char_indices().nth(60) {
            Some((end, _)) => format!("{} ...", &text[..end]),
            None => text,
        }
    }

    /// The node without an optional `Some(...)` around it.
    pub(crate) fn unwrapped(&self) -> &Node {
        match &self.content {
            Content::Variant(name, inner) if name == "Some" => inner.unwrapped(),
            _ => self,
        }
    }

    /// The last number of a tuple or in a variant: 200 of `(258, 0, 200)`, 46 of `count(46)`; `None` for lists and
    /// values with keys.
    pub(crate) fn last_number(&self) -> Option<f64> {
        match &self.content {
            Content::Word(word) => number(word),
            Content::Variant(_, inner) => inner.last_number(),
            Content::Items(items) if !self.place.text().starts_with('[') => items.last()?.last_number(),
            Content::Text(_) | Content::Fields(_) | Content::Items(_) => None,
        }
    }

    /// Gives problems without a place the one of their path.
    pub(crate) fn locate(&self, problems: &mut Problems) {
        for problem in problems.0.iter_mut().filter(|problem| problem.place.is_none()) {
            problem.place = Some(self.find(&problem.path).0);
        }
    }

    /// Position of the value at a path, or of the innermost part of the path that the text contains; and
    /// whether it contains the entire path.
    pub(crate) fn find(&self, path: &str) -> (Place, bool) {
        let (mut node, mut place) = (self.unwrapped(), &self.place);
        for step in path.split('.').filter(|step| !step.is_empty()) {
            let next = match &node.content {
                Content::Variant(name, content) if name == step => Some((content.as_ref(), &node.place)),
                Content::Word(name) | Content::Text(name) if name == step => Some((node, &node.place)),
                Content::Fields(fields) => {
                    fields.iter().find(|f| f.key == step).map(|f| (&f.value, &f.place))
                }
                Content::Items(items) => {
                    step.parse::<usize>().ok().and_then(|i| items.get(i)).map(|item| (item, &item.place))
                }
                _ => None,
            };
            let Some((inner, at)) = next else { return (place.clone(), false) };
            (node, place) = (inner.unwrapped(), at);
        }
        (place.clone(), true)
    }
}

struct Reader<'a> {
    source: &'a Arc<Source>,
    at: usize,
}

impl<'a> Reader<'a> {
    fn rest(&self) -> &'a str {
        &self.source.text[self.at..]
    }

    fn place(&self, span: Range<usize>) -> Place {
        Place { source: self.source.clone(), span }
    }

    fn fault(&self, at: usize, message: &str) -> Problem {
        let end = at + self.source.text[at..].chars().next().map_or(0, char::len_utf8);
        Problem::other("", message).at(&self.place(at..end))
    }

    /// Skips white space and comments.
    fn skip(&mut self) {
        loop {
            let rest = self.rest();
            let trimmed = rest.trim_start();
            self.at += rest.len() - trimmed.len();
            if trimmed.starts_with("//") {
                self.at += trimmed.find('\n').unwrap_or(trimmed.len());
            } else if trimmed.starts_with("/*") {
                self.block_comment();
            } else {
                return;
            }
        }
    }

    /// Skips a block comment; they can be nested.
    fn block_comment(&mut self) {
        let mut depth = 0;
        while !self.rest().is_empty() {
            let rest = self.rest();
            let step = if rest.starts_with("/*") {
                depth += 1;
                2
            } else if rest.starts_with("*/") {
                depth -= 1;
                2
            } else {
                rest.chars().next().map_or(0, char::len_utf8)
            };
            self.at += step;
            if depth == 0 {
                return;
            }
        }
    }

    fn value(&mut self, depth: usize) -> Result<Node, Problem> {
        if depth > MAX_DEPTH {
            let message = format!("expected at most {MAX_DEPTH} nested brackets");
            return Err(self.fault(self.at, &message));
        }
        let start = self.at;
        let content = match self.rest().chars().next() {
            None => return Err(self.fault(start, "expected a value, found the end of the text")),
            Some('(' | '[' | '{') => self.brackets(depth)?,
            Some(_) if self.opens_string() => Content::Text(self.string()?),
            Some(_) => {
                let word = self.word();
                if word.is_empty() {
                    let found: String = self.rest().chars().take(1).collect();
                    return Err(self.fault(start, &format!("expected a value, found `{found}`")));
                }
                let end = self.at;
                self.skip();
                let is_name = word.starts_with(|c: char| c.is_alphabetic() || c == '_');
                if is_name && self.rest().starts_with('(') {
                    let at = self.at;
                    let content = match self.brackets(depth)? {
                        // A variant with a single value contains the value itself.
                        Content::Items(mut items) if items.len() == 1 => items.remove(0),
                        content => Node { place: self.place(at..self.at), content },
                    };
                    Content::Variant(word.to_owned(), Box::new(content))
                } else {
                    self.at = end;
                    Content::Word(word.to_owned())
                }
            }
        };
        Ok(Node { place: self.place(start..self.at), content })
    }

    fn word(&mut self) -> &'a str {
        let rest = self.rest();
        let stops = |c: char| c.is_whitespace() || ",:()[]{}\"'/".contains(c);
        let length = rest.find(stops).unwrap_or(rest.len());
        self.at += length;
        &rest[..length]
    }

    fn brackets(&mut self, depth: usize) -> Result<Content, Problem> {
        let opened = self.at;
        let opening = self.rest().chars().next();
        let closing = match opening {
            Some('(') => ')',
            Some('[') => ']',
            _ => '}',
        };
        self.at += 1;
        let (mut fields, mut items) = (Vec::new(), Vec::new());
        loop {
            self.skip();
            if self.rest().starts_with(closing) {
                self.at += 1;
                let are_items = opening == Some('[') || !items.is_empty();
                return Ok(if are_items { Content::Items(items) } else { Content::Fields(fields) });
            }
            if self.rest().is_empty() {
                return Err(self.fault(opened, &format!("expected a `{closing}` that closes this bracket")));
            }
            let first = self.value(depth + 1)?;
            self.skip();
            if self.rest().starts_with(':') {
                let (Content::Word(key) | Content::Text(key)) = first.content else {
                    return Err(self.fault(self.at, "expected a key before the colon"));
                };
                if !items.is_empty() {
                    return Err(self
                        .fault(first.place.span.start, "expected a value without a key, like those before"));
                }
                self.at += 1;
                self.skip();
                fields.push(Field { key, place: first.place, value: self.value(depth + 1)? });
            } else if !fields.is_empty() || closing == '}' {
                return Err(self.fault(self.at, "expected a colon and a value after the key"));
            } else {
                items.push(first);
            }
            self.skip();
            if self.rest().starts_with(',') {
                self.at += 1;
            } else if !self.rest().is_empty() && !self.rest().starts_with(closing) {
                return Err(self.fault(self.at, "expected a comma or the closing bracket"));
            }
        }
    }

    /// Whether a string begins here: `"`, `r"`, `r#"`.
    fn opens_string(&self) -> bool {
        let rest = self.rest();
        let is_raw = |rest: &str| rest.trim_start_matches('#').starts_with('"');
        rest.starts_with('"') || rest.strip_prefix('r').is_some_and(is_raw)
    }

    fn string(&mut self) -> Result<String, Problem> {
        let (start, rest) = (self.at, self.rest());
        let unclosed = || self.fault(start, "expected a quote that closes this string");
        if let Some(raw) = rest.strip_prefix('r') {
            let hashes = raw.len() - raw.trim_start_matches('#').len();
            let body = &raw[hashes + 1..];
            let end = format!("\"{}", "#".repeat(hashes));
            let length = body.find(&end).ok_or_else(unclosed)?;
            self.at += 1 + hashes + 1 + length + end.len();
            return Ok(body[..length].to_owned());
        }
        let length = 1 + quoted(&rest[1..]).ok_or_else(unclosed)?;
        self.at += length;
        // RON and JSON differ in escape sequences.
        let literal = &rest[..length];
        ron::from_str(literal).or_else(|e| {
            serde_json::from_str(literal).map_err(|_| self.fault(start, &format!("string: {}", e.code)))
        })
    }
}

/// Length up to and including the closing quote; escaped quotes do not count.
fn quoted(text: &str) -> Option<usize> {
    let mut escaped = false;
    for (i, c) in text.char_indices() {
        if c == '"' && !escaped {
            return Some(i + 1);
        }
        escaped = c == '\\' && !escaped;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r##"#![enable(implicit_some)]
// A comment with a ( bracket.
(
    name: "a, (b)\" c", /* and /* nested */ ) one */
    raw: r#"x"y)"#,
    motion: flow(field: sum([poiseuille(speed: 3), hill()])),
    number: count(4),
    pair: Some((-80, 2e1)),
    bodies: [sphere(radius_um: 5)],
    json: {"count": [1, 2], "text": "\u00b5"},
)"##;

    fn tree(text: &str) -> Result<Node, Problem> {
        parse(&Arc::new(Source::file("s.ron", text)))
    }

    #[test]
    fn numbers_are_those_of_scenarios() {
        assert_eq!(["1_000", "0x10", "-2.5e-1"].map(number), [Some(1000.0), Some(16.0), Some(-0.25)]);
        assert_eq!(["inf", "(1, 2)", "setting1", "x10", ""].map(number), [None; 5]);
    }

    #[test]
    fn the_last_number_of_a_value_is_found() {
        let of = |value| parse(&Arc::new(Source::assignment("key", value))).unwrap().last_number();
        for (value, number) in [
            ("0.5", Some(0.5)),
            ("(258, 0, 200)", Some(200.0)),
            ("count(46)", Some(46.0)),
            ("[1, 2]", None),
            ("(a: 1)", None),
            ("\"2\"", None),
            ("off", None),
        ] {
            assert_eq!(of(value), number, "{value}");
        }
    }

    #[test]
    fn positions_are_found_past_comments_and_strings() {
        let root = tree(TEXT).unwrap();
        let place = |path: &str| {
            let (place, is_written) = root.find(path);
            (place.line_and_column(), is_written)
        };
        assert_eq!(place("name"), ((4, 5), true));
        assert_eq!(place("motion.flow.field.sum.0.poiseuille.speed"), ((6, 41), true));
        assert_eq!(place("motion.flow.field.sum.1"), ((6, 52), true));
        assert_eq!(place("pair.1"), ((8, 22), true));
        assert_eq!(place("bodies.0.sphere.radius_um"), ((9, 21), true));
        // A missing value has the position of its innermost existing parent.
        assert_eq!(place("number.count.more"), ((7, 13), false));
        let Content::Fields(fields) = &root.content else { panic!() };
        let texts: Vec<&str> = fields
            .iter()
            .filter_map(
                |f| if let Content::Text(text) = &f.value.content { Some(text.as_str()) } else { None },
            )
            .collect();
        assert_eq!(texts, ["a, (b)\" c", "x\"y)"]);
    }

    #[test]
    fn syntax_errors_have_a_position() {
        for (text, expected) in [
            ("", "1:1: expected a value"),
            ("(", "1:1: expected a `)`"),
            ("(a: 1,\n b: [1, 2)", "2:10: expected a comma or the closing bracket"),
            ("(a: )", "1:5: expected a value, found `)`"),
            ("(a: \"x)", "1:5: expected a quote"),
            ("(a: 1))", "1:7: expected nothing after the value"),
            ("(a: r#\"x\")", "1:5: expected a quote"),
            ("(a 1)", "1:4: expected a comma"),
            ("(a: 1, 2)", "1:9: expected a colon"),
            ("{1}", "1:3: expected a colon"),
            ("'", "1:1: expected a value, found `'`"),
            ("(a: 1 /* 1)", "1:1: expected a `)`"),
        ] {
            let problem = tree(text).unwrap_err().to_string();
            assert!(problem.starts_with(&format!("s.ron:{expected}")), "{text}: {problem}");
        }
        assert!(tree(&"(".repeat(100_000)).unwrap_err().to_string().contains("at most 100 nested brackets"));
    }
}
