//! Degenerate results rank behind microsig's own trackers in every case of the shipped suite (its smallest
//! size; `microsig suite score --anchors` does the same for any).

use std::path::Path;

use serde_json::Value;
use suite::microsig::{fail, path, run};

/// Trackers of each track; `piv-ensemble` is `piv --ensemble`, `mle-spheroid` is `mle --shape spheroid`.
const TRACKERS: [(&str, &[&str]); 6] = [
    ("P2", &["spots"]),
    ("D3", &["ncc", "mle"]),
    ("A3", &["ncc", "mle", "aptv"]),
    ("T", &["ncc", "mle"]),
    ("V", &["piv", "piv-ensemble"]),
    ("S", &["ncc", "mle-spheroid"]),
];

#[test]
#[ignore = "slow: .ci/full"]
fn degenerate_results_rank_behind_honest_ones_in_every_case() {
    let place = tempfile::tempdir().unwrap();
    let (datasets, results) = (place.path().join("datasets"), place.path().join("results"));
    for split in ["train", "test"] {
        let of = ["--split", split, "--out", path(&datasets), "--quiet"];
        run(&[&["suite", "generate", "odpc1", "--size", "smoke"][..], &of].concat());
    }
    let listed = run(&["suite", "list", "odpc1", "--size", "smoke", "--json", "--quiet"]);
    let listed: Value = serde_json::from_str(&listed).unwrap();
    for track in listed["tracks"].as_array().unwrap() {
        let name = track["track"].as_str().unwrap();
        let trackers = TRACKERS.iter().find(|(of, _)| *of == name).unwrap().1;
        for case in track["cases"].as_array().unwrap() {
            let case = case["case"].as_str().unwrap();
            for tracker in trackers {
                let folder = results.join(tracker).join(name).join(case);
                std::fs::create_dir_all(&folder).unwrap();
                let (test, file) = (datasets.join(name).join(case).join("test"), folder.join("results.csv"));
                let (method, more) = match *tracker {
                    "piv-ensemble" => ("piv", &["--ensemble"][..]),
                    "mle-spheroid" => ("mle", &["--shape", "spheroid"][..]),
                    method => (method, &[][..]),
                };
                let how = ["track", path(&test), "--method", method, "--out", path(&file), "--quiet"];
                run(&[&how[..], more].concat());
            }
        }
    }
    let out = place.path().join("scores");
    let all = [
        "suite",
        "score",
        "odpc1",
        path(&datasets),
        "--results",
        path(&results),
        "--out",
        path(&out),
        "--quiet",
    ];
    let said = run(&[&all[..], &["--anchors", "--json"]].concat());
    let scores: Value = serde_json::from_str(&said).unwrap();
    for case in scores["cases"].as_array().unwrap() {
        let anchors = case["anchors"].as_array().unwrap();
        let scored = anchors.iter().filter(|anchor| anchor["result"]["status"] == "scored").count();
        assert!(scored == anchors.len() && scored >= 6, "{case:#}");
    }
    let page = std::fs::read_to_string(out.join("index.html")).unwrap();
    assert!(page.contains("Degenerate results and the rank that each would have: empty "));

    // A tracker that finds nothing is as bad as an anchor, and is named.
    let nothing = results.join("nothing/P2/snr_4");
    std::fs::create_dir_all(&nothing).unwrap();
    std::fs::write(nothing.join("results.csv"), "frame,x_px,y_px\n").unwrap();
    let message = fail(1, &[&all[..], &["--anchors", "--force", "--track", "P2"]].concat());
    assert!(message.contains("P2/snr_4: the anchor empty does not rank behind nothing"), "{message}");
}

const CLAIMS: &str = r#"(
    name: "claims",
    version: "1.0.0",
    title: "Claimed uncertainties",
    tracks: [(
        name: "U",
        title: "In focus",
        rank_by: [f1, crps_xy_px],
        dims: 2,
        sizes: (
            smoke: (train: 2, val: 2, test: 8), small: (train: 2, val: 2, test: 8), full: (train: 2, val: 2, test: 8),
        ),
        ladders: [(name: "one", title: "One", from: "base.ron")],
    )],
)"#;

const BASE: &str = r#"(
    name: "base",
    seed: 3,
    optics: (gaussian: (diameter_px: 3, peak_counts: 200), pixel_dim_x: 160, pixel_dim_y: 120, background_mean: 50),
    motion: flow(field: uniform(velocity_um_s: (129, 0, 0))),
    particles: (number: count(40)),
    boundaries: (z_um: (-5, 5)),
    timing: sequence(frames: 8),
    calibration: none,
)"#;

