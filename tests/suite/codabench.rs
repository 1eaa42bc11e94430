//! The bundle for Codabench: its files, and its scoring program, run on files laid out as the platform does. `chain`
//! compares its numbers with `evaluate`.

use std::io::Write;
use std::path::Path;
use std::process::Command;

use serde_json::Value;
use suite::microsig::{binary, fail, path, run, write};

use crate::release::{CHALLENGE, images_sha256, submission, unpack};

/// A wheel whose module runs the program that STANDS_FOR names.
fn stand_in(wheel: &Path) {
    let main =
        "import os, subprocess, sys\nsys.exit(subprocess.call([os.environ['STANDS_FOR'], *sys.argv[1:]]))\n";
    let about = "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n";
    let mut zip = zip::ZipWriter::new(std::fs::File::create(wheel).unwrap());
    for (name, text) in [
        ("microsig/__init__.py", ""),
        ("microsig/__main__.py", main),
        ("microsig-0.dist-info/METADATA", "Metadata-Version: 2.1\nName: microsig\nVersion: 0\n"),
        ("microsig-0.dist-info/WHEEL", about),
        ("microsig-0.dist-info/RECORD", ""),
    ] {
        zip.start_file(name, zip::write::SimpleFileOptions::default()).unwrap();
        zip.write_all(text.as_bytes()).unwrap();
    }
    zip.finish().unwrap();
}

#[test]
fn the_bundle_has_all_that_its_scoring_program_needs() {
    let c = &*CHALLENGE;
    let place = tempfile::tempdir().unwrap();
    let out = place.path().join("challenge");
    let wheel = place.path().join("microsig-0-py3-none-any.whl");
    stand_in(&wheel);
    let with = ["--codabench", "--wheel", path(&wheel), "--quiet"];
    run(&[&["release", path(&c.dataset), "--out", path(&out)], &with[..]].concat());
    assert!(!out.join("public/codabench.zip").exists(), "it has the truth");

    // As the platform does: reference data, submission and program are unpacked below /app.
    let bundle = place.path().join("bundle");
    unpack(&out.join("withheld/codabench.zip"), &bundle);
    let app = place.path().join("app");
    unpack(&bundle.join("reference_data.zip"), &app.join("input/ref"));
    unpack(&bundle.join("scoring_program.zip"), &app.join("program"));
    let told = suite::tree(&app.join("input/ref")).unwrap();
    assert!(
        told.contains_key("test/truth/tracks.csv") && told.contains_key("particles_only.txt"),
        "{told:?}"
    );
    let secret = ["secret_key", "images/"];
    assert!(!told.keys().any(|file| secret.iter().any(|part| file.contains(part))), "{told:?}");
    assert!(app.join("program/microsig-0-py3-none-any.whl").exists());
    let metadata = std::fs::read_to_string(app.join("program/metadata.yaml")).unwrap();
    assert_eq!(metadata, "command: python3 /app/program/scoring.py /app/input /app/output\n");

    let test = out.join("withheld/test");
    let good = submission(place.path(), &suite::microsig::images_sha256(&test));
    // Not a perfect result: every third point is missing.
    let truth = std::fs::read_to_string(test.join("truth/tracks.csv")).unwrap();
    let kept = truth.lines().enumerate().filter(|(i, _)| i % 3 != 1).map(|(_, line)| format!("{line}\n"));
    std::fs::write(good.join("results.csv"), kept.collect::<String>()).unwrap();
    std::fs::rename(&good, app.join("input/res")).unwrap();

    let score = || {
        let mut command = Command::new("python3");
        command.env("MICROSIG", binary()).arg(app.join("program/scoring.py"));
        command.args([app.join("input"), app.join("output")]).output().unwrap()
    };
    let said = score();
    assert!(said.status.success(), "{}", String::from_utf8_lossy(&said.stderr));
    let read = |name: &str| -> Value {
        serde_json::from_slice(&std::fs::read(app.join("output").join(name)).unwrap()).unwrap()
    };
    let scores = read("scores.json");
    let written = std::fs::read(app.join("output/scores.json")).unwrap();
    // The numbers of the leaderboard are those told to the team.
    for (key, told) in [
        ("recall", "/detection/recall"),
        ("link_f1", "/links/f1"),
        ("sigma_z_over_h", "/gdpt/sigma_z_over_h"),
    ] {
        assert_eq!(Some(&scores[key]), read("score.json").pointer(told), "{key}");
    }
    assert!(scores["recall"].as_f64().unwrap() < 0.9, "{scores}");
    let competition = std::fs::read_to_string(bundle.join("competition.yaml")).unwrap();
    for line in competition.lines().filter_map(|line| line.trim().split_once(": ")) {
        let is_file = line.1.ends_with(".md") || line.1.ends_with(".zip") || line.1.ends_with(".png");
        assert!(!is_file || bundle.join(line.1).is_file(), "{line:?}");
    }

    // Where no command is installed, the wheel of the bundle is.
    let python = || {
        let mut command = Command::new("python3");
        command.env_remove("MICROSIG").env("PATH", "/usr/bin:/bin").env("STANDS_FOR", binary());
        command.env("PIP_DISABLE_PIP_VERSION_CHECK", "1");
        command
    };
    if python().args(["-m", "pip", "--version"]).output().is_ok_and(|said| said.status.success()) {
        let mut command = python();
        command.arg(app.join("program/scoring.py")).args([app.join("input"), app.join("wheel")]);
        let said = command.output().unwrap();
        assert!(said.status.success(), "{}", String::from_utf8_lossy(&said.stderr));
        assert_eq!(std::fs::read(app.join("wheel/scores.json")).unwrap(), written);
    }

    // A submission that is refused is told why.
    std::fs::write(app.join("input/res/results.csv"), "frame,x_px,y_px\n99,1,1\n").unwrap();
    let said = score();
    let message = String::from_utf8_lossy(&said.stderr).into_owned();
    assert!(!said.status.success() && message.contains("results.csv:2: frame = 99"), "{message}");
}

#[test]
fn a_submission_is_checked_by_a_verb_of_its_own() {
    let c = &*CHALLENGE;
    let place = tempfile::tempdir().unwrap();
    let good = submission(place.path(), &images_sha256());
    let alone = run(&["check-submission", path(&c.test), path(&good.join("results.csv"))]);
    assert!(alone.contains("particles; "), "{alone}");
    let wheel = write(place.path(), "x.txt", "");
    let out = place.path().join("out");
    let with = ["--codabench", "--wheel", path(&wheel)];
    let message = fail(2, &[&["release", path(&c.dataset), "--out", path(&out)], &with[..]].concat());
    assert!(message.contains("x.txt: expected a Python wheel"), "{message}");
}
