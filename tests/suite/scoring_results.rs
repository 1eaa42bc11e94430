//! General properties of scores: the truth is perfect, invariance, warnings, files.

use std::path::Path;

use crate::scoring_hints::{scene, scores};
use proptest::prelude::*;
use scoring::evaluate::truth::TrueParticles;
use scoring::results::{Points, TrackRow};
use suite::microsig::{fail, generate, json, path, run, write};

/// Fast rotation about the center of a small image: many particles leave it at the corners and return.
const VORTEX: &str = r#"(
    name: "vortex",
    optics: (pixel_dim_x: 150, pixel_dim_y: 110, n_rays: 50),
    motion: flow(field: lamb_oseen(max_speed_um_s: 2500, core_radius_um: 20)),
    particles: (number: count(25), diameter_um: constant(2)),
    boundaries: (z_um: (-40, 20)),
    timing: sequence(frames: 30, dt_s: 0.005),
    calibration: none,
)"#;

const PAIRS: &str = r#"(
    name: "pairs",
    optics: (pixel_dim_x: 150, pixel_dim_y: 110, n_rays: 50),
    motion: flow(field: poiseuille()),
    particles: (number: count(20)),
    timing: pairs(count: 4),
    calibration: none,
)"#;

fn is_perfect(score: &serde_json::Value) {
    let number = |of: &str| score.pointer(&format!("/{of}")).and_then(serde_json::Value::as_f64);
    let ones = "detection/precision detection/recall detection/f1 detection/jaccard links/precision links/recall \
                links/f1 isbi/alpha isbi/beta isbi/jsc isbi/jsc_theta isbi_2d/alpha clear/mota identity/idf1 ctc/tra ctc/det \
                ctc/lnk gdpt/phi gdpt/precision lpt/correct lpt/coverage_longest lpt/purity lpt/strict lpt/mostly_tracked \
                lpt/fragments_per_truth hota/hota hota/deta hota/assa hota/loca";
    let zeros = "detection/rmse_xy_px detection/rmse_z_um detection/bias_x_px isbi/rmse clear/id_switches gdpt/sigma_z_um \
                 lpt/displacement_rms_px lpt/velocity_rms_um_s lpt/velocity_rms_z_um_s lpt/ghost";
    for (keys, expected) in [(ones, 1.0), (zeros, 0.0)] {
        for key in keys.split(' ') {
            // HOTA is a sum over 19 thresholds, which rounds.
            let allowed = if key.starts_with("hota") { 1e-12 } else { 0.0 };
            assert!(number(key).is_some_and(|n| (n - expected).abs() <= allowed), "{key}: {:?}", number(key));
        }
    }
    for caveats in ["hints", "warnings"] {
        assert_eq!(score[caveats].as_array().map(Vec::len), Some(0), "{}", score[caveats]);
    }
}

#[test]
fn the_truth_is_a_perfect_result_where_particles_leave_and_come_back() {
    let place = tempfile::tempdir().unwrap();
    let dataset = generate(place.path(), "dataset", VORTEX);
    let tracks = dataset.join("truth/tracks.csv");
    let score = json(&["evaluate", path(&dataset), path(&tracks)]);
    is_perfect(&score);
    // Checks the premise: some particle is visible, invisible, and visible again.
    let header = csv::Reader::from_path(&tracks).unwrap().headers().unwrap().clone();
    let column = |name: &str| header.iter().position(|h| h == name).unwrap();
    let (track, visible) = (column("track"), column("visible"));
    let mut seen: std::collections::BTreeMap<String, String> = std::collections::BTreeMap::new();
    for record in csv::Reader::from_path(&tracks).unwrap().records() {
        let record = record.unwrap();
        seen.entry(record[track].to_owned()).or_default().push_str(&record[visible]);
    }
    assert!(seen.values().any(|v| v.contains("10") && v[v.find("10").unwrap()..].contains("01")), "{seen:?}");
    assert!(score["counts"]["ignored_truth"].as_u64() > Some(0));
    assert_eq!(score["counts"]["ignored_truth"], score["counts"]["ignored_result"]);
}

