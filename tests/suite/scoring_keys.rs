//! The keys of `score.json` are documented: each has a definition, and docs/score_keys.md lists them.

use arena::report::parse_score;
use scoring::evaluate::score_keys::{markdown, score_keys};
use scoring::ranking::SCORES;

use crate::scoring_hints::{scene, scores};

#[test]
fn every_key_has_a_definition_and_stands_in_the_docs() {
    let keys = score_keys();
    assert!(keys.len() > 200, "{}", keys.len());
    let bare: Vec<&str> = keys.iter().filter(|k| k.meaning.is_empty()).map(|k| k.path.as_str()).collect();
    assert_eq!(bare, [""; 0]);
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/score_keys.md");
    if std::env::var_os("UPDATE_DOCS").is_some() {
        std::fs::write(path, markdown()).unwrap();
    }
    let found = std::fs::read_to_string(path).unwrap();
    assert!(found == markdown(), "docs/score_keys.md is old, run this test with UPDATE_DOCS=1");
}

#[test]
fn scores_of_tables_have_paths_of_keys() {
    let keys: Vec<String> = score_keys().into_iter().map(|k| k.path).collect();
    // Without a path: computed from several values.
    let paths = SCORES.iter().map(|def| def.path).filter(|path| !path.is_empty());
    let unknown: Vec<&str> = paths.filter(|path| !keys.iter().any(|key| key == path)).collect();
    assert_eq!(unknown, [""; 0]);
}

#[test]
fn scores_that_rank_stand_in_the_docs_of_suites() {
    let found = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/suite.md")).unwrap();
    let ranks = SCORES.iter().filter(|def| def.metric.is_some()).map(|def| format!("`{}`", def.name));
    let missing: Vec<String> = ranks.filter(|name| !found.contains(name)).collect();
    assert_eq!(missing, [""; 0]);
}

#[test]
fn a_score_is_read_as_it_was_written() {
    let (truth, points) = scene();
    let score = scores(&truth, &points);
    let text = serde_json::to_string_pretty(&score).unwrap();
    let again = serde_json::to_value(parse_score(&text).unwrap()).unwrap();
    close("", &serde_json::to_value(&score).unwrap(), &again);
    // Every key that is written is documented.
    let keys: Vec<String> = score_keys().into_iter().map(|k| k.path).collect();
    let value: serde_json::Value = serde_json::from_str(&text).unwrap();
    let mut unknown = Vec::new();
    collect("", &value, &mut |path| {
        unknown.extend((!keys.iter().any(|k| k == path)).then(|| path.to_owned()))
    });
    assert_eq!(unknown, [""; 0]);
}

/// Asserts equal values; decimal numbers are read back to within one bit.
fn close(path: &str, a: &serde_json::Value, b: &serde_json::Value) {
    match (a, b) {
        (serde_json::Value::Object(x), serde_json::Value::Object(y)) => {
            assert_eq!(x.keys().collect::<Vec<_>>(), y.keys().collect::<Vec<_>>(), "{path}");
            x.iter().for_each(|(key, value)| close(&format!("{path}.{key}"), value, &y[key]));
        }
        (serde_json::Value::Array(x), serde_json::Value::Array(y)) => {
            assert_eq!(x.len(), y.len(), "{path}");
            x.iter().zip(y).for_each(|(x, y)| close(path, x, y));
        }
        _ => match a.as_f64().zip(b.as_f64()) {
            Some((x, y)) => assert!((x - y).abs() <= 1e-15 * x.abs(), "{path}: {x} {y}"),
            None => assert_eq!(a, b, "{path}"),
        },
    }
}

fn collect(path: &str, value: &serde_json::Value, each: &mut impl FnMut(&str)) {
    match value {
        serde_json::Value::Object(parts) => parts.iter().for_each(|(name, part)| {
            let path = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
            each(&path);
            collect(&path, part, each);
        }),
        serde_json::Value::Array(parts) => {
            parts.iter().for_each(|part| collect(&format!("{path}[]"), part, each));
        }
        _ => {}
    }
}
