//! General properties of scores: the truth is perfect, invariance, warnings, files.

use std::path::Path;

use crate::scoring_hints::{scene, scores};
use proptest::prelude::*;
use scoring::evaluate::EvaluateOptions;
use scoring::evaluate::truth::TrueParticles;
use scoring::results::{Points, TrackRow};
use suite::microsig::{fail, generate, json, path, run};

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

fn evaluated(arguments: &[&str]) -> serde_json::Value {
    let said = run(&[&["evaluate"], arguments, &["--json", "--quiet"]].concat());
    serde_json::from_str(&said).unwrap()
}

fn is_perfect(score: &serde_json::Value) {
    let one = |pointer: &str| {
        assert_eq!(score.pointer(pointer).and_then(serde_json::Value::as_f64), Some(1.0), "{pointer}")
    };
    for pointer in [
        "/detection/precision",
        "/detection/recall",
        "/detection/f1",
        "/detection/jaccard",
        "/links/precision",
        "/links/recall",
        "/links/f1",
        "/isbi/alpha",
        "/isbi/beta",
        "/isbi/jsc",
        "/isbi/jsc_theta",
        "/isbi_2d/alpha",
        "/clear/mota",
        "/identity/idf1",
        "/ctc/tra",
        "/ctc/det",
        "/ctc/lnk",
        "/gdpt/phi",
        "/gdpt/precision",
        "/lpt/correct",
        "/lpt/coverage_longest",
        "/lpt/purity",
        "/lpt/strict",
        "/lpt/mostly_tracked",
        "/lpt/fragments_per_truth",
    ] {
        one(pointer);
    }
    let value = |pointer: &str| score.pointer(pointer).and_then(serde_json::Value::as_f64).unwrap();
    // Rounding of sums over 19 thresholds.
    for pointer in ["/hota/hota", "/hota/deta", "/hota/assa", "/hota/loca"] {
        assert!((value(pointer) - 1.0).abs() < 1e-12, "{pointer} {}", value(pointer));
    }
    for pointer in [
        "/detection/rmse_xy_px",
        "/detection/rmse_z_um",
        "/detection/bias_x_px",
        "/isbi/rmse",
        "/clear/id_switches",
        "/gdpt/sigma_z_um",
        "/lpt/displacement_rms_px",
        "/lpt/velocity_rms_um_s",
        "/lpt/velocity_rms_z_um_s",
        "/lpt/ghost",
    ] {
        assert_eq!(value(pointer), 0.0, "{pointer}");
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
    let score = evaluated(&[path(&dataset), path(&tracks)]);
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
    is_perfect(&evaluated(&[path(&dataset), path(&dataset.join("truth/tracks.csv"))]));
}

/// Writes these columns of the truth as a result.
fn columns(tracks: &Path, names: &[&str], out: &Path) {
    let mut text = names.join(",") + "\n";
    for row in csv::Reader::from_path(tracks).unwrap().deserialize() {
        let row: std::collections::BTreeMap<String, String> = row.unwrap();
        text += &(names.iter().map(|n| row[*n].as_str()).collect::<Vec<_>>().join(",") + "\n");
    }
    std::fs::write(out, text).unwrap();
}

#[test]
fn velocities_are_those_of_the_times_at_which_frames_were_taken() {
    let place = tempfile::tempdir().unwrap();
    let positions = place.path().join("positions.csv");
    for (timing, even) in [
        ("four_pulse(count: 2, dt_s: 0.002, gap_s: 0.005, interval_s: 0.1)", false),
        ("sequence(frames: 8, dt_s: 0.004, jitter_s: 0.0004)", false),
        ("sequence(frames: 8, dt_s: 0.004)", true),
    ] {
        let scenario = VORTEX.replace("sequence(frames: 30, dt_s: 0.005)", timing);
        let folder = tempfile::tempdir_in(place.path()).unwrap();
        let dataset = generate(folder.path(), "dataset", &scenario);
        let tracks = dataset.join("truth/tracks.csv");
        is_perfect(&evaluated(&[path(&dataset), path(&tracks)]));
        columns(&tracks, &["frame", "track", "x_px", "y_px", "z_um"], &positions);
        let lpt = &evaluated(&[path(&dataset), path(&positions)])["lpt"];
        assert_eq!(lpt["velocity_from"], "positions");
        // Finite differences over a few ms of a rotation period of 0.1 s; with equal time steps the error
        // would be half of the velocity.
        assert!(lpt["velocity_rms_relative"].as_f64().unwrap() < 0.15, "{timing}: {lpt}");
        assert_eq!(lpt["acceleration_rms_px"].is_number(), even, "{timing}: {lpt}");
        // Rounding of times; positions are the same.
        assert!(lpt["acceleration_rms_relative"].as_f64().unwrap() < 1e-9, "{timing}: {lpt}");
    }
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
fn scores_lie_within_their_intervals() {
    let (truth, points) = scene();
    let score = serde_json::to_value(scores(&truth, &points)).unwrap();
    for (value, interval) in [
        ("/detection/precision", "/detection/interval_precision"),
        ("/detection/f1", "/detection/interval_f1"),
        ("/detection/rmse_xy_px", "/detection/interval_rmse_xy_px"),
        ("/links/recall", "/links/interval_recall"),
        ("/links/f1", "/links/interval_f1"),
        ("/isbi/alpha", "/isbi/interval_alpha"),
        ("/isbi/beta", "/isbi/interval_beta"),
        ("/isbi/jsc", "/isbi/interval_jsc"),
        ("/isbi/jsc_theta", "/isbi/interval_jsc_theta"),
        ("/isbi/rmse", "/isbi/interval_rmse"),
        ("/hota/hota", "/hota/interval_hota"),
        ("/hota/assa", "/hota/interval_assa"),
        ("/clear/mota", "/clear/interval_mota"),
        ("/clear/motp", "/clear/interval_motp"),
        ("/identity/idf1", "/identity/interval_idf1"),
        ("/gdpt/phi", "/gdpt/interval_phi"),
        ("/gdpt/sigma_z_over_h", "/gdpt/interval_sigma_z_over_h"),
        ("/lpt/ghost", "/lpt/interval_ghost"),
        ("/lpt/displacement_rms_px", "/lpt/interval_displacement_rms_px"),
        ("/lpt/acceleration_rms_px", "/lpt/interval_acceleration_rms_px"),
    ] {
        let number = |pointer: &str| score.pointer(pointer).and_then(serde_json::Value::as_f64);
        let ends = [0, 1].map(|i| number(&format!("{interval}/{i}")));
        let (Some(v), [Some(low), Some(high)]) = (number(value), ends) else { panic!("{value} {ends:?}") };
        assert!(low < v && v < high, "{value}: {v} in [{low}, {high}]");
    }
}

#[test]
fn claims_are_compared_with_errors() {
    let (truth, points) = scene();
    // Errors are uniform over +-0.3 px: a standard deviation of 0.173 px. The claimed uncertainty of z is
    // half of the true one.
    let sigma = 0.6 / 12f64.sqrt();
    let claimed = Points { sigma: vec![[sigma, f64::NAN, sigma / 2.0]; points.rows.len()], ..points };
    let claims = scores(&truth, &claimed).uncertainty.unwrap();
    let (x, z) = (claims.x.unwrap(), claims.z.unwrap());
    // 430 errors give a standard deviation to 3.4 %; 1 / sqrt 3 of them are within one, all within two.
    assert!((x.ratio.unwrap() - 1.0).abs() < 0.1 && (z.ratio.unwrap() - 2.0).abs() < 0.2, "{x:?} {z:?}");
    assert!((x.coverage_1s.unwrap() - 0.577).abs() < 0.08 && x.coverage_2s == Some(1.0), "{x:?}");
    assert_eq!((claims.y, x.bins.len()), (None, 10));
}

#[test]
fn recall_is_binned_by_what_the_truth_tells_of_a_particle() {
    let place = tempfile::tempdir().unwrap();
    let paths = ["truth.csv", "result.csv"].map(|name| place.path().join(name));
    let (mut truth, mut result) =
        ("frame,track,x_px,y_px,snr,overlap\n".to_owned(), "frame,track,x_px,y_px\n".to_owned());
    for i in 0..100 {
        // Faint particles are missed; overlap has no effect.
        let (x, snr) = (10 * i, i / 10);
        truth += &format!("0,{i},{x},5,{snr},{}\n", f64::from(i % 10) / 10.0);
        if snr >= 3 {
            result += &format!("0,{i},{x},5\n");
        }
    }
    std::fs::write(&paths[0], truth).unwrap();
    std::fs::write(&paths[1], result).unwrap();
    let score =
        scoring::evaluate::evaluate_files(&paths[0], &paths[1], &EvaluateOptions::default()).unwrap().score;
    let recalls = |against: &str| -> Vec<f64> {
        let curve = score.curves.iter().find(|c| c.against == against).unwrap();
        curve.bins.iter().map(|b| b.recall.unwrap()).collect()
    };
    assert_eq!(recalls("snr"), [0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]);
    assert!(recalls("overlap").iter().all(|r| (r - 0.7).abs() < 1e-12), "{:?}", recalls("overlap"));
}

#[test]
fn what_does_not_fit_a_dataset_is_told() {
    let place = tempfile::tempdir().unwrap();
    let dataset = generate(place.path(), "dataset", PAIRS);
    let result = place.path().join("result.csv");
    std::fs::write(&result, "frame,track,x_px,y_px\n1,0,5,5\n8,0,5,5\n").unwrap();
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
    let said = run(&["evaluate", path(&dataset), path(&worse), "--json"]);
    let changed: serde_json::Value = serde_json::from_str(&said).unwrap();
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
        let said = run(&[&["compare"], &scores[..], &["--out", path(&out), "--json", "--quiet"]].concat());
        serde_json::from_str(&said).unwrap()
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

#[test]
fn gaussian_spots_have_a_bound_of_x_and_y_but_not_of_z() {
    let place = tempfile::tempdir().unwrap();
    let scenario = r#"(
        name: "spots",
        optics: (gaussian: (diameter_px: 6, peak_counts: 500), pixel_dim_x: 90, pixel_dim_y: 70, background_noise: 5),
        motion: flow(field: poiseuille()),
        particles: (number: count(20)),
        timing: pairs(count: 1),
    )"#;
    let dataset = generate(place.path(), "dataset", scenario);
    let tracks = dataset.join("truth/tracks.csv");
    let flat = place.path().join("flat.csv");
    columns(&tracks, &["frame", "track", "x_px", "y_px"], &flat);
    // 20 bins over depth; a single bin for a result without depth.
    for (result, bins) in [(&tracks, 20), (&flat, 1)] {
        let score = evaluated(&[path(&dataset), path(result), "--crlb"]);
        let all = score["crlb"]["bins"].as_array().unwrap();
        assert_eq!(all.len(), bins);
        for bin in all {
            // Noise of 5 counts plus rounding and a peak of 500: sqrt(2 / pi) s / A; the pixel size is a
            // quarter of the image width.
            let expected = (2.0 / std::f64::consts::PI).sqrt() * (25.0f64 + 1.0 / 12.0).sqrt() / 500.0;
            let x = bin["crlb_x_px"].as_f64().unwrap();
            assert!((x / expected - 1.0).abs() < 0.05 && bin["crlb_z_um"].is_null(), "{x} {expected}");
        }
    }
    let field = place.path().join("field.txt");
    run(&["export", path(&dataset), "--format", "openpiv", "--out", path(&field)]);
    // Options of the other kind of results are refused, not ignored.
    let of_particles = [&["--gate-xy", "3"][..], &["--dims", "2"], &["--border", "4"], &["--auto-offset"]];
    for option in of_particles {
        let said = fail(2, &[&["evaluate", path(&dataset), path(&field)], option].concat());
        assert!(said.contains(&format!("{}: is for results that are particles", option[0])), "{said}");
    }
    let said = fail(2, &["evaluate", path(&dataset), path(&tracks), "--plane", "0"]);
    assert!(said.contains("--plane: is for results that are fields"), "{said}");
    let said = fail(2, &["evaluate", path(&dataset), path(&tracks), "--dims", "2", "--gate-z", "5"]);
    assert!(said.contains("--gate-z: has no meaning with --dims 2"), "{said}");
    let score = evaluated(&[path(&dataset), path(&field), "--crlb"]);
    assert_eq!(score["crlb"], serde_json::Value::Null);
    assert!(
        score["warnings"].to_string().contains("no Cramer-Rao bound: it is defined for particles only"),
        "{score}"
    );
}
