//! Reading a scenario: RON to [`Spec`], with every unknown key reported at once.

use ron::extensions::Extensions;
use serde_json::Value;

use super::keys::{self, Status};
use super::spec::Spec;
use crate::error::{Error, Result};

/// How RON is read and written everywhere: `Some` need not be written, nor a variant's inner brackets.
pub(crate) fn options() -> ron::Options {
    ron::Options::default().with_default_extension(
        Extensions::IMPLICIT_SOME | Extensions::UNWRAP_VARIANT_NEWTYPES | Extensions::UNWRAP_NEWTYPES,
    )
}

/// Reads a scenario; `name` is what messages call it.
///
/// # Errors
/// [`Error::Input`] with line and column of what is no RON or has the wrong type, and with the path of every unknown
/// key; [`Error::Unsupported`] if all unknown keys are planned ones.
pub fn parse(text: &str, name: &str) -> Result<Spec> {
    let at = |e: ron::error::SpannedError| {
        let place = format!("{name}:{}:{}", e.span.start.line, e.span.start.col);
        match &e.code {
            ron::Error::NoSuchEnumVariant { expected, found, .. } => unknown_variant(&place, expected, found),
            code => Error::input(format!("{place}: {code}")),
        }
    };
    let mut unknown = Vec::new();
    let mut deserializer = ron::Deserializer::from_str_with_options(text, &options()).map_err(at)?;
    let spec: Spec = serde_ignored::deserialize(&mut deserializer, |path| unknown.push(steps(&path)))
        .and_then(|spec| deserializer.end().map(|()| spec))
        .map_err(|e| at(deserializer.span_error(e)))?;
    if unknown.is_empty() {
        return Ok(spec);
    }
    let tree = serde_json::to_value(&spec).map_err(|e| Error::input(format!("{name}: {e}")))?;
    let (mut wrong, mut planned) = (Vec::new(), Vec::new());
    for path in unknown.iter().map(|steps| named(steps, &tree)) {
        if keys::status(&path) == Some(Status::Planned) {
            planned.push(not_yet(name, &path));
        } else {
            let hint = keys::suggestion(&path).map(|s| format!("; did you mean `{s}`?")).unwrap_or_default();
            wrong.push(format!("{name}: unknown key `{path}`{hint}"));
        }
    }
    if wrong.is_empty() {
        return Err(Error::Unsupported(planned));
    }
    wrong.append(&mut planned);
    Err(Error::Input(wrong))
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

fn not_yet(place: &str, what: &str) -> String {
    format!("{place}: `{what}` is valid but not supported yet")
}

fn unknown_variant(place: &str, expected: &[&str], found: &str) -> Error {
    let planned = |(path, status): &(String, Status)| {
        *status == Status::Planned && path.rsplit('.').next() == Some(found)
    };
    if keys::all().iter().any(planned) {
        return Error::Unsupported(vec![not_yet(place, found)]);
    }
    let nearest = expected
        .iter()
        .map(|e| (strsim::jaro_winkler(e, found), e))
        .filter(|&(likeness, _)| likeness > 0.75)
        .max_by(|a, b| a.0.total_cmp(&b.0));
    let hint = nearest.map(|(_, e)| format!("; did you mean `{e}`?")).unwrap_or_default();
    Error::input(format!("{place}: unknown variant `{found}`: expected one of {}{hint}", expected.join(", ")))
}

/// The steps of a path; `None` stands for an enum's variant, whose name serde_ignored does not tell.
fn steps(path: &serde_ignored::Path<'_>) -> Vec<Option<String>> {
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
    fn all_unknown_keys_are_named_at_once_with_suggestions() {
        let text = GOOD
            .replace("max_speed_um_s", "max_sped_um_s: 1, walls_z_um: (0, 1), max_speed_um_s")
            .replace("name:", "optics: (gian: 3, gaussian: (diameter_px: 2)), flavour: sweet, name:");
        let (code, message) = refuse(&text);
        assert_eq!(code, 2);
        for expected in [
            "unknown key `optics.gian`; did you mean `gain`?",
            "unknown key `motion.flow.field.poiseuille.max_sped_um_s`; did you mean `max_speed_um_s`?",
            "unknown key `flavour`",
            "`optics.gaussian` is valid but not supported yet",
        ] {
            assert!(message.contains(expected), "{message}");
        }
    }

    #[test]
    fn planned_keys_and_variants_say_so() {
        for (from, to) in [
            ("timing:", "illumination: sheet(thickness_um: 3), timing:"),
            ("flow(field: poiseuille(max_speed_um_s: 1000))", "tracks(file: \"t.csv\")"),
            ("count: 2", "count: 2, exposure_s: 0.001"),
        ] {
            let (code, message) = refuse(&GOOD.replace(from, to));
            assert!(code == 2 && message.contains("valid but not supported yet"), "{message}");
        }
    }

    #[test]
    fn faults_of_syntax_and_type_name_line_and_column() {
        assert!(refuse(&GOOD.replace("1000", "\"fast\"")).1.starts_with("s.ron:3:"));
        assert!(refuse(&GOOD.replace("poiseuille", "poisseuille")).1.contains("did you mean `poiseuille`?"));
        assert!(refuse("(name: \"a\"").1.starts_with("s.ron:1:"));
        assert!(refuse(&GOOD.replace("timing: pairs(count: 2),", "")).1.contains("`timing`"));
    }
}
