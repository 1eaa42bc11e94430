//! Robustness: killed runs, full disks, damaged datasets.

use std::path::{Path, PathBuf};
use std::process::Command;

use microsig_core::render::Context;
use storage::Progress;
use suite::microsig::{binary, fail, path, run, write};

/// Each image takes long enough for an interruption.
const SCENARIO: &str = r#"(
    name: "long",
    optics: (pixel_dim_x: 200, pixel_dim_y: 100, points_per_pixel: 9),
    motion: flow(field: poiseuille()),
    particles: (number: count(6)),
    timing: pairs(count: 40),
    calibration: none,
)"#;

/// Runs the command with a limit of the shell. `-f` acts like a full disk: a write fails.
#[cfg(unix)]
fn limited(limit: &str, arguments: &[&str]) -> (Option<i32>, String) {
    let script = format!("ulimit {limit}; exec \"$@\"");
    let output =
        Command::new("sh").args(["-c", &script, "sh"]).arg(binary()).args(arguments).output().unwrap();
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

#[cfg(unix)]
#[test]
fn what_cannot_be_written_is_said_and_leaves_no_result() {
    let place = tempfile::tempdir().unwrap();
    let scenario = write(place.path(), "base.ron", SCENARIO.replace("count: 40", "count: 2"));
    let sweep = r#"(name: "s", base: "base.ron", axes: [(path: "seed", values: list([1, 2]))])"#;
    let sweep = write(place.path(), "sweep.ron", sweep);
    let dataset = place.path().join("dataset");
    run(&["generate", path(&scenario), "--out", path(&dataset)]);
    let (settings, particles) = (dataset.join("settings.txt"), dataset.join("particles"));
    let tracks = dataset.join("truth/tracks.csv");
    let out = place.path().join("out");
    let generate = vec!["generate", path(&scenario), "--out", path(&out)];
    let render = vec!["render", path(&settings), path(&particles), path(&out)];
    let evaluate = vec!["evaluate", path(&dataset), path(&tracks), "--out", path(&out)];
    let sweep = vec!["sweep", path(&sweep), "--out", path(&out)];
    let released = place.path().join("released");
    let release = vec!["release", path(&dataset), "--out", path(&released)];
    // Images take 40 kB, the tables less.
    for (arguments, kilobytes) in [
        (&generate, 16),
        (&generate, 1),
        (&render, 16),
        (&evaluate, 1),
        (&sweep, 16),
        (&release, 50),
        (&release, 1),
    ] {
        let (code, message) = limited(&format!("-f {}", 2 * kilobytes), arguments);
        assert_eq!(code, Some(1), "{arguments:?}: {message}");
        assert!(message.starts_with("error: ") && message.contains("File too large"), "{message}");
        assert!(message.contains(path(place.path())), "no path: {message}");
        let out = Path::new(arguments[arguments.len() - 1]);
        let finished = std::fs::read_dir(out).map_or(0, |cases| {
            cases.flatten().filter(|case| case.path().extension().is_none_or(|e| e != "partial")).count()
        });
        assert_eq!(finished, 0, "{arguments:?}");
        assert!(arguments[0] == "sweep" || !out.exists(), "{arguments:?}");
        // The interrupted run continues once there is space.
        if arguments[0] == "generate" {
            run(&[&arguments[..], &["--resume"]].concat());
            assert!(suite::tree(out).unwrap() == suite::tree(&dataset).unwrap());
            std::fs::remove_dir_all(out).unwrap();
        }
    }
    run(&[&sweep[..], &["--resume"]].concat());
}

/// A small dataset with every kind of file.
fn small(place: &Path) -> PathBuf {
    let text = r#"(
        name: "small",
        optics: (pixel_dim_x: 40, pixel_dim_y: 30, points_per_pixel: 4, settings: "own.txt"),
        motion: flow(field: poiseuille()),
        particles: (number: file("places.txt")),
        boundaries: (z_um: (-30, -20)),
        timing: pairs(count: 1),
    )"#;
    let mut settings = Vec::new();
    microsig_core::formats::settings_file::write(&mut settings, &microsig_core::Settings::setting1())
        .unwrap();
    write(place, "own.txt", String::from_utf8(settings).unwrap());
    write(place, "places.txt", "20 15 -25 2\n5 5 -28 2\n");
    let scenario = write(place, "scenario.ron", text);
    let dataset = place.join("dataset");
    run(&["generate", path(&scenario), "--out", path(&dataset)]);
    dataset
}

fn verifies(dataset: &Path) -> bool {
    generator::runner::verify(dataset, false, Progress::default(), &Context::default()).is_ok()
}

