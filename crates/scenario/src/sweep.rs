//! Sweeps: a scenario varied along axes.
//!
//! A case is the base scenario with one value per axis and a repetition number. Its seed is derived from
//! these values, not from its position in the list: adding or reordering values or splitting the sweep into
//! shards does not change other cases.

use std::borrow::Cow;
use std::path::Path;
use std::sync::{Arc, LazyLock};

use microsig_core::problem::{Problem, Problems, Source};
use schemars::{JsonSchema, Schema as JsonSchemaValue, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::language::derive::schema_of;
use super::language::graft::{assigned, graft};
use super::language::schema::Schema;
use super::language::text::{self, Node};
use super::language::typed;
use super::spec::{Spec, schema as scenario};
use super::{parse, read_text, set};
use storage::error::{Error, Result};

/// Maximum number of cases of a sweep; more are almost certainly a mistake.
const MAX_CASES: usize = 1_000_000;

/// Maximum number of values of an axis that are checked before any case is run.
const MAX_CHECKED: usize = 1000;

/// The sweep file as a Rust struct: a scenario that is varied along axes.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
pub struct SweepSpec {
    /// Name of the sweep and of its folder.
    #[schemars(example = &"stand-in")]
    pub name: String,
    /// Purpose of the sweep.
    #[serde(default)]
    pub description: String,
    /// The scenario that is varied: a file, relative to the sweep file.
    #[schemars(example = &"")]
    pub base: String,
    /// The keys that are varied.
    #[schemars(example = Vec::<Axis>::new())]
    pub axes: Vec<Axis>,
    /// How the axes are combined.
    #[serde(default)]
    pub combine: Combine,
    /// Datasets per combination of values, each with its own seed.
    #[serde(default = "one")]
    #[schemars(range(min = 1, max = MAX_CASES))]
    pub repetitions: u32,
    /// Seed from which the seeds of the cases are derived.
    #[serde(default)]
    pub seed: u64,
}

/// The schema of sweep files.
fn sweep_schema() -> Schema<'static> {
    static ROOT: LazyLock<Value> = LazyLock::new(schema_of::<SweepSpec>);
    Schema::root(&ROOT)
}

fn one() -> u32 {
    1
}

/// A key and its values.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
pub struct Axis {
    /// Path of a key of the scenario.
    pub path: String,
    /// Its values.
    pub values: Values,
}

/// Values of an axis.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Values {
    /// The given values, each written as in a scenario.
    List(#[schemars(length(min = 1))] Vec<Written>),
    /// Values with equal steps.
    Linear(Span),
    /// Values with equal ratios.
    Log(Span),
}

/// A range of numbers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Span {
    /// The first number.
    pub from: f64,
    /// The last number.
    pub to: f64,
    /// Number of values, including both ends.
    #[schemars(range(min = 1, max = MAX_CASES))]
    pub count: u32,
}

/// A value as written in a scenario, kept as text because its type depends on the path.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Written(pub String);

impl JsonSchema for Written {
    fn schema_name() -> Cow<'static, str> {
        "Value".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> JsonSchemaValue {
        json_schema!({ "description": "A value that fits the path." })
    }
}

/// How axes are combined.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Combine {
    /// All combinations of the values; the last axis varies fastest.
    #[default]
    Product,
    /// The first values together, then the second values, and so on.
    Zip,
}

/// A valid sweep and its cases.
#[derive(Debug, Clone)]
pub struct Sweep {
    /// The sweep file.
    pub spec: SweepSpec,
    /// The base scenario, not yet resolved.
    pub base: Spec,
    /// Every case, in order.
    pub cases: Vec<Case>,
}

/// One case of a sweep.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Case {
    /// Its number, from 0.
    pub index: usize,
    /// Name of its dataset.
    pub name: String,
    /// The value of each axis, written as in a scenario.
    pub values: Vec<String>,
    /// Repetition, from 0.
    pub repetition: u32,
    /// Its seed.
    pub seed: u64,
}