#[test]
fn the_truth_of_pairs_is_a_perfect_result() {
    let place = tempfile::tempdir().unwrap();
    let dataset = generate(place.path(), "dataset", PAIRS);
    is_perfect(&json(&["evaluate", path(&dataset), path(&dataset.join("truth/tracks.csv"))]));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20))]
    #[test]
    fn order_of_rows_and_names_of_tracks_change_nothing(seed in any::<u64>(), step in 1i64..50) {
        let (truth, points) = scene();
        let expected = serde_json::to_string(&scores(&truth, &points)).unwrap();
        let key = |i: usize| (i as u64 + 1).wrapping_mul(seed | 1).rotate_left(23);
        let shuffled = |rows: &[TrackRow]| {
            let mut order: Vec<usize> = (0..rows.len()).collect();
            order.sort_by_key(|&i| key(i));
            order.iter().map(|&i| {
                let r = rows[i];
                TrackRow { track: if r.track < 0 { -1 } else { (200 - r.track) * step + 7 }, ..r }
            }).collect::<Vec<TrackRow>>()
        };
        let truth = TrueParticles { rows: shuffled(&truth.rows), ..truth };
        let points = Points { rows: shuffled(&points.rows), ..points };
        prop_assert_eq!(serde_json::to_string(&scores(&truth, &points)).unwrap(), expected);
    }
}

#[test]
fn what_does_not_fit_a_dataset_is_told() {
    let place = tempfile::tempdir().unwrap();
    let dataset = generate(place.path(), "dataset", PAIRS);
    let result = write(place.path(), "result.csv", "frame,track,x_px,y_px\n1,0,5,5\n8,0,5,5\n");
    let message = fail(2, &["evaluate", path(&dataset), path(&result), "--validate-only"]);
    assert!(message.contains("result.csv:3: frame = 8: expected 0 to 7"), "{message}");
    let bad = |more: &[&str]| fail(2, &[&["evaluate", path(&dataset), path(&result)], more].concat());
    let message = bad(&["--depth", "10", "-10"]);
    assert!(message.contains("--depth 10 -10: expected two depths in um, the lower one first"), "{message}");
    assert!(bad(&["--border", "1e9"]).contains("--border 1e9: expected 0 to 1e7 px"));
    let bare = fail(2, &["evaluate", path(&result), path(&result), "--border", "3"]);
    assert!(bare.contains("a bare table does not contain"), "{bare}");

    let partial = place.path().join("dataset.partial");
    std::fs::rename(&dataset, &partial).unwrap();
    std::fs::remove_file(partial.join("SHA256SUMS")).unwrap();
    let tracks = partial.join("truth/tracks.csv");
    for arguments in [
        vec!["evaluate", path(&partial), path(&tracks)],
        vec!["export", path(&partial), "--format", "isbi", "--out", path(&result), "--force"],
    ] {
        let message = fail(2, &arguments);
        assert!(message.contains("dataset.partial: unfinished; microsig generate --resume"), "{message}");
    }
}

#[test]
fn a_reader_that_reads_no_further_is_no_error() {
    // The reading end of the pipe is closed before anything is written.
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let child = suite::microsig::microsig().arg("flows").stdout(writer).output().unwrap();
    let said = String::from_utf8_lossy(&child.stderr);
    assert!(child.status.success() && said.is_empty(), "{:?} {said}", child.status);
}

#[test]
fn degenerate_results_have_null_scores() {
    let (truth, _) = scene();
    let nothing = scores(&truth, &Points { has_z: true, ..Points::default() });
    let d = nothing.detection.unwrap();
    assert_eq!(
        (d.missed, d.precision, d.recall, d.f1, d.rmse_xy_px),
        (480, None, Some(0.0), Some(0.0), None)
    );
    let isbi = nothing.isbi.unwrap();
    assert_eq!((isbi.alpha, isbi.beta, isbi.rmse), (Some(0.0), Some(0.0), None));
    assert!(isbi.alpha.is_some_and(f64::is_sign_positive) && isbi.beta.is_some_and(f64::is_sign_positive));

    let none = TrueParticles { has_z: true, ..TrueParticles::default() };
    let both = scores(&none, &Points::default());
    assert!(both.warnings.iter().any(|w| w.contains("nothing was missed")), "{:?}", both.warnings);
    let d = both.detection.unwrap();
    assert_eq!((d.precision, d.recall, d.f1, d.jaccard), (None, None, None, None));
    assert_eq!(
        (both.hota.unwrap().hota, both.isbi.unwrap().alpha, both.clear.unwrap().mota),
        (None, None, None)
    );
    let ghosts = scores(&none, &scene().1);
    let isbi = ghosts.isbi.unwrap();
    assert_eq!((ghosts.detection.unwrap().precision, isbi.alpha, isbi.beta), (Some(0.0), None, Some(0.0)));
}

