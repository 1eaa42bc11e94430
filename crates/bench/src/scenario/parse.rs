//! Reading a scenario: RON to [`Spec`], with all that is wrong reported at once, each with its place.
//!
//! RON's own reader stops at the first value that does not fit. So the names of keys and variants are checked against the
//! list of all ([`keys`]) first, on the text's outline.

use std::ops::Range;

use ron::error::SpannedError;
use ron::extensions::Extensions;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::keys::{self, Status};
use super::outline::{Field, Inside, Node, line_and_column, outline};
use super::spec::Spec;
use crate::error::{Error, Result};

/// How RON is read and written everywhere: `Some` need not be written, nor a variant's inner brackets.
pub(super) fn options() -> ron::Options {
    ron::Options::default().with_default_extension(
        Extensions::IMPLICIT_SOME | Extensions::UNWRAP_VARIANT_NEWTYPES | Extensions::UNWRAP_NEWTYPES,
    )
}

/// Something that is wrong with a text, and where.
pub(super) struct Fault {
    /// Byte of the text.
    pub(super) at: usize,
    /// The path of the key, what was found, what is allowed.
    pub(super) message: String,
}

/// Reads a scenario; `name` is what messages call it.
///
/// # Errors
/// [`Error::Input`] with line and column of everything that is no RON, has the wrong type, or is an unknown key or
/// variant.
pub fn parse(text: &str, name: &str) -> Result<Spec> {
    read(text).whole(|fault| fault.placed(text, name))
}

impl Fault {
    /// The message with the place, in a file of this name.
    pub(super) fn placed(&self, text: &str, name: &str) -> String {
        let (line, column) = line_and_column(text, self.at);
        format!("{name}:{line}:{column}: {}", self.message)
    }
}

/// What is found in a text.
pub(super) struct Reading {
    /// The scenario, without what is wrong; `None` if that leaves none.
    pub(super) spec: Option<Spec>,
    /// All that is wrong, in order.
    pub(super) faults: Vec<Fault>,
}

impl Reading {
    /// The scenario, if nothing is wrong.
    pub(super) fn whole(self, message: impl Fn(&Fault) -> String) -> Result<Spec> {
        match self.spec {
            Some(spec) if self.faults.is_empty() => Ok(spec),
            _ => Err(Error::Input(self.faults.iter().map(message).collect())),
        }
    }
}

/// Reads as much of a text as can be read.
pub(super) fn read(text: &str) -> Reading {
    let root = outline(text);
    let mut names = Names { text, faults: Vec::new(), refused: Vec::new() };
    if let Some(root) = &root {
        names.value(root, "");
    }
    let Names { mut faults, refused, .. } = names;
    let source = Source { text, root: root.as_ref(), refused, needed: &NEEDED };
    let spec = source.recover(&mut faults).map(|(spec, unknown)| {
        let tree = serde_json::to_value(&spec).unwrap_or_default();
        for steps in &unknown {
            let path = named(steps, &tree);
            let at = root.as_ref().map_or(0, |root| root.find(path.split('.')));
            // Most are among the faults already; the rest is what the list of keys is vague about.
            if !faults.iter().any(|fault: &Fault| fault.at == at) {
                faults.push(unknown_key(&path, at));
            }
        }
        spec
    });
    faults.sort_by_key(|fault| fault.at);
    Reading { spec, faults }
}

/// What a scenario cannot be read without, and what stands there while the rest is looked at.
const NEEDED: [(&str, &str); 3] = [
    ("name", "name: \"stand-in\""),
    ("motion", "motion: flow(field: poiseuille())"),
    ("timing", "timing: pairs(count: 1)"),
];

/// A text to be read.
pub(super) struct Source<'a> {
    pub(super) text: &'a str,
    pub(super) root: Option<&'a Node>,
    /// Values that are known to be unreadable.
    pub(super) refused: Vec<Range<usize>>,
    /// Fields that it cannot be read without, with stand-ins.
    pub(super) needed: &'a [(&'a str, &'a str)],
}

/// The steps of a path; `None` is a variant.
pub(super) type Steps = Vec<Option<String>>;

