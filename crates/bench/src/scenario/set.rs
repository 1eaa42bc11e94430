//! Setting one value of a scenario by its path: `--set optics.background_noise=50`, and the axes of sweeps.
//!
//! The scenario is written out as RON, the value (RON too) is put in at its place, and the whole is read again, so that a
//! value is checked like one in a file. Steps of a path are keys and variants; naming another variant than the one
//! in place switches to it.

use std::ops::Range;

use super::keys::{self, Status};
use super::spec::Spec;
use super::{parse, write};
use crate::error::{Error, Result};

/// The scenario with the value at `path` replaced.
///
/// # Errors
/// [`Error::Input`] if there is no such path, or the value does not fit it; [`Error::Unsupported`] if it is planned.
pub fn set(spec: &Spec, path: &str, value: &str) -> Result<Spec> {
    let name = format!("{path}={value}");
    match keys::status(path) {
        Some(Status::Planned) => {
            return Err(Error::Unsupported(vec![format!("{name}: `{path}` is valid but not supported yet")]));
        }
        None => {
            let hint = keys::suggestion(path).map(|s| format!("; did you mean `{s}`?")).unwrap_or_default();
            return Err(Error::input(format!("{name}: unknown key `{path}`{hint}")));
        }
        Some(Status::Key | Status::Variant) => {}
    }
    let text = write(spec)?;
    let steps: Vec<&str> = path.split('.').collect();
    let new =
        splice(&text, &steps, value.trim()).ok_or_else(|| Error::input(format!("{name}: no such place")))?;
    parse(&new, &name).map_err(|e| match e {
        // Lines of the text that was put together mean nothing to the reader.
        Error::Input(messages) => Error::Input(messages.iter().map(|m| without_place(m, &name)).collect()),
        other => other,
    })
}

/// Splits `path=value`.
pub fn assignment(text: &str) -> Result<(&str, &str)> {
    text.split_once('=')
        .map(|(path, value)| (path.trim(), value.trim()))
        .filter(|(path, value)| !path.is_empty() && !value.is_empty())
        .ok_or_else(|| Error::input(format!("`{text}`: expected path=value")))
}

fn without_place(message: &str, name: &str) -> String {
    let rest = message.strip_prefix(name).unwrap_or(message);
    let place = |c: char| c.is_ascii_digit() || c == ':' || c == '-';
    format!("{name}: {}", rest.trim_start_matches(place).trim_start())
}

/// What stands at a place of the text.
enum Place {
    /// A value.
    Value(Range<usize>),
    /// What stands in a variant's brackets: a value, or fields without brackets of their own.
    Content(Range<usize>),
}

fn splice(text: &str, steps: &[&str], value: &str) -> Option<String> {
    let mut place = Place::Value(value_at(text, 0)?);
    for (i, step) in steps.iter().enumerate() {
        let fields = match place {
            Place::Content(content) => content,
            Place::Value(span) if text[span.clone()].starts_with('(') => span.start + 1..span.end - 1,
            Place::Value(span) => {
                let end = ident_end(text, span.start);
                if &text[span.start..end] != *step {
                    return Some(replaced(text, span, &built(steps, i, value)));
                }
                let opening = skip(text, end);
                let has_content = opening < span.end && text[opening..].starts_with('(');
                place =
                    if has_content { Place::Content(opening + 1..span.end - 1) } else { Place::Value(span) };
                continue;
            }
        };
        let written = text[fields.clone()].trim_end();
        match field(text, fields.clone(), step) {
            Some(span) => place = Place::Value(span),
            None if written.is_empty() || has_names(text, fields.clone()) => {
                let comma = if written.is_empty() || written.ends_with(',') { "" } else { "," };
                let at = fields.start + written.len();
                return Some(replaced(text, at..at, &format!("{comma} {}", built(steps, i, value))));
            }
            None => return None,
        }
    }
    let (Place::Value(span) | Place::Content(span)) = place;
    Some(replaced(text, span, value))
}

/// The steps from `first` on as RON around a value.
fn built(steps: &[&str], first: usize, value: &str) -> String {
    let Some(step) = steps.get(first) else { return value.to_owned() };
    let inner = built(steps, first + 1, value);
    let is = |n: usize, status| keys::status(&steps[..=n].join(".")) == Some(status);
    if is(first, Status::Variant) {
        // A variant without content is its name alone: `calibration.none=` has no value to hold.
        return format!("{step}({inner})");
    }
    let next_is_key = steps.get(first + 1).is_some() && is(first + 1, Status::Key);
    if next_is_key { format!("{step}: ({inner})") } else { format!("{step}: {inner}") }
}

fn replaced(text: &str, span: Range<usize>, with: &str) -> String {
    format!("{}{with}{}", &text[..span.start], &text[span.end..])
}

fn skip(text: &str, at: usize) -> usize {
    at + text[at..].len() - text[at..].trim_start().len()
}

fn ident_end(text: &str, at: usize) -> usize {
    let part_of_ident = |c: char| c.is_ascii_alphanumeric() || c == '_';
    at + text[at..].find(|c| !part_of_ident(c)).unwrap_or(text.len() - at)
}