#[test]
fn an_evaluation_leaves_files_that_can_be_compared() {
    let place = tempfile::tempdir().unwrap();
    let dataset = generate(place.path(), "dataset", VORTEX);
    let tracks = dataset.join("truth/tracks.csv");
    let worse = place.path().join("worse.csv");
    let mut text = "frame,track,x_px,y_px,z_um\n".to_owned();
    for record in csv::Reader::from_path(&tracks).unwrap().deserialize().enumerate() {
        let (i, row): (usize, std::collections::BTreeMap<String, String>) = (record.0, record.1.unwrap());
        let get = |name: &str| row[name].parse::<f64>().unwrap();
        if i % 5 > 0 {
            text += &format!(
                "{},{},{},{},{}\n",
                get("frame"),
                get("track"),
                get("x_px") + 0.1,
                get("y_px"),
                get("z_um")
            );
        }
    }
    std::fs::write(&worse, text).unwrap();
    let (a, b) = (place.path().join("perfect"), place.path().join("fair"));
    let table = run(&["evaluate", path(&dataset), path(&tracks), "--out", path(&a), "--report"]);
    assert!(table.lines().filter(|l| !l.contains("wrote")).all(|l| l.chars().count() <= 80), "{table}");
    assert!(
        fail(2, &["evaluate", path(&dataset), path(&tracks), "--out", path(&a)]).contains("already exists")
    );
    run(&["evaluate", path(&dataset), path(&worse), "--out", path(&b), "--report"]);
    for name in ["score.json", "per_frame.csv", "matches.csv", "curves.csv", "report.html"] {
        assert!(b.join(name).is_file(), "{name}");
    }
    let html = std::fs::read_to_string(b.join("report.html")).unwrap();
    assert!(html.contains("<svg") && !html.contains("<script") && !html.contains("src="));
    // The only URL is the SVG namespace.
    assert_eq!(html.matches("http").count(), html.matches("http://www.w3.org/2000/svg").count());

    let score: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(b.join("score.json")).unwrap()).unwrap();
    let matches = csv::Reader::from_path(b.join("matches.csv")).unwrap().into_records().count() as u64;
    let count = |key: &str| score["detection"][key].as_u64().unwrap();
    assert_eq!(matches, count("tp") + count("fn") + count("fp"));
    assert_eq!(score["definitions"]["assignment"], "lap-maxcard-d2");
    assert_eq!(score["definitions"]["gate"]["z_um"], 6.0);

    // A truth that is not the one of the manifest.
    let whole = std::fs::read_to_string(&tracks).unwrap();
    std::fs::write(&tracks, whole.trim_end().rsplit_once('\n').unwrap().0).unwrap();
    let changed = json(&["evaluate", path(&dataset), path(&worse)]);
    assert!(changed["warnings"].to_string().contains("truth/tracks.csv has changed"), "{changed}");
    assert!(changed["definitions"]["truth_sha256"] != score["definitions"]["truth_sha256"]);
    std::fs::write(&tracks, whole).unwrap();

    let board = place.path().join("board");
    let compared = json(&["compare", path(&b), path(&a), "--out", path(&board)]);
    let rank = |i: usize| (compared["entries"][i]["name"].clone(), compared["entries"][i]["rank"].clone());
    assert_eq!((rank(0), rank(1)), (("perfect".into(), 1.into()), ("fair".into(), 2.into())));
    for name in ["leaderboard.csv", "curves.csv", "leaderboard.html"] {
        assert!(board.join(name).is_file(), "{name}");
    }
}

