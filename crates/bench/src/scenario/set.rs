//! Setting one value of a scenario by its path: `--set optics.background_noise=50`, and the axes of sweeps.
//!
//! The scenario is written out as RON, the value (RON too) is put in at its place, and the whole is read again, so that a
//! value is checked like one in a file. Steps of a path are keys and variants; naming another variant than the one
//! in place switches to it.

use std::ops::Range;

use super::keys::{self, Status};
use super::outline::{Inside, Node, outline};
use super::parse::read;
use super::spec::Spec;
use super::write;
use crate::error::{Error, Result};

/// The scenario with the value at `path` replaced.
///
/// # Errors
/// [`Error::Input`] if there is no such path, or the value does not fit it.
pub fn set(spec: &Spec, path: &str, value: &str) -> Result<Spec> {
    let name = format!("{path}={value}");
    if keys::status(path).is_none() {
        let hint = keys::hint(path);
        return Err(Error::input(format!("{name}: unknown key `{path}`{hint}")));
    }
    let text = write(spec)?;
    let steps: Vec<&str> = path.split('.').collect();
    let edit = outline(&text).and_then(|root| edit(&root, false, &steps, 0, value.trim()));
    let (span, with) = edit.ok_or_else(|| Error::input(format!("{name}: no such place")))?;
    let new = format!("{}{with}{}", &text[..span.start], &text[span.end..]);
    // Lines of the text that was put together mean nothing to the reader.
    read(&new).whole(|fault| format!("{name}: {}", fault.message))
}

/// Splits `path=value`.
pub fn assignment(text: &str) -> Result<(&str, &str)> {
    text.split_once('=')
        .map(|(path, value)| (path.trim(), value.trim()))
        .filter(|(path, value)| !path.is_empty() && !value.is_empty())
        .ok_or_else(|| Error::input(format!("`{text}`: expected path=value")))
}

/// What is to be replaced below a node, and by what; `entered` says that the node's name, a variant, was the step before.
fn edit(
    node: &Node,
    entered: bool,
    steps: &[&str],
    first: usize,
    value: &str,
) -> Option<(Range<usize>, String)> {
    let Some(step) = steps.get(first) else {
        return Some(match &node.inside {
            Inside::Fields(_, inside) | Inside::Items(_, inside) if entered => {
                (inside.clone(), value.to_owned())
            }
            _ => (node.span.clone(), built(steps, first - usize::from(entered), value)),
        });
    };
    if let Some(name) = node.name.as_ref().filter(|_| !entered) {
        if name == step {
            return edit(node, true, steps, first + 1, value);
        }
        return Some((node.span.clone(), built(steps, first, value)));
    }
    match &node.inside {
        Inside::Nothing => Some((node.span.clone(), built(steps, first - usize::from(entered), value))),
        // What a variant holds has no step of its own, the places of a list do.
        Inside::Items(items, _) => match (node.only_item(), step.parse::<usize>()) {
            (Some(only), _) if entered => edit(only, false, steps, first, value),
            (_, Ok(i)) => edit(items.get(i)?, false, steps, first + 1, value),
            _ => None,
        },
        Inside::Fields(fields, inside) => match node.field(step) {
            Some(field) => edit(&field.value, false, steps, first + 1, value),
            None => {
                let at = fields.last().map_or(inside.start, |f| f.value.span.end);
                let comma = if fields.is_empty() { "" } else { ", " };
                Some((at..at, format!("{comma}{}", built(steps, first, value))))
            }
        },
    }
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

#[cfg(test)]
mod tests {
    use super::super::parse;
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
        let flow = |path, value| match changed(path, value).motion {
            Motion::Flow(flow) => flow,
            Motion::Tracks(_) => panic!(),
        };
        let flow_of = flow("motion.flow.field.poiseuille.direction_rad", "0.5");
        let Field::Poiseuille(p) = flow_of.field else { panic!() };
        assert_eq!((p.max_speed_um_s, p.direction_rad), (1000.0, 0.5));
        let Field::LambOseen(v) = flow("motion.flow.field.lamb_oseen.core_radius_um", "30").field else {
            panic!()
        };
        assert_eq!(v.core_radius_um, 30.0);
        let sum = changed("motion.flow.field", "sum([poiseuille(), hill()])");
        let sum = set(&sum, "motion.flow.field.sum.0.poiseuille.max_speed_um_s", "5").unwrap();
        let Motion::Flow(flow) = set(&sum, "motion.flow.field.sum.1", "abc()").unwrap().motion else {
            panic!()
        };
        let Field::Sum(parts) = flow.field else { panic!() };
        assert!(matches!(&parts[..], [Field::Poiseuille(p), Field::Abc(_)] if p.max_speed_um_s == 5.0));
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
        assert_eq!(refuse("optics.gain", "red"), "optics.gain=red: optics.gain = red: expected a number");
        assert!(refuse("optics.gain", "1, colour: 2").contains("unknown key `optics.colour`"));
        assert!(assignment("seed").is_err());
        assert_eq!(assignment(" seed = 3 ").unwrap(), ("seed", "3"));
    }
}
