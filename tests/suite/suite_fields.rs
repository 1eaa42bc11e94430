//! Suites of displacement fields: a released case takes fields.

use std::fmt::Write as _;

use serde_json::Value;
use suite::leak::unzip;
use suite::microsig::{fail, json, path, run};

use crate::release::unpack;

const SCENARIO: &str = r#"(
    name: "fields",
    seed: 3,
    optics: (gaussian: (diameter_px: 3), pixel_dim_x: 256, pixel_dim_y: 224),
    motion: flow(field: uniform(velocity_um_s: (580.5, 0, 0))),
    particles: (number: ppp(0.02)),
    boundaries: (z_um: (-5, 5)),
    timing: pairs(count: 3),
    calibration: none,
)"#;

const SUITE: &str = r#"(
    name: "flows",
    version: "1.0.0",
    title: "Fields",
    tracks: [(
        name: "V",
        title: "Fields",
        rank_by: [valid_nodes, rms_nodes_px],
        sizes: (smoke: (train: 1, val: 1, test: 2), small: (train: 2, val: 2, test: 2), full: (train: 2, val: 2, test: 2)),
        ladders: [
            (name: "shift", title: "Shift", from: "shift.ron"),
        ],
    )],
)"#;

/// Vectors of both pairs, 8 px apart, of those places that are wanted.
fn vectors(moved: impl Fn(f64, f64) -> Option<f64>) -> String {
    let mut text = "pair,x_px,y_px,dx_px,dy_px,flag\n".to_owned();
    for pair in 0..2 {
        for (row, column) in (0..28).flat_map(|row| (0..32).map(move |column| (row, column))) {
            let (x, y) = (4.5 + 8.0 * f64::from(column), 4.5 + 8.0 * f64::from(row));
            if let Some(dx) = moved(x, y) {
                writeln!(text, "{pair},{x},{y},{dx},0,0").unwrap();
            }
        }
    }
    text
}

#[test]
fn a_released_case_of_fields_takes_fields() {
    let place = tempfile::tempdir().unwrap();
    for (name, text) in [("shift.ron", SCENARIO), ("suite.ron", SUITE)] {
        std::fs::write(place.path().join(name), text).unwrap();
    }
    let (suite, datasets) = (place.path().join("suite.ron"), place.path().join("datasets"));
    run(&["suite", "generate", path(&suite), "--size", "smoke", "--out", path(&datasets), "--quiet"]);
    let out = place.path().join("released");
    let only = ["--case", "shift", "--codabench", "--quiet"];
    run(&[&["suite", "release", path(&suite), path(&datasets), "--out", path(&out)][..], &only].concat());
    let out = out.join("V/shift");
    // The flow is the same as in train, which participants must know.
    let readme = std::fs::read_to_string(out.join("public/README.md")).unwrap();
    assert!(
        readme.contains("A challenge for PIV")
            && readme.contains("`truth/field.csv` of train is also the field of test")
    );
    unpack(&out.join("public/flows-v-shift-test.zip"), place.path());
    let test = place.path().join("flows-v-shift-test");
    let submission = test.join("submission");
    let header = std::fs::read_to_string(submission.join("results.csv")).unwrap();
    assert_eq!(header, "pair,x_px,y_px,dx_px,dy_px,flag\n");
    assert!(std::fs::read_to_string(test.join("README.md")).unwrap().contains("dx_px, dy_px, flag"));

    let about = std::fs::read_to_string(submission.join("submission.json")).unwrap();
    let mut about: Value = serde_json::from_str(&about).unwrap();
    for (key, value) in [("team", "A"), ("method", "B"), ("version", "1"), ("hardware", "paper")] {
        about[key] = value.into();
    }
    about["images_sha256"] = suite::microsig::images_sha256(&test).into();
    std::fs::write(submission.join("submission.json"), about.to_string()).unwrap();
    std::fs::write(submission.join("results.csv"), vectors(|_, _| Some(4.4))).unwrap();
    let said = run(&["check-submission", path(&test), path(&submission)]);
    assert!(said.contains("vectors"), "{said}");
    let withheld = out.join("withheld/test");
    let score: Value = json(&["evaluate", path(&withheld), path(&submission)]);
    assert_eq!(score["field"]["nodes"]["valid"], 1.0);

    let bundle = place.path().join("bundle");
    unpack(&out.join("withheld/codabench.zip"), &bundle);
    let board = std::fs::read_to_string(bundle.join("competition.yaml")).unwrap();
    let columns: Vec<&str> = board.lines().filter_map(|line| line.trim().strip_prefix("key: ")).collect();
    // Other scores of fields would tell the truth.
    assert_eq!(&columns[1..], ["valid_nodes", "rms_nodes_px"]);
    let reference = unzip(&bundle.join("reference_data.zip")).unwrap();
    assert!(reference.keys().any(|name| name == "fields_only.txt"));
    std::fs::write(submission.join("results.csv"), "frame,track,x_px,y_px\n0,-1,40,40\n").unwrap();
    for split in [&test, &withheld] {
        let message = fail(2, &["evaluate", path(split), path(&submission), "--quiet"]);
        assert!(message.contains("this challenge scores displacement fields"), "{message}");
    }
}
