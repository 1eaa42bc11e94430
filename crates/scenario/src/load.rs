//! Reads scenario files.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Arc;

use flows::fields::UniformParams;
use microsig_core::problem::{Place, Problem, Problems, Source};

use microsig_core::render::Context;

use super::language::graft::{assigned, graft};
use super::language::text::{Content, Node};
use super::language::write::write;
use super::language::{text, typed};
use super::resolve::resolve;
use super::resolved::Scenario;
use super::source::{ScenarioText, read_text};
use super::spec::{Motion, Spec, schema as scenario};
use storage::dataset::secret;
use storage::{Error, InputFile, Result};

/// The resolved scenario in a dataset's folder.
pub const SCENARIO: &str = "scenario.ron";

/// Reads a scenario from a text; `name` is its name in messages. Errors: [`Error::Problems`] with line and
/// column of every error: syntax, unknown keys, values of the wrong type or out of range.
pub fn parse(text: &str, name: &str) -> Result<Spec> {
    let (tree, mut problems) = (tree(&Arc::new(Source::file(name, text)))?, Problems::default());
    match typed(scenario(), &tree, &mut problems) {
        Some(spec) if !problems.any() => Ok(spec),
        _ => Err(Error::Problems(problems.sorted())),
    }
}

/// The tree of a scenario that a program has put together; as RON, because JSON has no NaN and no infinity.
fn tree_of(spec: &Spec) -> Result<Node> {
    let source = Arc::new(Source::file("scenario", &write(spec)?));
    text::parse(&source).map_err(|problem| Error::Problems(vec![Problem { place: None, ..problem }]))
}

fn tree(source: &Arc<Source>) -> Result<Node> {
    let begins = source.text.trim_start().starts_with(['(', '{', '/', '#']);
    let hint = (!begins).then(|| "a scenario begins with `(` in RON, with `{` in JSON".to_owned());
    let tree = text::parse(source).map_err(|problem| Error::Problems(vec![problem.hinted(hint)]))?;
    let (name, is_written) = (&source.name, |key| tree.find(key).1);
    if is_written("axes") && !is_written("motion") {
        return Err(Error::input(format!(
            "{name}: is a sweep; run `microsig sweep {name}` to generate its datasets"
        )));
    }
    if is_written("tracks") && !is_written("motion") {
        return Err(Error::input(format!(
            "{name}: is a suite; run `microsig suite generate {name}` to generate its datasets"
        )));
    }
    if !matches!(tree.content, Content::Fields(_)) {
        let message = "expected a scenario: (name: ..., motion: ..., timing: ...)";
        return Err(Error::Problems(vec![Problem::other("", message).at(&tree.place)]));
    }
    Ok(tree)
}

/// Reads and resolves the scenario in a file, or the shipped one of this name, after replacing values by
/// `assignments` and its seed by `seed`. Its renderers keep their tables where `context` says. Errors:
/// [`Error::Problems`] with all problems of text, assignments and values. Constraints between values are
/// checked as far as the values can be read.
pub fn load(
    file: impl Into<InputFile>,
    assignments: &[Assignment],
    seed: Option<u64>,
    context: &Context,
) -> Result<Scenario> {
    // Files that a scenario refers to are read when it is resolved.
    let found = ScenarioText::open(file)?;
    load_text(&found.text, (&found.name, &found.folder), assignments, seed, context)
}

/// [`load`] for a text, with its name in messages and the folder that paths in it are relative to.
pub fn load_text(
    text: &str,
    place: (&str, &Path),
    assignments: &[Assignment],
    seed: Option<u64>,
    context: &Context,
) -> Result<Scenario> {
    Parsed::new(text, place)?.resolve(assignments, seed, context)
}

/// A scenario's text as a tree, from which scenarios with other values are resolved.
#[derive(Debug)]
pub struct Parsed {
    tree: Node,
    folder: PathBuf,
}