/// Reads a sweep and its base scenario. `name`: the sweep's name in messages; `folder`: the path of the base
/// scenario is relative to it; `seed` replaces the one in the text. Errors: as for a scenario; also axes
/// without values, with unequal numbers of values in a zip, or with paths that do not exist.
pub fn parse_sweep(text: &str, name: &str, folder: &Path, seed: Option<u64>) -> Result<Sweep> {
    let source = Arc::new(Source::file(name, text));
    let tree = text::parse(&source).map_err(|problem| Error::Problems(vec![problem]))?;
    if tree.find("motion").1 && !tree.find("base").1 {
        let hint = format!("run `microsig generate {name}` to generate its dataset");
        return Err(Error::input(format!("{name}: is a scenario; {hint}")));
    }
    let mut problems = Problems::default();
    let Some(mut spec) = typed::<SweepSpec>(sweep_schema(), &tree, &mut problems) else {
        return Err(Error::Problems(problems.sorted()));
    };
    spec.seed = seed.unwrap_or(spec.seed);
    // The placeholder for a missing `base` is not a file.
    if spec.base.is_empty() {
        return Err(Error::Problems(problems.sorted()));
    }
    let base_path = folder.join(&spec.base);
    let at_key = |key: &str, message: String| Problem::other(key, message).at(&tree.find(key).0);
    let base_text =
        read_text(&base_path).map_err(|e| Error::Problems(vec![at_key("base", e.to_string())]))?;
    let base = parse(&base_text, &base_path.display().to_string())?;
    let base_source = Arc::new(Source::file(&base_path.display().to_string(), &base_text));
    let base_tree = text::parse(&base_source).map_err(|problem| Error::Problems(vec![problem]))?;
    if spec.axes.is_empty() && !problems.any() {
        problems.push(at_key("axes", "expected at least one".to_owned()));
    }
    let columns = columns(&spec, &tree, &base_tree, &mut problems);
    if !problems.any() && spec.combine == Combine::Zip && columns.iter().any(|c| c.len() != columns[0].len())
    {
        let lengths: Vec<String> = columns.iter().map(|c| c.len().to_string()).collect();
        let message = format!("axes of a zip have {} values: expected equal numbers", lengths.join(", "));
        problems.push(at_key("axes", message));
    }
    problems.finish(Error::Problems)?;
    let combinations = combine(&columns, spec.combine)
        .filter(|c| c.len().saturating_mul(spec.repetitions as usize) <= MAX_CASES)
        .ok_or_else(|| Error::input(format!("{name}: expected at most {MAX_CASES} cases")))?;
    let mut distinct = std::collections::BTreeSet::new();
    if let Some(twice) = combinations.iter().find(|values| !distinct.insert(*values)) {
        let hint = "expected different cases; use `repetitions` to repeat a case";
        let message = format!("{} occurs twice: {hint}", twice.join(", "));
        return Err(Error::Problems(vec![at_key("axes", message)]));
    }
    let cases: Vec<Case> = combinations
        .into_iter()
        .flat_map(|values| (0..spec.repetitions).map(move |repetition| (values.clone(), repetition)))
        .enumerate()
        .map(|(index, (values, repetition))| Case {
            index,
            name: format!("case_{index:05}"),
            seed: given_seed(&spec, &values).unwrap_or_else(|| seed_of(&spec, &values, repetition)),
            values,
            repetition,
        })
        .collect();
    Ok(Sweep { spec, base, cases })
}

impl Sweep {
    /// The scenario of a case. Errors: [`Error::Input`] if a value does not fit its key.
    pub fn scenario(&self, case: &Case) -> Result<Spec> {
        let mut spec = self.base.clone();
        for (axis, value) in self.spec.axes.iter().zip(&case.values) {
            spec = set(&spec, &axis.path, value)?;
        }
        spec.name = self.name_of(case);
        spec.seed = case.seed;
        Ok(spec)
    }

    /// The `name` of a case's scenario.
    pub fn name_of(&self, case: &Case) -> String {
        format!("{}_{}", self.spec.name, case.name)
    }
}

