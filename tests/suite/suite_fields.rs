//! Tracks of displacement fields: results that avoid measuring rank behind an honest one, and a released case
//! takes fields.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use serde_json::Value;
use suite::leak::unzip;
use suite::microsig::{fail, json, path, run};

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

/// 258 um/s are 2 px; 12.9 um are 20 px.
const WAVE: &str = "sinusoid(amplitude_um_s: 258, wavelength_um: 12.9)), truth_grid: grid(spacing_px: 1),";

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
            (name: "wave", title: "Wave", from: "wave.ron", rank_by: [rms_nodes_px, response_nodes]),
        ],
    )],
)"#;

/// A suite of two cases with its datasets.
struct Fields {
    place: tempfile::TempDir,
    suite: PathBuf,
    datasets: PathBuf,
}

static FIELDS: LazyLock<Fields> = LazyLock::new(|| {
    let place = tempfile::tempdir().unwrap();
    let wave = SCENARIO
        .replace("uniform(velocity_um_s: (580.5, 0, 0))),", WAVE)
        .replace("256, pixel_dim_y: 224", "160, pixel_dim_y: 128");
    assert!(wave.contains("sinusoid"));
    for (name, text) in [("shift.ron", SCENARIO), ("wave.ron", &wave), ("suite.ron", SUITE)] {
        std::fs::write(place.path().join(name), text).unwrap();
    }
    let (suite, datasets) = (place.path().join("suite.ron"), place.path().join("datasets"));
    run(&["suite", "generate", path(&suite), "--size", "smoke", "--out", path(&datasets), "--quiet"]);
    Fields { place, suite, datasets }
});

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
fn rounded_displacements_are_not_exact_in_the_shipped_suite() {
    let place = tempfile::tempdir().unwrap();
    let cases = [
        ("gradient_0.05", 0.1),
        ("gradient_0.1", 0.1),
        ("gradient_0.2", 0.1),
        ("loss_0", 0.5),
        ("loss_0.5", 0.5),
    ];
    for (case, step) in cases {
        let of = [
            "suite", "generate", "odpc1", "--size", "small", "--split", "test", "--track", "V", "--case",
            case,
        ];
        run(&[&of[..], &["--out", path(place.path()), "--resume", "--quiet"]].concat());
        let file = place.path().join("V").join(case).join("test/truth/field.csv");
        let text = std::fs::read_to_string(file).unwrap();
        let column =
            text.lines().next().unwrap().split(',').position(|name| name == "central_dx_px").unwrap();
        let moved: Vec<f64> =
            text.lines().skip(1).map(|row| row.split(',').nth(column).unwrap().parse().unwrap()).collect();
        let is_round = |d: &&f64| (*d - step * (*d / step).round()).abs() < 0.02;
        assert!(!moved.is_empty() && moved.iter().filter(is_round).count() * 10 < moved.len(), "{case}");
    }
}

#[test]
fn one_vector_and_a_field_of_zeros_rank_behind_an_honest_field() {
    let c = &*FIELDS;
    let results = c.place.path().join("results");
    let write = |tracker: &str, case: &str, text: String| {
        let folder = results.join(tracker).join("V").join(case);
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("results.csv"), text).unwrap();
    };
    // The wave has its zero in the middle of the image, at y = 64.5 px.
    let wave = |y: f64| 2.0 * (std::f64::consts::TAU * (y - 64.5) / 20.0).sin();
    let is_one = |x: f64, y: f64| (x, y) == (76.5, 60.5);
    // Half of the amplitude, and some wrong vectors, are honest; one vector is right to the last digit.
    let is_wrong = |x: f64, y: f64| (x + y) % 120.0 == 9.0;
    write("honest", "shift", vectors(|x, y| Some(if is_wrong(x, y) { 0.0 } else { 4.6 })));
    write("honest", "wave", vectors(|_, y| Some(0.5 * wave(y))));
    write("one", "shift", vectors(|x, y| is_one(x, y).then_some(4.5)));
    write("one", "wave", vectors(|x, y| is_one(x, y).then(|| wave(y))));
    write("zeros", "shift", vectors(|_, _| Some(0.0)));
    write("zeros", "wave", vectors(|_, _| Some(0.0)));
    let out = c.place.path().join("scores");
    let scores = json(&[
        "suite",
        "score",
        path(&c.suite),
        path(&c.datasets),
        "--results",
        path(&results),
        "--out",
        path(&out),
    ]);
    for case in scores["cases"].as_array().unwrap() {
        let best = &case["results"][0];
        assert_eq!((&best["tracker"], &best["rank"]), (&"honest".into(), &1.into()), "{case:#}");
        assert!(case["results"][1]["rank"].as_u64() > Some(1), "{case:#}");
    }
    let of = |case: usize, tracker: &str, metric: &str| {
        let results = scores["cases"][case]["results"].as_array().unwrap();
        let result = results.iter().find(|result| result["tracker"] == tracker).unwrap();
        let found = result["scores"].as_array().unwrap().iter().find(|s| s["metric"] == metric).unwrap();
        found["value"].as_f64().unwrap()
    };
    // By the vectors that it reports alone, one vector would be first.
    assert_eq!(of(0, "one", "valid_vector_probability"), 1.0);
    assert!(of(0, "one", "rms_inliers_px") < of(0, "honest", "rms_inliers_px"));
    assert!(of(0, "one", "valid_nodes") < 0.02 && of(0, "honest", "valid_nodes") > 0.7);
    assert!(of(1, "zeros", "rms_nodes_px") > 0.8 && of(1, "zeros", "response_nodes") == 0.0);
    assert!((0.2..0.6).contains(&of(1, "honest", "response_nodes")));
    assert_eq!(scores["cases"][1]["rank_by"][0], "rms_nodes_px");
}

