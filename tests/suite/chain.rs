//! The rules of a suite from its file to every place where results are scored: generated suite, release, `evaluate`, kit,
//! Codabench; and which truth a submission belongs to.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;

use serde_json::{Value, json};
use suite::leak::{Files, Known, unzip};
use suite::microsig::{self, binary, fail, generate, path, run};

use crate::release::{scenario, unpack};

/// The release of odpc1 at size smoke, as a team has it, and results for it.
struct Released {
    _place: tempfile::TempDir,
    datasets: PathBuf,
    out: PathBuf,
    /// `suite.json` and the unpacked test splits.
    team: PathBuf,
    /// `TRACKER/TRACK/CASE/results.csv` of one tracker.
    results: PathBuf,
    /// `TRACK/CASE` and dataset of each case.
    cases: Vec<(String, String)>,
}

const DEADLINE: &str = "2037-12-31";
const ADDRESS: &str = "challenge@example.org";

static RELEASED: LazyLock<Released> = LazyLock::new(|| {
    let place = tempfile::tempdir().unwrap();
    let [datasets, out, team, results] =
        ["datasets", "release", "team", "results"].map(|name| place.path().join(name));
    run(&["suite", "generate", "odpc1", "--size", "smoke", "--out", path(&datasets), "--quiet"]);
    let more = ["--codabench", "--deadline", DEADLINE, "--submit-to", ADDRESS, "--quiet"];
    run(&[&["suite", "release", "odpc1", path(&datasets), "--out", path(&out)][..], &more].concat());
    let listed = microsig::json(&["suite", "list", "odpc1", "--size", "smoke"]);
    let mut cases = Vec::new();
    for track in listed["tracks"].as_array().unwrap() {
        for case in track["cases"].as_array().unwrap() {
            let text = |of: &Value| of.as_str().unwrap().to_owned();
            let folder = format!("{}/{}", text(&track["track"]), text(&case["case"]));
            cases.push((folder, text(&case["dataset"])));
        }
    }
    fs::create_dir(&team).unwrap();
    fs::copy(out.join("public/suite.json"), team.join("suite.json")).unwrap();
    for (case, dataset) in &cases {
        unpack(&out.join("public").join(case).join(format!("{dataset}-test.zip")), &team);
        let result = results.join("one").join(case).join("results.csv");
        fs::create_dir_all(result.parent().unwrap()).unwrap();
        let test = out.join(case).join("withheld/test");
        let how = if case.starts_with("V/") { vec!["piv"] } else { vec!["truth-noise", "--noise-xy", "0.4"] };
        let of = ["track", path(&test), "--out", path(&result), "--quiet", "--method"];
        run(&[&of[..], &how].concat());
    }
    about(&out, &results.join("one"));
    Released { _place: place, datasets, out, team, results, cases }
});

fn read(file: &Path) -> Value {
    serde_json::from_slice(&fs::read(file).unwrap()).unwrap()
}

/// The example of a release, filled in, beside the results of a team.
fn about(release: &Path, results: &Path) {
    let example = unzip(&release.join("public/example.zip")).unwrap();
    let about = filled(serde_json::from_slice(&example["submission.json"]).unwrap());
    fs::write(results.join("submission.json"), about).unwrap();
}

fn filled(mut about: Value) -> String {
    for (key, text) in [("team", "A"), ("method", "B"), ("version", "1"), ("hardware", "paper")] {
        about[key] = text.into();
    }
    about.to_string()
}

/// A score without what names the file.
fn without_file_name(mut score: Value) -> Value {
    score["result"] = Value::Null;
    score
}

fn score(suite: &str, datasets: &Path, results: &Path, out: &Path) -> Value {
    let of = ["suite", "score", suite, path(datasets), "--results", path(results), "--out", path(out)];
    microsig::json(&of)
}

/// The results of the cases of a scored suite, by `TRACK/CASE`.
fn result<'a>(scores: &'a Value, case: &str, tracker: &str) -> &'a Value {
    let is_it =
        |of: &&Value| format!("{}/{}", of["track"].as_str().unwrap(), of["case"].as_str().unwrap()) == case;
    let of_case = scores["cases"].as_array().unwrap().iter().find(is_it).unwrap();
    of_case["results"].as_array().unwrap().iter().find(|of| of["tracker"] == tracker).unwrap()
}

