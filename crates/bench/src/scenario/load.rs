//! From a scenario's file to one that can be run, with the place of everything that is wrong.

use std::path::Path;

use super::outline::{Node, outline};
use super::parse::{Fault, Reading, parse, read};
use super::resolve::{Scenario, resolve};
use super::{assignment, keys, set};
use crate::error::{Error, Result};

/// The resolved scenario in a dataset's folder.
pub const SCENARIO: &str = "scenario.ron";

/// The scenario of a file, some of its values replaced: by assignments `path=value`, and by another seed.
///
/// # Errors
/// [`Error::Input`] with all problems of text, assignments and values, those of the file with line and column. Rules between
/// values are checked as far as values can be read.
pub fn load(file: &Path, assignments: &[String], seed: Option<u64>) -> Result<Scenario> {
    let text = std::fs::read_to_string(file).map_err(|e| Error::read(file, e))?;
    let name = file.display().to_string();
    let root = outline(&text);
    if root.as_ref().is_some_and(|root| root.field("axes").is_some() && root.field("motion").is_none()) {
        return Err(Error::input(format!("{name}: is a sweep; `microsig sweep {name}` makes its datasets")));
    }
    let Reading { spec, mut faults } = read(&text);
    let (mut elsewhere, mut replaced) = (Vec::new(), Vec::new());
    if let Some(mut spec) = spec {
        for text in assignments {
            let changed = assignment(text).and_then(|(path, value)| {
                replaced.push(path);
                set(&spec, path, value)
            });
            match changed {
                Ok(changed) => spec = changed,
                Err(Error::Input(messages)) => elsewhere.extend(messages),
                Err(other) => return Err(other),
            }
        }
        spec.seed = seed.unwrap_or(spec.seed);
        let is_whole = faults.is_empty() && elsewhere.is_empty();
        let problems = match resolve(spec, file.parent().unwrap_or(Path::new("."))) {
            Ok(scenario) if is_whole => return Ok(scenario),
            Ok(_) => Vec::new(),
            Err(Error::Input(problems)) => problems,
            Err(other) if is_whole => return Err(other),
            Err(_) => Vec::new(),
        };
        for message in problems {
            match place(&message, root.as_ref(), &replaced) {
                // What could not be read may be what a message about a default misses.
                Some((at, is_said)) if is_whole || is_said => faults.push(Fault { at, message }),
                None if is_whole => elsewhere.push(message),
                _ => {}
            }
        }
        faults.sort_by_key(|fault| fault.at);
    }
    let placed = faults.iter().map(|fault| fault.placed(&text, &name));
    Err(Error::Input(placed.chain(elsewhere).collect()))
}

/// The scenario of a dataset, and its text.
///
/// # Errors
/// A file that is missing; [`Error::Input`] for one that another version wrote.
pub fn of_dataset(dataset: &Path) -> Result<(Scenario, String)> {
    let path = dataset.join(SCENARIO);
    let text = std::fs::read_to_string(&path).map_err(|e| Error::read(&path, e))?;
    let scenario = resolve(parse(&text, &path.display().to_string())?, dataset)?;
    Ok((scenario, text))
}

/// Where the value whose path a message begins with stands in the file, and whether it is there or only its section is.
fn place(message: &str, root: Option<&Node>, replaced: &[&str]) -> Option<(usize, bool)> {
    let path = message.split([' ', ':']).next().unwrap_or_default();
    let from_file = !replaced.iter().any(|r| path.starts_with(r) || r.starts_with(path));
    let root = root.filter(|_| from_file && keys::status(path).is_some())?;
    Some((root.find(path.split('.')), root.value(path.split('.')).is_some()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrong_values_have_a_place_unless_they_are_not_from_the_file() {
        let place = tempfile::tempdir().unwrap();
        let file = place.path().join("s.ron");
        let text = "(\n  name: \"Mine\",\n  motion: flow(field: poiseuille()),\n  timing: pairs(dt_s: 0, count: 0),\n)\n";
        std::fs::write(&file, text).unwrap();
        let problems = |set: &[String]| load(&file, set, None).unwrap_err().to_string();
        let at = |line_and_column: &str| format!("{}:{line_and_column}: ", file.display());
        let expected = [
            at("2:3") + "name = `Mine`: expected 1 to 100 lower-case",
            at("4:17") + "timing.pairs.dt_s = 0",
            at("4:26") + "timing.pairs.count = 0",
        ];
        let found = problems(&[]);
        assert_eq!(found.lines().count(), 3, "{found}");
        assert!(found.lines().zip(&expected).all(|(f, e)| f.starts_with(e)), "{found}");
        let set = problems(&["timing.pairs.count=2".to_owned(), "timing.pairs.dt_s=-1".to_owned()]);
        assert!(set.contains("\ntiming.pairs.dt_s = -1"), "{set}");
    }

    #[test]
    fn what_cannot_be_read_hides_no_value_out_of_range() {
        let place = tempfile::tempdir().unwrap();
        let file = place.path().join("s.ron");
        let text = "(\n  name: \"Mine\", colour: red,\n  optics: (gain: high, n_rays: 0),\n  motion: flow(field: poiseuille()),\n  timing: pairs(dt_s: 1, count: two),\n)\n";
        std::fs::write(&file, text).unwrap();
        let found = load(&file, &["seed=x".to_owned()], None).unwrap_err().to_string();
        let at = |line_and_column: &str| format!("{}:{line_and_column}: ", file.display());
        let expected = [
            at("2:3") + "name = `Mine`: expected 1 to 100 lower-case",
            at("2:17") + "unknown key `colour`",
            at("3:17") + "optics.gain = high: expected a number",
            at("3:24") + "optics.n_rays = 0",
            at("5:32") + "timing.pairs.count = two: expected a whole number",
            "seed=x: seed = x: expected a whole number".to_owned(),
        ];
        assert_eq!(found.lines().count(), expected.len(), "{found}");
        assert!(found.lines().zip(&expected).all(|(f, e)| f.starts_with(e)), "{found}");
    }

    #[test]
    fn faults_of_one_section_hide_none_of_another() {
        let place = tempfile::tempdir().unwrap();
        let file = place.path().join("s.ron");
        let text = "(name: \"m\", motion: flow(field: poiseuille()), timing: pairs(count: 1),\n\
            optics: (n_rays: 0),\n\
            sensor: (bits: 9),\n\
            truth_grid: grid(spacing_px: 0),\n\
            boundaries: (margin_px: -3),\n\
            render: (mode: expected, tolerance: 5),\n\
)\n";
        std::fs::write(&file, text).unwrap();
        let found = load(&file, &[], None).unwrap_err().to_string();
        let lines: Vec<&str> = found.lines().collect();
        let expected = [
            "optics.n_rays",
            "sensor.bits",
            "truth_grid.grid.spacing_px",
            "boundaries.margin_px",
            "render.tolerance",
        ];
        for (i, key) in expected.iter().enumerate() {
            let start = format!("{}:{}:", file.display(), i + 2);
            assert!(lines[i].starts_with(&start) && lines[i].contains(key), "{found}");
        }
    }
}