fn unpack(archive: &Path, folder: &Path) {
    for (name, bytes) in unzip(archive).unwrap() {
        let file = folder.join(name);
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(file, bytes).unwrap();
    }
}

#[test]
fn a_released_case_of_fields_takes_fields() {
    let c = &*FIELDS;
    let out = c.place.path().join("released");
    let only = ["--case", "shift", "--codabench", "--quiet"];
    run(&[&["suite", "release", path(&c.suite), path(&c.datasets), "--out", path(&out)][..], &only].concat());
    let out = out.join("V/shift");
    // The flow is that of train, which participants must know.
    let readme = std::fs::read_to_string(out.join("public/README.md")).unwrap();
    assert!(
        readme.contains("A challenge for PIV")
            && readme.contains("`truth/field.csv` of train is also the field of test")
    );
    let place = tempfile::tempdir().unwrap();
    unpack(&out.join("public/flows-v-shift-test.zip"), place.path());
    let test = place.path().join("flows-v-shift-test");
    let submission = test.join("submission");
    let header = std::fs::read_to_string(submission.join("results.csv")).unwrap();
    assert_eq!(header, "pair,x_px,y_px,dx_px,dy_px,flag\n");
    assert!(std::fs::read_to_string(test.join("README.md")).unwrap().contains("dx_px, dy_px, flag"));

    let sums = std::fs::read_to_string(test.join("SHA256SUMS")).unwrap();
    let images: String = sums.lines().filter(|l| l.contains("  images/")).map(|l| format!("{l}\n")).collect();
    let about = std::fs::read_to_string(submission.join("submission.json")).unwrap();
    let mut about: Value = serde_json::from_str(&about).unwrap();
    for (key, value) in [("team", "A"), ("method", "B"), ("version", "1"), ("hardware", "paper")] {
        about[key] = value.into();
    }
    about["images_sha256"] = suite::sha256_of(images.as_bytes()).into();
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
    // The scoring program gives each column its number.
    let app = place.path().join("app");
    unpack(&bundle.join("reference_data.zip"), &app.join("input/ref"));
    unpack(&bundle.join("scoring_program.zip"), &app.join("program"));
    std::fs::create_dir_all(app.join("input")).unwrap();
    std::fs::rename(&submission, app.join("input/res")).unwrap();
    let mut command = std::process::Command::new("python3");
    command.env("MICROSIG", suite::microsig::binary()).arg(app.join("program/scoring.py"));
    let said = command.args([app.join("input"), app.join("output")]).output().unwrap();
    assert!(said.status.success(), "{}", String::from_utf8_lossy(&said.stderr));
    let scores: Value =
        serde_json::from_slice(&std::fs::read(app.join("output/scores.json")).unwrap()).unwrap();
    assert!(columns[1..].iter().all(|key| scores[*key].is_number()), "{scores}");

    let submission = app.join("input/res");
    std::fs::write(submission.join("results.csv"), "frame,track,x_px,y_px\n0,-1,40,40\n").unwrap();
    for split in [&test, &withheld] {
        let message = fail(2, &["evaluate", path(split), path(&submission), "--quiet"]);
        assert!(message.contains("this challenge scores displacement fields"), "{message}");
    }
}