impl Parsed {
    /// Parses a text with its name in messages and the folder that paths in it are relative to. Errors:
    /// [`Error::Problems`] with the first error of syntax.
    pub fn new(text: &str, (name, folder): (&str, &Path)) -> Result<Self> {
        Ok(Parsed { tree: tree(&Arc::new(Source::file(name, text)))?, folder: folder.to_owned() })
    }

    /// [`load`] of this text.
    pub fn resolve(
        &self,
        assignments: &[Assignment],
        seed: Option<u64>,
        context: &Context,
    ) -> Result<Scenario> {
        let (mut tree, mut problems) = (self.tree.clone(), Problems::default());
        for Assignment { path, value } in assignments {
            match assigned(scenario(), path, value)
                .and_then(|value| graft(tree.clone(), scenario(), path, value))
            {
                Ok(changed) => tree = changed,
                Err(problem) => problems.push(problem),
            }
        }
        resolve_tree(&tree, problems, (&self.folder, seed, context))
    }
}

fn resolve_tree(
    tree: &Node,
    mut problems: Problems,
    (folder, seed, context): (&Path, Option<u64>, &Context),
) -> Result<Scenario> {
    let spec = typed::<Spec>(scenario(), tree, &mut problems);
    // Without a value that was to be assigned, other values may only seem to be wrong.
    let is_assigned = |problem: &Problem| problem.place.as_ref().is_some_and(|place| !place.source.is_file);
    let Some(mut spec) = spec.filter(|_| !problems.0.iter().any(is_assigned)) else {
        return Err(Error::Problems(problems.sorted()));
    };
    spec.seed = seed.unwrap_or(spec.seed);
    let found = match resolve(spec, folder, context) {
        Ok(scenario) if !problems.any() => return Ok(scenario),
        Err(Error::Problems(found)) => found,
        Err(other) if !problems.any() => return Err(other),
        _ => Vec::new(),
    };
    let is_within =
        |a: &str, b: &str| a.strip_prefix(b).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'));
    let related = |a: &str, b: &str| is_within(a, b) || is_within(b, a);
    let read = problems.0.clone();
    for problem in found {
        let (place, is_written) = tree.find(&problem.path);
        // Values that cannot be read are replaced by defaults; problems of these defaults are dropped.
        let matters = is_written
            && !problem.path.is_empty()
            && !read.iter().any(|p| !p.path.is_empty() && related(&p.path, &problem.path));
        let is_key = scenario().find(&problem.path).is_some();
        if read.is_empty() || matters {
            problems.push(if is_key { problem.at(&place) } else { problem });
        }
    }
    Err(Error::Problems(problems.sorted()))
}

/// The resolved scenario of a dataset, with its secret random numbers if it has their key, and its text. Errors: a missing
/// file; a malformed key; [`Error::Problems`] for a scenario that this version cannot read.
pub fn of_dataset(dataset: &Path, context: &Context) -> Result<(Scenario, String)> {
    let path = dataset.join(SCENARIO);
    let text = read_text(&path)?;
    let mut scenario = resolve(parse(&text, &path.display().to_string())?, dataset, context)?;
    if let Some(streams) = secret::streams(dataset)? {
        scenario.streams = streams;
    }
    Ok((scenario, text))
}

/// Checks and resolves a scenario that a program has put together: its values have the ranges of a scenario
/// file. Errors: [`Error::Problems`] with all values that are out of range or contradict each other.
pub fn build(spec: Spec, folder: &Path, context: &Context) -> Result<Scenario> {
    let (motion, still) = match spec.motion {
        Motion::Own(field) => (Some(Motion::Own(field)), UniformParams::default().into()),
        listed => (None, listed),
    };
    let (tree, mut problems) = (tree_of(&Spec { motion: still, ..spec })?, Problems::default());
    let Some(read) = typed::<Spec>(scenario(), &tree, &mut problems).filter(|_| !problems.any()) else {
        let unplaced = |problem| Problem { place: None, ..problem };
        return Err(Error::Problems(problems.sorted().into_iter().map(unplaced).collect()));
    };
    let motion = motion.unwrap_or_else(|| read.motion.clone());
    resolve(Spec { motion, ..read }, folder, context)
}

