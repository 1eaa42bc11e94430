//! Suites: the same bytes for any shards, what differs from the frozen list is named, scores come from
//! `evaluate`, and faults of a suite's file are shown with their line.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use serde_json::Value;
use suite::microsig::{fail, json, path, run, told};

use crate::command::kill_when;

const SCENARIO: &str = r#"(
    name: "base",
    seed: 3,
    optics: (
        gaussian: (diameter_px: 3, peak_counts: 200), pixel_dim_x: 80, pixel_dim_y: 60, background_mean: 50,
        background_noise: 5,
    ),
    motion: flow(field: uniform(velocity_um_s: (129, 0, 0))),
    particles: (number: count(12)),
    boundaries: (z_um: (-5, 5)),
    timing: sequence(frames: 3),
    calibration: none,
)"#;

const SWEEP: &str = r#"(
    name: "noise", base: "base.ron",
    axes: [(path: "optics.background_noise", values: list([5, 20]))],
)"#;

const SUITE: &str = r#"(
    name: "little",
    version: "1.0.0",
    title: "A suite for tests",
    tracks: [
        (
            name: "P2",
            title: "In focus",
            rank_by: [f1, rmse_xy_px],
            dims: 2,
            sizes: (
                smoke: (train: 2, val: 2, test: 3),
                small: (train: 3, val: 3, test: 6, set: ["optics.pixel_dim_x=90"]),
                full: (train: 3, val: 3, test: 6),
            ),
            ladders: [
                (name: "noise", title: "Noise", from: "noise.ron", labels: [(name: "SNR", factor: 0.1)]),
                (name: "one", title: "One", from: "base.ron", smoke: []),
            ],
        ),
    ],
)"#;

fn write(folder: &Path, suite: &str) -> PathBuf {
    std::fs::write(folder.join("base.ron"), SCENARIO).unwrap();
    std::fs::write(folder.join("noise.ron"), SWEEP).unwrap();
    let file = folder.join("suite.ron");
    std::fs::write(&file, suite).unwrap();
    file
}

/// A suite and its datasets of size smoke, shared by read-only tests.
struct Little {
    _place: tempfile::TempDir,
    suite: PathBuf,
    datasets: PathBuf,
}

static LITTLE: LazyLock<Little> = LazyLock::new(|| {
    let place = tempfile::tempdir().unwrap();
    let suite = write(place.path(), SUITE);
    let datasets = place.path().join("datasets");
    run(&["suite", "generate", path(&suite), "--size", "smoke", "--out", path(&datasets), "--quiet"]);
    Little { _place: place, suite, datasets }
});

#[test]
fn a_suite_is_listed_with_its_tracks_and_the_cases_of_a_size() {
    let suite = path(&LITTLE.suite);
    let names = |size: &str| -> Vec<String> {
        let listed = json(&["suite", "list", suite, "--size", size]);
        let cases = listed["tracks"][0]["cases"].as_array().unwrap();
        cases.iter().map(|case| case["case"].as_str().unwrap().to_owned()).collect()
    };
    assert_eq!(names("smoke"), ["noise_0.5", "noise_2"]);
    assert_eq!(names("small"), ["noise_0.5", "noise_2", "one"]);
    let said = run(&["suite", "list", suite]);
    assert!(said.contains("P2  In focus; ranked by f1, rmse_xy_px"), "{said}");
}

/// The suite that the program carries is listed at every size, and is a start for one's own.
#[test]
fn the_shipped_suite_is_carried_by_the_program() {
    let place = tempfile::tempdir().unwrap();
    let file = place.path().join("suite.ron");
    run(&["new", path(&file), "--from", "odpc1"]);
    assert!(run(&["new", "--list"]).contains("odpc1"));
    for size in ["smoke", "small", "full"] {
        let [own, carried] =
            [path(&file), "odpc1"].map(|suite| json(&["suite", "list", suite, "--size", size]));
        assert_eq!(own, carried);
        let tracks = own["tracks"].as_array().unwrap();
        let names: Vec<&str> = tracks.iter().map(|track| track["track"].as_str().unwrap()).collect();
        assert_eq!(names, ["P2", "D3", "A3", "T", "V", "S"]);
        assert!(tracks.iter().all(|track| !track["cases"].as_array().unwrap().is_empty()), "{size}");
    }
}

