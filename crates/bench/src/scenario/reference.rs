//! The reference of all keys, for people: unit, default and meaning of each, and pictures of what it changes.
//!
//! Which keys there are is said in [`super::keys`]; what they mean is said here. Defaults are not said at all but found:
//! by filling in a scenario of five lines. `docs/scenario.md` is written from this (`cargo xtask figures keys`), and a test
//! compares.

use std::path::Path;

use flows::registry;
use microsig_core::KEYS as SETTINGS;

use super::effects::EFFECTS;
use super::keys::{self, FIELD, Status};
use super::meanings::MEANINGS;
use super::outline::outline;
use super::{parse, resolve, set, write};
use crate::error::{Error, Result};

/// The scenario whose defaults are told.
const FIVE_LINES: &str = r#"(name: "mine", motion: flow(field: poiseuille()), timing: pairs(count: 10))"#;

/// The whole of `docs/scenario.md`.
///
/// # Errors
/// [`Error::Input`] with every key that `MEANINGS` lacks or has too many.
pub fn document() -> Result<String> {
    complete()?;
    let mut text = String::from(HEADER);
    for (section, title, introduction) in SECTIONS {
        text += &format!(
            "\n## {title}\n\n{introduction}\n\n| key | unit | default | meaning |\n|---|---|---|---|\n"
        );
        let own = |path: &str| {
            path.split('.').next().is_some_and(|first| section.contains(&first)) && !is_of_field(path)
        };
        for (path, status) in keys::all().iter().filter(|(path, _)| own(path)) {
            text += &row(path, *status)?;
        }
        for effect in EFFECTS.iter().filter(|effect| own(effect.path)) {
            text += &format!(
                "\n`{}`: {}\n\n![{}](scenario/{})\n",
                effect.path,
                effect.caption,
                effect.path,
                effect.file()
            );
        }
    }
    text += "\n## Velocity fields\n\nWhat `motion.flow.field` may be. The [gallery](flows/README.md) draws each of them; \
             `microsig flows NAME` says the same.\n\n| key | unit | default | range | meaning |\n|---|---|---|---|---|\n";
    for (path, _) in keys::all().iter().filter(|(path, _)| is_of_field(path)) {
        text += &field_row(path)?;
    }
    Ok(text)
}

const HEADER: &str = "# Every key of a scenario\n\n\
    Made by `cargo xtask figures keys`; `microsig new mine.ron` writes a scenario with comments to start from.\n\n\
    Keys are written as paths: `optics.gain` is `optics: (gain: 3.2)` in the file and `--set optics.gain=3.2` on the command \
    line. A step in *italics* is a choice: `particles.number.`*`count`* is `number: count(46)`. A default of \u{2013} means that \
    the thing is not there, *required* that there is none. Five lines are a whole scenario:\n\n\
    ```ron\n(\n    name: \"mine\",\n    motion: flow(field: poiseuille()),\n    timing: pairs(count: 10),\n)\n```\n\n\
    Pictures show, on one grey scale (square roots of counts), three particles of 2 um at z = -70, -25 and +15 um under setting 1 unless they say \
    otherwise: a ring far below focus, a spot in focus, a halo above.\n";

/// First steps of the paths, title and introduction of each part.
const SECTIONS: &[(&[&str], &str, &str)] = &[
    (
        &["name", "description", "license", "seed", "randomness", "random"],
        "The scenario itself",
        "What the dataset is called, and where its random numbers come from.",
    ),
    (
        &["optics"],
        "Optics",
        "MicroSIG's 14 settings by their own names, from a preset, a settings file, or one by one.",
    ),
    (&["illumination"], "Illumination", "The light that falls on the particles."),
    (
        &["sensor"],
        "Camera",
        "A camera behind the optics. Left out, images have MicroSIG's own sensor: a constant background and Gaussian noise. \
         Every effect is off unless it is given.",
    ),
    (&["motion"], "Motion", "What moves the particles."),
    (
        &["particles"],
        "Particles",
        "How many of what kind, where at first, and what moves them besides the flow.",
    ),
    (
        &["boundaries"],
        "Boundaries",
        "The box that holds the particles: the image, a margin around it, the depth range.",
    ),
    (&["timing"], "Timing", "When frames are taken."),
    (&["render"], "Rendering", "How particles become images."),
    (&["truth_grid", "truth", "calibration"], "Truth and calibration", "What is written beside the images."),
];

fn is_of_field(path: &str) -> bool {
    path.strip_prefix(FIELD).is_some_and(|rest| rest.starts_with('.'))
}

