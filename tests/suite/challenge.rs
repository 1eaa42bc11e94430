//! Challenges resist cheating: truths revealed by train, links to the truth, oversized and disguised
//! submissions.

use std::fs;
use std::io::Write;
use std::path::Path;

use serde_json::Value;
use suite::microsig::{fail, generate, listing, path, run};

use crate::release::{CHALLENGE, images_sha256, scenario, submission, unpack};

/// A regular grid of particles does not depend on the key.
#[test]
fn truths_that_do_not_depend_on_the_key_are_refused() {
    let place = tempfile::tempdir().unwrap();
    for (name, seeding) in [("grid", "jittered_grid(0.0)"), ("jitter", "jittered_grid(0.05)")] {
        let particles = format!("particles: (number: per_um3(1e-4), seeding: {seeding})");
        let text = scenario(3).replace("particles: (number: count(20))", &particles);
        let dataset = generate(place.path(), name, &text);
        let out = place.path().join("out");
        let message = fail(2, &["release", path(&dataset), "--out", path(&out)]);
        assert!(message.contains("train reveals the truth of test") && message.contains('%'), "{message}");
        assert!(!out.exists() && !place.path().join("out.partial").exists());
    }
}

/// Train and test have the same flow: train's truth/field.csv would be a perfect submission.
#[test]
fn fields_that_train_tells_are_not_scored() {
    let c = &*CHALLENGE;
    let place = tempfile::tempdir().unwrap();
    let good = submission(place.path(), &images_sha256());
    let train = fs::read_to_string(c.dataset.join("truth/field.csv")).unwrap();
    let test = fs::read_to_string(c.out.join("withheld/test/truth/field.csv")).unwrap();
    assert_eq!(train, test);
    fs::write(good.join("results.csv"), "pair,x_px,y_px,dx_px,dy_px,flag\n0,40,40,1,0,0\n").unwrap();
    for split in [c.test.clone(), c.out.join("withheld/test")] {
        let message = fail(2, &["evaluate", path(&split), path(&good), "--quiet"]);
        assert!(message.contains("scores particles only"), "{message}");
    }
}

#[cfg(unix)]
#[test]
fn links_pipes_and_devices_are_refused() {
    let c = &*CHALLENGE;
    let place = tempfile::tempdir().unwrap();
    let good = submission(place.path(), &images_sha256());
    let test = c.out.join("withheld/test");
    let refused = |expected: &str| {
        for more in [&[][..], &["--validate-only"]] {
            let message = fail(2, &[&["evaluate", path(&test), path(&good), "--quiet"], more].concat());
            assert!(message.contains(expected), "{expected}: {message}");
        }
    };
    let results = good.join("results.csv");
    let text = fs::read(&results).unwrap();
    fs::remove_file(&results).unwrap();
    std::os::unix::fs::symlink(test.join("truth/tracks.csv"), &results).unwrap();
    refused("results.csv: a symbolic link");
    fs::remove_file(&results).unwrap();
    fs::write(&results, &text).unwrap();
    // Anywhere in the folder, also where nothing is read.
    std::os::unix::fs::symlink(test.join("truth"), good.join("more")).unwrap();
    refused("more: a symbolic link");
    fs::remove_file(good.join("more")).unwrap();
    let about = good.join("submission.json");
    let json = fs::read(&about).unwrap();
    fs::remove_file(&about).unwrap();
    assert!(std::process::Command::new("mkfifo").arg(&about).status().unwrap().success());
    refused("submission.json: a pipe, device or socket");
    fs::remove_file(&about).unwrap();
    fs::write(&about, json).unwrap();
    run(&["evaluate", path(&test), path(&good), "--quiet"]);
    // As results and as truth.
    for (truth, result) in [(results.as_path(), Path::new("/dev/zero")), (Path::new("/dev/zero"), &results)] {
        let message = fail(2, &["evaluate", path(truth), path(result)]);
        assert!(message.contains("/dev/zero: a pipe, device or socket"), "{message}");
    }
}

/// Writes an archive of files, each of which repeats some bytes.
fn zipped(archive: &Path, files: [(&str, (&[u8], usize)); 2]) {
    let mut zip = zip::ZipWriter::new(fs::File::create(archive).unwrap());
    for (file, (bytes, times)) in files {
        zip.start_file(file, zip::write::SimpleFileOptions::default()).unwrap();
        (0..times).for_each(|_| zip.write_all(bytes).unwrap());
    }
    zip.finish().unwrap();
}

#[test]
fn archives_are_bounded_by_the_size_of_the_truth() {
    let c = &*CHALLENGE;
    let place = tempfile::tempdir().unwrap();
    let good = submission(place.path(), &images_sha256());
    let (results, about) =
        (fs::read(good.join("results.csv")).unwrap(), fs::read(good.join("submission.json")).unwrap());
    let test = c.out.join("withheld/test");
    let refused = |name: &str, results: (&[u8], usize), about: (&[u8], usize), expected: &str| {
        let archive = place.path().join(name);
        zipped(&archive, [("results.csv", results), ("submission.json", about)]);
        let message = fail(2, &["evaluate", path(&test), path(&archive), "--quiet"]);
        assert!(message.contains(expected), "{expected}: {message}");
    };
    let blanks = [b' '; 1 << 16];
    refused("blanks.zip", (&results, 1), (&blanks, 1 << 7), "submission.json is larger than 1048576 bytes");
    // 16 MiB are always allowed.
    refused("long.zip", (&blanks, 1 << 9), (&about, 1), "results.csv is larger than");
    let rows = "0,-1,5,5,0\n".repeat(1000);
    let header = "frame,track,x_px,y_px,z_um\n";
    let many = format!("{header}{}", rows.repeat(150));
    refused("rows.zip", (many.as_bytes(), 1), (&about, 1), "results.csv: more than 100000 rows");

    let archive = place.path().join("two.zip");
    zipped(&archive, [("results.csv", (&results, 1)), ("team/results.csv", (&results, 1))]);
    let message = fail(2, &["evaluate", path(&test), path(&archive), "--quiet"]);
    assert!(message.contains("2 entries named results.csv"), "{message}");

    // Messages about a file in an archive name the archive, also when a valid submission is scored.
    let archive = place.path().join("good.zip");
    zipped(&archive, [("results.csv", (&results, 1)), ("submission.json", (&about, 1))]);
    let message = fail(2, &["evaluate", path(&test), path(&archive), "--format", "trackpy", "--quiet"]);
    assert!(message.contains("good.zip/results.csv: column "), "{message}");
}