/// All of it takes longer; `microsig suite check odpc1 --size smoke` does it.
#[test]
fn the_test_splits_of_the_shipped_suite_have_the_frozen_bytes() {
    run(&["suite", "check", "odpc1", "--size", "smoke", "--split", "test", "--quiet"]);
}

#[test]
fn shards_and_resumed_runs_give_the_bytes_of_one_run() {
    let c = &*LITTLE;
    let expected = suite::tree(&c.datasets).unwrap();
    assert!(expected.contains_key("suite.csv") && expected.contains_key("P2/noise_2/val/SHA256SUMS"));
    let place = tempfile::tempdir().unwrap();
    let again = place.path().join("again");
    let all = ["suite", "generate", path(&c.suite), "--size", "smoke", "--out", path(&again)];
    for k in [3, 1, 2] {
        run(&[&all[..], &["--shard", &format!("{k}/3")]].concat());
    }
    assert!(suite::tree(&again).unwrap() == expected, "three shards");

    let message = fail(2, &all);
    assert!(message.contains("already exists; --force replaces it, --resume continues"), "{message}");
    std::fs::remove_dir_all(again.join("P2/noise_2/test")).unwrap();
    let made = json(&[&all[..], &["--resume"]].concat());
    assert_eq!((made["made"].as_u64(), made["done"].as_u64()), (Some(1), Some(6)));
    assert!(suite::tree(&again).unwrap() == expected, "resumed");

    // One case and split of another size has a folder of its own.
    let message = fail(2, &["suite", "generate", path(&c.suite), "--size", "small", "--out", path(&again)]);
    assert!(message.contains("contains size smoke, not small"), "{message}");
    let one = place.path().join("one");
    let only = ["--track", "P2", "--case", "one", "--split", "train", "--out", path(&one), "--quiet"];
    run(&[&["suite", "generate", path(&c.suite), "--size", "small"][..], &only].concat());
    let made: Vec<String> =
        suite::tree(&one).unwrap().into_keys().filter(|p| p.ends_with("SHA256SUMS")).collect();
    assert_eq!(made, ["P2/one/train/SHA256SUMS"]);
}

/// Train and val equal a challenge's made from train.
#[test]
fn a_released_case_has_the_train_and_val_of_the_suite() {
    let c = &*LITTLE;
    let place = tempfile::tempdir().unwrap();
    let out = place.path().join("out");
    let only = ["--case", "noise_2", "--creator", "Doe, Jane"];
    let of = ["suite", "release", path(&c.suite), path(&c.datasets), "--out", path(&out)];
    let told = told(&[&of[..], &only].concat());
    assert!(
        told.contains("P2/noise_2: test has ") && told.contains(" tracks, and scores of a result"),
        "{told}"
    );
    let public = out.join("P2/noise_2/public");
    for (split, name) in [("train", "little-p2-noise_2-train"), ("val", "little-p2-noise_2-val")] {
        let files = suite::leak::unzip(&public.join(format!("{name}.zip"))).unwrap();
        let sums = std::fs::read(c.datasets.join("P2/noise_2").join(split).join("SHA256SUMS")).unwrap();
        assert!(files[&format!("{name}/SHA256SUMS")] == sums, "{split}");
    }
    let withheld = out.join("P2/noise_2/withheld/test");
    let released = suite::tree(&withheld.join("images")).unwrap();
    let own = suite::tree(&c.datasets.join("P2/noise_2/test/images")).unwrap();
    assert!(released.keys().eq(own.keys()) && released != own, "the same frames, drawn from a secret key");
}