impl Source<'_> {
    /// What the text says, and the fields that nobody read. RON's reader stops at the first value that does not fit: it is
    /// given the text without it, to find the next. `None` if that leaves nothing to read.
    pub(super) fn recover<T: DeserializeOwned>(&self, faults: &mut Vec<Fault>) -> Option<(T, Vec<Steps>)> {
        let (mut without, mut stand_ins): (Vec<&Field>, Vec<&str>) = (Vec::new(), Vec::new());
        for _ in 0..MAX_FAULTS {
            let mut unknown = Vec::new();
            let e = match deserialize(&self.amended(&without, &stand_ins), |path| unknown.push(steps(&path)))
            {
                Ok(value) => return Some((value, unknown)),
                Err(e) => e,
            };
            let fault = unreadable(self.text, self.root, &e);
            let missing = match &e.code {
                ron::Error::MissingStructField { field, .. } => Some(*field),
                _ => None,
            };
            let field = self.root.and_then(|root| root.field_around(fault.at, missing.is_some()));
            // A name that was refused is the reader's fault too, and what was taken out is missing.
            let is_refused = self.refused.iter().any(|span| (span.start..=span.end).contains(&fault.at));
            let is_taken_out = missing.is_some_and(|key| without.iter().any(|field| field.key == key));
            let goes_on = is_refused
                || missing.is_some()
                || is_of_a_value(&e.code)
                || is_fraction(&e.code, self.root, fault.at, self.text);
            if !is_refused && !is_taken_out && (goes_on || without.is_empty()) {
                faults.push(fault);
            }
            let stand_in = missing.and_then(|key| self.needed.iter().find(|(needed, _)| *needed == key));
            match (stand_in, field) {
                (Some((_, stand_in)), _) if !stand_ins.contains(stand_in) => stand_ins.push(stand_in),
                (None, Some(field)) if goes_on => without.push(field),
                _ => return None,
            }
        }
        None
    }

    /// The text with spaces in the place of some fields, and with stand-ins: lines and columns of what is kept stay.
    fn amended(&self, without: &[&Field], stand_ins: &[&str]) -> String {
        let text = self.text;
        let ranges: Vec<Range<usize>> = without
            .iter()
            .map(|field| {
                let end = field.value.span.end;
                let after = text[end..].trim_start();
                field.at..if after.starts_with(',') { text.len() - after.len() + 1 } else { end }
            })
            .collect();
        let is_out = |i: usize| ranges.iter().any(|range| range.contains(&i));
        // Behind the last field that is kept.
        let place = self.root.filter(|_| !stand_ins.is_empty()).and_then(|root| match &root.inside {
            Inside::Fields(fields, inside) => {
                let kept = fields.iter().rev().find(|field| !is_out(field.at));
                Some(kept.map_or((inside.start, ""), |field| (field.value.span.end, ", ")))
            }
            _ => None,
        });
        let mut amended = String::with_capacity(text.len());
        for (i, c) in text.char_indices() {
            if let Some((_, comma)) = place.filter(|(at, _)| *at == i) {
                amended.push_str(comma);
                amended.push_str(&stand_ins.join(", "));
            }
            amended.push(if c != '\n' && is_out(i) { ' ' } else { c });
        }
        amended
    }
}

/// Most faults that are looked for in values.
const MAX_FAULTS: usize = 50;

/// Whether an error is about one value, not about the brackets around it.
fn is_of_a_value(code: &ron::Error) -> bool {
    use ron::Error as E;
    matches!(
        code,
        E::ExpectedFloat
            | E::ExpectedInteger
            | E::InvalidIntegerDigit { .. }
            | E::IntegerOutOfBounds
            | E::ExpectedBoolean
            | E::ExpectedString
            | E::ExpectedStructLike
            | E::ExpectedNamedStructLike(_)
            | E::ExpectedArray
            | E::NoSuchEnumVariant { .. }
            | E::InvalidValueForType { .. }
    )
}

/// Whether the reader stumbles over the point of a number that should be whole.
fn is_fraction(code: &ron::Error, root: Option<&Node>, at: usize, text: &str) -> bool {
    let found = root.map_or("", |root| &text[root.around(at).1.span.clone()]);
    matches!(code, ron::Error::ExpectedComma | ron::Error::ExpectedStructLikeEnd)
        && found.parse::<f64>().is_ok()
}