/// The scenario with the value at `path` replaced. Errors: [`Error::Problems`] if the path does not exist or
/// the value does not fit its key.
pub fn set(spec: &Spec, path: &str, value: &str) -> Result<Spec> {
    let whole = Arc::new(Source::assignment(path, value));
    let whole = Place { span: whole.value_at..whole.text.len(), source: whole };
    let (base, mut problems) = (tree_of(spec)?, Problems::default());
    let changed = assigned(scenario(), path, value).and_then(|value| graft(base, scenario(), path, value));
    let changed = changed.map_err(|problem| problems.push(problem)).ok();
    match changed.and_then(|tree| typed(scenario(), &tree, &mut problems)) {
        Some(spec) if !problems.any() => Ok(spec),
        _ => {
            // Other values have no place that the user knows.
            let is_own = |p: &Problem| p.place.as_ref().is_some_and(|place| !place.source.is_file);
            let problems = problems.sorted().into_iter();
            Err(Error::Problems(problems.map(|p| if is_own(&p) { p } else { p.at(&whole) }).collect()))
        }
    }
}

/// A key of a scenario and its new value, written as in a scenario.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Assignment {
    /// Path of the key, such as `optics.gain`.
    pub path: String,
    /// The value.
    pub value: String,
}

impl Assignment {
    /// Parses texts `path=value`.
    pub fn all(texts: &[String]) -> Result<Vec<Self>> {
        texts.iter().map(|text| text.parse()).collect()
    }
}

impl FromStr for Assignment {
    type Err = Error;

    /// Reads `path=value`. Errors: a text without path, equals sign or value.
    fn from_str(text: &str) -> Result<Self> {
        text.split_once('=')
            .map(|(path, value)| (path.trim(), value.trim()))
            .filter(|(path, value)| !path.is_empty() && !value.is_empty())
            .map(|(path, value)| Assignment { path: path.to_owned(), value: value.to_owned() })
            .ok_or_else(|| Error::input(format!("`{text}`: expected path=value")))
    }
}

impl fmt::Display for Assignment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}={}", self.path, self.value)
    }
}

#[cfg(test)]
mod tests {
    use super::super::spec::{Diameter, Field, Number, Optics, Pairs, Preset, Sensor, Timing};
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

    /// The messages for a file with this text, one per line, without the folder.
    fn problems(text: &str, set: &[&str]) -> Vec<String> {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("s.ron");
        std::fs::write(&file, text).unwrap();
        let set: Vec<Assignment> = set.iter().map(|set| set.parse().unwrap()).collect();
        let found = load(&file, &set, None, &Context::default()).unwrap_err().to_string();
        found.replace(&file.display().to_string(), "s.ron").lines().map(str::to_owned).collect()
    }

    fn assert_begin(found: &[String], expected: &[&str]) {
        assert_eq!(found.len(), expected.len(), "{found:#?}");
        for (found, expected) in found.iter().zip(expected) {
            assert!(found.starts_with(expected), "expected {expected}\nfound    {found}");
        }
    }

    #[test]
    fn what_is_written_is_read_back() {
        let spec = parse(GOOD, "s.ron").unwrap();
        let text = write(&spec).unwrap();
        assert_eq!(parse(&text, "s.ron").unwrap(), spec);
        assert_eq!(write(&parse(&text, "s.ron").unwrap()).unwrap(), text);
    }

    #[test]
    fn numbers_of_a_program_that_are_not_finite_are_refused_like_those_of_a_file() {
        let spec = parse(GOOD, "s.ron").unwrap();
        let Timing::Pairs(pairs) = spec.timing else { panic!() };
        let timing = Timing::Pairs(Pairs { dt_s: f64::NAN, ..pairs });
        let optics = Optics { gain: Some(f64::INFINITY), ..spec.optics.clone() };
        let error = build(Spec { timing, optics, ..spec.clone() }, Path::new("."), &Context::default())
            .unwrap_err()
            .to_string();
        assert_begin(
            &error.lines().map(str::to_owned).collect::<Vec<_>>(),
            &["optics.gain = inf: expected a number, 0 to 1e6", "timing.pairs.dt_s = NaN: expected a number"],
        );
        // Infinity where a file may have it.
        let sensor = Some(Sensor { full_well_e: f64::INFINITY, ..Sensor::default() });
        assert!(build(Spec { sensor, ..spec }, Path::new("."), &Context::default()).is_ok());
    }