/// A run that is killed, and one that the file system stops, are continued; finished challenges stay.
#[test]
fn a_release_of_a_suite_continues_and_keeps_its_keys() {
    let c = &*LITTLE;
    let place = tempfile::tempdir().unwrap();
    let out = place.path().join("out");
    let release = ["suite", "release", path(&c.suite), path(&c.datasets), "--out", path(&out)];
    let first = out.join("P2/noise_0.5");
    kill_when(&release, || first.exists());
    let kept = suite::tree(&first).unwrap();

    let message = fail(2, &release);
    assert!(message.contains("noise_0.5: is a challenge with its secret key: --resume"), "{message}");
    assert!(fail(2, &[&release[..], &["--force"]].concat()).contains("--force with --new-keys"));
    assert!(run(&[&release[..], &["--resume"]].concat()).contains("2 challenges of suite little 1.0.0, "));
    assert!(suite::tree(&first).unwrap() == kept, "a finished challenge has kept its key and files");
    assert!(out.join("P2/noise_2/withheld/test/secret_key.txt").is_file());
    assert!(run(&[&release[..], &["--resume"]].concat()).contains("0 made now"));
    run(&[&release[..], &["--force", "--new-keys", "--case", "noise_0.5"]].concat());
    assert!(suite::tree(&first).unwrap() != kept);
    // New keys of all, interrupted after the first; baselines have results for the new images.
    let resume = [&release[..], &["--resume", "--baselines", "spots"]].concat();
    run(&resume);
    let key = |case: &str| std::fs::read(out.join("P2").join(case).join("withheld/test/secret_key.txt")).ok();
    let before = ["noise_0.5", "noise_2"].map(key);
    let replace = [&release[..], &["--force", "--new-keys"]].concat();
    kill_when(&replace, || key("noise_0.5").is_some_and(|key| Some(key) != before[0]));
    assert!(!out.join("public/index.html").exists());
    run(&resume);
    assert!(key("noise_0.5") != before[0] && key("noise_2") != before[1]);
    let (baselines, scores) = (out.join("baselines"), place.path().join("scores"));
    let score = ["suite", "score", path(&c.suite), path(&out), "--results", path(&baselines)];
    let scores = json(&[&score[..], &["--out", path(&scores)]].concat());
    assert!(
        scores["cases"].as_array().unwrap().iter().all(|of| of["results"][0]["status"] == "scored"),
        "{scores}"
    );
    // An interrupted `reveal` is repeated.
    let truth = place.path().join("truth");
    let reveal = ["reveal", path(&out), "--out", path(&truth), "--early"];
    run(&reveal);
    std::fs::remove_dir_all(truth.join("P2/noise_2")).unwrap();
    assert!(fail(2, &reveal).contains("noise_0.5: already exists; --force replaces it"));
    run(&[&reveal[..], &["--force"]].concat());
    assert!(truth.join("P2/noise_2/salt.bin").is_file());
}

#[test]
fn what_differs_from_the_frozen_list_is_named() {
    let c = &*LITTLE;
    let place = tempfile::tempdir().unwrap();
    let file = write(place.path(), SUITE);
    let check = ["suite", "check", path(&file), "--size", "smoke", "--quiet"];
    assert!(fail(2, &check).contains("no frozen checksums"));
    let of_part = [&check[..], &["--freeze", "--case", "noise_2"]].concat();
    assert!(fail(2, &of_part).contains("this version has no frozen checksums yet"));
    run(&[&check[..], &["--freeze"]].concat());
    run(&check);
    // A part again: the other lines stay.
    run(&of_part);
    run(&check);
    let copy = ["--datasets", path(&c.datasets)];
    run(&[&check[..], &copy].concat());

    // A byte of an image, in a copy of one dataset.
    let datasets = place.path().join("datasets");
    let only = ["--case", "noise_2", "--split", "test", "--quiet"];
    run(&[&["suite", "generate", path(&file), "--size", "smoke", "--out", path(&datasets)][..], &only]
        .concat());
    let image = datasets.join("P2/noise_2/test/images/frame_00001.tif");
    let mut bytes = std::fs::read(&image).unwrap();
    bytes[2000] ^= 1;
    std::fs::write(&image, bytes).unwrap();
    let of_copy = [&check[..], &["--datasets", path(&datasets)], &only[..4]].concat();
    let message = fail(1, &of_copy);
    assert!(message.contains("P2/noise_2/test/images/frame_00001.tif: changed"), "{message}");
    std::fs::remove_file(&image).unwrap();
    assert!(fail(1, &of_copy).contains("P2/noise_2/test/images/frame_00001.tif: missing"));

    // Another seed.
    std::fs::write(place.path().join("base.ron"), SCENARIO.replace("peak_counts: 200", "peak_counts: 201"))
        .unwrap();
    let message = fail(1, &[&check[..], &["--case", "noise_2", "--split", "val"]].concat());
    assert!(message.contains("P2/noise_2/val/images: differs from the frozen checksum"), "{message}");
    let message = fail(1, &[&check[..], &["--freeze"]].concat());
    assert!(message.contains("version 1.0.0 already has different frozen checksums"), "{message}");

    // A case less.
    let fewer =
        SUITE.replace("small: (train: 3, val: 3, test: 6, set", "small: (train: 2, val: 3, test: 6, set");
    let fewer = fewer.replace("title: \"Noise\",", "title: \"Noise\", smoke: [\"noise_2\"],");
    write(place.path(), &fewer);
    let message = fail(1, &check);
    let gone = "P2/noise_0.5/test/images: has a frozen checksum but is no longer in the suite";
    assert!(message.contains(gone) && !message.contains("noise_2"), "{message}");
    write(place.path(), &SUITE.replace("1.0.0", "1.1.0"));
    let message = fail(1, &check);
    assert!(message.contains("belongs to version 1.0.0, not 1.1.0"), "{message}");
}

