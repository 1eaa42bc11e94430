//! The command line: successful runs, invalid input, no incomplete output; estimates of `--dry-run`.

use std::path::Path;
use std::process::Stdio;

use serde_json::Value;
use suite::microsig::{fail, generate, json, listing, microsig, path, run, write};

const SCENARIO: &str = r#"(
    name: "small",
    optics: (pixel_dim_x: 90, pixel_dim_y: 70),
    motion: flow(field: poiseuille()),
    particles: (number: count(4)),
    timing: pairs(count: 2),
)"#;

/// Starts a run, waits until `ready` and kills it; `false` if it ended before.
pub(crate) fn kill_when(arguments: &[&str], ready: impl Fn() -> bool) -> bool {
    let mut child = microsig().arg("--quiet").args(arguments).stdout(Stdio::null()).spawn().unwrap();
    loop {
        if child.try_wait().unwrap().is_some() {
            return false;
        }
        if ready() {
            child.kill().unwrap();
            return !child.wait().unwrap().success();
        }
        std::thread::yield_now();
    }
}

#[test]
fn a_dataset_verifies_and_can_be_made_again() {
    let place = tempfile::tempdir().unwrap();
    let dataset = generate(place.path(), "dataset", SCENARIO);
    let result = json(&["verify", path(&dataset), "--regenerate"]);
    assert_eq!(result["regenerated"], true);
    assert_eq!(listing(place.path()), ["dataset", "dataset.ron"]);

    // The scenario stored in a dataset reproduces it.
    let again = place.path().join("again");
    run(&["generate", path(&dataset.join("scenario.ron")), "--out", path(&again)]);
    let sums = |d: &Path| std::fs::read_to_string(d.join("SHA256SUMS")).unwrap();
    assert_eq!(sums(&dataset), sums(&again));
}

#[test]
fn nothing_is_overwritten_without_force() {
    let place = tempfile::tempdir().unwrap();
    let dataset = generate(place.path(), "dataset", SCENARIO);
    let scenario = place.path().join("dataset.ron");
    let arguments = ["generate", path(&scenario), "--out", path(&dataset)];
    assert!(fail(2, &arguments).contains("already exists"));
    run(&[&arguments[..], &["--force"]].concat());

    // A folder that is not a dataset is never removed.
    let own = place.path().join("own");
    std::fs::create_dir(&own).unwrap();
    write(&own, "thesis.txt", "three years of work");
    let message = fail(2, &["generate", path(&scenario), "--out", path(&own), "--force"]);
    assert!(message.contains("not replaced") && own.join("thesis.txt").exists(), "{message}");

    let images = place.path().join("images");
    let (settings, particles) = (dataset.join("settings.txt"), dataset.join("particles"));
    let arguments = ["render", path(&settings), path(&particles), path(&images)];
    run(&arguments);
    assert!(fail(2, &arguments).contains("pair_00000_a.tif: already exists; --force replaces it"));
    run(&[&arguments[..], &["--force"]].concat());
}

/// Mistakes that everybody makes once name the right path.
#[test]
fn exchanged_arguments_and_folders_that_are_no_dataset_are_named() {
    let place = tempfile::tempdir().unwrap();
    let dataset = generate(place.path(), "dataset", SCENARIO);
    let result = write(place.path(), "result.csv", "frame,x_px,y_px\n0,1,1\n");
    for check in [&[][..], &["--validate-only"]] {
        let said = fail(2, &[&["evaluate", path(&result), path(&dataset)], check].concat());
        assert!(said.contains("give the dataset first, then the result"), "{said}");
    }
    let said = fail(2, &["evaluate", path(place.path()), path(&result)]);
    let named = format!("no dataset: it has no datapackage.json; {} is one", dataset.display());
    assert!(said.contains(&named), "{said}");
    let said = fail(
        2,
        &["track", path(&dataset.join("images")), "--method", "spots", "--out", path(&result), "--force"],
    );
    assert!(said.contains("no dataset") && said.contains("dataset is one"), "{said}");
    let said = fail(2, &["track", path(&result), "--method", "spots", "--out", "never.csv"]);
    assert!(said.contains("a file; expected the folder of a dataset"), "{said}");
}

