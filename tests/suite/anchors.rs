//! Degenerate results rank behind microsig's own trackers in every case of the shipped suite (its smallest
//! size; `microsig suite score --anchors` does the same for any).

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