#[test]
fn a_comparison_knows_datasets_by_their_truth_and_ranks_fields_apart() {
    let place = tempfile::tempdir().unwrap();
    let (scenario, seven) = (place.path().join("vortex.ron"), place.path().join("seven"));
    let dataset = generate(place.path(), "dataset", VORTEX);
    std::fs::write(&scenario, VORTEX).unwrap();
    run(&["generate", path(&scenario), "--out", path(&seven), "--seed", "7", "--quiet"]);
    let score = |dataset: &Path, result: &Path, name: &str| {
        let out = place.path().join(name);
        run(&["evaluate", path(dataset), path(result), "--out", path(&out), "--quiet"]);
        out
    };
    let field = place.path().join("field.txt");
    run(&["export", path(&dataset), "--format", "openpiv", "--pair", "0", "--out", path(&field)]);
    let particles = score(&dataset, &dataset.join("truth/tracks.csv"), "particles");
    let vectors = place.path().join("vectors");
    run(&["evaluate", path(&dataset), path(&field), "--pair", "all", "--out", path(&vectors), "--quiet"]);
    let other = score(&seven, &seven.join("truth/tracks.csv"), "other");
    let compared = |scores: &[&Path], out: &str| -> serde_json::Value {
        let out = place.path().join(out);
        let scores: Vec<&str> = scores.iter().map(|s| path(s)).collect();
        json(&[&["compare"], &scores[..], &["--out", path(&out)]].concat())
    };
    let both = compared(&[&vectors, &particles], "both");
    assert_eq!(both["warnings"].as_array().map(Vec::len), Some(0), "{both}");
    let line = |i: usize| (both["entries"][i]["kind"].clone(), both["entries"][i]["rank"].clone());
    assert_eq!((line(0), line(1)), (("particles_3d".into(), 1.into()), ("field".into(), 1.into())));
    let page = std::fs::read_to_string(place.path().join("both/leaderboard.html")).unwrap();
    assert!(page.contains("<h2>Particles in three dimensions</h2>") && page.contains("<h2>Fields</h2>"));
    let seeds = compared(&[&particles, &other], "seeds");
    let warned = seeds["warnings"].as_array().into_iter().flatten().filter_map(|w| w.as_str());
    assert_eq!(
        warned.filter(|w| w.contains("different datasets that are all named vortex")).count(),
        1,
        "{seeds}"
    );

    let file = particles.join("score.json");
    let text = std::fs::read_to_string(&file).unwrap().replacen("\"f1\": 1.0", "\"f1\": 2.0", 1);
    std::fs::write(&file, text).unwrap();
    let message = fail(2, &["compare", path(&file), "--out", path(&place.path().join("never"))]);
    assert!(message.contains("score.json: detection.f1 = 2.0: expected from 0 to 1"), "{message}");
}

/// Options of the other kind of results are refused, not ignored.
#[test]
fn options_belong_to_a_kind_of_results() {
    let place = tempfile::tempdir().unwrap();
    let dataset = generate(place.path(), "dataset", PAIRS);
    let tracks = dataset.join("truth/tracks.csv");
    let field = place.path().join("field.txt");
    run(&["export", path(&dataset), "--format", "openpiv", "--out", path(&field)]);
    let of_particles = [&["--gate-xy", "3"][..], &["--dims", "2"], &["--border", "4"], &["--auto-offset"]];
    for option in of_particles {
        let said = fail(2, &[&["evaluate", path(&dataset), path(&field)], option].concat());
        assert!(said.contains(&format!("{}: is for results that are particles", option[0])), "{said}");
    }
    let said = fail(2, &["evaluate", path(&dataset), path(&tracks), "--plane", "0"]);
    assert!(said.contains("--plane: is for results that are fields"), "{said}");
    let said = fail(2, &["evaluate", path(&dataset), path(&tracks), "--dims", "2", "--gate-z", "5"]);
    assert!(said.contains("--gate-z: has no meaning with --dims 2"), "{said}");
    let score = json(&["evaluate", path(&dataset), path(&field), "--crlb"]);
    assert_eq!(score["crlb"], serde_json::Value::Null);
    assert!(
        score["warnings"].to_string().contains("no Cramer-Rao bound: it is defined for particles only"),
        "{score}"
    );
}
