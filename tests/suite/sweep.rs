//! Sweeps: shards give the same files as one run, wherever they ran; a failed case is a row of the table.

use std::path::{Path, PathBuf};

use suite::microsig::{fail, microsig, path, run, succeed, text};
use suite::tree;

const BASE: &str = r#"(
    name: "base",
    optics: (pixel_dim_x: 60, pixel_dim_y: 50, points_per_pixel: 4),
    motion: flow(field: poiseuille()),
    particles: (number: count(3)),
    timing: pairs(count: 1),
    calibration: none,
)"#;

const SWEEP: &str = r#"(
    name: "grid",
    base: "base.ron",
    axes: [
        (path: "optics.background_noise", values: linear(from: 0, to: 20, count: 3)),
        (path: "particles.number", values: list([count(2), ppp(0.001)])),
    ],
)"#;

fn write(folder: &Path, sweep: &str) -> PathBuf {
    std::fs::write(folder.join("base.ron"), BASE).unwrap();
    let file = folder.join("sweep.ron");
    std::fs::write(&file, sweep).unwrap();
    file
}

#[test]
fn shards_and_slurm_tasks_give_the_tree_of_one_run() {
    let place = tempfile::tempdir().unwrap();
    let sweep = write(place.path(), SWEEP);
    let whole = place.path().join("whole");
    run(&["sweep", path(&sweep), "--out", path(&whole)]);
    let expected = tree(&whole).unwrap();
    assert!(expected.contains_key("cases.csv"));
    assert_eq!(expected.keys().filter(|name| name.ends_with("SHA256SUMS")).count(), 6);

    // Seven shards of six cases, in reverse order; one of them is empty.
    let shards = place.path().join("shards");
    for k in (1..=7).rev() {
        run(&["sweep", path(&sweep), "--out", path(&shards), "--shard", &format!("{k}/7")]);
    }
    assert!(tree(&shards).unwrap() == expected, "7 shards");

    // Two tasks of a job array in separate folders, merged and collected.
    let together = place.path().join("together");
    std::fs::create_dir(&together).unwrap();
    for task in ["10", "12"] {
        let own = place.path().join(format!("task{task}"));
        let output = succeed(
            microsig()
                .args(["sweep", path(&sweep), "--out", path(&own), "--shard", "slurm", "--quiet", "--json"])
                .env("SLURM_ARRAY_TASK_ID", task)
                .env("SLURM_ARRAY_TASK_MIN", "10")
                .env("SLURM_ARRAY_TASK_STEP", "2")
                .env("SLURM_ARRAY_TASK_COUNT", "2"),
        );
        let (said, result) = (text(&output.stderr), text(&output.stdout));
        let shard = format!("{}/2", if task == "10" { 1 } else { 2 });
        assert_eq!(said.trim(), format!("shard {shard}"), "a share is announced even with --quiet");
        assert!(result.contains(&format!("\"shard\":\"{shard}\"")), "{result}");
        for entry in std::fs::read_dir(&own).unwrap() {
            let case = entry.unwrap().path();
            std::fs::rename(&case, together.join(case.file_name().unwrap())).unwrap();
        }
        if task == "10" {
            assert!(
                fail(1, &["sweep", path(&sweep), "--out", path(&together), "--collect"]).contains("3 cases")
            );
        }
    }
    run(&["sweep", path(&sweep), "--out", path(&together), "--collect"]);
    assert!(tree(&together).unwrap() == expected, "tasks in folders of their own");
    let other = fail(2, &["sweep", path(&sweep), "--out", path(&together), "--collect", "--seed", "9"]);
    assert!(other.contains("case_00000/datapackage.json: belongs to another sweep"), "{other}");
    assert!(tree(&together).unwrap() == expected, "left as it was");
}

/// A share that was not asked for would pass for the whole.
#[test]
fn a_task_of_a_job_array_makes_all_cases_unless_it_is_asked_for_its_share() {
    let place = tempfile::tempdir().unwrap();
    let sweep = write(place.path(), SWEEP);
    let out = place.path().join("out");
    let output = succeed(
        microsig()
            .args(["sweep", path(&sweep), "--out", path(&out)])
            .env("SLURM_ARRAY_TASK_ID", "2")
            .env("SLURM_ARRAY_TASK_MIN", "1")
            .env("SLURM_ARRAY_TASK_COUNT", "6"),
    );
    let (said, result) = (text(&output.stderr), text(&output.stdout));
    assert!(result.contains("6 of 6 cases done") && !result.contains("shard"), "{result}");
    assert!(
        said.contains("one of 6 tasks of a Slurm array but does all of the work; --shard slurm"),
        "{said}"
    );
    let message = fail(2, &["sweep", path(&sweep), "--list", "--shard", "slurm"]);
    assert!(message.contains("SLURM_ARRAY_TASK_ID is not set"), "{message}");
    assert!(
        run(&["sweep", path(&sweep), "--out", path(&out), "--resume", "--shard", "2/6"])
            .contains(", shard 2/6: 6 of 6 cases done")
    );
}

