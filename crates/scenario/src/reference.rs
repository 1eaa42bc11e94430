//! Documentation of the scenario language, generated from the schema: `microsig new` and `docs/scenario.md`.

use std::path::Path;

use serde_json::Value;

use super::language::document::{self, Picture};
use super::language::template;
use super::spec::schema as scenario;
use super::{parse, resolve};
use storage::error::{Error, Result};

/// The scenario whose defaults are documented.
const FIVE_LINES: &str = r#"(
    name: "mine",
    motion: flow(field: poiseuille()),
    timing: pairs(count: 10),
)"#;

/// The five lines with every default filled in.
fn filled() -> Result<Value> {
    let spec = resolve(parse(FIVE_LINES, "five lines")?, Path::new("."))?.spec;
    serde_json::to_value(&spec).map_err(|e| Error::input(e.to_string()))
}

/// A commented scenario to start from.
///
/// # Errors
/// None: the tests exclude them.
pub fn template() -> Result<String> {
    let header = "A scenario: what is imaged, through which optics, and when. Everything but `name`, `motion` and `timing` may \
                  be left out. Values are the defaults; what is commented out is off or follows from other keys.";
    Ok(template::template(scenario(), &filled()?, header))
}

/// The text of `docs/scenario.md`.
///
/// # Errors
/// A picture of a key that does not exist.
pub fn document(pictures: &[Picture]) -> Result<String> {
    if let Some(stray) = pictures.iter().find(|picture| scenario().find(&picture.key).is_none()) {
        return Err(Error::input(format!("docs/scenario/pictures.ron: unknown key `{}`", stray.key)));
    }
    let header = format!(
        "# Every key of a scenario\n\n\
         Made by `cargo xtask figures keys`; `microsig new mine.ron` writes a commented scenario to start from, \
         `microsig schema` the same as JSON Schema. Scenarios are written in RON, or in JSON by programs (a file that ends with \
         `.json`; `count(46)` is `{{\"count\": 46}}`).\n\n\
         Keys are written as paths: `optics.gain` is `optics: (gain: 3.2)` in the file and `--set optics.gain=3.2` on the \
         command line. A step in *italics* is a choice: `particles.number.`*`count`* is `number: count(46)`. A default of \u{2013} \
         means that the effect is off. Five lines are a whole scenario:\n\n\
         ```ron\n{FIVE_LINES}\n```\n\n\
         Pictures show, on one gray scale (square roots of counts), three particles of 2 um at z = -70, -25 and +15 um under \
         setting 1 unless they say otherwise: a ring far below focus, a spot in focus, a halo above.\n"
    );
    Ok(document::document(scenario(), &filled()?, &header, pictures))
}

#[cfg(test)]
mod tests {
    use super::super::spec::Spec;
    use super::*;

    /// If this fails, run it with `UPDATE_DOCS=1`; `cargo xtask figures keys` draws the pictures.
    #[test]
    fn the_document_is_up_to_date() {
        let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs");
        let pictures =
            Picture::list(&std::fs::read_to_string(docs.join("scenario/pictures.ron")).unwrap()).unwrap();
        let expected = document(&pictures).unwrap();
        if std::env::var_os("UPDATE_DOCS").is_some() {
            std::fs::write(docs.join("scenario.md"), &expected).unwrap();
        }
        let found = std::fs::read_to_string(docs.join("scenario.md")).unwrap();
        let differ = expected.lines().zip(found.lines()).find(|(e, f)| e != f);
        assert!(
            expected == found,
            "docs/scenario.md is out of date, run this test with UPDATE_DOCS=1: {differ:?}"
        );
        for picture in pictures {
            let file = docs.join("scenario").join(picture.file());
            assert!(file.is_file(), "{}: run `cargo xtask figures keys`", file.display());
        }
    }

    /// The lines that are not commented out give the same scenario as the five lines.
    #[test]
    fn the_template_has_the_defaults() {
        let spec = |text: &str| resolve(parse(text, "s.ron").unwrap(), Path::new(".")).unwrap().spec;
        let template = template().unwrap();
        let (template, five): (Spec, Spec) = (spec(&template), spec(FIVE_LINES));
        assert_eq!(template, five);
    }

    /// The lines that are commented out are valid, too: each is a key with a value that fits.
    #[test]
    fn the_template_can_be_uncommented() {
        let is_key = |line: &str| {
            let line = line.trim_start().trim_start_matches("// ");
            let key = line.split([':', '(', ')', ',']).next().unwrap_or_default();
            line.starts_with(')')
                || scenario().keys().iter().any(|(path, e)| {
                    e.name == key
                        && !path.is_empty()
                        && line[key.len()..].starts_with(": ")
                        && line.ends_with([',', '('])
                })
        };
        let template = template().unwrap();
        let lines = template
            .lines()
            .map(|line| if is_key(line) { line.replacen("// ", "", 1) } else { line.to_owned() });
        let text = lines.collect::<Vec<_>>().join("\n");
        let spec = parse(&text, "template").unwrap_or_else(|e| panic!("{e}\n{text}"));
        assert!(spec.sensor.is_some() && spec.illumination.is_some() && spec.optics.gaussian.is_some());
    }
}