/// Runs a scoring program that copies rounded scores, and keeps those with all digits.
const KEEPING: &str = "import runpy, shutil, sys; copy = shutil.copy; sys.argv = sys.argv[1:]; \
    shutil.copy = lambda a, b: (copy(a.parent.parent / 'score.json', sys.argv[3]), copy(a, b)); \
    runpy.run_path(sys.argv[0], run_name='__main__')";

#[test]
fn the_same_result_has_the_same_score_wherever_it_is_scored() {
    let c = &*RELEASED;
    let place = tempfile::tempdir().unwrap();
    // In the release, as a folder, and packed by the kit.
    let inbox = place.path().join("inbox");
    fs::create_dir(&inbox).unwrap();
    let pack = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/kit/python/pack.py");
    let mine = c.results.join("one");
    let packed = Command::new("python3")
        .arg(&pack)
        .args([&c.team, &mine, &inbox.join("packed.zip")])
        .output()
        .unwrap();
    assert!(packed.status.success(), "{}", String::from_utf8_lossy(&packed.stderr));
    let both = place.path().join("both");
    let of =
        ["suite", "score", "odpc1", path(&c.out), "--results", path(&c.results), "--results", path(&inbox)];
    microsig::json(&[&of[..], &["--out", path(&both)]].concat());
    // Against a published leaderboard, with which each tracker is compared.
    let (board, against) = (place.path().join("board"), place.path().join("against"));
    fs::create_dir_all(board.join("results")).unwrap();
    fs::copy(inbox.join("packed.zip"), board.join("results/packed.zip")).unwrap();
    let of = ["suite", "score", "odpc1", path(&c.out), "--results", path(&c.results)];
    let said = run(&[&of[..], &["--against", path(&board), "--out", path(&against)]].concat());
    let expected = "P2: one and published packed: better in 0, worse in 0, not separated in 2 cases";
    assert!(said.contains(expected), "{said}");
    // In the generated suite, if the release had its test splits.
    let generated = place.path().join("generated");
    fs::create_dir(&generated).unwrap();
    fs::copy(c.datasets.join("suite.json"), generated.join("suite.json")).unwrap();
    for (case, _) in &c.cases {
        let (from, to) = (c.out.join(case).join("withheld/test"), generated.join(case).join("test"));
        for file in suite::tree(&from).unwrap().into_keys() {
            fs::create_dir_all(to.join(&file).parent().unwrap()).unwrap();
            fs::copy(from.join(&file), to.join(&file)).unwrap();
        }
    }
    let alone = place.path().join("alone");
    score("odpc1", &generated, &c.results, &alone);
    for (case, _) in &c.cases {
        let [test, result] = [c.out.join(case).join("withheld/test"), mine.join(case).join("results.csv")];
        let evaluated = without_file_name(microsig::json(&["evaluate", path(&test), path(&result)]));
        for (scores, tracker) in [(&both, "one"), (&both, "packed"), (&alone, "one")] {
            let found = read(&scores.join("scores").join(tracker).join(case).join("score.json"));
            assert_eq!(without_file_name(found), evaluated, "{case}: {tracker}");
        }
        // Codabench's program computes the same, of which it shows what a team is told.
        let app = place.path().join("app").join(case);
        unpack(&c.out.join(case).join("withheld/codabench.zip"), &app);
        unpack(&app.join("reference_data.zip"), &app.join("input/ref"));
        unpack(&app.join("scoring_program.zip"), &app.join("program"));
        fs::create_dir_all(app.join("input/res")).unwrap();
        fs::copy(&result, app.join("input/res/results.csv")).unwrap();
        fs::copy(mine.join("submission.json"), app.join("input/res/submission.json")).unwrap();
        let mut program = Command::new("python3");
        program.env("MICROSIG", binary()).args(["-c", KEEPING]).arg(app.join("program/scoring.py"));
        let said = program.args(["input", "output", "all.json"].map(|name| app.join(name))).output().unwrap();
        assert!(said.status.success(), "{case}: {}", String::from_utf8_lossy(&said.stderr));
        assert_eq!(without_file_name(read(&app.join("all.json"))), evaluated, "{case}: Codabench");
        let told = read(&both.join("scores/one").join(case).join("for_team/score.json"));
        assert_eq!(
            without_file_name(read(&app.join("output/score.json"))),
            without_file_name(told),
            "{case}"
        );
        // Every column of its leaderboard has a number, unless the split is too small for any.
        let board = fs::read_to_string(app.join("competition.yaml")).unwrap();
        let columns = board.lines().filter_map(|line| line.trim().strip_prefix("key: "));
        let scores = read(&app.join("output/scores.json"));
        let empty: Vec<&str> = columns.filter(|key| *key != "main" && !scores[*key].is_number()).collect();
        assert!(empty.is_empty() || scores == json!({}), "{case}: {empty:?}: {scores}");
    }
    let of = |case: &str| read(&both.join("scores/one").join(case).join("score.json"))["definitions"].clone();
    let p2 = of("P2/ppp_0.01");
    assert_eq!((&p2["gate"]["xy_px"], &p2["dims"]), (&json!(0.5), &json!(2)), "{p2}");
    assert_eq!(p2["rank_by"], json!(["f1", "rmse_xy_px", "link_f1"]));
    assert_eq!(of("V/shift_4.5_px")["rank_by"], json!(["rms_nodes_px", "valid_nodes"]));
    let readme = fs::read_to_string(c.out.join("public/P2/ppp_0.01/README.md")).unwrap();
    assert!(readme.contains("within 0.5 px in the image plane, in the image plane"), "{readme}");
}