/// In the image plane the gate is wider: a result without depth would win.
#[test]
fn results_without_depth_are_refused_where_depth_is_scored() {
    let c = &*CHALLENGE;
    let place = tempfile::tempdir().unwrap();
    let good = submission(place.path(), &images_sha256());
    let mut reader = csv::Reader::from_path(good.join("results.csv")).unwrap();
    let header = reader.headers().unwrap().clone();
    let mut writer = csv::Writer::from_writer(Vec::new());
    for record in std::iter::once(header.clone()).chain(reader.records().map(Result::unwrap)) {
        writer
            .write_record(record.iter().zip(&header).filter(|(_, name)| *name != "z_um").map(|(v, _)| v))
            .unwrap();
    }
    let text = writer.into_inner().unwrap();
    fs::write(good.join("results.csv"), text).unwrap();
    let test = c.out.join("withheld/test");
    for verb in
        [&["check-submission", path(&c.test), path(&good)][..], &["evaluate", path(&test), path(&good)]]
    {
        let message = fail(2, verb);
        assert!(
            message.contains("no z_um, or 0 in every row; this challenge is scored in depth"),
            "{message}"
        );
    }
}

/// Particles in focus have no depth to measure: both sides take a result in the image plane.
#[test]
fn results_without_depth_are_taken_where_all_is_in_focus() {
    let place = tempfile::tempdir().unwrap();
    let optics = "optics: (gaussian: (diameter_px: 3, peak_counts: 200), ";
    let dataset = generate(place.path(), "focus", &scenario(4).replace("optics: (", optics));
    let (out, test) = (place.path().join("out"), place.path().join("unpacked"));
    run(&["release", path(&dataset), "--out", path(&out), "--quiet"]);
    unpack(&out.join("public/small-test.zip"), &test);
    let test = test.join("small-test");
    let found = submission(place.path(), &suite::microsig::images_sha256(&test));
    fs::write(found.join("results.csv"), "frame,track,x_px,y_px\n0,-1,5,5\n").unwrap();
    for verb in ["check-submission", "evaluate"] {
        let split = if verb == "evaluate" { &out.join("withheld/test") } else { &test };
        run(&[verb, path(split), path(&found), "--quiet"]);
    }
}

/// Files for a team contain no true positions.
#[test]
fn scores_for_a_team_stand_apart_from_the_truth() {
    let c = &*CHALLENGE;
    let place = tempfile::tempdir().unwrap();
    let good = submission(place.path(), &images_sha256());
    let out = place.path().join("scores");
    let test = c.out.join("withheld/test");
    run(&["evaluate", path(&test), path(&good), "--out", path(&out), "--report", "--quiet"]);
    // The journal has hashes, but no positions.
    let names = |folder: &Path| -> Vec<String> {
        listing(folder).into_iter().filter(|name| !name.starts_with('.')).collect()
    };
    let private =
        ["curves.csv", "for_team", "matches.csv", "per_frame.csv", "report.html", "score.json", "units.json"];
    assert_eq!(names(&out), private);
    let for_team = out.join("for_team");
    assert_eq!(names(&for_team), ["score.json"]);
    let told: Value =
        serde_json::from_str(&fs::read_to_string(for_team.join("score.json")).unwrap()).unwrap();
    assert!(told["detection"]["f1"].is_f64() && told["detection"]["tp"].is_null(), "{told}");
    // For a public dataset all files are in one folder.
    let own = place.path().join("own");
    let tracks = c.dataset.join("truth/tracks.csv");
    run(&["evaluate", path(&c.dataset), path(&tracks), "--out", path(&own), "--quiet"]);
    assert!(own.join("matches.csv").is_file() && !own.join("for_team").exists());
}

#[test]
fn names_from_submissions_are_shown_as_text() {
    let c = &*CHALLENGE;
    let place = tempfile::tempdir().unwrap();
    let good = submission(place.path(), &images_sha256());
    let about = good.join("submission.json");
    let text = fs::read_to_string(&about).unwrap();
    let disguised = text.replace("\"team\":\"A\"", "\"team\":\"\\u001b[2J\\u009b31m\\u202eB\"");
    assert_ne!(text, disguised);
    fs::write(&about, disguised).unwrap();
    for more in [&[][..], &["--json"]] {
        let said = run(&[&["evaluate", "--validate-only", path(&c.test), path(&good)], more].concat());
        assert!(said.contains("[2J") && !said.contains(['\u{1b}', '\u{9b}', '\u{202e}']), "{said:?}");
    }
}