#[test]
fn scores_are_those_of_evaluate_and_what_is_missing_is_shown() {
    let c = &*LITTLE;
    let place = tempfile::tempdir().unwrap();
    let results = place.path().join("results");
    let result = |tracker: &str, case: &str| {
        let folder = results.join(tracker).join("P2").join(case);
        std::fs::create_dir_all(&folder).unwrap();
        folder.join("results.csv")
    };
    let test = |case: &str| c.datasets.join("P2").join(case).join("test");
    for case in ["noise_0.5", "noise_2"] {
        let out = result("spots", case);
        run(&["track", path(&test(case)), "--method", "spots", "--out", path(&out), "--quiet"]);
    }
    std::fs::copy(test("noise_2").join("truth/tracks.csv"), result("perfect", "noise_2")).unwrap();
    std::fs::write(result("broken", "noise_2"), "frame,x_px,y_px\n0,1,a\n").unwrap();
    std::fs::create_dir(result("broken", "noise_0.5")).unwrap();
    std::fs::write(result("field", "noise_2"), "pair,x_px,y_px,dx_px,dy_px,flag\n0,40,40,1,0,0\n").unwrap();
    let out = place.path().join("out");
    let (suite, datasets) = (path(&c.suite), path(&c.datasets));
    // With a separator at the end, as a shell completes it.
    let folder = results.join("");
    let all = ["suite", "score", suite, datasets, "--results", path(&folder), "--out", path(&out)];
    let scores = json(&all);

    let case = |name: &str| {
        scores["cases"].as_array().unwrap().iter().find(|case| case["case"] == name).unwrap().clone()
    };
    let of = |name: &str, tracker: &str| {
        case(name)["results"].as_array().unwrap().iter().find(|r| r["tracker"] == tracker).unwrap().clone()
    };
    // The very numbers of evaluate.
    let options = ["--dims", "2"];
    let spots = results.join("spots/P2/noise_2/results.csv");
    let alone = json(&[&["evaluate", path(&test("noise_2")), path(&spots)][..], &options].concat());
    let written = std::fs::read(out.join("scores/spots/P2/noise_2/score.json")).unwrap();
    assert_eq!(serde_json::from_slice::<Value>(&written).unwrap(), alone);
    let ranked = &of("noise_2", "spots")["scores"];
    assert_eq!(ranked[0]["value"], alone["detection"]["f1"]);
    assert_eq!(ranked[1]["value"], alone["detection"]["rmse_xy_px"]);

    assert_eq!(of("noise_2", "perfect")["rank"], 1);
    assert_eq!(of("noise_0.5", "perfect")["status"], "missing");
    assert!(of("noise_0.5", "perfect")["rank"].is_null());
    let broken = of("noise_2", "broken");
    assert!(
        broken["status"] == "refused"
            && broken["reason"].as_str().unwrap().starts_with("broken/P2/noise_2/results.csv:2: "),
        "{broken}"
    );
    let broken = of("noise_0.5", "broken");
    assert_eq!(broken["reason"], "broken/P2/noise_0.5/results.csv: a folder; expected a regular file");
    assert_eq!(of("noise_2", "field")["status"], "refused");
    // perfect and spots are each better in one case, in which broken and field have no result.
    let standing = |tracker: &str| {
        scores["standings"].as_array().unwrap().iter().find(|s| s["tracker"] == tracker).unwrap().clone()
    };
    assert_eq!(
        (standing("perfect")["scored"].as_u64(), standing("perfect")["rank"].as_u64()),
        (Some(1), Some(1))
    );
    assert_eq!((standing("spots")["rank"].as_u64(), standing("broken")["rank"].as_u64()), (Some(1), Some(3)));

    let table = std::fs::read_to_string(out.join("suite_scores.csv")).unwrap();
    assert_eq!(table.lines().count(), 1 + 2 * 4, "{table}");
    assert!(table.contains(",perfect,missing,"), "{table}");
    let page = std::fs::read_to_string(out.join("index.html")).unwrap();
    assert!(page.contains("missing") && page.contains("perfect") && !page.contains("<script"), "no scripts");
    assert!(fail(2, &all).contains("already exists"));
    check_site(place.path(), &all, (&results, &out));
    // What a participant says about a tracker is on the page.
    let about = results.join("perfect/tracker.json");
    let said =
        r#"{"name": "Perfect <2>", "made_for": "PIV in focus", "seconds_per_frame": {"P2/noise_2": 0.125}}"#;
    std::fs::write(&about, said).unwrap();
    let again = [&all[..], &["--force"]].concat();
    run(&again);
    let page = std::fs::read_to_string(out.join("index.html")).unwrap();
    for text in ["Perfect &lt;2&gt;", "PIV in focus", "0.125"] {
        assert!(page.contains(text), "{text}");
    }
    for (from, to, expected) in [
        ("noise_2", "noise_3", "P2/noise_3: expected TRACK/CASE of the suite"),
        ("0.125", "-1", "P2/noise_2 = -1: expected a time > 0 s"),
        ("made_for", "purpose", "tracker.json: "),
    ] {
        std::fs::write(&about, said.replace(from, to)).unwrap();
        let message = fail(2, &again);
        assert!(message.contains("perfect/tracker.json: ") && message.contains(expected), "{message}");
    }
    std::fs::remove_file(&about).unwrap();

    // The same is told before an upload.
    let mine = results.join("perfect");
    let check = |folder: &Path| run(&["check-submission", datasets, path(folder), "--suite", suite]);
    assert!(check(&mine).contains("1 of 2 cases can be scored; 1 missing, behind all others: P2/noise_0.5"));
    let message = fail(2, &["check-submission", datasets, path(&results.join("broken")), "--suite", suite]);
    assert!(message.contains("results.csv:2: "), "{message}");

    // A misspelled case would be a missing result.
    result("spots", "noise_3");
    std::fs::write(results.join("spots/P2/noise_3/results.csv"), "frame,x_px,y_px\n").unwrap();
    let own = results.join("spots");
    let message = fail(2, &["check-submission", datasets, path(&own), "--suite", suite]);
    assert!(message.contains("spots/P2/noise_3: track P2 has no such case at size smoke"), "{message}");
    let message = fail(2, &[&all[..], &["--force"]].concat());
    assert!(message.contains("spots/P2/noise_3: track P2 has no such case at size smoke"), "{message}");
}

