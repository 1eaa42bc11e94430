//! Habits of the command line: standard streams, names of shipped files, existing folders, quiet runs, progress.

use std::io::Write as _;
use std::path::Path;
use std::process::{Output, Stdio};

use serde_json::Value;
use suite::microsig::{fail, generate, microsig, path, run, succeed, text, told, write};

const SCENARIO: &str = r#"(
    name: "small",
    optics: (pixel_dim_x: 60, pixel_dim_y: 50, points_per_pixel: 4),
    motion: flow(field: poiseuille()),
    particles: (number: count(3)),
    timing: pairs(count: 1),
)"#;

/// Runs the command in a folder, with this standard input.
fn run_in(folder: &Path, arguments: &[&str], input: &str) -> Output {
    let mut command = microsig();
    command.current_dir(folder).args(arguments);
    let mut run =
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    // A command that fails early closes its input.
    let _ = run.stdin.take().unwrap().write_all(input.as_bytes());
    run.wait_with_output().unwrap()
}

fn sums(dataset: &Path) -> String {
    std::fs::read_to_string(dataset.join("SHA256SUMS")).unwrap()
}

#[test]
fn a_dash_is_standard_input_or_output() {
    let place = tempfile::tempdir().unwrap();
    let dataset = generate(place.path(), "dataset", SCENARIO);
    let here = |arguments: &[&str], input: &str| {
        let output = run_in(place.path(), arguments, input);
        assert!(output.status.success(), "{arguments:?}: {}", text(&output.stderr));
        (text(&output.stdout), text(&output.stderr))
    };
    here(&["generate", "-", "-o", "piped"], SCENARIO);
    assert_eq!(sums(&place.path().join("piped")), sums(&dataset));
    assert!(here(&["optics", "-"], SCENARIO).0.starts_with("small: M 10"));
    assert!(here(&["optics", "-", "--plot", "-"], SCENARIO).0.starts_with("<svg"));
    assert!(here(&["flows", "uniform", "--plot", "-"], "").0.starts_with("<svg"));

    let particles = std::fs::read_to_string(dataset.join("particles/pair_00000_a.txt")).unwrap();
    here(&["render", "dataset/settings.txt", "-", "rendered"], &particles);
    assert!(place.path().join("rendered/image.tif").is_file());

    let (rows, said) = here(&["track", "dataset", "--method", "ncc", "-o", "-"], "");
    assert!(rows.starts_with("frame,") && said.contains(" rows from 2 frames"), "{said}");
    let (scores, _) = here(&["evaluate", "dataset", "-", "--json"], &rows);
    write(place.path(), "rows.csv", &rows);
    let of_file = |json: &str| serde_json::from_str::<Value>(json).unwrap()["detection"].clone();
    assert_eq!(of_file(&scores), of_file(&here(&["evaluate", "dataset", "rows.csv", "--json"], "").0));
    assert!(here(&["check-submission", "dataset", "-"], &rows).0.contains("-: "));
    assert!(here(&["export", "dataset", "--format", "trackpy", "-o", "-"], "").0.starts_with("y,x,"));

    here(&["evaluate", "dataset", "rows.csv", "-o", "scores", "-q"], "");
    let score = std::fs::read_to_string(place.path().join("scores/score.json")).unwrap();
    here(&["compare", "-", "-o", "board"], &score);
    let board = std::fs::read_to_string(place.path().join("board/leaderboard.csv")).unwrap();
    assert!(board.contains(",small,") && board.contains("particles_3d"), "{board}");
}

#[test]
fn a_dash_is_no_folder_and_a_file_of_that_name_has_a_path() {
    let place = tempfile::tempdir().unwrap();
    let scenario = write(place.path(), "-", SCENARIO);
    let said = fail(2, &["generate", path(&scenario), "-o", "-"]);
    assert!(said.contains("'-' for '--out <DIR>': expected a folder; `./-`"), "{said}");
    let output = run_in(place.path(), &["generate", "./-", "-o", "./made"], "");
    assert!(output.status.success() && place.path().join("made/images").is_dir());
    let output = run_in(place.path(), &["generate", "-", "-o", "never"], "(name: 3)");
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("-:1:8: name = 3"), "{}", text(&output.stderr));
}

#[test]
fn new_prints_without_a_file() {
    let template = run(&["new"]);
    let place = tempfile::tempdir().unwrap();
    let file = place.path().join("mine.ron");
    run(&["new", path(&file)]);
    assert_eq!(std::fs::read_to_string(&file).unwrap(), template);
    assert!(run(&["new", "--from", "odpc1"]).contains("tracks:"));
}