/// The span of the value that begins at or after `at`; the text is what RON's writer makes, without comments.
fn value_at(text: &str, at: usize) -> Option<Range<usize>> {
    let start = skip(text, at);
    let (mut depth, mut in_string, mut escaped) = (0i32, false, false);
    for (i, c) in text[start..].char_indices() {
        if in_string {
            in_string = escaped || c != '"';
            escaped = c == '\\' && !escaped;
            continue;
        }
        match c {
            '"' => in_string = true,
            '(' | '[' | '{' => depth += 1,
            ')' | ']' | '}' if depth == 0 => {
                return Some(start..start + text[start..start + i].trim_end().len());
            }
            ')' | ']' | '}' => {
                depth -= 1;
                if depth == 0 {
                    return Some(start..start + i + 1);
                }
            }
            ',' if depth == 0 => return Some(start..start + i),
            _ => {}
        }
    }
    (depth == 0 && !in_string).then(|| start..start + text[start..].trim_end().len())
}

/// The value of a field, among fields separated by commas.
fn field(text: &str, fields: Range<usize>, name: &str) -> Option<Range<usize>> {
    let mut at = skip(text, fields.start);
    while at < fields.end {
        let end = ident_end(text, at);
        let colon = skip(text, end);
        if end == at || !text[colon..].starts_with(':') {
            return None;
        }
        let value = value_at(text, colon + 1)?;
        if &text[at..end] == name {
            return Some(value);
        }
        at = skip(text, value.end);
        if text[at..].starts_with(',') {
            at = skip(text, at + 1);
        }
    }
    None
}

/// Whether this is a list of named fields.
fn has_names(text: &str, fields: Range<usize>) -> bool {
    let at = skip(text, fields.start);
    let end = ident_end(text, at);
    end > at && text[skip(text, end)..].starts_with(':')
}

#[cfg(test)]
mod tests {
    use super::super::spec::{Diameter, Field, Motion, Number, Preset, Timing};
    use super::*;

    fn spec() -> Spec {
        let text = r#"(
            name: "a, (b)\" c",
            optics: (preset: setting1),
            motion: flow(field: poiseuille(max_speed_um_s: 1000)),
            timing: pairs(count: 2),
        )"#;
        parse(text, "s.ron").unwrap()
    }

    #[test]
    fn values_are_replaced_added_and_switched() {
        let spec = spec();
        let changed = |path, value| set(&spec, path, value).unwrap();
        assert_eq!(changed("seed", "7").seed, 7);
        assert_eq!(changed("name", "\"b\"").name, "b");
        assert_eq!(changed("optics.preset", "setting2").optics.preset, Some(Preset::Setting2));
        assert_eq!(changed("optics.background_noise", "50").optics.background_noise, Some(50.0));
        assert_eq!(changed("particles.number.ppp", "0.001").particles.number, Some(Number::Ppp(0.001)));
        assert_eq!(changed("particles.number", "count(3)").particles.number, Some(Number::Count(3)));
        assert_eq!(
            changed("particles.diameter_um.constant", "3").particles.diameter_um,
            Some(Diameter::Constant(3.0))
        );
        assert_eq!(changed("boundaries.z_um", "(-10, 10)").boundaries.z_um, Some((-10.0, 10.0)));
        let Timing::Pairs(pairs) = changed("timing.pairs.count", "9").timing else { panic!() };
        assert_eq!(pairs.count, 9);
        let Timing::Sequence(sequence) = changed("timing.sequence.frames", "5").timing else { panic!() };
        assert_eq!(sequence.frames, 5);
        let Motion::Flow(flow) = changed("motion.flow.field.poiseuille.direction_rad", "0.5").motion;
        let Field::Poiseuille(p) = flow.field else { panic!() };
        assert_eq!((p.max_speed_um_s, p.direction_rad), (1000.0, 0.5));
        let Motion::Flow(flow) = changed("motion.flow.field.lamb_oseen.core_radius_um", "30").motion;
        let Field::LambOseen(v) = flow.field else { panic!() };
        assert_eq!(v.core_radius_um, 30.0);
    }

    #[test]
    fn one_change_does_not_undo_another() {
        let changed =
            set(&set(&spec(), "particles.number.count", "5").unwrap(), "particles.number.count", "6")
                .unwrap();
        assert_eq!(changed.particles.number, Some(Number::Count(6)));
        let both = set(&changed, "optics.gain", "2").unwrap();
        assert_eq!((both.optics.gain, both.particles.number), (Some(2.0), Some(Number::Count(6))));
    }

    #[test]
    fn wrong_paths_and_values_are_refused() {
        let refuse = |path, value| set(&spec(), path, value).unwrap_err().to_string();
        assert!(refuse("optics.gian", "1").contains("did you mean `gain`?"));
        assert!(refuse("illumination", "1").contains("valid but not supported yet"));
        assert_eq!(refuse("optics.gain", "red"), "optics.gain=red: Expected float");
        assert!(refuse("optics.gain", "1, colour: 2").contains("unknown key `optics.colour`"));
        assert!(assignment("seed").is_err());
        assert_eq!(assignment(" seed = 3 ").unwrap(), ("seed", "3"));
    }
}