#[test]
fn a_damaged_truth_is_no_fault_of_a_tracker() {
    let c = &*LITTLE;
    let place = tempfile::tempdir().unwrap();
    let damaged = place.path().join("damaged");
    for file in suite::tree(&c.datasets).unwrap().into_keys() {
        std::fs::create_dir_all(damaged.join(&file).parent().unwrap()).unwrap();
        std::fs::copy(c.datasets.join(&file), damaged.join(&file)).unwrap();
    }
    let tracks = damaged.join("P2/noise_2/test/truth/tracks.csv");
    let results = place.path().join("results/perfect/P2/noise_2");
    std::fs::create_dir_all(&results).unwrap();
    std::fs::copy(&tracks, results.join("results.csv")).unwrap();
    let text = std::fs::read_to_string(&tracks).unwrap().replacen("\n0,", "\nzero,", 1);
    std::fs::write(&tracks, text).unwrap();
    let (results, out) = (place.path().join("results"), place.path().join("out"));
    let message = fail(
        2,
        &["suite", "score", path(&c.suite), path(&damaged), "--results", path(&results), "--out", path(&out)],
    );
    assert!(message.contains("P2/noise_2/test/truth/tracks.csv:2: ") && !out.exists(), "{message}");
}

/// Writes the site of the scores of `all` in `out`, also with a name that links must escape, moves it, and checks it.
fn check_site(place: &Path, all: &[&str], (results, out): (&Path, &Path)) {
    let odd = results.join("50 % #1 ä");
    std::fs::create_dir_all(odd.join("P2/noise_2")).unwrap();
    let perfect = results.join("perfect/P2/noise_2/results.csv");
    std::fs::copy(perfect, odd.join("P2/noise_2/results.csv")).unwrap();
    let (site, copy) = (place.join("site"), place.join("copied/to/a server"));
    let with_site = [all, &["--force", "--site", path(&site)]].concat();
    // A run that is killed, as by an allocation that fails, leaves folders for the next one to remove.
    let partial = [&site, out].map(|folder| folder.with_extension("partial"));
    let are_left = || partial.each_ref().map(|folder| folder.is_dir());
    assert!(kill_when(&with_site, || are_left() == [true; 2]));
    assert_eq!(are_left(), [true; 2]);
    run(&with_site);
    assert_eq!(are_left(), [false; 2]);
    // A site whose scores were not placed, because the run was interrupted, is replaced.
    std::fs::remove_dir_all(out).unwrap();
    let again = [all, &["--site", path(&site)]].concat();
    assert!(fail(2, &again).contains("site: already exists; --force replaces it"));
    std::fs::write(site.join(".unfinished"), "").unwrap();
    run(&again);
    assert!(!site.join(".unfinished").exists());
    std::fs::create_dir_all(copy.parent().unwrap()).unwrap();
    std::fs::rename(&site, &copy).unwrap();
    let linked = check_links(&copy);
    for page in
        ["rules.html", "scores/spots/P2/noise_2/report.html", "scores/50 % #1 ä/P2/noise_2/report.html"]
    {
        assert!(linked.contains(page), "{page}: {linked:?}");
    }
    for (page, expected) in [("index.html", "50 % #1 ä"), ("rules.html", "Ranked by, in this order")] {
        assert!(std::fs::read_to_string(copy.join(page)).unwrap().contains(expected), "{page}: {expected}");
    }
    let table = |folder: &Path| std::fs::read(folder.join("suite_scores.csv")).unwrap();
    assert!(table(&copy) == table(out));
    std::fs::remove_dir_all(odd).unwrap();
}