#[test]
fn shipped_files_are_known_by_name() {
    let place = tempfile::tempdir().unwrap();
    let shipped = place.path().join("own.ron");
    run(&["new", path(&shipped), "--from", "quickstart"]);
    let of = |scenario: &str, out: &str| {
        let out = place.path().join(out);
        let small = ["--set", "timing.pairs.count=1", "--set", "particles.number.count=2"];
        run(&[&["generate", scenario, "-o", path(&out)][..], &small].concat());
        sums(&out)
    };
    assert_eq!(of("quickstart", "by_name"), of(path(&shipped), "by_path"));
    // Scenarios and sweeps that refer to other shipped files.
    assert!(run(&["generate", "recorded_tracks", "--dry-run"]).contains("frames"));
    assert!(run(&["sweep", "gdpt_1_sweep", "--list"]).starts_with("case_00000  seed="));
    assert!(run(&["suite", "list", "odpc1", "--size", "smoke"]).contains("size smoke"));
    let said = fail(2, &["generate", "quikstart"]);
    assert!(said.contains("did you mean `quickstart`?"), "{said}");
    let output = run_in(place.path(), &["new", "quickstart"], "");
    assert!(text(&output.stderr).contains("`microsig new --from quickstart`"), "{output:?}");
    assert!(!place.path().join("quickstart").exists());
    // A file of this name comes first.
    std::fs::write(place.path().join("quickstart"), SCENARIO).unwrap();
    let output = run_in(place.path(), &["optics", "quickstart"], "");
    assert!(text(&output.stdout).starts_with("small: "));
}

#[test]
fn quiet_is_quiet_and_results_that_were_asked_for_are_printed() {
    let place = tempfile::tempdir().unwrap();
    let dataset = generate(place.path(), "dataset", SCENARIO);
    let (result, scores, truth) =
        (place.path().join("r.csv"), place.path().join("scores"), dataset.join("truth/tracks.csv"));
    let silent = |arguments: &[&str]| {
        let output = succeed(microsig().args(arguments).arg("-q"));
        assert_eq!((text(&output.stdout), text(&output.stderr)), Default::default(), "{arguments:?}");
    };
    silent(&["verify", path(&dataset)]);
    silent(&["track", path(&dataset), "--method", "spots", "-o", path(&result)]);
    silent(&["track", path(&dataset), "--method", "spots", "-o", path(&result), "-f", "-j", "1"]);
    silent(&["evaluate", path(&dataset), path(&truth), "-o", path(&scores)]);
    silent(&["compare", path(&scores), "-o", path(&place.path().join("board"))]);
    silent(&["new", path(&place.path().join("new.ron"))]);
    silent(&["flows", "uniform", "--plot", path(&place.path().join("u.svg"))]);
    for asked in [&["flows"][..], &["evaluate", path(&dataset), path(&truth)], &["new", "--list"]] {
        assert!(run(&[asked, &["-q"]].concat()).len() > 40, "{asked:?}");
    }
    assert!(run(&["verify", path(&dataset), "-q", "--json"]).starts_with('{'));
}

#[test]
fn a_tracker_has_a_default_output_beside_the_dataset() {
    let place = tempfile::tempdir().unwrap();
    let dataset = generate(place.path(), "dataset", SCENARIO);
    run(&["track", path(&dataset), "--method", "spots"]);
    assert!(place.path().join("dataset-spots.csv").is_file());
    assert!(
        fail(2, &["track", path(&dataset), "--method", "spots"])
            .contains("dataset-spots.csv: already exists")
    );
    let output = run_in(&dataset, &["track", ".", "--method", "empty"], "");
    assert!(output.status.success() && place.path().join("dataset-empty.csv").is_file());
    run(&["verify", path(&dataset)]);
}

#[test]
fn programs_read_the_progress_as_json_and_a_log_has_no_bars() {
    let place = tempfile::tempdir().unwrap();
    let scenario = write(place.path(), "s.ron", SCENARIO);
    let said = |out: &str, more: &[&str]| {
        let out = place.path().join(out);
        told(&[&["generate", path(&scenario), "-o", path(&out)], more].concat())
    };
    let lines = said("json", &["--progress", "json"]);
    let first: Value = serde_json::from_str(lines.lines().next().unwrap()).unwrap();
    assert_eq!((&first["event"], &first["done"]), (&"begin".into(), &0.into()), "{lines}");
    assert_eq!(said("log", &[]), "");
}

#[test]
fn one_case_of_a_sweep_succeeds_or_fails_by_itself() {
    let place = tempfile::tempdir().unwrap();
    write(place.path(), "s.ron", SCENARIO);
    let numbers = "list([count(2), per_um3(1000), count(3)])";
    let sweep =
        format!(r#"(name: "s", base: "s.ron", axes: [(path: "particles.number", values: {numbers})])"#);
    let sweep = write(place.path(), "sweep.ron", &sweep);
    let out = place.path().join("out");
    let one = ["sweep", path(&sweep), "-o", path(&out), "--case"];
    assert!(
        fail(1, &[&one[..], &["case_00001"]].concat()).contains("case_00001 failed; see case_00001.failed")
    );
    let said = run(&[&one[..], &["case_00002"]].concat());
    assert!(said.starts_with("sweep s, case_00002: 1 of 3 cases done, 1 failed, 1 generated now"), "{said}");
    assert!(!out.join("case_00000").exists() && !out.join("cases.csv").exists());
    run(&[&one[..], &["case_00000"]].concat());
    assert_eq!(std::fs::read_to_string(out.join("cases.csv")).unwrap().lines().count(), 4);
    let said = fail(2, &[&one[..], &["case_00009"]].concat());
    assert!(said.contains("case case_00009: expected case_00000 to case_00002"), "{said}");
    fail(2, &[&one[..], &["case_00000", "--shard", "1/2"]].concat());
}