#[test]
fn verify_finds_a_flipped_bit_in_any_file_and_files_that_are_missing_or_too_many() {
    let place = tempfile::tempdir().unwrap();
    let dataset = small(place.path());
    let whole = suite::tree(&dataset).unwrap();
    let kinds = ["SHA256SUMS", "README.md", "preview.png", "inputs/own.txt", "calibration/calibration.csv"];
    assert!(kinds.iter().all(|kind| whole.contains_key(*kind)), "{whole:?}");
    let refuse = |file: &Path, good: &[u8], at: usize, bit: usize| {
        let mut broken = good.to_vec();
        broken[at] ^= 1 << bit;
        std::fs::write(file, &broken).unwrap();
        assert!(!verifies(&dataset), "bit {bit} of byte {at} of {} is flipped", file.display());
        std::fs::write(file, good).unwrap();
    };
    for (i, file) in whole.keys().enumerate() {
        let file = dataset.join(file);
        let good = std::fs::read(&file).unwrap();
        // Changes a different byte and bit in each file.
        refuse(&file, &good, (i * 7919) % good.len(), i % 8);
        let aside = place.path().join("aside");
        std::fs::rename(&file, &aside).unwrap();
        assert!(!verifies(&dataset), "{} is missing", file.display());
        std::fs::rename(&aside, &file).unwrap();
    }
    // `sha256sum` ignores the case of hexadecimal digits.
    let sums = dataset.join("SHA256SUMS");
    let good = std::fs::read(&sums).unwrap();
    refuse(&sums, &good, good.iter().position(u8::is_ascii_lowercase).unwrap(), 5);
    let told = |what: &str| assert!(fail(1, &["verify", path(&dataset)]).contains(what), "{what}");
    for extra in ["notes.txt", "images/pair_00001_a.tif", ".hidden"] {
        std::fs::write(dataset.join(extra), "x").unwrap();
        told(&format!("{extra}: not in SHA256SUMS"));
        std::fs::remove_file(dataset.join(extra)).unwrap();
    }
    let image = dataset.join("images/pair_00000_b.tif");
    let good = std::fs::read(&image).unwrap();
    std::fs::write(&image, &good[1..]).unwrap();
    told("images/pair_00000_b.tif: changed");
    std::fs::remove_file(&image).unwrap();
    told("images/pair_00000_b.tif: missing");
    std::fs::write(&image, good).unwrap();
    // The name alone does not make it unfinished.
    let partial = place.path().join("dataset.partial");
    std::fs::rename(&dataset, &partial).unwrap();
    assert!(verifies(&partial));
    std::fs::rename(&partial, &dataset).unwrap();
    run(&["verify", path(&dataset), "--regenerate"]);
}

/// Changes a file of a dataset and updates checksums and manifest accordingly.
fn forge(dataset: &Path, name: &str, change: impl Fn(&str) -> String) {
    let rewrite = |name: &str, change: &dyn Fn(&str) -> String| {
        let file = dataset.join(name);
        let (old, text) = (suite::sha256(&file).unwrap(), std::fs::read_to_string(&file).unwrap());
        let changed = change(&text);
        assert_ne!(text, changed, "{name}");
        std::fs::write(&file, changed).unwrap();
        (old, suite::sha256(&file).unwrap())
    };
    let (old, new) = rewrite(name, &change);
    let manifest = rewrite("datapackage.json", &|text| text.replace(&old, &new));
    rewrite("SHA256SUMS", &|text| text.replace(&old, &new).replace(&manifest.0, &manifest.1));
}

#[test]
fn verify_finds_forged_tables_and_scenarios() {
    let place = tempfile::tempdir().unwrap();
    let dataset = small(place.path());
    let files = suite::tree(&dataset).unwrap().into_keys().map(|file| dataset.join(file));
    let whole: Vec<_> = files.map(|file| (std::fs::read(&file).unwrap(), file)).collect();
    let restore = || {
        for (bytes, file) in &whole {
            std::fs::write(file, bytes).unwrap();
        }
        assert!(verifies(&dataset));
    };
    // Checksums updated, manifest not.
    let file = dataset.join("truth/displacements.csv");
    let (old, text) = (suite::sha256(&file).unwrap(), std::fs::read_to_string(&file).unwrap());
    let changed = text.replacen(",10,", ",11,", 1);
    assert_ne!(changed, text);
    std::fs::write(&file, changed).unwrap();
    let sums = std::fs::read_to_string(dataset.join("SHA256SUMS")).unwrap();
    std::fs::write(dataset.join("SHA256SUMS"), sums.replace(&old, &suite::sha256(&file).unwrap())).unwrap();
    assert!(fail(1, &["verify", path(&dataset)]).contains("truth/displacements.csv"));
    restore();

    // Both updated: only regeneration detects the change.
    for (name, cell, other) in [
        ("truth/displacements.csv", ",10,", ",11,"),
        ("truth/tracks.csv", "-0.3225", "-0.4225"),
        ("truth/field.csv", ",3.6,", ",3.7,"),
        ("calibration/calibration.csv", "-30", "-31"),
    ] {
        forge(&dataset, name, |text| text.replacen(cell, other, 1));
        assert!(verifies(&dataset), "{name}");
        let said = fail(1, &["verify", path(&dataset), "--regenerate"]);
        assert!(said.contains(&format!("{name}: has different bytes when generated again")), "{said}");
        restore();
    }
    forge(&dataset, "scenario.ron", |text| text.replace("seed: 0", "seed: 1"));
    assert!(verifies(&dataset));
    let said = fail(1, &["verify", path(&dataset), "--regenerate"]);
    assert!(said.contains("has different bytes when generated again"), "{said}");
    restore();

    // A cell that is not a number, with valid checksums.
    forge(&dataset, "truth/tracks.csv", |text| text.replacen("\n0,", "\nzero,", 1));
    assert!(
        fail(1, &["verify", path(&dataset)]).contains("frame = \"zero\": expected a value of type integer")
    );
}