/// Checks that every link of the pages below a folder leads to a file in it, that pages fetch nothing from elsewhere and
/// are drawn in light and dark, and that all pages are linked. Returns the files that are linked.
fn check_links(site: &Path) -> std::collections::BTreeSet<String> {
    let files: std::collections::BTreeSet<String> = suite::tree(site).unwrap().into_keys().collect();
    let mut linked = std::collections::BTreeSet::new();
    for page in files.iter().filter(|name| name.ends_with(".html")) {
        let text = std::fs::read_to_string(site.join(page)).unwrap();
        assert!(text.contains("prefers-color-scheme: dark") && !text.contains("<script"), "{page}");
        assert!(!text.contains("url(") && !text.contains("@import") && !text.contains("<base"), "{page}");
        for attribute in ["href=\"", "src=\"", "action=\""] {
            for target in text.split(attribute).skip(1).map(|rest| rest.split('"').next().unwrap()) {
                if target.starts_with("data:image/") {
                    continue;
                }
                let (file, place) = target.split_once('#').unwrap_or((target, ""));
                let is_id = |id: &str| id.is_empty() || text.contains(&format!("id=\"{id}\""));
                if file.is_empty() {
                    assert!(is_id(place), "{page}: {target}");
                    continue;
                }
                assert!(
                    place.is_empty() && !file.contains(':') && !file.starts_with('/'),
                    "{page}: {target}"
                );
                let folder = page.rsplit_once('/').map_or("", |(folder, _)| folder);
                let decoded = percent_encoding::percent_decode_str(file).decode_utf8().unwrap();
                let to = if folder.is_empty() { decoded.into_owned() } else { format!("{folder}/{decoded}") };
                assert!(files.contains(&to), "{page}: {target} leads to {to}");
                linked.insert(to);
            }
        }
    }
    for page in files.iter().filter(|name| name.ends_with(".html") && *name != "index.html") {
        assert!(linked.contains(page), "no link to {page}");
    }
    let known = ["html", "csv", "json"];
    let others =
        files.iter().filter(|name| !known.iter().any(|end| name.ends_with(end)) && !name.starts_with('.'));
    assert_eq!(others.count(), 0, "{files:?}");
    linked
}