#[test]
fn an_interrupted_run_goes_on_with_resume_only() {
    let place = tempfile::tempdir().unwrap();
    let text = SCENARIO.replace("count: 2", "count: 60");
    let scenario = write(place.path(), "scenario.ron", &text);
    let (whole, dataset) = (place.path().join("whole"), place.path().join("dataset"));
    run(&["generate", path(&scenario), "--out", path(&whole)]);
    let sums = |d: &Path| std::fs::read_to_string(d.join("SHA256SUMS")).unwrap();

    let partial = dataset.with_added_extension("partial");
    let images = || std::fs::read_dir(partial.join("images")).map_or(0, Iterator::count);
    let arguments = ["generate", path(&scenario), "--out", path(&dataset)];
    assert!(kill_when(&[&arguments[..], &["--threads", "1"]].concat(), || images() >= 4), "the run was over");
    assert!(fail(1, &["verify", path(&partial)]).contains("unfinished"));
    // As after a power failure: truncated files, among them a finished image.
    write(&partial, "images/.unfinished-x1", "half");
    write(&partial, "truth/tracks.csv", "frame,t_");
    write(&partial, "images/pair_00000_a.tif", "");
    assert!(fail(2, &arguments).contains("--resume"));
    let resumed = [&arguments[..], &["--resume"]].concat();

    // A foreign file stops the run and is named; it is neither included nor removed.
    let notes = write(&partial, "images/notes.txt", "mine");
    for arguments in [&resumed, &[&arguments[..], &["--force"]].concat()] {
        let message = fail(2, arguments);
        assert!(message.contains("images/notes.txt") && notes.exists(), "{message}");
    }
    std::fs::remove_file(notes).unwrap();
    let other = write(place.path(), "other.ron", text.replace("count(4)", "count(5)"));
    let message = fail(2, &["generate", path(&other), "--out", path(&dataset), "--resume"]);
    assert!(message.contains("another scenario"), "{message}");

    run(&resumed);
    assert_eq!(sums(&dataset), sums(&whole));
    run(&["verify", path(&dataset)]);
    // A job that is restarted when everything is complete.
    let said = run(&resumed);
    assert!(said.contains("already exists"), "{said}");
    let message = fail(2, &["generate", path(&other), "--out", path(&dataset), "--resume"]);
    assert!(message.contains("another scenario; cannot resume"), "{message}");
    assert_eq!(sums(&dataset), sums(&whole));
    assert_eq!(listing(place.path()), ["dataset", "other.ron", "scenario.ron", "whole"]);
}

#[test]
fn the_command_tells_its_version_and_completes_itself() {
    let said: serde_json::Value = json(&["--version"]);
    assert_eq!(
        (said["name"].as_str(), said["version"].as_str()),
        (Some("microsig"), Some(env!("CARGO_PKG_VERSION")))
    );
    for shell in ["bash", "zsh", "fish"] {
        assert!(run(&["completions", shell]).contains("generate"), "{shell}");
    }
    let place = tempfile::tempdir().unwrap();
    let pages = place.path().join("man1");
    run(&["man", path(&pages)]);
    let page = std::fs::read_to_string(pages.join("microsig-suite-score.1")).unwrap();
    assert!(page.contains("leaderboard"), "{page}");
    assert!(fail(2, &["flows", "--threads", "65536"]).contains("65536 is not in 0..=1024"));
}

#[test]
fn a_seed_and_a_plot_that_cannot_be_are_refused_with_what_can() {
    for seed in ["-1", "18446744073709551616", "x"] {
        let said = fail(2, &["generate", "quickstart", "--seed", seed]);
        let expected = "for '--seed <N>': expected an integer from 0 to 18446744073709551615";
        assert!(said.contains(&format!("'{seed}' {expected}")), "{said}");
    }
    let place = tempfile::tempdir().unwrap();
    let scenario = write(place.path(), "scenario.ron", SCENARIO);
    let (pdf, nowhere) = (place.path().join("a.pdf"), place.path().join("none/a.svg"));
    for verb in [vec!["optics", path(&scenario)], vec!["flows", "uniform"]] {
        let plot = |file: &Path, code| fail(code, &[&verb[..], &["--plot", path(file)]].concat());
        let said = plot(&pdf, 2);
        assert!(said.contains("expected a name that ends in .svg or .png") && !pdf.exists(), "{said}");
        let said = plot(&nowhere, 1);
        let missing = format!("the folder {} does not exist", place.path().join("none").display());
        assert!(said.contains(&format!("{}: {missing}", nowhere.display())), "{said}");
    }
}

