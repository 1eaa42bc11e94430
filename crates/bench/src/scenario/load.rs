//! From a scenario's file to one that can be run, with the place of everything that is wrong.

use std::path::Path;

use super::outline::{line_and_column, outline};
use super::resolve::{Scenario, resolve};
use super::{assignment, keys, parse, set};
use crate::error::{Error, Result};

/// The scenario of a file, some of its values replaced: by assignments `path=value`, and by another seed.
///
/// # Errors
/// [`Error::Input`] with all problems that one stage finds (text, assignments, values), each with file, line and column.
pub fn load(file: &Path, assignments: &[String], seed: Option<u64>) -> Result<Scenario> {
    let text = std::fs::read_to_string(file).map_err(|e| Error::read(file, e))?;
    let name = file.display().to_string();
    if outline(&text).is_some_and(|root| root.field("axes").is_some() && root.field("motion").is_none()) {
        return Err(Error::input(format!("{name}: is a sweep; `microsig sweep {name}` makes its datasets")));
    }
    let mut spec = parse(&text, &name)?;
    let mut replaced = Vec::new();
    for text in assignments {
        let (path, value) = assignment(text)?;
        spec = set(&spec, path, value)?;
        replaced.push(path);
    }
    spec.seed = seed.unwrap_or(spec.seed);
    let folder = file.parent().unwrap_or(Path::new("."));
    resolve(spec, folder).map_err(|e| match e {
        Error::Input(messages) => {
            Error::Input(messages.iter().map(|m| placed(m, &text, &name, &replaced)).collect())
        }
        other => other,
    })
}

/// A message that begins with a key's path, with the place where the file says it.
fn placed(message: &str, text: &str, name: &str, replaced: &[&str]) -> String {
    let path = message.split([' ', ':']).next().unwrap_or_default();
    let from_file = !replaced.iter().any(|r| path.starts_with(r) || r.starts_with(path));
    match outline(text).filter(|_| from_file && keys::status(path).is_some()) {
        Some(root) => {
            let (line, column) = line_and_column(text, root.find(path.split('.')));
            format!("{name}:{line}:{column}: {message}")
        }
        None => message.to_owned(),
    }
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
            at("4:26") + "timing.pairs.count = 0",
            at("4:17") + "timing.pairs.dt_s = 0",
        ];
        let found = problems(&[]);
        assert_eq!(found.lines().count(), 3, "{found}");
        assert!(found.lines().zip(&expected).all(|(f, e)| f.starts_with(e)), "{found}");
        let set = problems(&["timing.pairs.count=2".to_owned(), "timing.pairs.dt_s=-1".to_owned()]);
        assert!(set.contains("\ntiming.pairs.dt_s = -1"), "{set}");
    }
}