    #[test]
    fn json_is_read_like_ron() {
        let json = r#"{
            "name": "test", "seed": 18446744073709551615,
            "optics": {"preset": "setting1a", "settings": null},
            "sensor": {"full_well_e": null, "bits": 12},
            "motion": {"flow": {"field": {"sum": [{"poiseuille": {"walls_z_um": [-80, 20]}}, {"hill": {"axis": "y"}}]}}},
            "particles": {"number": {"ppp": 0.001}, "diameter_um": {"list": [[2, 1], [1, 3]]}},
            "boundaries": {"z_um": [-70, 10], "x": "periodic"},
            "timing": {"pairs": {"count": 2}}
        }"#;
        let ron = r#"(
            name: "test", seed: 18446744073709551615,
            optics: (preset: setting1a),
            sensor: (full_well_e: inf, bits: 12),
            motion: flow(field: sum([poiseuille(walls_z_um: (-80, 20)), hill(axis: y)])),
            particles: (number: ppp(0.001), diameter_um: list([(2, 1), (1, 3)])),
            boundaries: (z_um: (-70, 10), x: periodic),
            timing: pairs(count: 2),
        )"#;
        let spec = parse(json, "s.json").unwrap();
        assert_eq!(typed(scenario(), &tree_of(&spec).unwrap(), &mut Problems::default()), Some(spec.clone()));
        assert_eq!(spec, parse(ron, "s.ron").unwrap());
        // JSON written by serde also fits the schema.
        assert_eq!(parse(&serde_json::to_string(&spec).unwrap(), "s.json").unwrap(), spec);
    }

    #[test]
    fn older_spellings_are_read() {
        let text = GOOD.replace(
            "timing",
            "boundaries: (bodies: [sphere(centre_um: (0, 0, -30), radius_um: 5)]), timing",
        );
        let spec = parse(&text, "s.ron").unwrap();
        assert_eq!(spec, parse(&text.replace("centre", "center"), "s.ron").unwrap());
        assert_eq!(spec.boundaries.bodies.len(), 1);
        let set = set(&spec, "boundaries.bodies.0.sphere.centre_um", "(1, 2, 3)").unwrap();
        assert!(write(&set).unwrap().contains("center_um: (1.0, 2.0, 3.0)"));
    }

    #[test]
    fn all_unknown_keys_and_variants_are_reported_at_once_with_position_and_suggestion() {
        let text = GOOD
            .replace("max_speed_um_s", "max_sped_um_s: 1, walls_z_um: (0, 1), max_speed_um_s")
            .replace("name:", "optics: (gian: 3), flavour: sweet,\nname:")
            .replace("timing", "boundaries: (x: opne, bodies: [sphere(radius: 3)], z_mu: (1, 2)), timing")
            .replace("count: 2", "count: two");
        let (code, message) = refuse(&text);
        assert_eq!(code, 2);
        let expected = [
            "s.ron:2:18: unknown key `optics.gian`; did you mean `gain`?",
            "s.ron:2:28: unknown key `flavour`; expected one of name, description, license, seed, optics, sensor, motion, particles, boundaries, timing, illumination, render, image_format, truth, truth_grid, calibration, scoring",
            "s.ron:4:40: unknown key `motion.flow.field.poiseuille.max_sped_um_s`; did you mean `max_speed_um_s`?",
            "s.ron:5:25: boundaries.x: unknown variant `opne`: did you mean `open`? expected one of open, wall, periodic",
            "s.ron:5:46: boundaries.bodies.0.sphere: `center_um` is missing",
            "s.ron:5:47: unknown key `boundaries.bodies.0.sphere.radius`; did you mean `radius_um`?",
            "s.ron:5:60: unknown key `boundaries.z_mu`; did you mean `z_um`?",
            "s.ron:5:96: timing.pairs.count = two: expected a whole number, 1 to 5e6",
        ];
        assert_eq!(message.lines().collect::<Vec<_>>(), expected);
    }

    #[test]
    fn all_values_of_the_wrong_type_or_out_of_range_are_reported_at_once() {
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
            "s.ron:2:35: optics.gain = \"high\": expected a number, 0 to 1e6",
            "s.ron:2:51: optics.n_rays = 2.5: expected a whole number, 1 to 1e6",
            "s.ron:3:56: motion.flow.field.poiseuille.max_speed_um_s = fast: expected a finite number, in um/s",
            "s.ron:4:15: seed = -1: expected a whole number >= 0",
            "s.ron:5:28: particles.c_int.uniform: `max` is missing",
            "s.ron:5:52: timing.pairs: `count` is missing",
            "s.ron:5:59: timing.pairs.dt_s = soon: expected a number > 0 and <= 1e9 s",
        ];
        assert_eq!(message.lines().collect::<Vec<_>>(), expected);
    }

    #[test]
    fn errors_of_syntax_and_type_give_position_path_and_what_was_found() {
        for (from, to, expected) in [
            (
                "1000",
                "\"fast\"",
                "s.ron:3:56: motion.flow.field.poiseuille.max_speed_um_s = \"fast\": expected a finite number",
            ),
            ("1000", "inf", "motion.flow.field.poiseuille.max_speed_um_s = inf: expected a finite number"),
            ("poiseuille", "poisseuille", "did you mean `poiseuille`?"),
            ("count: 2", "count: -2", "timing.pairs.count = -2: expected a whole number, 1 to 5e6"),
            ("count: 2", "count: 2, count: 3", "timing.pairs: `count` is given a second time"),
            ("\"test\"", "test", "s.ron:2:15: name = test: expected a string in quotes"),
            ("timing: pairs(count: 2),", "", "`timing` is missing"),
            (
                "timing:",
                "particles: (diameter_um: uniform(1.5, 2.5)), timing:",
                "particles.diameter_um.uniform = (1.5, 2.5): expected named values in parentheses, such as (min: ..., max: ...)",
            ),
            (
                "timing:",
                "boundaries: (z_um: 3), timing:",
                "boundaries.z_um = 3: expected 2 values in parentheses",
            ),
            (
                "timing:",
                "boundaries: (z_um: (3, red)), timing:",
                "boundaries.z_um.1 = red: expected a number",
            ),
            (
                "timing:",
                "boundaries: (bodies: [1]), timing:",
                "boundaries.bodies.0 = 1: expected one of sphere",
            ),
            ("timing:", "license: \"MIT\", timing:", "license = \"MIT\": expected one of CC-BY-4.0, "),
            (
                "timing:",
                "particles: (number: 5), timing:",
                "particles.number = 5: expected one of count, ppp, per_um3, n_s, file; write `count(46)`, for example",
            ),
            (
                "timing:",
                "render: (mode: waves, wavelength_um: 520), timing:",
                "render.wavelength_um = 520: expected a number, 0.1 to 2 um; 520 nm is 0.52 um",
            ),
            ("timing:", "calibration: none(3), timing:", "calibration.none = 3: expected nothing"),
            (
                "timing:",
                "optics: (pixel_size: 6.5e-6), timing:",
                "optics.pixel_size = 6.5e-6: expected a number, 0.05 to 1000 um; 6.5e-6 m is 6.5 um",
            ),
        ] {
            let message = refuse(&GOOD.replace(from, to)).1;
            assert!(message.contains(expected), "{to}: {message}");
            assert_eq!(message.lines().count(), 1, "{message}");
        }
        for text in ["(name: \"a\"", "", "\u{feff}", "P5 752 366", "a = 3\nb = 4", "[package]\nname = 3"] {
            let message = refuse(text).1;
            assert!(message.starts_with("s.ron:") && message.contains(": expected "), "{text}: {message}");
            assert!(!message.contains("Spec"), "{message}");
        }
        let deep = format!("(name: {}", "(".repeat(1000));
        assert!(refuse(&deep).1.contains("expected at most 100 nested brackets"));
    }

    #[test]
    fn a_problem_is_shown_with_its_line_and_a_caret() {
        let error = parse(&GOOD.replace("1000", "fast"), "s.ron").unwrap_err();
        let expected = "\
s.ron:3:56: motion.flow.field.poiseuille.max_speed_um_s = fast: expected a finite number, in um/s
  |
3 |         motion: flow(field: poiseuille(max_speed_um_s: fast)),
  |                                                        ^^^^";
        assert_eq!(error.messages(), [expected]);
    }

    #[test]
    fn invalid_values_from_the_file_have_a_position() {
        let text = "(\n  name: \"Mine\",\n  motion: flow(field: poiseuille()),\n  timing: pairs(dt_s: 0, count: 0),\n)\n";
        let expected = [
            "s.ron:2:3: name = `Mine`: expected 1 to 100 lower-case",
            "s.ron:4:23: timing.pairs.dt_s = 0: expected a number > 0",
            "s.ron:4:33: timing.pairs.count = 0: expected a whole number, 1 to",
        ];
        assert_begin(&problems(text, &[]), &expected);
        let set = problems(text, &["timing.pairs.count=2", "timing.pairs.dt_s=-1", "name=other"]);
        assert_begin(&set, &["timing.pairs.dt_s=-1: expected a number > 0 and <= 1e9 s"]);
    }

    #[test]
    fn unreadable_values_do_not_hide_values_out_of_range() {
        let text = "(\n  name: \"Mine\", colour: red,\n  optics: (gain: high, n_rays: 0),\n  motion: flow(field: poiseuille()),\n  timing: pairs(dt_s: 1, count: two),\n)\n";
        let expected = [
            "s.ron:2:3: name = `Mine`: expected 1 to 100 lower-case",
            "s.ron:2:17: unknown key `colour`",
            "s.ron:3:18: optics.gain = high: expected a number",
            "s.ron:3:32: optics.n_rays = 0",
            "s.ron:5:33: timing.pairs.count = two: expected a whole number",
        ];
        assert_begin(&problems(text, &[]), &expected);
        // Without the rules that look at several values.
        let set = [&["seed=x: expected a whole number"][..], &expected[1..]].concat();
        assert_begin(&problems(text, &["seed=x"]), &set);
    }

    #[test]
    fn problems_of_one_section_do_not_hide_those_of_another() {
        let text = "(name: \"m\", motion: flow(field: poiseuille()), timing: pairs(count: 1),\n\
            optics: (n_rays: 0),\n\
            sensor: (bits: 9),\n\
            truth_grid: grid(spacing_px: 0),\n\
            boundaries: (margin_px: -3),\n\
            render: (mode: expected, tolerance: 5),\n\
            particles: (settling: (direction: (0, 0, 0))),\n\
)\n";
        let expected = [
            "s.ron:2:18: optics.n_rays = 0",
            "s.ron:3:16: sensor.bits = 9: expected a whole number, one of 8, 10, 12, 14, 16",
            "s.ron:4:30: truth_grid.grid.spacing_px = 0: expected a number, 0.1 to 1e5 px",
            "s.ron:5:25: boundaries.margin_px = -3",
            "s.ron:6:37: render.tolerance = 5",
            "s.ron:7:24: particles.settling.direction = ",
        ];
        assert_begin(&problems(text, &[]), &expected);
    }

    fn spec() -> Spec {
        parse(
            &GOOD.replace("name", "optics: (preset: setting1), name").replace("test", "a, (b)\\\" c"),
            "s.ron",
        )
        .unwrap()
    }

    #[test]
    fn values_are_replaced_added_and_switched() {
        let spec = spec();
        let changed = |path, value| set(&spec, path, value).unwrap();
        assert_eq!(changed("seed", "7").seed, 7);
        assert_eq!(changed("name", "\"b\"").name, "b");
        assert_eq!(changed("name", "b").name, "b");
        assert_eq!(changed("optics.preset", "setting2").optics.preset, Some(Preset::Setting2));
        assert_eq!(changed("optics.background_noise", "50").optics.background_noise, Some(50.0));
        assert_eq!(changed("particles.number.ppp", "0.001").particles.number, Some(Number::Ppp(0.001)));
        assert_eq!(changed("particles.number", "count(3)").particles.number, Some(Number::Count(3)));
        assert_eq!(
            changed("particles.diameter_um.constant", "3").particles.diameter_um,
            Some(Diameter::Constant(3.0))
        );
        assert_eq!(changed("boundaries.z_um", "(-10, 10)").boundaries.z_um, Some((-10.0, 10.0)));
        assert_eq!(changed("boundaries.z_um", "[-10, 10]").boundaries.z_um, Some((-10.0, 10.0)));
        let Timing::Pairs(pairs) = changed("timing.pairs.count", "9").timing else { panic!() };
        assert_eq!(pairs.count, 9);
        let Timing::Sequence(sequence) = changed("timing.sequence.frames", "5").timing else { panic!() };
        assert_eq!(sequence.frames, 5);
        let flow = |path, value| match changed(path, value).motion {
            Motion::Flow(flow) => flow,
            other => panic!("{other:?}"),
        };
        let flow_of = flow("motion.flow.field.poiseuille.direction_rad", "0.5");
        let Field::Poiseuille(p) = flow_of.field else { panic!() };
        assert_eq!((p.max_speed_um_s, p.direction_rad), (Some(1000.0), 0.5));
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
        assert!(matches!(&parts[..], [Field::Poiseuille(p), Field::Abc(_)] if p.max_speed_um_s == Some(5.0)));
        let times = set(&spec, "motion.flow.field", "gridded(file: \"x.npy\", geometry: (times_s: ()))");
        assert!(times.is_ok(), "{times:?}");
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
    fn a_wrong_assignment_comes_first_and_without_what_may_follow_from_it() {
        let set = ["optics.gain=red".parse().unwrap()];
        let said = |text: &str| {
            let loaded = load_text(text, ("s.ron", Path::new(".")), &set, None, &Context::default());
            loaded.unwrap_err().to_string()
        };
        let wrong = "optics.gain=red: expected a number, 0 to 1e6";
        assert_eq!(said(&GOOD.replace("timing:", "boundaries: (z_um: (5, -5)), timing:")), wrong);
        let both = said(&GOOD.replace("timing:", "colour: 1, timing:"));
        assert!(both.starts_with(&format!("{wrong}\ns.ron:")) && both.contains("`colour`"), "{both}");
    }

    #[test]
    fn invalid_paths_and_values_are_refused() {
        let refuse = |path, value| set(&spec(), path, value).unwrap_err().to_string();
        assert_eq!(
            refuse("optics.gian", "1"),
            "optics.gian=1: unknown key `optics.gian`; did you mean `gain`?"
        );
        assert_eq!(refuse("optics.gain", "red"), "optics.gain=red: expected a number, 0 to 1e6");
        assert!(refuse("optics.gain", "1, color: 2").contains("expected nothing after the value"));
        let missing = "sensor.hot_pixels.fraction=0.1: sensor.hot_pixels: `dark_e` is missing";
        assert_eq!(refuse("sensor.hot_pixels.fraction", "0.1"), missing);
        assert!(
            refuse("boundaries.bodies.3", "drain()")
                .contains("boundaries.bodies.3=drain(): the list has 0 values")
        );
        assert!(refuse("calibration.none", "3").contains("`none` takes no value"));
        assert!("seed".parse::<Assignment>().is_err());
        assert_eq!(" seed = 3 ".parse::<Assignment>().unwrap().to_string(), "seed=3");
    }
}