#[test]
fn wrong_scenarios_name_what_is_wrong_and_leave_nothing() {
    let place = tempfile::tempdir().unwrap();
    for (from, to, expected) in [
        ("count(4)", "count(4), colour: red", "unknown key `particles.colour`"),
        (
            "pairs(count: 2)",
            "pairs(count: 2, exposure_s: 0.01)",
            "timing.pairs.exposure_s = 0.01 (0.01 s in total): expected",
        ),
        ("pixel_dim_x: 90", "pixel_dim_x: 0", "optics.pixel_dim_x = 0: expected a whole number"),
        ("pixel_dim_x: 90", "settings: \"missing.txt\"", "missing.txt"),
        ("count: 2", "count: two", "scenario.ron:6:"),
        ("\"small\"", "\"../small\"", "name = `../small`"),
    ] {
        let scenario = write(place.path(), "scenario.ron", SCENARIO.replace(from, to));
        let out = place.path().join("dataset");
        let message = fail(2, &["generate", path(&scenario), "--out", path(&out)]);
        assert!(message.contains(expected), "{to}: {message}");
        assert_eq!(listing(place.path()), ["scenario.ron"], "{to}");
    }
}

#[test]
fn render_takes_what_the_formats_allow() {
    let place = tempfile::tempdir().unwrap();
    let mut bytes = Vec::new();
    let small =
        microsig_core::Settings { pixel_dim_x: 50, pixel_dim_y: 40, ..microsig_core::Settings::setting1() };
    microsig_core::formats::settings_file::write(&mut bytes, &small).unwrap();
    let data = place.path().join("data");
    std::fs::create_dir(&data).unwrap();
    // The settings file may be in the folder of the data files.
    let settings = write(&data, "settings.txt", &(String::from_utf8(bytes).unwrap() + "lamp = 3\n"));
    write(&data, "a10.txt", "25;20;-30;2;0.5\n");
    write(&data, "a9.txt", "# nobody\n");
    write(&data, "a11.txt", "25 20 -30 6 3 0.4 0.7\n25 20 0 2 0.3 0 0\n");
    let out = place.path().join("out");
    let result = json(&["render", path(&settings), path(&data), path(&out), "--spheroids", "uniform"]);
    assert_eq!((result["images"].as_u64(), result["particles"].as_u64()), (Some(3), Some(3)));
    assert!(result["warnings"][0].as_str().unwrap().contains("unknown key `lamp`"));
    assert_eq!(listing(&out), ["a10.tif", "a11.tif", "a9.tif"]);

    // Frames are numbered in natural order: a9 is frame 0, a10 frame 1.
    let single = place.path().join("single");
    let file = data.join("a10.txt");
    run(&["render", path(&settings), path(&file), path(&single), "--first-frame", "1"]);
    assert!(std::fs::read(single.join("a10.tif")).unwrap() == std::fs::read(out.join("a10.tif")).unwrap());
}

#[test]
fn a_listed_place_that_is_refused_has_file_and_line() {
    let place = tempfile::tempdir().unwrap();
    write(
        place.path(),
        "places.txt",
        "# x y z d\n10 10 -30 2\n\n50 40 -30 2 # in the channel\n50 40 500 2\n",
    );
    let listed = SCENARIO.replace("count(4)", "file(\"places.txt\")");
    let scenario = write(place.path(), "s.ron", &listed);
    for arguments in [&["generate", path(&scenario)][..], &["generate", path(&scenario), "--dry-run"]] {
        let message = fail(2, arguments);
        assert!(
            message.contains("places.txt:5: x = 50 px, y = 40 px, z = 500 um: expected a position inside"),
            "{message}"
        );
        assert!(message.contains("particles.number.file"), "{message}");
    }
}

fn estimate(scenario: &str, set: &[&str]) -> Value {
    let place = tempfile::tempdir().unwrap();
    write(place.path(), "places.txt", "10 10 -30 2\n50 40 -30 2\n");
    let file = write(place.path(), "s.ron", scenario);
    let set = set.iter().flat_map(|set| ["--set", set]);
    let arguments: Vec<&str> =
        ["generate", path(&file), "--dry-run", "--threads", "1"].into_iter().chain(set).collect();
    json(&arguments)
}

#[test]
fn estimates_cover_listed_particles_and_the_memory_of_rays() {
    let listed = SCENARIO.replace("count(4)", "file(\"places.txt\")");
    let cost = estimate(&listed, &[]);
    assert_eq!(cost["particles_per_frame"], 2.0);
    assert!(cost["seconds"].as_f64().unwrap() > 0.0);
    // 6 million source points, of which one image takes tens of seconds: an estimate may not draw it.
    let many = estimate(&listed, &["optics.points_per_pixel=100000"]);
    let memory = many["memory_bytes"].as_u64().unwrap();
    assert!((400_000_000..2_000_000_000).contains(&memory), "{memory}");
    assert!(many["seconds"].as_f64().unwrap() > 10.0 * cost["seconds"].as_f64().unwrap(), "{many} {cost}");
}