/// Every key has a meaning and a part of the document, and nothing else has.
fn complete() -> Result<()> {
    let mut problems = Vec::new();
    for (path, _) in keys::all().iter().filter(|(path, _)| !is_of_field(path)) {
        match MEANINGS.iter().filter(|(key, ..)| key == path).count() {
            1 => {}
            n => problems.push(format!(
                "{path}: {n} lines in scenario/meanings.rs: expected 1; then `cargo xtask figures keys`"
            )),
        }
        let first = path.split('.').next().unwrap_or_default();
        if !SECTIONS.iter().any(|(section, ..)| section.contains(&first)) {
            problems.push(format!("{path}: in no section of scenario/reference.rs"));
        }
    }
    let unknown = |path: &&str| keys::status(path).is_none();
    let stray = EFFECTS.iter().map(|effect| effect.path).filter(unknown);
    problems.extend(stray.map(|path| format!("{path}: drawn but not in scenario/keys.rs")));
    if problems.is_empty() { Ok(()) } else { Err(Error::Input(problems)) }
}

fn row(path: &str, status: Status) -> Result<String> {
    let Some((_, unit, meaning)) = MEANINGS.iter().find(|(key, ..)| *key == path) else {
        return Ok(String::new());
    };
    let default = if status == Status::Key { default(path)? } else { String::new() };
    let of_microsig =
        path.strip_prefix("optics.").and_then(|name| SETTINGS.iter().find(|key| key.name == name));
    let unit = match (of_microsig, *unit) {
        (Some(key), _) => key.unit,
        (None, "") => unit_of(path),
        (None, unit) => unit,
    };
    let allowed = of_microsig.map(|key| format!("; {}", key.allowed)).unwrap_or_default();
    Ok(format!("| {} | {unit} | {default} | {}{} |\n", shown(path, status), cell(meaning), cell(&allowed)))
}

fn field_row(path: &str) -> Result<String> {
    let steps: Vec<&str> = path[FIELD.len() + 1..].split('.').collect();
    let entry = steps.first().and_then(|name| registry::find(name));
    let Some(entry) = entry else { return Ok(String::new()) };
    let key = steps[1..].join(".");
    Ok(match (steps.last(), key.is_empty()) {
        (_, true) => {
            format!("| **[{0}](flows/README.md#{0})** | | | | `{1}` |\n", entry.name, cell(entry.formula))
        }
        (Some(last), _) => match entry.parameters.iter().find(|p| p.name == *last) {
            Some(p) => format!(
                "| `{key}` | {} | {} | {} | {} |\n",
                unit_of(last),
                p.default_text(),
                cell(p.range),
                cell(p.meaning())
            ),
            None => format!("| `{key}` | {} | | | {} |\n", unit_of(last), field_key(last)),
        },
        _ => String::new(),
    })
}

/// Keys of fields that are no parameters of theirs.
fn field_key(name: &str) -> &'static str {
    match name {
        "walls_z_um" => "floor and ceiling; default: the depth range",
        "file" => "`.npy`, `.csv` or `.vtk` file with the velocities, relative to the scenario; required",
        "geometry" => "where the nodes of a `.npy` file are",
        "field" => "the field that is changed; required",
        "by" => "how it is changed",
        _ => "",
    }
}

fn cell(text: &str) -> String {
    text.replace('|', "\\|")
}

/// A path with its choices in italics.
fn shown(path: &str, status: Status) -> String {
    match path.rsplit_once('.') {
        Some((parent, last)) if status == Status::Variant => format!("`{parent}.`*`{last}`*"),
        _ => format!("`{path}`"),
    }
}

/// The unit in a key's name.
fn unit_of(path: &str) -> &'static str {
    const SUFFIXES: &[(&str, &str)] = &[
        ("_counts_per_e", "counts/e"),
        ("_um2_s3", "um\u{b2}/s\u{b3}"),
        ("_um2_s", "um\u{b2}/s"),
        ("_um3_s", "um\u{b3}/s"),
        ("_um_s2", "um/s\u{b2}"),
        ("_um_s", "um/s"),
        ("_rad_um", "rad/um"),
        ("_per_um3", "1/um\u{b3}"),
        ("per_um3", "1/um\u{b3}"),
        ("_um", "um"),
        ("_nm", "nm"),
        ("_px", "px"),
        ("_rad_s", "rad/s"),
        ("_rad", "rad"),
        ("_pa_s", "Pa s"),
        ("_kg_m3", "kg/m\u{b3}"),
        ("_per_s", "1/s"),
        ("_hz", "Hz"),
        ("_counts", "counts"),
        ("_e", "e"),
        ("_k", "K"),
        ("_s", "s"),
    ];
    // e_p is a ratio, not a number of electrons.
    let name = path.rsplit('.').next().unwrap_or(path);
    SUFFIXES.iter().find(|(suffix, _)| name.ends_with(suffix)).map_or("", |(_, unit)| unit)
}