#[test]
fn a_case_that_fails_is_a_row_with_its_reason() {
    let place = tempfile::tempdir().unwrap();
    let sweep = write(place.path(), &SWEEP.replace("[count(2), ppp(0.001)]", "[count(2), per_um3(1000)]"));
    let out = place.path().join("out");
    assert!(fail(1, &["sweep", path(&sweep), "--out", path(&out)]).contains("3 cases failed"));
    let mut table = csv::Reader::from_path(out.join("cases.csv")).unwrap();
    let header = table.headers().unwrap().clone();
    let column = |name: &str| header.iter().position(|h| h == name).unwrap();
    let (status, reason) = (column("status"), column("reason"));
    let rows: Vec<csv::StringRecord> = table.records().map(Result::unwrap).collect();
    assert_eq!(rows.len(), 6);
    for (i, row) in rows.iter().enumerate() {
        let fails = i % 2 == 1;
        assert_eq!(&row[status], if fails { "failed" } else { "done" });
        assert_eq!(row[reason].contains("expected number of particles"), fails);
    }

    // Resuming retries failed cases and leaves the others unchanged.
    let message = fail(1, &["sweep", path(&sweep), "--out", path(&out), "--resume"]);
    assert!(message.contains("3 cases failed"));
    assert!(fail(2, &["sweep", path(&sweep), "--out", path(&out)]).contains("already exists"));
}

#[test]
fn going_on_after_an_edit_of_the_sweep_is_refused() {
    let place = tempfile::tempdir().unwrap();
    let sweep = write(place.path(), SWEEP);
    let out = place.path().join("out");
    run(&["sweep", path(&sweep), "--out", path(&out)]);
    run(&["sweep", path(&sweep), "--out", path(&out), "--resume"]);
    write(place.path(), &SWEEP.replace("to: 20", "to: 30"));
    let message = fail(2, &["sweep", path(&sweep), "--out", path(&out), "--resume"]);
    assert!(message.contains("case_00002: contains another scenario"), "{message}");
}

#[test]
fn a_dataset_is_no_place_for_cases() {
    let place = tempfile::tempdir().unwrap();
    let sweep = write(place.path(), SWEEP);
    let base = place.path().join("base.ron");
    let out = place.path().join("out");
    run(&["generate", path(&base), "--out", path(&out)]);
    let message = fail(2, &["sweep", path(&sweep), "--out", path(&out)]);
    assert!(message.contains("is a dataset"), "{message}");
    run(&["verify", path(&out)]);
}

#[test]
fn a_sweep_leads_to_scores_over_its_axes() {
    let place = tempfile::tempdir().unwrap();
    let sweep = write(place.path(), SWEEP);
    let out = place.path().join("out");
    let scored =
        ["sweep", path(&sweep), "--out", path(&out), "--track", "truth-noise,empty", "--evaluate", "--plot"];
    // The first shard tracks its cases; scores wait for the others.
    run(&[&scored[..], &["--shard", "1/2"]].concat());
    assert!(out.join("results/empty/case_00002.csv").is_file() && !out.join("scores").exists());
    assert!(!out.join("results/empty/case_00001.csv").exists());
    run(&[&scored[..], &["--resume", "--shard", "1/1"]].concat());
    let page = std::fs::read_to_string(out.join("comparison/leaderboard.html")).unwrap();
    assert!(page.contains("Scores over the sweep") && page.contains("against background noise, counts"));
    assert!(page.contains("empty, number = count(2)"));
    let board = csv::Reader::from_path(out.join("comparison/leaderboard.csv")).unwrap().into_records();
    assert_eq!(board.count(), 12);
    // The datasets are as they were.
    run(&["verify", path(&out.join("case_00003"))]);
    // The same as by hand.
    let by_hand = place.path().join("by_hand");
    let (dataset, result) = (out.join("case_00004"), out.join("results/truth-noise/case_00004.csv"));
    run(&["evaluate", path(&dataset), path(&result), "--out", path(&by_hand)]);
    let score = |folder: &Path| std::fs::read(folder.join("score.json")).unwrap();
    assert!(score(&by_hand) == score(&out.join("scores/truth-noise/case_00004")));
    assert!(fail(2, &scored).contains("already exists"));
    // What was made of other datasets is made again.
    let stale = out.join("results/empty/case_00001.csv");
    let made = std::fs::read(&stale).unwrap();
    std::fs::write(&stale, "of the dataset before").unwrap();
    run(&["sweep", path(&sweep), "--out", path(&out), "--force"]);
    run(&[&scored[..], &["--resume"]].concat());
    assert!(std::fs::read(&stale).unwrap() == made);
    let written = |file: &Path| file.metadata().unwrap().modified().unwrap();
    assert!(written(&out.join("scores/empty/case_00001/score.json")) >= written(&stale));
}

#[test]
fn results_of_other_programs_are_scored_over_a_sweep() {
    let place = tempfile::tempdir().unwrap();
    let sweep = write(place.path(), SWEEP);
    let out = place.path().join("out");
    let scored = ["sweep", path(&sweep), "--out", path(&out), "--resume", "--evaluate", "--plot"];
    assert!(fail(2, &scored).contains("results of another program as"));
    let options = [&scored[..], &["--max-displacement", "3"]].concat();
    assert!(fail(2, &options).contains("expected with --track METHOD"));
    let mine = out.join("results/mine");
    std::fs::create_dir_all(&mine).unwrap();
    for case in ["case_00000", "case_00003"] {
        std::fs::copy(out.join(case).join("truth/tracks.csv"), mine.join(format!("{case}.csv"))).unwrap();
    }
    run(&scored);
    let board = csv::Reader::from_path(out.join("comparison/leaderboard.csv")).unwrap().into_records();
    assert_eq!(board.count(), 2);
    assert!(out.join("scores/mine/case_00003/score.json").is_file());
}
