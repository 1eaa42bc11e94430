//! Faults that users found who had seen neither the code nor its tests.

use std::io::{Cursor, Write};
use std::process::Stdio;

use serde_json::Value;
use suite::microsig::{fail, generate, json, microsig, path, run, write};

/// Dense: many particles lie within the gate of others.
const DENSE: &str = r#"(
    name: "dense",
    optics: (gaussian: (), pixel_dim_x: 64, pixel_dim_y: 64),
    motion: flow(field: uniform(velocity_um_s: (100, 0, 0))),
    particles: (number: count(60)),
    timing: sequence(frames: 5),
    calibration: none,
)"#;

#[test]
fn the_truth_has_no_uncertainty_of_idf1_and_its_score_can_be_compared() {
    let place = tempfile::tempdir().unwrap();
    let (dataset, score) = (generate(place.path(), "dataset", DENSE), place.path().join("score"));
    let tracks = dataset.join("truth/tracks.csv");
    let result = json(&["evaluate", path(&dataset), path(&tracks), "--out", path(&score)]);
    assert_eq!(result["identity"]["interval_idf1"], serde_json::json!([1.0, 1.0]));
    run(&["compare", path(&score), "--out", path(&place.path().join("board"))]);
}

#[test]
fn ghosts_at_the_border_are_not_scored() {
    let place = tempfile::tempdir().unwrap();
    let dataset = generate(place.path(), "dataset", DENSE);
    let ghosts = write(place.path(), "ghosts.csv", "frame,x_px,y_px,z_um\n0,3,3,0\n0,62,40,0\n");
    let score = |border: &str| -> Value {
        let score = run(&[
            "evaluate",
            path(&dataset),
            path(&ghosts),
            "--border",
            border,
            "--gate-xy",
            "0.01",
            "--json",
            "--quiet",
        ]);
        serde_json::from_str(&score).unwrap()
    };
    assert_eq!(score("0")["detection"]["fp"], 2);
    assert_eq!(
        (&score("5")["detection"]["fp"], &score("5")["counts"]["ignored_result"]),
        (&0.into(), &2.into())
    );
}

/// A run that must end by itself; it is stopped after a minute.
pub(crate) fn ends(arguments: &[&str]) -> (Option<i32>, String) {
    let mut child = microsig()
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    for _ in 0..6000 {
        if child.try_wait().unwrap().is_some() {
            let output = child.wait_with_output().unwrap();
            return (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned());
        }
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    (None, format!("{arguments:?} does not end"))
}

#[test]
fn archives_with_two_results_are_refused() {
    let place = tempfile::tempdir().unwrap();
    let dataset = generate(place.path(), "dataset", DENSE);
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let options = zip::write::SimpleFileOptions::default();
    for name in ["results.csv", "team/results.csv", "submission.json"] {
        zip.start_file(name, options).unwrap();
        zip.write_all(b"frame,x_px,y_px\n").unwrap();
    }
    let file = place.path().join("two.zip");
    std::fs::write(&file, zip.finish().unwrap().into_inner()).unwrap();
    let message = fail(2, &["evaluate", path(&dataset), path(&file)]);
    assert!(message.contains("2 entries named results.csv"), "{message}");
}

#[test]
fn a_byte_order_mark_is_skipped_and_lost_particles_are_told() {
    let place = tempfile::tempdir().unwrap();
    let fast = DENSE.replace("(100, 0, 0)", "(1e9, 0, 0)");
    let scenario = write(place.path(), "fast.ron", &format!("\u{feff}{fast}"));
    let (code, message) = ends(&["generate", path(&scenario), "--out", path(&place.path().join("out"))]);
    assert_eq!(code, Some(0), "{message}");
    assert!(message.contains("no particle is in both frames"), "{message}");
}