/// The default of a key, as a cell: found by filling in a scenario that has the section around it and nothing more.
fn default(path: &str) -> Result<String> {
    let mut base = parse(FIVE_LINES, "five lines")?;
    for (section, value) in OPTIONAL.iter().filter(|(section, _)| path.starts_with(&format!("{section}."))) {
        base = set(&base, section, value)?;
    }
    let filled = resolve(base.clone(), Path::new(".")).map(|scenario| scenario.spec)?;
    if let Some(value) = written(&write(&filled)?, path) {
        // What the five lines say themselves is no default.
        let is_given =
            ["name", "motion", "timing", "timing.pairs.count", "motion.flow.field"].contains(&path);
        return Ok(if is_given { "*required*".to_owned() } else { value });
    }
    let Some((section, key)) = path.rsplit_once('.') else { return Ok("\u{2013}".to_owned()) };
    let is_variant = keys::status(section) == Some(Status::Variant);
    let (place, open) = match section.rsplit_once('.') {
        Some((parent, variant)) if is_variant => (parent, format!("{variant}(")),
        _ => (section, "(".to_owned()),
    };
    // Keys that must be there, and which of the examples each has by now.
    let mut required: Vec<(String, usize)> = Vec::new();
    for _ in 0..50 {
        let given: Vec<String> = required.iter().map(|(key, i)| format!("{key}: {}", EXAMPLES[*i])).collect();
        let value = format!("{open}{})", given.join(", "));
        let value = if place == "boundaries.bodies" { format!("[{value}]") } else { value };
        let refused = match set(&base, place, &value) {
            Ok(spec) => {
                let filled = resolve(spec.clone(), Path::new(".")).map_or(spec, |scenario| scenario.spec);
                let path = path.replace("boundaries.bodies.", "boundaries.bodies.0.");
                let is_required = required.iter().any(|(r, _)| r == key);
                let value = written(&write(&filled)?, &path).unwrap_or("\u{2013}".to_owned());
                return Ok(if is_required { "*required*".to_owned() } else { value });
            }
            Err(e) => e.to_string(),
        };
        let missing = refused.split_once("` is missing").and_then(|(before, _)| before.rsplit('`').next());
        match (missing, required.last_mut()) {
            (Some(missing), _) => required.push((missing.to_owned(), 0)),
            // The example has the wrong type.
            (None, Some((_, example))) if *example + 1 < EXAMPLES.len() => *example += 1,
            _ => break,
        }
    }
    // Its section needs values that cannot be guessed.
    Ok(String::new())
}

/// Optional sections that cannot be empty and hold others.
const OPTIONAL: &[(&str, &str)] = &[("particles.spheroids", "(e_p: 1)")];

/// Values of many types, to stand for what must be given.
const EXAMPLES: &[&str] =
    &["1", "\"a\"", "(1, 1)", "(1, 1, 1)", "poiseuille()", "[1]", "[(1, 1)]", "()", "true"];

/// The value of a path in a scenario that is written out, as a cell; nothing if it is long.
fn written(text: &str, path: &str) -> Option<String> {
    let root = outline(text)?;
    let node = root.value(path.split('.'))?;
    let value = text[node.span.clone()].split_whitespace().collect::<Vec<_>>().join(" ");
    let value = value.replace("( ", "(").replace(",)", ")").replace(", )", ")");
    Some(if value.len() > 40 || value.contains(": ") { String::new() } else { format!("`{value}`") })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// If this fails: a line for each key in scenario/meanings.rs, then `cargo xtask figures keys`.
    #[test]
    fn the_reference_is_that_of_the_keys_there_are() {
        let expected = document().unwrap();
        let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs");
        let found = std::fs::read_to_string(docs.join("scenario.md")).unwrap();
        let differ = expected.lines().zip(found.lines()).find(|(e, f)| e != f);
        assert!(expected == found, "docs/scenario.md is old, run `cargo xtask figures keys`: {differ:?}");
        for effect in EFFECTS {
            let picture = docs.join("scenario").join(effect.file());
            assert!(picture.is_file(), "{}: run `cargo xtask figures keys`", picture.display());
        }
    }
}