fn deserialize<T: DeserializeOwned>(
    text: &str,
    ignored: impl FnMut(serde_ignored::Path<'_>),
) -> std::result::Result<T, SpannedError> {
    let mut deserializer = ron::Deserializer::from_str_with_options(text, &options())?;
    serde_ignored::deserialize(&mut deserializer, ignored)
        .and_then(|spec| deserializer.end().map(|()| spec))
        .map_err(|e| deserializer.span_error(e))
}

/// The check of the names of keys and variants against the list of all.
struct Names<'a> {
    text: &'a str,
    faults: Vec<Fault>,
    /// Values that cannot be read because of their names.
    refused: Vec<Range<usize>>,
}

impl Names<'_> {
    fn value(&mut self, node: &Node, path: &str) {
        let allowed = keys::below(path);
        let is_choice = allowed.iter().any(|(_, status)| *status == Status::Variant);
        match (&node.name, &node.inside) {
            (Some(name), _) if name == "Some" => {
                if let Some(inner) = node.only_item() {
                    self.value(inner, path);
                }
            }
            (Some(name), inside) if is_choice => {
                let variant = joined(path, name);
                match allowed.iter().find(|(a, _)| a == name) {
                    Some(_) => self.content(inside, &variant),
                    None => {
                        let choice = choice(name, allowed.iter().map(|(name, _)| *name));
                        self.refuse(node, format!("{path}: unknown variant `{name}`: {choice}"));
                    }
                }
            }
            (None, Inside::Nothing) if is_choice => {
                let found = &self.text[node.span.clone()];
                let choice = choice(found, allowed.iter().map(|(name, _)| *name));
                self.refuse(node, format!("{path} = {found}: {choice}"));
            }
            (_, inside) => self.content(inside, path),
        }
    }

    fn refuse(&mut self, node: &Node, message: String) {
        self.faults.push(Fault { at: node.span.start, message });
        self.refused.push(node.span.clone());
    }

    /// The same for what is in brackets.
    fn content(&mut self, inside: &Inside, path: &str) {
        match inside {
            Inside::Nothing => {}
            Inside::Items(items, _) => {
                for (i, item) in items.iter().enumerate() {
                    // A variant's only value has no step of its own, nor has the list in it.
                    let alone = items.len() == 1 && item.name.is_none();
                    let path = if alone { path.to_owned() } else { joined(path, &i.to_string()) };
                    self.value(item, &path);
                }
            }
            Inside::Fields(fields, _) => {
                let is_listed = !keys::below(path).is_empty();
                for field in fields {
                    let path = joined(path, &field.key);
                    match keys::status(&path) {
                        Some(Status::Key | Status::Variant) => self.value(&field.value, &path),
                        None if !is_listed => {}
                        _ => self.faults.push(unknown_key(&path, field.at)),
                    }
                }
            }
        }
    }
}

fn joined(path: &str, step: &str) -> String {
    if path.is_empty() { step.to_owned() } else { format!("{path}.{step}") }
}

fn unknown_key(path: &str, at: usize) -> Fault {
    let hint = keys::hint(path);
    Fault { at, message: format!("unknown key `{path}`{hint}") }
}

/// What RON's reader refuses, in the words of scenarios.
fn unreadable(text: &str, root: Option<&Node>, e: &SpannedError) -> Fault {
    use ron::Error as E;
    let at = byte(text, e.span.start);
    let Some(root) = root else {
        return Fault { at, message: e.code.to_string() };
    };
    let (path, node) = root.around(at);
    // What is missing or doubled concerns the section, not the value before it.
    let path = match (&e.code, &node.inside) {
        (E::MissingStructField { .. } | E::DuplicateStructField { .. }, Inside::Nothing) => {
            path.rsplit_once('.').map_or("", |(section, _)| section).to_owned()
        }
        _ => path,
    };
    let in_path = |message: String| if path.is_empty() { message } else { format!("{path}: {message}") };
    let found = |expected: &str| {
        let found: String = text[node.span.clone()].chars().take(40).collect();
        in_path(String::new()).trim_end_matches(": ").to_owned() + &format!(" = {found}: expected {expected}")
    };
    let message = match &e.code {
        E::MissingStructField { field, .. } => in_path(format!("`{field}` is missing")),
        E::DuplicateStructField { field, .. } => in_path(format!("`{field}` is given a second time")),
        E::NoSuchEnumVariant { expected, found, .. } => {
            in_path(format!("unknown variant `{found}`: {}", choice(found, expected.iter().copied())))
        }
        E::ExpectedFloat => found("a number"),
        E::ExpectedInteger | E::InvalidIntegerDigit { .. } => found("a whole number"),
        E::IntegerOutOfBounds => found("a whole number that is not negative and not too large"),
        E::ExpectedBoolean => found("true or false"),
        E::ExpectedString => found("a text in quotes"),
        E::ExpectedStructLike | E::ExpectedNamedStructLike(_) => found("values in round brackets"),
        E::ExpectedArray => found("a list in square brackets"),
        E::InvalidValueForType { expected, .. } => found(expected),
        code if is_fraction(code, Some(root), at, text) => found("a whole number"),
        E::ExpectedComma => in_path("expected a comma or the closing bracket".to_owned()),
        code => in_path(code.to_string()),
    };
    Fault { at, message }
}