/// The values of all axes, each checked in the base scenario.
fn columns(spec: &SweepSpec, tree: &Node, base: &Node, problems: &mut Problems) -> Vec<Vec<String>> {
    let mut columns = Vec::new();
    for (i, axis) in spec.axes.iter().enumerate() {
        let (place, _) = tree.find(&format!("axes.{i}.path"));
        let mut other = |message: &str| problems.push(Problem::other(&axis.path, message).at(&place));
        if axis.path == "name" {
            other("expected another key, because cases are named after the sweep");
        }
        let below = |inner: &str, outer: &str| {
            inner.strip_prefix(outer).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
        };
        if let Some(before) = spec.axes[..i]
            .iter()
            .find(|before| below(&before.path, &axis.path) || below(&axis.path, &before.path))
        {
            if before.path == axis.path {
                other("is varied by two axes");
            } else {
                other(&format!("one of the axes {} and {} contains the other", before.path, axis.path));
            }
        }
        match axis.values.written() {
            Ok(values) => {
                // Only the first invalid value is reported: there may be many.
                let refused = values.iter().take(MAX_CHECKED).enumerate().find_map(|(j, value)| {
                    let (value_place, _) = tree.find(&format!("axes.{i}.values.list.{j}"));
                    let problem = refused(base, &axis.path, value)?;
                    let is_path = problem.is_of_keys() && scenario().find(&axis.path).is_none();
                    Some(problem.at(if is_path { &place } else { &value_place }))
                });
                refused.into_iter().for_each(|problem| problems.push(problem));
                columns.push(values);
            }
            Err(message) => {
                let (place, _) = tree.find(&format!("axes.{i}.values"));
                problems.push(Problem::other(&axis.path, message).at(&place));
            }
        }
    }
    columns
}

/// The problem with a value, if it does not fit its key.
fn refused(base: &Node, path: &str, value: &str) -> Option<Problem> {
    let mut problems = Problems::default();
    match assigned(scenario(), path, value).and_then(|value| graft(base.clone(), scenario(), path, value)) {
        Ok(tree) => drop(typed::<Spec>(scenario(), &tree, &mut problems)),
        Err(problem) => problems.push(problem),
    }
    problems.0.into_iter().next()
}

impl Values {
    fn written(&self) -> std::result::Result<Vec<String>, String> {
        let at = |span: &Span, log: bool| {
            let usable = |x: f64| x.is_finite() && (!log || x > 0.0);
            if !(usable(span.from) && usable(span.to)) {
                let positive = if log { " > 0" } else { "" };
                return Err(format!("expected finite numbers{positive}"));
            }
            let share = |i: u32| if span.count == 1 { 0.0 } else { f64::from(i) / f64::from(span.count - 1) };
            // Rounded to 13 digits, so that 10 does not become 9.999999999999998.
            let rounded = |x: f64| format!("{x:.12e}").parse().unwrap_or(x);
            let value = |i: u32| match i {
                // Both ends are exact.
                0 => span.from,
                i if i + 1 == span.count => span.to,
                i if log => rounded(libm::exp(
                    libm::log(span.from) * (1.0 - share(i)) + libm::log(span.to) * share(i),
                )),
                i => rounded(span.from * (1.0 - share(i)) + span.to * share(i)),
            };
            Ok((0..span.count).map(|i| value(i).to_string()).collect())
        };
        match self {
            Values::List(values) => Ok(values.iter().map(|value| value.0.clone()).collect()),
            Values::Linear(span) => at(span, false),
            Values::Log(span) => at(span, true),
        }
    }
}

fn combine(columns: &[Vec<String>], how: Combine) -> Option<Vec<Vec<String>>> {
    match how {
        Combine::Zip => {
            Some((0..columns[0].len()).map(|i| columns.iter().map(|c| c[i].clone()).collect()).collect())
        }
        Combine::Product => {
            let total = columns.iter().try_fold(1usize, |n, c| n.checked_mul(c.len()))?;
            if total > MAX_CASES {
                return None;
            }
            let mut rows = vec![Vec::new()];
            for column in columns {
                rows = rows
                    .into_iter()
                    .flat_map(|row| {
                        column.iter().map(move |value| row.iter().cloned().chain([value.clone()]).collect())
                    })
                    .collect();
            }
            Some(rows)
        }
    }
}

