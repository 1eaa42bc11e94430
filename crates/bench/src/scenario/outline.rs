//! Where things stand in a RON text: values, keys and variants with their places, whatever they mean.
//!
//! RON's own reader gives values without places, and stops at the first that does not fit. Messages that name the line of
//! every wrong key, and `--set`, which puts a value in the place of another, need the places.

use std::ops::Range;

/// Deeper nesting is no scenario; RON's own reader has a limit too.
const MAX_DEPTH: usize = 100;

/// A value of the text.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Node {
    /// The name before its brackets, or alone: a variant (or `true`, `inf`).
    pub(super) name: Option<String>,
    /// Where it stands, name and brackets included.
    pub(super) span: Range<usize>,
    /// What is in its brackets.
    pub(super) inside: Inside,
}

/// What brackets hold.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Inside {
    /// There are none.
    Nothing,
    /// Values with names, and the text between the brackets.
    Fields(Vec<Field>, Range<usize>),
    /// Values without names, and the text between the brackets.
    Items(Vec<Node>, Range<usize>),
}

/// A value with its name.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Field {
    /// The key.
    pub(super) key: String,
    /// Where the key stands.
    pub(super) at: usize,
    /// Its value.
    pub(super) value: Node,
}

/// The outline of a text; `None` if its brackets do not close. Words that RON would refuse may pass.
pub(super) fn outline(text: &str) -> Option<Node> {
    let mut reader = Reader { text, at: 0 };
    reader.skip();
    while reader.rest().starts_with("#!") {
        // An attribute: `#![enable(implicit_some)]`.
        reader.at += reader.rest().find(']')? + 1;
        reader.skip();
    }
    let node = reader.value(0)?;
    reader.skip();
    reader.rest().is_empty().then_some(node)
}

/// Line and column of a place, both from 1.
pub(super) fn line_and_column(text: &str, at: usize) -> (usize, usize) {
    let before = &text[..at.min(text.len())];
    let line_start = before.rfind('\n').map_or(0, |i| i + 1);
    (before.matches('\n').count() + 1, before[line_start..].chars().count() + 1)
}

impl Node {
    /// The value of a field.
    pub(super) fn field(&self, key: &str) -> Option<&Field> {
        match &self.inside {
            Inside::Fields(fields, _) => fields.iter().find(|f| f.key == key),
            _ => None,
        }
    }

    /// The only value in its brackets, if it has no name: what a variant of one value holds.
    pub(super) fn only_item(&self) -> Option<&Node> {
        match &self.inside {
            Inside::Items(items, _) if items.len() == 1 => items.first(),
            _ => None,
        }
    }

    /// Where the value of a path stands, or as much of the path as is written.
    pub(super) fn find<'p>(&self, path: impl IntoIterator<Item = &'p str>) -> usize {
        self.follow(path).0
    }

    /// The value of a path.
    pub(super) fn value<'p>(&self, path: impl IntoIterator<Item = &'p str>) -> Option<&Node> {
        self.follow(path).1
    }

    fn follow<'p>(&self, path: impl IntoIterator<Item = &'p str>) -> (usize, Option<&Node>) {
        let (mut node, mut at) = (self, self.span.start);
        for step in path {
            if node.name.as_deref() == Some("Some") {
                node = node.only_item().unwrap_or(node);
            }
            if node.name.as_deref() == Some(step) {
                at = node.span.start;
                // `variant((..))` and `variant(other(..))` hold the next step one bracket deeper.
                node = node.only_item().unwrap_or(node);
                continue;
            }
            let item = match &node.inside {
                Inside::Items(items, _) => step.parse::<usize>().ok().and_then(|i| items.get(i)),
                _ => None,
            };
            match (node.field(step), item) {
                (Some(field), _) => (node, at) = (&field.value, field.at),
                (_, Some(item)) => (node, at) = (item, item.span.start),
                _ => return (at, None),
            }
        }
        (at, Some(node))
    }

    /// The innermost field around a place, or only one whose value has brackets.
    pub(super) fn field_around(&self, at: usize, with_brackets: bool) -> Option<&Field> {
        match &self.inside {
            Inside::Nothing => None,
            Inside::Fields(fields, _) => {
                let around = fields.iter().find(|f| (f.at..=f.value.span.end).contains(&at))?;
                let own = Some(around).filter(|f| !with_brackets || f.value.inside != Inside::Nothing);
                around.value.field_around(at, with_brackets).or(own)
            }
            Inside::Items(items, _) => items
                .iter()
                .find(|item| (item.span.start..=item.span.end).contains(&at))?
                .field_around(at, with_brackets),
        }
    }

    /// The path to the innermost value around a place, and that value.
    pub(super) fn around(&self, at: usize) -> (String, &Node) {
        let (mut node, mut steps) = (self, Vec::new());
        loop {
            let next = match &node.inside {
                Inside::Nothing => None,
                Inside::Fields(fields, _) => fields
                    .iter()
                    .find(|f| (f.at..=f.value.span.end).contains(&at))
                    .map(|f| (f.key.clone(), &f.value)),
                Inside::Items(items, _) => items
                    .iter()
                    .position(|item| (item.span.start..=item.span.end).contains(&at))
                    .map(|i| (i.to_string(), &items[i])),
            };
            let Some((step, inner)) = next else { return (steps.join("."), node) };
            steps.extend(node.name.clone().filter(|name| name != "Some"));
            if node.name.is_none() || node.only_item().is_none() {
                steps.push(step);
            }
            node = inner;
        }
    }
}

struct Reader<'a> {
    text: &'a str,
    at: usize,
}