/// Writes the true positions with errors uniform within sqrt(3) U, where U alternates between 0.05 and 0.2 px, and the
/// claims `claim(U)`.
fn write_claims(truth: &Path, result: &Path, claim: impl Fn(f64) -> Option<f64>) {
    std::fs::create_dir_all(result.parent().unwrap()).unwrap();
    let mut reader = csv::Reader::from_path(truth).unwrap();
    let header = reader.headers().unwrap().clone();
    let columns =
        ["frame", "track", "x_px", "y_px"].map(|name| header.iter().position(|h| h == name).unwrap());
    let mut writer = csv::Writer::from_path(result).unwrap();
    writer.write_record(["frame", "track", "x_px", "y_px", "sx_px", "sy_px"]).unwrap();
    // Multiples of the golden ratio and of sqrt(2) fill the interval from -1 to 1 evenly.
    let spread = |i: usize, step: f64| 2.0 * (i as f64 * step).fract() - 1.0;
    for (i, row) in reader.records().map(Result::unwrap).enumerate() {
        let [frame, track, x, y] = columns.map(|column| row[column].parse::<f64>().unwrap());
        let u = if track % 2.0 == 0.0 { 0.05 } else { 0.2 };
        let error = |step: f64| 3f64.sqrt() * u * spread(i, step);
        let claimed = claim(u).map_or(String::new(), |u| u.to_string());
        let at =
            [frame, track, x + error(0.618_033_988_7), y + error(0.414_213_562_4)].map(|v| v.to_string());
        writer.write_record(at.iter().chain([&claimed, &claimed])).unwrap();
    }
    writer.flush().unwrap();
}

#[test]
fn claims_that_are_too_large_too_small_or_partial_rank_behind_true_ones() {
    let place = tempfile::tempdir().unwrap();
    let (suite, datasets) = (place.path().join("suite.ron"), place.path().join("datasets"));
    std::fs::write(&suite, CLAIMS).unwrap();
    std::fs::write(place.path().join("base.ron"), BASE).unwrap();
    run(&["suite", "generate", path(&suite), "--size", "smoke", "--out", path(&datasets), "--quiet"]);
    let results = place.path().join("results");
    let truth = datasets.join("U/one/test/truth/tracks.csv");
    let write = |name: &str, claim: &dyn Fn(f64) -> Option<f64>| {
        write_claims(&truth, &results.join(name).join("U/one/results.csv"), claim);
    };
    write("true", &|u| Some(u));
    write("large", &|u| Some(3.0 * u));
    write("small", &|u| Some(u / 3.0));
    write("easy", &|u| Some(u).filter(|u| *u < 0.1));
    write("none", &|_| None);
    let out = place.path().join("out");
    let scores = run(&[
        "suite",
        "score",
        path(&suite),
        path(&datasets),
        "--results",
        path(&results),
        "--out",
        path(&out),
        "--anchors",
        "--json",
        "--quiet",
    ]);
    let scores: Value = serde_json::from_str(&scores).unwrap();
    let case = &scores["cases"][0];
    let of = |name: &str| case["results"].as_array().unwrap().iter().find(|r| r["tracker"] == name).unwrap();
    let crps = |name: &str| {
        let all = of(name)["scores"].as_array().unwrap();
        all.iter().find(|score| score["metric"] == "crps_xy_px").unwrap()["value"].as_f64().unwrap()
    };
    assert_eq!(of("true")["rank"], 1, "{case:#}");
    for other in ["large", "small", "easy", "none"] {
        assert!(
            of(other)["rank"].as_u64() > Some(1) && crps(other) > 1.05 * crps("true"),
            "{other}: {case:#}"
        );
        // Positions are the same, and so are the scores before.
        assert_eq!(of(other)["scores"][0], of("true")["scores"][0], "{other}");
    }
    let anchors = case["anchors"].as_array().unwrap();
    for name in ["wide-claims", "narrow-claims"] {
        let anchor = anchors.iter().find(|anchor| anchor["result"]["tracker"] == name).unwrap();
        assert!(anchor["made_from"] == "true" && anchor["result"]["rank"].as_u64() > Some(1), "{anchor:#}");
    }
}
