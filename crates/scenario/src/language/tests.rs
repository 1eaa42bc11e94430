//! Tests of the schema: a key is defined once and known everywhere, and ranges are enforced wherever they are
//! stated.

use std::path::Path;
use std::sync::Arc;

use microsig_core::Interval;
use microsig_core::problem::{Problems, Source};
use microsig_core::render::Context;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::super::spec::schema as scenario;
use super::super::{Shipped, parse, resolve, shipped, write};
use super::derive::schema_of;
use super::document::{Picture, Scene, document};
use super::graft::{assigned, graft};
use super::schema::{Schema, ValueKind};
use super::template::{sample, template};
use super::text::{self, Content, Node};
use super::typed;
use super::write::ron;

fn tree(text: &str) -> Node {
    text::parse(&Arc::new(Source::file("t.ron", text))).unwrap()
}

/// A small language for tests.
#[derive(Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
struct Laboratory {
    /// Laser on the table.
    #[serde(default)]
    laser: Laser,
}

#[derive(Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
struct Laser {
    /// Wavelength in vacuum.
    #[schemars(range(min = 200.0, max = 2000.0))]
    wavelength_nm: f64,
    /// Mode of operation.
    mode: Operation,
}

#[derive(Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Operation {
    /// Always on.
    Continuous,
    /// Pulses at this rate.
    Pulsed(#[schemars(extend("exclusiveMinimum" = 0, "x-unit" = "Hz"), example = 15.0)] f64),
}

impl Default for Laser {
    fn default() -> Self {
        Laser { wavelength_nm: 532.0, mode: Operation::Continuous }
    }
}

#[test]
fn a_key_that_is_added_to_a_struct_is_known_everywhere() {
    let root = schema_of::<Laboratory>();
    let language = Schema::root(&root);
    let keys: Vec<String> = language.keys().into_iter().map(|(path, _)| path).collect();
    let expected =
        ["laser", "laser.wavelength_nm", "laser.mode", "laser.mode.continuous", "laser.mode.pulsed"];
    assert_eq!(keys, expected);

    let refuse = |text: &str| {
        let mut problems = Problems::default();
        typed::<Laboratory>(language, &tree(text), &mut problems);
        problems.0.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
    };
    let range = "t.ron:1:25: laser.wavelength_nm = 10: expected a number, 200 to 2000 nm";
    assert_eq!(refuse("(laser: (wavelength_nm: 10))"), range);
    assert_eq!(
        refuse("(laser: (mode: pulsed(0)))"),
        "t.ron:1:23: laser.mode.pulsed = 0: expected a number > 0 Hz"
    );
    let unknown = "t.ron:1:10: unknown key `laser.wavelenght_nm`; did you mean `wavelength_nm`?";
    assert_eq!(refuse("(laser: (wavelenght_nm: 500))"), unknown);

    let set = assigned(language, "laser.mode.pulsed", "15").unwrap();
    let set = graft(tree("()"), language, "laser.mode.pulsed", set).unwrap();
    let set: Laboratory = typed(language, &set, &mut Problems::default()).unwrap();
    assert_eq!(set.laser, Laser { wavelength_nm: 532.0, mode: Operation::Pulsed(15.0) });

    let values = serde_json::json!({ "laser": { "wavelength_nm": 532.0, "mode": "continuous" } });
    let new = template(language, &values, "A laboratory.");
    assert_eq!(
        new,
        "// A laboratory.\n(\n    // Laser on the table.\n    laser: (\n        // Wavelength in vacuum. [nm, 200 to 2000]\n        \
         wavelength_nm: 532.0,\n        // Mode of operation.\n        //   continuous: Always on.\n        //   pulsed(15.0): Pulses at \
         this rate.\n        mode: continuous,\n    ),\n\n)\n"
    );
    let picture = Picture {
        key: "laser.wavelength_nm".to_owned(),
        scene: Scene::Ladder,
        images: Vec::new(),
        caption: "532, 355 nm".to_owned(),
    };
    let pages = document(language, &values, "# Laboratory\n", &[picture]);
    let page = &pages.iter().find(|page| page.file == "scenario/laser.md").unwrap().text;
    assert!(pages[0].text.contains("- [`laser`](scenario/laser.md): Laser on the table."), "{pages:?}");
    for line in [
        "| `laser.wavelength_nm` | nm | `532.0` | 200 to 2000 | Wavelength in vacuum. |",
        "| `laser.mode.`*`pulsed`* | Hz |  | > 0 | Pulses at this rate. |",
        "`laser.wavelength_nm`: 532, 355 nm",
    ] {
        assert!(page.contains(line), "{line} is not in\n{page}");
    }
    let json = root.pointer("/$defs/Laser/properties/wavelength_nm").unwrap();
    assert_eq!(
        (&json["x-unit"], &json["default"], &json["maximum"]),
        (&"nm".into(), &532.0.into(), &2000.0.into())
    );
}