fn byte(text: &str, position: ron::error::Position) -> usize {
    let line_start: usize =
        text.split_inclusive('\n').take(position.line.saturating_sub(1)).map(str::len).sum();
    let in_line = text[line_start..].char_indices().nth(position.col.saturating_sub(1));
    line_start + in_line.map_or(text.len() - line_start, |(i, _)| i)
}

fn choice<'a>(found: &str, allowed: impl Iterator<Item = &'a str> + Clone) -> String {
    let all = allowed.clone().collect::<Vec<_>>().join(", ");
    let hint = keys::nearest(found, allowed).map(|s| format!("did you mean `{s}`? ")).unwrap_or_default();
    format!("{hint}expected one of {all}")
}

/// Writes a scenario so that [`parse`] reads it back.
pub fn write(spec: &Spec) -> Result<String> {
    let pretty = ron::ser::PrettyConfig::new().struct_names(false).new_line("\n");
    let text =
        options().to_string_pretty(spec, pretty).map_err(|e| Error::input(format!("scenario: {e}")))?;
    Ok(text + "\n")
}

/// Part of a scenario on one line.
pub fn compact(part: &impl serde::Serialize) -> Result<String> {
    options().to_string(part).map_err(|e| Error::input(format!("scenario: {e}")))
}

/// The steps of a path; `None` stands for an enum's variant, whose name serde_ignored does not tell.
fn steps(path: &serde_ignored::Path<'_>) -> Steps {
    use serde_ignored::Path;
    let (parent, step) = match path {
        Path::Root => return Vec::new(),
        Path::Seq { parent, index } => (parent, Some(index.to_string())),
        Path::Map { parent, key } => (parent, Some(key.clone())),
        Path::NewtypeVariant { parent } => (parent, None),
        Path::Some { parent } | Path::NewtypeStruct { parent } => return steps(parent),
    };
    let mut steps = steps(parent);
    steps.push(step);
    steps
}