/// The seed of a case, if an axis gives it.
fn given_seed(spec: &SweepSpec, values: &[String]) -> Option<u64> {
    let axis = spec.axes.iter().position(|axis| axis.path == "seed")?;
    ron::from_str(&values[axis]).ok()
}

/// The first 64 bits of a hash of the sweep's seed, the case's values and its repetition number.
fn seed_of(spec: &SweepSpec, values: &[String], repetition: u32) -> u64 {
    let mut assignments: Vec<String> =
        spec.axes.iter().zip(values).map(|(axis, value)| format!("{}={value}", axis.path)).collect();
    assignments.sort();
    let identity =
        format!("microsig case\nseed={}\n{}\nrepetition={repetition}\n", spec.seed, assignments.join("\n"));
    let digest = Sha256::digest(identity);
    u64::from_le_bytes(std::array::from_fn(|i| digest[i]))
}

#[cfg(test)]
mod tests {
    use super::*;

    const BASE: &str = r#"(name: "base", motion: flow(field: poiseuille()), timing: pairs(count: 2))"#;

    fn sweep(text: &str) -> Result<Sweep> {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("base.ron"), BASE).unwrap();
        parse_sweep(text, "sweep.ron", folder.path(), None)
    }

    const SWEEP: &str = r#"(
        name: "grid",
        base: "base.ron",
        axes: [
            (path: "optics.background_noise", values: list([0, 10, 50])),
            (path: "particles.number", values: list([count(23), ppp(0.001)])),
        ],
        repetitions: 2,
    )"#;

    #[test]
    fn a_product_has_every_combination_with_seeds_of_its_own() {
        let sweep = sweep(SWEEP).unwrap();
        assert_eq!(sweep.cases.len(), 12);
        assert_eq!(sweep.cases[2].values, ["0", "ppp(0.001)"]);
        let mut seeds: Vec<u64> = sweep.cases.iter().map(|c| c.seed).collect();
        seeds.sort_unstable();
        seeds.dedup();
        assert_eq!(seeds.len(), 12);
        let spec = sweep.scenario(&sweep.cases[11]).unwrap();
        assert_eq!((spec.optics.background_noise, spec.name.as_str()), (Some(50.0), "grid_case_00011"));
    }

    #[test]
    fn the_seed_of_a_case_depends_on_its_values_only() {
        let wider = SWEEP.replace("[0, 10, 50]", "[5, 0, 10, 50]");
        let (a, b) = (sweep(SWEEP).unwrap(), sweep(&wider).unwrap());
        for case in &a.cases {
            let same =
                b.cases.iter().find(|c| c.values == case.values && c.repetition == case.repetition).unwrap();
            assert_eq!(same.seed, case.seed);
        }
    }

    #[test]
    fn ranges_meet_their_ends_and_zip_pairs_them() {
        let text = SWEEP
            .replace("list([0, 10, 50])", "linear(from: 0, to: 50, count: 3)")
            .replace("list([count(23), ppp(0.001)])", "list([count(1), count(2), count(3)])")
            .replace("repetitions: 2", "combine: zip");
        let zipped = sweep(&text).unwrap();
        assert_eq!(zipped.cases.iter().map(|c| c.values[0].as_str()).collect::<Vec<_>>(), ["0", "25", "50"]);
        let exact = text.replace("from: 0, to: 50,", "from: 0.1234567890123456, to: 50,");
        assert_eq!(sweep(&exact).unwrap().cases[0].values[0], "0.1234567890123456");
        let log = SWEEP.replace("list([0, 10, 50])", "log(from: 1, to: 100, count: 3)");
        let middle: f64 = sweep(&log).unwrap().cases[4].values[0].parse().unwrap();
        assert!((middle - 10.0).abs() < 1e-14);
    }

    #[test]
    fn all_problems_of_a_sweep_are_reported_at_once() {
        let text = "(\n name: 5, repetition: 2,\n base: \"base.ron\",\n combine: zipp,\n axes: [\n\
            (path: \"optics.gian\", values: list([1])),\n\
            (path: \"particles.number.count\", values: linear(from: 5, to: 8, count: 3)),\n\
            (path: \"name\", values: list([\"a\"])),\n\
            (path: \"seed\", values: list([])),\n],\n)";
        let found = sweep(text).unwrap_err().to_string();
        let expected = [
            "sweep.ron:2:8: name = 5: expected a string",
            "sweep.ron:2:11: unknown key `repetition`; did you mean `repetitions`?",
            "sweep.ron:4:11: combine: unknown variant `zipp`: did you mean `zip`?",
            "sweep.ron:6:2: unknown key `optics.gian`; did you mean `gain`?",
            "sweep.ron:7:34: particles.number.count = 6.5: expected a whole number",
            "sweep.ron:8:2: name: expected another key",
            "sweep.ron:9:29: axes.3.values.list = 0 values: expected at least 1",
        ];
        assert_eq!(found.lines().count(), expected.len(), "{found}");
        for (found, expected) in found.lines().zip(expected) {
            assert!(found.starts_with(expected), "expected {expected}\nfound    {found}");
        }
    }

    #[test]
    fn the_document_has_every_key_and_its_example_is_a_sweep() {
        let document = include_str!("../../../docs/sweeps.md");
        for (path, entry) in super::sweep_schema().keys().iter().filter(|(_, entry)| !entry.is_variant) {
            let key = entry.name;
            assert!(
                document.contains(&format!("`{key}`")) || document.contains(&format!("`axes.{key}`")),
                "{path}"
            );
        }
        let example = document.split("```").nth(1).and_then(|block| block.strip_prefix("ron")).unwrap();
        let example = example.replace("../scenarios/quickstart.ron", "base.ron");
        assert_eq!(sweep(&example).unwrap().cases.len(), 90);
    }

    #[test]
    fn whole_numbers_stay_whole_and_a_seed_is_the_one_given() {
        let of = |axis: &str| {
            sweep(&format!("(name: \"s\", base: \"base.ron\", axes: [{axis}])")).map(|s| s.cases)
        };
        let cases = of("(path: \"particles.number.count\", values: log(from: 5, to: 20, count: 3))").unwrap();
        assert_eq!(cases.iter().map(|c| c.values[0].as_str()).collect::<Vec<_>>(), ["5", "10", "20"]);
        let cases = of("(path: \"seed\", values: list([7, 1_000, 0x10]))").unwrap();
        assert_eq!(cases.iter().map(|c| c.seed).collect::<Vec<_>>(), [7, 1000, 16]);
        let twice = of("(path: \"seed\", values: list([7, 7]))").unwrap_err().to_string();
        assert!(twice.contains("axes: 7 occurs twice"), "{twice}");
        let axis = "(path: \"optics.gain\", values: list([1, 2]))";
        let twice = of(&[axis, axis].join(", ")).unwrap_err().to_string();
        assert!(twice.contains("optics.gain: is varied by two axes"), "{twice}");
        let outer = "(path: \"optics\", values: list([\"(gain: 2)\", \"(gain: 3)\"]))";
        let nested = of(&[axis, outer].join(", ")).unwrap_err().to_string();
        assert!(nested.contains("one of the axes optics.gain and optics contains the other"), "{nested}");
    }

    #[test]
    fn invalid_sweeps_are_refused_with_the_reason() {
        let refuse = |from: &str, to: &str| sweep(&SWEEP.replace(from, to)).unwrap_err().to_string();
        assert!(refuse("optics.background_noise", "optics.noise").contains("unknown key `optics.noise`"));
        assert!(refuse("list([0, 10, 50])", "list([])").contains("0 values: expected at least 1"));
        assert!(refuse("repetitions: 2", "combine: zip").contains("axes of a zip have 3, 2 values"));
        assert!(
            refuse("repetitions: 2", "repetitions: 0")
                .contains("repetitions = 0: expected a whole number, 1 to 1e6")
        );
        assert!(
            refuse("repetitions: 2", "repetition: 2")
                .contains("sweep.ron:8:9: unknown key `repetition`; did you mean `repetitions`?")
        );
        assert!(refuse("base.ron", "nothing.ron").contains("nothing.ron"));
        assert!(
            refuse("list([0, 10, 50])", "log(from: 0, to: 1, count: 3)")
                .contains("expected finite numbers > 0")
        );
    }
}