/// The flow is the same as in train, which participants must know.
#[test]
fn a_released_case_of_fields_takes_fields() {
    let c = &*RELEASED;
    let (case, dataset) = c.cases.iter().find(|(case, _)| case.starts_with("V/")).unwrap();
    let readme = fs::read_to_string(c.out.join("public").join(case).join("README.md")).unwrap();
    assert!(readme.contains("A challenge for PIV"), "{readme}");
    assert!(readme.contains("`truth/field.csv` of train is also the field of test"), "{readme}");
    let place = tempfile::tempdir().unwrap();
    unpack(&c.out.join("public").join(case).join(format!("{dataset}-test.zip")), place.path());
    let test = place.path().join(format!("{dataset}-test"));
    assert!(fs::read_to_string(test.join("README.md")).unwrap().contains("dx_px, dy_px, flag"));
    let submission = test.join("submission");
    let header = fs::read_to_string(submission.join("results.csv")).unwrap();
    assert_eq!(header, "pair,x_px,y_px,dx_px,dy_px,flag\n");

    let bundle = place.path().join("bundle");
    unpack(&c.out.join(case).join("withheld/codabench.zip"), &bundle);
    let board = fs::read_to_string(bundle.join("competition.yaml")).unwrap();
    let columns: Vec<&str> = board.lines().filter_map(|line| line.trim().strip_prefix("key: ")).collect();
    // Other scores of fields would tell the truth.
    assert_eq!(&columns[1..], ["valid_nodes", "rms_nodes_px"]);
    assert!(unzip(&bundle.join("reference_data.zip")).unwrap().contains_key("fields_only.txt"));
    fs::write(submission.join("results.csv"), "frame,track,x_px,y_px\n0,-1,40,40\n").unwrap();
    let about = submission.join("submission.json");
    let mut template = read(&about);
    template["images_sha256"] = microsig::images_sha256(&test).into();
    fs::write(about, filled(template)).unwrap();
    for split in [&test, &c.out.join(case).join("withheld/test")] {
        let message = fail(2, &["evaluate", path(split), path(&submission), "--quiet"]);
        assert!(message.contains("this challenge scores displacement fields"), "{message}");
    }
}