impl<'a> Reader<'a> {
    fn rest(&self) -> &'a str {
        &self.text[self.at..]
    }

    /// Passes white space and comments.
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

    /// Block comments may hold others.
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

    fn eat(&mut self, c: char) -> bool {
        let found = self.rest().starts_with(c);
        self.at += usize::from(found) * c.len_utf8();
        found
    }

    fn identifier(&mut self) -> &'a str {
        let part_of_it = |c: char| c.is_alphanumeric() || c == '_';
        let start = self.at;
        self.at += self.rest().find(|c| !part_of_it(c)).unwrap_or(self.rest().len());
        &self.text[start..self.at]
    }

    fn value(&mut self, depth: usize) -> Option<Node> {
        if depth > MAX_DEPTH {
            return None;
        }
        let start = self.at;
        let node = |name: Option<String>, inside, end| Some(Node { name, span: start..end, inside });
        let rest = self.rest();
        let hashes = rest.len() - rest.trim_start_matches(['b', 'r']).trim_start_matches('#').len();
        if rest.starts_with('"') || (rest.starts_with(['b', 'r']) && rest[hashes..].starts_with('"')) {
            self.string()?;
            return node(None, Inside::Nothing, self.at);
        }
        match rest.chars().next()? {
            '(' | '[' | '{' => {
                let inside = self.brackets(depth)?;
                node(None, inside, self.at)
            }
            '\'' => {
                self.character()?;
                node(None, Inside::Nothing, self.at)
            }
            c if c.is_alphabetic() || c == '_' => {
                let name = self.identifier().to_owned();
                let end = self.at;
                self.skip();
                let inside = match self.rest().starts_with('(') {
                    true => self.brackets(depth)?,
                    false => {
                        self.at = end;
                        Inside::Nothing
                    }
                };
                node(Some(name), inside, self.at)
            }
            _ => {
                // A number, or a word that RON's own reader will refuse.
                let stop = |c: char| c.is_whitespace() || ",:()[]{}\"'/".contains(c);
                self.at += rest.find(stop).unwrap_or(rest.len());
                (self.at > start).then_some(())?;
                node(None, Inside::Nothing, self.at)
            }
        }
    }

    fn brackets(&mut self, depth: usize) -> Option<Inside> {
        let closing = match self.rest().chars().next()? {
            '(' => ')',
            '[' => ']',
            _ => '}',
        };
        self.at += 1;
        let start = self.at;
        let (mut fields, mut items) = (Vec::new(), Vec::new());
        loop {
            self.skip();
            let end = self.at;
            if self.eat(closing) {
                // What has no values may get fields.
                return Some(match items.is_empty() {
                    true => Inside::Fields(fields, start..end),
                    false => Inside::Items(items, start..end),
                });
            }
            let at = self.at;
            let first = self.value(depth + 1)?;
            self.skip();
            if self.eat(':') {
                self.skip();
                let key = first.name.unwrap_or_else(|| self.text[first.span].to_owned());
                fields.push(Field { key, at, value: self.value(depth + 1)? });
            } else {
                items.push(first);
            }
            self.skip();
            if !self.eat(',') && !self.rest().starts_with(closing) {
                return None;
            }
        }
    }

    fn string(&mut self) -> Option<()> {
        let rest = self.rest();
        let prefix = rest.len() - rest.trim_start_matches(['b', 'r']).len();
        let is_raw = rest[..prefix].contains('r');
        let hashes = rest[prefix..].len() - rest[prefix..].trim_start_matches('#').len();
        let body = prefix + hashes + 1;
        let length = if is_raw {
            let end = format!("\"{}", "#".repeat(hashes));
            rest[body..].find(&end)? + end.len()
        } else {
            quoted(&rest[body..], '"')?
        };
        self.at += body + length;
        Some(())
    }

    fn character(&mut self) -> Option<()> {
        let length = quoted(&self.rest()[1..], '\'')?;
        self.at += 1 + length;
        Some(())
    }
}

/// Length up to and with the closing quote, past what a backslash protects.
fn quoted(text: &str, quote: char) -> Option<usize> {
    let mut escaped = false;
    for (i, c) in text.char_indices() {
        if c == quote && !escaped {
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
    raw: r#"x"y)"#, letter: ')',
    motion: flow(field: sum([poiseuille(speed: 3), hill()])),
    number: count(4),
    pair: Some((-80, 2e1)),
    bodies: [sphere(radius_um: 5)],
)"##;

    #[test]
    fn places_are_found_past_comments_and_strings() {
        let root = outline(TEXT).unwrap();
        let line = |path: &str| line_and_column(TEXT, root.find(path.split('.')));
        assert_eq!(line("name"), (4, 5));
        assert_eq!(line("letter"), (5, 21));
        assert_eq!(line("motion.flow.field.sum.0.poiseuille.speed"), (6, 41));
        assert_eq!(line("motion.flow.field.sum.1"), (6, 52));
        assert_eq!(line("bodies.0.sphere.radius_um"), (9, 21));
        // What is not written is placed where it would be.
        assert_eq!(line("number.count.more"), (7, 13));
    }

    #[test]
    fn the_value_around_a_place_has_a_path() {
        let root = outline(TEXT).unwrap();
        let path = |part: &str| root.around(TEXT.find(part).unwrap()).0;
        assert_eq!(path("3)"), "motion.flow.field.sum.0.poiseuille.speed");
        assert_eq!(path("5)"), "bodies.0.sphere.radius_um");
        assert_eq!(path("2e1"), "pair.1");
        assert_eq!(path("4)"), "number.count");
    }

    #[test]
    fn what_does_not_close_has_no_outline() {
        for text in ["", "(", "(a: )", "(a: \"x)", "(a: 1))", "(a: r#\"x\")", "(a 1)", "'", "(a: /* 1)"] {
            assert_eq!(outline(text), None, "{text}");
        }
        assert_eq!(outline(&"(".repeat(100_000)), None);
    }
}