#[test]
fn faults_of_a_suite_are_shown_with_their_line() {
    let place = tempfile::tempdir().unwrap();
    const FAULTS: &str = r#"
rank_by: [f1, => rank_by: [f2, => suite.ron:9:23: tracks.0.rank_by.0: unknown variant `f2`: expected one of f1, recall
dims: 2, => dims: 4, => suite.ron:10:
dims: 2, => dim: 2, => suite.ron:10:13: unknown key `tracks.0.dim`; did you mean `dims`?
from: "noise.ron" => from: "nois.ron" => suite.ron:17:
smoke: [] => smoke: ["two"] => "two": expected one of one
optics.pixel_dim_x=90 => optics.pixel_dim_z=90 => suite.ron:13:
name: "one" => name: "One" => name = "One": expected 1 to 60 letters
(name: "SNR", factor: 0.1) => (name: "a"), (name: "b") => 2 labels: expected at most 1
from: "noise.ron", => from: "noise.ron", case: "x", => 0 times `{}`: expected `{}` for each of the 1 axes
(name: "one", title: "One" => (name: "noise_2", title: "One" => case `noise_2` occurs twice in track P2
version: "1.0.0", =>  => `version`
"#;
    for line in FAULTS.trim().lines() {
        let [from, to, expected] = line.split(" => ").collect::<Vec<_>>()[..] else { panic!("{line}") };
        assert!(SUITE.contains(from), "{from}");
        let file = write(place.path(), &SUITE.replacen(from, to, 1));
        let message = fail(2, &["suite", "list", path(&file)]);
        assert!(message.contains(expected), "{expected}\n{message}");
    }
    // Values that are the same once rounded.
    let file = write(place.path(), SUITE);
    std::fs::write(place.path().join("noise.ron"), SWEEP.replace("list([5, 20])", "list([20.001, 20.002])"))
        .unwrap();
    let message = fail(2, &["suite", "list", path(&file)]);
    assert!(message.contains("case `noise_2` occurs twice in track P2"), "{message}");
    write(place.path(), &SUITE.replace(", factor: 0.1", ""));
    std::fs::write(place.path().join("noise.ron"), SWEEP.replace("list([5, 20])", "list([20.001, 20.002])"))
        .unwrap();
    let listed = run(&["suite", "list", path(&file)]);
    assert!(listed.contains("noise_20.001 ") && listed.contains("noise_20.002 "), "{listed}");
    // Faults of a scenario or sweep have the line of its own file.
    let file = write(place.path(), SUITE);
    std::fs::write(place.path().join("noise.ron"), SWEEP.replace("background_noise", "background_nois"))
        .unwrap();
    let message = fail(2, &["suite", "list", path(&file)]);
    assert!(message.contains("noise.ron:3:") && message.contains("did you mean"), "{message}");
    let message = fail(2, &["generate", path(&file)]);
    assert!(message.contains("is a suite; run `microsig suite generate"), "{message}");
    let message = fail(2, &["suite", "list", path(&place.path().join("base.ron"))]);
    assert!(message.contains("is not a suite; run `microsig generate"), "{message}");
    assert!(fail(2, &["suite", "list", "odpc7"]).contains("odpc1"));
    assert!(
        fail(2, &["suite", "generate", "odpc1", "--size", "tiny"]).contains("expected smoke, small or full")
    );
}