#[test]
fn every_manifest_of_a_released_suite_has_its_rules() {
    let c = &*RELEASED;
    let place = tempfile::tempdir().unwrap();
    let truth = place.path().join("truth");
    run(&["reveal", path(&c.out), "--out", path(&truth), "--early", "--quiet"]);
    for (case, dataset) in &c.cases {
        let rules = |manifest: &[u8]| {
            serde_json::from_slice::<Value>(manifest).unwrap()["microsig"]["scoring"].clone()
        };
        let manifest = c.datasets.join(case).join("test/datapackage.json");
        let own = rules(&fs::read(&manifest).unwrap());
        assert_eq!(format!("{}/{}", own["suite"]["track"], own["suite"]["case"]).replace('"', ""), *case);
        let mut found = Vec::new();
        for folder in [c.out.join("public").join(case), truth.join(case)] {
            for name in suite::tree(&folder).unwrap().into_keys() {
                let file = folder.join(&name);
                let files = match name.ends_with(".zip") {
                    true => unzip(&file).unwrap(),
                    false => Files::from([(name, fs::read(&file).unwrap())]),
                };
                found.extend(files.into_iter().filter(|(name, _)| name.ends_with("datapackage.json")));
            }
        }
        // Of the challenge, of train, val and test, and of test with its truth.
        assert_eq!(found.len(), 5, "{dataset}: {:?}", found.iter().map(|of| &of.0).collect::<Vec<_>>());
        found.iter().for_each(|(name, manifest)| assert_eq!(rules(manifest), own, "{case}: {name}"));
    }
}

#[test]
fn results_for_other_images_are_refused_by_name() {
    let c = &*RELEASED;
    let place = tempfile::tempdir().unwrap();
    let results = place.path().join("results");
    let case = "P2/ppp_0.01";
    let entry = |name: &str| {
        let folder = results.join(name);
        fs::create_dir_all(folder.join(case)).unwrap();
        fs::copy(c.results.join("one").join(case).join("results.csv"), folder.join(case).join("results.csv"))
            .unwrap();
        about(&c.out, &folder);
        folder
    };
    let change = |name: &str, key: &str, value: Value| {
        let file = entry(name).join("submission.json");
        let mut about = read(&file);
        about[key] = value;
        fs::write(file, about.to_string()).unwrap();
    };
    entry("good");
    for (name, suite) in [
        ("size", "odpc1 1.0.0, size small"),
        ("version", "odpc1 0.9.0, size smoke"),
        ("suite", "mine 1.0.0, size smoke"),
    ] {
        change(name, "suite", suite.into());
    }
    // The images of the generated suite.
    let sums = fs::read_to_string(c.datasets.join(case).join("test/SHA256SUMS")).unwrap();
    let images: String = sums.lines().filter(|l| l.contains("  images/")).map(|l| format!("{l}\n")).collect();
    change("open", "images_sha256", json!({ case: suite::sha256_of(images.as_bytes()) }));
    fs::remove_file(entry("unnamed").join("submission.json")).unwrap();
    fs::write(results.join("broken.zip"), "PK\u{3}\u{4}").unwrap();
    let scores = score("odpc1", &c.out, &results, &place.path().join("out"));
    assert_eq!(result(&scores, case, "good")["status"], "scored");
    for (name, expected) in [
        ("size", "suite: expected odpc1 1.0.0, size smoke; the submission is for odpc1 1.0.0, size small"),
        ("version", "the submission is for odpc1 0.9.0, size smoke"),
        ("suite", "the submission is for mine 1.0.0, size smoke"),
        ("open", "images_sha256.P2/ppp_0.01: expected the hash of this split's images"),
        ("unnamed", "submission.json: missing; it states the images that were used"),
        ("broken", "broken.zip: not a complete ZIP archive"),
    ] {
        let of = result(&scores, case, name);
        let reason = of["reason"].as_str().unwrap_or_default();
        assert!(of["status"] == "refused" && reason.contains(expected), "{name}: {of}");
        let folder = if name == "broken" { results.join("broken.zip") } else { results.join(name) };
        // Teams are told the same before they send it.
        let message = fail(2, &["check-submission", path(&c.team), path(&folder)]);
        assert!(message.contains(expected), "{name}: {message}");
    }
    // An archive of the name of another entry is refused alone.
    fs::copy(results.join("broken.zip"), results.join("good.zip")).unwrap();
    let same = score("odpc1", &c.out, &results, &place.path().join("same"));
    assert_eq!(result(&same, case, "good")["status"], "scored");
    let reason = result(&same, case, "good (3)")["reason"].as_str().unwrap();
    assert!(reason.contains("good.zip: another tracker has this name"), "{reason}");
    fs::remove_file(results.join("good.zip")).unwrap();
    // Against the truth of the generated suite, nothing counts.
    let other = score("odpc1", &c.datasets, &results, &place.path().join("other"));
    assert_eq!(result(&other, case, "good")["status"], "refused", "{other}");
    // Partial submissions count where they are, and what is missing is one line.
    let said = run(&["check-submission", path(&c.team), path(&results.join("good"))]);
    assert!(
        said.contains("1 of 7 cases can be scored; 6 missing, behind all others: ")
            && said.contains(DEADLINE),
        "{said}"
    );
    // A file that is newer than the deadline.
    let late = fs::File::options().write(true).open(results.join("good/submission.json")).unwrap();
    late.set_modified(std::time::SystemTime::UNIX_EPOCH + std::time::Duration::from_secs(2_146_900_000))
        .unwrap();
    let out = place.path().join("late");
    let scores = score("odpc1", &c.out, &results, &out);
    let of = result(&scores, case, "good");
    assert!(of["reason"].as_str().unwrap_or_default().contains("received after the deadline"), "{of}");
    let of = [
        "suite",
        "score",
        "odpc1",
        path(&c.out),
        "--results",
        path(&results),
        "--out",
        path(&out),
        "--force",
        "--late",
    ];
    assert_eq!(result(&microsig::json(&of), case, "good")["status"], "scored");
}