/// A scenario in which a key has a valid value, and the key's path with list indices.
fn around(path: &str) -> (Node, String) {
    let mut whole = tree(r#"(name: "m", motion: flow(field: poiseuille()), timing: pairs(count: 1))"#);
    let mut at = String::new();
    let put = |whole: Node, at: &str, schema: Schema<'_>, value: &Value| {
        let value = assigned(scenario(), at, &ron(value, schema)).unwrap();
        graft(whole, scenario(), at, value).unwrap()
    };
    for step in path.split('.') {
        let before = (!at.is_empty()).then(|| scenario().find(&at).unwrap().schema.unwrap());
        if let Some(ValueKind::List(item)) = before.map(|schema| schema.kind()) {
            let content = item.child(step).unwrap().schema.and_then(sample).unwrap();
            let item = Value::Object([(step.to_owned(), content)].into_iter().collect());
            whole = put(whole, &at, before.unwrap(), &Value::Array(vec![item]));
            at += ".0";
        }
        at = super::schema::joined(&at, step);
        let entry = scenario().find(&at).unwrap_or_else(|| panic!("{at}: no such key"));
        if let Some(schema) = entry.schema.filter(|_| !whole.find(&at).1) {
            let value = sample(schema).unwrap_or_else(|| panic!("{at}: expected an example"));
            whole = put(whole, &at, schema, &value);
        }
    }
    (whole, at)
}

#[test]
fn quotes_around_a_text_that_is_set_are_optional() {
    for (value, expected) in
        [("run1", "run1"), ("\"run1\"", "run1"), ("r\"a\"", "a"), ("r#\"a\"#", "a"), ("run 1", "run 1")]
    {
        let Ok(Node { content: Content::Text(text), .. }) = assigned(scenario(), "name", value) else {
            panic!("{value}")
        };
        assert_eq!(text, expected);
    }
}

#[test]
fn every_number_with_a_range_is_refused_outside_with_path_and_range() {
    let mut checked = 0;
    for (path, entry) in scenario().keys() {
        let Some(schema) = entry.schema else { continue };
        if !matches!(schema.kind(), ValueKind::Number | ValueKind::Whole) {
            continue;
        }
        let (whole, at) = around(&path);
        let refused = |value: &str| {
            let mut problems = Problems::default();
            let value = assigned(scenario(), &at, value).unwrap();
            typed::<super::super::spec::Spec>(
                scenario(),
                &graft(whole.clone(), scenario(), &at, value).unwrap(),
                &mut problems,
            );
            problems.0
        };
        let value = ron(&sample(schema).unwrap(), schema);
        assert!(refused(&value).is_empty(), "{at}={value}: {:?}", refused(&value));
        let bound = |name| schema.attribute(name).and_then(Value::as_f64);
        let mut outside: Vec<String> = vec!["NaN".to_owned(), "-inf".to_owned()];
        outside.extend(bound("minimum").map(|low| (low - 1.0 - low.abs()).to_string()));
        outside.extend(bound("exclusiveMinimum").map(|low| low.to_string()));
        outside.extend(bound("maximum").map(|high| (high + 1.0 + high.abs()).to_string()));
        outside.extend(bound("exclusiveMaximum").map(|high| high.to_string()));
        for value in outside {
            let problems = refused(&value);
            assert_eq!(problems.len(), 1, "{at} = {value}: {problems:?}");
            let expected = format!("{at}={value}: expected {}", schema.allowed());
            assert!(problems[0].to_string().starts_with(&expected), "{expected}\n{}", problems[0]);
            checked += 1;
        }
    }
    assert!(checked > 500, "{checked}");
}

/// A condition in words beside a number without bounds must not state a bound.
#[test]
fn bounds_of_numbers_are_data() {
    let mut checked = 0;
    for (path, entry) in scenario().keys() {
        let Some(schema) =
            entry.schema.filter(|schema| matches!(schema.kind(), ValueKind::Number | ValueKind::Whole))
        else {
            continue;
        };
        let Some(condition) = schema.words("x-condition") else { continue };
        let is_bounded = schema.interval() != Interval::FINITE;
        // The second one is two ranges, which no pair of bounds describes; resolving checks it.
        let free = ["0: no cylinder", "0.01 to 1e7, or negative"];
        assert!(is_bounded || free.contains(&condition), "{path}: {condition}");
        checked += 1;
    }
    assert!(checked > 5, "{checked}");
}

/// Scenarios that the program writes, as RON or JSON, fit the schema.
#[test]
fn every_shipped_scenario_with_its_defaults_fits_the_schema() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios");
    let mut resolved = 0;
    for Shipped { name, text } in shipped().into_iter().filter(|shipped| !shipped.is_sweep()) {
        let spec = resolve(parse(text, name).unwrap(), &folder, &Context::default()).unwrap().spec;
        assert_eq!(parse(&serde_json::to_string(&spec).unwrap(), name).unwrap(), spec, "{name}");
        let written = write(&spec).unwrap();
        assert_eq!(write(&parse(&written, name).unwrap()).unwrap(), written, "{name}");
        resolved += 1;
    }
    assert!(resolved > 25, "{resolved}");
}