/// The path with its variants named from the tree of what was read.
fn named(steps: &[Option<String>], tree: &Value) -> String {
    let mut node = Some(tree);
    let mut names = Vec::new();
    for step in steps {
        let name = match step {
            Some(name) => name.clone(),
            // A variant is an object of one key, the variant's name.
            None => node
                .and_then(|n| n.as_object())
                .and_then(|o| o.keys().next().cloned())
                .unwrap_or_else(|| "?".to_owned()),
        };
        node = node.and_then(|n| match n {
            Value::Array(items) => name.parse::<usize>().ok().and_then(|i| items.get(i)),
            other => other.get(&name),
        });
        names.push(name);
    }
    names.join(".")
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = r#"(
        name: "test",
        motion: flow(field: poiseuille(max_speed_um_s: 1000)),
        timing: pairs(count: 2),
    )"#;

    fn refuse(text: &str) -> (u8, String) {
        let error = parse(text, "s.ron").unwrap_err();
        (error.exit_code(), error.to_string())
    }

    #[test]
    fn what_is_written_is_read_back() {
        let spec = parse(GOOD, "s.ron").unwrap();
        let text = write(&spec).unwrap();
        assert_eq!(parse(&text, "s.ron").unwrap(), spec);
        assert_eq!(write(&parse(&text, "s.ron").unwrap()).unwrap(), text);
    }

    #[test]
    fn all_unknown_keys_and_variants_are_named_at_once_with_place_and_suggestion() {
        let text = GOOD
            .replace("max_speed_um_s", "max_sped_um_s: 1, walls_z_um: (0, 1), max_speed_um_s")
            .replace("name:", "optics: (gian: 3), flavour: sweet,\nname:")
            .replace("timing", "boundaries: (x: opne, bodies: [sphere(radius: 3)], z_mu: (1, 2)), timing")
            .replace("count: 2", "count: two");
        let (code, message) = refuse(&text);
        assert_eq!(code, 2);
        let expected = [
            "s.ron:2:18: unknown key `optics.gian`; did you mean `gain`?",
            "s.ron:2:28: unknown key `flavour`; expected one of name, description, license, seed, optics, sensor, motion, particles, boundaries, timing, illumination, render, truth, truth_grid, calibration",
            "s.ron:4:40: unknown key `motion.flow.field.poiseuille.max_sped_um_s`; did you mean `max_speed_um_s`?",
            "s.ron:5:25: boundaries.x: unknown variant `opne`: did you mean `open`? expected one of open, wall, periodic",
            "s.ron:5:47: unknown key `boundaries.bodies.0.sphere.radius`; did you mean `radius_um`?",
            "s.ron:5:56: boundaries.bodies.0.sphere: `centre_um` is missing",
            "s.ron:5:60: unknown key `boundaries.z_mu`; did you mean `z_um`?",
            "s.ron:5:95: timing.pairs.count = two: expected a whole number",
        ];
        assert_eq!(message.lines().collect::<Vec<_>>(), expected);
    }

    #[test]
    fn all_values_of_the_wrong_type_are_named_at_once() {
        let text = GOOD
            .replace("1000", "fast")
            .replace(
                "name: \"test\"",
                "name: \"\u{b5}\", optics: (gain: \"high\", n_rays: 2.5, preset: setting1)",
            )
            .replace("timing:", "seed: -1,\n particles: (c_int: uniform(min: 1)), timing:")
            .replace("count: 2", "dt_s: soon");
        let (_, message) = refuse(&text);
        let expected = [
            "s.ron:2:34: optics.gain = \"high\": expected a number",
            "s.ron:2:52: optics.n_rays = 2.5: expected a whole number",
            "s.ron:3:55: motion.flow.field.poiseuille.max_speed_um_s = fast: expected a number",
            "s.ron:4:16: seed = -1: expected a whole number that is not negative and not too large",
            "s.ron:5:35: particles.c_int.uniform: `max` is missing",
            "s.ron:5:58: timing.pairs.dt_s = soon: expected a number",
            "s.ron:5:63: timing.pairs: `count` is missing",
        ];
        assert_eq!(message.lines().collect::<Vec<_>>(), expected);
    }

    #[test]
    fn faults_of_syntax_and_type_name_place_path_and_what_was_found() {
        for (from, to, expected) in [
            (
                "1000",
                "\"fast\"",
                "s.ron:3:55: motion.flow.field.poiseuille.max_speed_um_s = \"fast\": expected a number",
            ),
            ("poiseuille", "poisseuille", "did you mean `poiseuille`?"),
            ("count: 2", "count: two", "s.ron:4:29: timing.pairs.count = two: expected a whole number"),
            ("count: 2", "count: -2", "timing.pairs.count = -2: expected a whole number"),
            ("count: 2", "dt_s: 1", "timing.pairs: `count` is missing"),
            ("count: 2", "count: 2, count: 3", "timing.pairs: `count` is given a second time"),
            ("\"test\"", "test", "s.ron:2:14: name = test: expected a text in quotes"),
            ("timing: pairs(count: 2),", "", "`timing` is missing"),
            ("timing:", "seed: -1, timing:", "seed = -1: expected a whole number"),
            ("timing:", "boundaries: (z_um: 3), timing:", "boundaries.z_um = 3: expected"),
            (
                "timing:",
                "boundaries: (z_um: (3, red)), timing:",
                "boundaries.z_um.1 = red: expected a number",
            ),
            ("timing:", "particles: (number: 5), timing:", "particles.number = 5: expected"),
            (
                "timing:",
                "particles: (c_int: uniform(min: 1)), timing:",
                "particles.c_int.uniform: `max` is missing",
            ),
        ] {
            let message = refuse(&GOOD.replace(from, to)).1;
            assert!(message.contains(expected), "{to}: {message}");
        }
        assert!(refuse("(name: \"a\"").1.starts_with("s.ron:1:"));
    }
}