#[test]
fn nothing_withheld_is_in_the_folder_to_be_published() {
    let c = &*RELEASED;
    let public = c.out.join("public");
    let mut files = Files::new();
    for name in suite::tree(&public).unwrap().into_keys() {
        let file = public.join(&name);
        // Train and val have a truth of their own.
        if name.ends_with("-train.zip") || name.ends_with("-val.zip") {
            continue;
        }
        if name.ends_with(".zip") {
            files.extend(unzip(&file).unwrap());
        } else {
            files.insert(name, fs::read(&file).unwrap());
        }
    }
    for (case, dataset) in &c.cases {
        // Images of other cases have other sizes.
        let is_own = |name: &str| !name.contains("images/") || name.starts_with(&format!("{dataset}-test/"));
        let of = files.iter().filter(|(name, _)| is_own(name));
        let files: Files = of.map(|(name, bytes)| (name.clone(), bytes.clone())).collect();
        let known = Known::of(&c.out.join(case).join("withheld/test"), &[]).unwrap();
        let found = known.told_by(&files);
        assert!(found.is_empty(), "{case}: {found:#?}");
    }
    // Checksums of all that is there, and what the page links to.
    let sums = fs::read_to_string(public.join("SHA256SUMS")).unwrap();
    let (mut archives, mut in_one_folder) = (BTreeSet::new(), BTreeSet::new());
    for (hash, file) in sums.lines().map(|line| line.split_once("  ").unwrap()) {
        let path = public.join(file);
        let name = path.file_name().unwrap().to_str().unwrap();
        if name.ends_with(".zip") && !path.is_file() {
            in_one_folder.insert((hash, name.to_owned()));
            continue;
        }
        archives.extend((name.ends_with(".zip") && file.contains('/')).then(|| (hash, name.to_owned())));
        assert_eq!(suite::sha256(&path).unwrap(), hash, "{file}");
    }
    assert!(archives == in_one_folder && archives.len() == 3 * c.cases.len(), "also by name alone");
    let page = fs::read_to_string(public.join("index.html")).unwrap();
    for target in page.split("href=\"").skip(1).map(|rest| rest.split('"').next().unwrap()) {
        assert!(target.starts_with("board/") || public.join(target).is_file(), "{target}");
    }
    for text in [
        DEADLINE,
        ADDRESS,
        "within 0.5 px in the image plane.",
        "plane and a tenth of the depth range along z",
    ] {
        assert!(page.contains(text), "{text}: {page}");
    }
    // Finished challenges keep their keys, and another deadline is refused.
    let of = ["suite", "release", "odpc1", path(&c.datasets), "--out", path(&c.out), "--resume", "--quiet"];
    let message = fail(2, &of);
    assert!(
        message.contains(&format!("deadline {DEADLINE}, expected odpc1 1.0.0, size smoke, deadline none")),
        "{message}"
    );
}

#[test]
fn gates_of_a_challenge_are_those_of_all_its_splits() {
    let place = tempfile::tempdir().unwrap();
    let dataset = generate(place.path(), "dataset", &scenario(6));
    let out = place.path().join("out");
    let of = ["release", path(&dataset), "--out", path(&out), "--quiet"];
    let message = fail(2, &[&of[..], &["--deadline", "2020-02-29"]].concat());
    assert!(message.contains("--deadline 2020-02-29: has passed") && !out.exists(), "{message}");
    let message = fail(2, &[&of[..], &["--dims", "2", "--gate-z", "3"]].concat());
    assert!(message.contains("--gate-z: has no meaning in the image plane"), "{message}");
    run(&[&of[..], &["--gate-xy", "0.7", "--gate-z", "3"]].concat());
    for split in ["train", "val"] {
        unpack(&out.join(format!("public/small-{split}.zip")), place.path());
    }
    let splits =
        [place.path().join("small-train"), place.path().join("small-val"), out.join("withheld/test")];
    for split in &splits {
        let score = microsig::json(&["evaluate", path(split), path(&split.join("truth/tracks.csv"))]);
        let gate = &score["definitions"]["gate"];
        assert_eq!((&gate["xy_px"], &gate["z_um"]), (&json!(0.7), &json!(3.0)), "{}", split.display());
        run(&["verify", path(split), "--regenerate", "--quiet"]);
    }
    let readme = fs::read_to_string(out.join("public/README.md")).unwrap();
    assert!(readme.contains("within 0.7 px in the image plane and 3 um along z"), "{readme}");
    run(&[&of[..], &["--gate-xy", "0.7", "--gate-z", "3", "--resume"]].concat());
    let message = fail(2, &[&of[..], &["--resume"]].concat());
    assert!(message.contains("was made with other gates"), "{message}");
}

#[test]
fn a_sweep_and_a_comparison_follow_the_rules_of_the_scenario() {
    let place = tempfile::tempdir().unwrap();
    let ruled =
        scenario(5).replace("timing:", "scoring: (gate_xy_px: 0.5, dims: 2, rank_by: [rmse_xy_px]), timing:");
    let sweep =
        r#"(name: "s", base: "ruled.ron", axes: [(path: "particles.number.count", values: list([20, 30]))])"#;
    fs::write(place.path().join("ruled.ron"), &ruled).unwrap();
    let file = place.path().join("sweep.ron");
    fs::write(&file, sweep).unwrap();
    let out = place.path().join("sweep");
    let of = ["sweep", path(&file), "--out", path(&out), "--quiet"];
    run(&[&of[..], &["--track", "truth-noise", "--evaluate"]].concat());
    let found = read(&out.join("scores/truth-noise/case_00001/score.json"))["definitions"].clone();
    assert_eq!((&found["gate"]["xy_px"], &found["dims"]), (&json!(0.5), &json!(2)), "{found}");
    // More complete, but less accurate.
    let dataset = generate(place.path(), "dataset", &ruled);
    let tracks = fs::read_to_string(dataset.join("truth/tracks.csv")).unwrap();
    let header = tracks.lines().next().unwrap();
    let x = header.split(',').position(|name| name == "x_px").unwrap();
    let moved = |px: f64, keep: fn(usize) -> bool| {
        let rows = tracks.lines().skip(1).enumerate().filter(|(i, _)| keep(*i)).map(|(_, row)| {
            let mut cells: Vec<String> = row.split(',').map(str::to_owned).collect();
            cells[x] = (cells[x].parse::<f64>().unwrap() + px).to_string();
            cells.join(",")
        });
        format!("{header}\n{}\n", rows.collect::<Vec<_>>().join("\n"))
    };
    let mut scores = Vec::new();
    for (name, text) in [("exact", moved(0.01, |i| i % 5 > 0)), ("whole", moved(0.3, |_| true))] {
        let (file, out) = (place.path().join(format!("{name}.csv")), place.path().join(name));
        fs::write(&file, text).unwrap();
        run(&["evaluate", path(&dataset), path(&file), "--out", path(&out), "--quiet"]);
        scores.push(out);
    }
    let board = place.path().join("board");
    let compared = microsig::json(&["compare", path(&scores[0]), path(&scores[1]), "--out", path(&board)]);
    assert_eq!(compared["entries"][0]["name"], "exact", "{compared}");
}
