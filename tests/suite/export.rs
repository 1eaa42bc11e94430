//! Exports of the truth, read back and evaluated, have a perfect score in each format.

use std::path::{Path, PathBuf};

use microsig_core::formats::pages::Pages;
use serde_json::Value;
use suite::microsig::{fail, generate, json, path, run};

const PAIRS: &str = r#"(
    name: "pairs",
    optics: (pixel_dim_x: 160, pixel_dim_y: 120),
    motion: flow(field: poiseuille()),
    particles: (number: count(8)),
    timing: pairs(count: 3),
    calibration: none,
)"#;

/// Particles leave the image and reenter on the other side with the same number.
const SEQUENCE: &str = r#"(
    name: "sequence",
    optics: (pixel_dim_x: 100, pixel_dim_y: 80),
    motion: flow(field: uniform(velocity_um_s: (4000, 500, 0))),
    particles: (number: count(8)),
    boundaries: (x: periodic, y: periodic, keep_ids: true, margin_px: 20),
    timing: sequence(frames: 12, dt_s: 0.002),
    calibration: none,
)"#;

fn exported(dataset: &Path, format: &str, more: &[&str]) -> PathBuf {
    let out = dataset.with_extension(format);
    run(&[&["export", path(dataset), "--format", format, "--out", path(&out), "--force"], more].concat());
    out
}

fn score(dataset: &Path, result: &Path) -> Value {
    json(&["evaluate", path(dataset), path(result)])
}

#[test]
fn exported_particles_score_perfectly() {
    let place = tempfile::tempdir().unwrap();
    for (name, scenario) in [("pairs", PAIRS), ("sequence", SEQUENCE)] {
        let dataset = generate(place.path(), name, scenario);
        let own = score(&dataset, &dataset.join("truth/tracks.csv"));
        if name == "sequence" {
            // Otherwise this scenario tests nothing new.
            let tracks = csv::Reader::from_path(dataset.join("truth/tracks.csv")).unwrap().into_records();
            let all: std::collections::BTreeSet<String> = tracks.map(|r| r.unwrap()[2].to_owned()).collect();
            assert!(own["counts"]["tracks_truth"].as_u64().unwrap() > all.len() as u64);
        }
        for format in ["isbi", "trackpy", "defocustracker", "trackmate-spots", "napari"] {
            let score = score(&dataset, &exported(&dataset, format, &[]));
            let number = |key: &str| score.pointer(key).and_then(Value::as_f64).unwrap_or(f64::NAN);
            let ones = "/detection/precision /detection/recall /detection/f1 /links/f1 /isbi/alpha /isbi/beta /isbi/jsc \
                        /isbi/jsc_theta /hota/hota /hota/assa /clear/mota /identity/idf1";
            for key in ones.split(' ') {
                // Coordinates are rounded once or twice: 1e-13 px relative to gates of some px.
                assert!((number(key) - 1.0).abs() < 1e-9, "{name} {format} {key}: {}", number(key));
            }
            assert!(number("/detection/rmse_xy_px") < 1e-10, "{name} {format}");
            assert!(number("/detection/rmse_z_um") < 1e-10, "{name} {format}");
            for count in ["tracks_truth", "n_truth", "tracks_result", "n_result"] {
                let expected = own["counts"][count.replace("result", "truth")].clone();
                assert_eq!(score["counts"][count], expected, "{name} {format} {count}");
            }
            for caveats in ["hints", "warnings"] {
                let told = &score[caveats];
                assert_eq!(told.as_array().map(Vec::len), Some(0), "{name} {format}: {told}");
            }
        }
    }
}

#[test]
fn an_export_is_what_the_format_says() {
    let place = tempfile::tempdir().unwrap();
    let dataset = generate(place.path(), "pairs", PAIRS);
    let text = |format: &str| std::fs::read_to_string(exported(&dataset, format, &[])).unwrap();
    let truth = std::fs::read_to_string(dataset.join("truth/tracks.csv")).unwrap();
    let rows: Vec<Vec<f64>> = truth
        .lines()
        .skip(1)
        .map(|l| l.split(',').map(|t| t.parse().unwrap_or(f64::NAN)).collect())
        .collect();
    let visible = truth.lines().next().unwrap().split(',').position(|c| c == "visible").unwrap();
    let first = rows.iter().find(|r| r[visible] == 1.0 && r[0] == 0.0 && r[2] == 0.0).unwrap();
    let cells = |line: &str| -> Vec<f64> { line.split(',').map(|t| t.parse().unwrap_or(f64::NAN)).collect() };
    let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a} is not {b}");

    let trackpy = text("trackpy");
    assert!(trackpy.starts_with("y,x,z,frame,particle\n"));
    let row = cells(trackpy.lines().nth(1).unwrap());
    near(row[0], first[4] - 1.0);
    near(row[1], first[3] - 1.0);
    near(row[2], first[5]);

    // Depth range -80 to 20 um; frames and ids from 1; the displacement to B is the truth's.
    let row = cells(text("defocustracker").lines().nth(1).unwrap());
    let partner = rows.iter().find(|r| r[0] == 1.0 && r[2] == 0.0).unwrap();
    assert_eq!((row[0], row[7]), (1.0, 1.0));
    near(row[1], first[3]);
    near(row[3], (first[5] + 80.0) / 100.0);
    near(row[4], partner[3] - first[3]);

    let trackmate = text("trackmate-spots");
    let row = cells(trackmate.lines().nth(4).unwrap());
    near(row[4], (first[3] - 1.0) * 0.645);
    near(row[9], 1.0);

    // Nothing is overwritten; a folder that is not a dataset is refused.
    let out = dataset.with_extension("trackpy");
    assert!(
        fail(2, &["export", path(&dataset), "--format", "trackpy", "--out", path(&out)]).contains("exists")
    );
    let other = place.path().join("none");
    assert!(
        fail(2, &["export", path(&other), "--format", "napari", "--out", path(&other)])
            .contains("expected the folder of a dataset")
    );
}

/// A table of the truth with nodes every 10 px, of all pairs or of each.
fn field(pairs: &[Option<u32>]) -> String {
    let mut text =
        "pair,plane,x_px,y_px,z_um,forward_dx_px,forward_dy_px,forward_dz_um,central_dx_px,central_dy_px,\
                    central_dz_um,mask\n"
            .to_owned();
    for pair in pairs {
        let (name, k) = (pair.map_or_else(String::new, |p| p.to_string()), f64::from(pair.unwrap_or(0)));
        for (x, y) in (0..15)
            .flat_map(|j| (0..11).map(move |i| (10.5 + 10.0 * f64::from(j), 10.5 + 10.0 * f64::from(i))))
        {
            let (u, v, mask) =
                (1.5 + 0.01 * x - 0.003 * y + k, 0.02 * x * y / 100.0, u8::from(x > 140.0 && y > 100.0));
            text += &format!("{name},0,{x},{y},-30,{},{v},0,{u},{v},0.1,{mask}\n", u + 0.1);
        }
    }
    text
}

#[test]
fn exported_fields_score_perfectly() {
    let place = tempfile::tempdir().unwrap();
    let dataset = generate(place.path(), "pairs", PAIRS);
    let table = dataset.join("truth/field.csv");
    std::fs::write(&table, field(&[None])).unwrap();
    // Middlebury's format has 24-bit mantissas: 1e-7 of some px.
    for (format, bar, vectors) in [("flo", 1e-6, 140.0 * 100.0), ("openpiv", 1e-12, 15.0 * 11.0)] {
        let score = score(&dataset, &exported(&dataset, format, &[]));
        let number = |key: &str| score.pointer(key).and_then(Value::as_f64).unwrap_or(f64::NAN);
        assert!(number("/field/aee_px") < bar, "{format}: {}", number("/field/aee_px"));
        assert_eq!(score["field"]["against"], "central", "{format}");
        assert_eq!((number("/field/n_outside"), number("/field/outlier_fraction")), (0.0, 0.0), "{format}");
        // All except the masked corner and, in the dense field, the cells that touch it.
        let reported = number("/field/n_reported");
        assert!(reported < vectors && reported > 0.97 * vectors, "{format}: {reported} of {vectors}");
        let forward = self::score(&dataset, &exported(&dataset, format, &["--displacement", "forward"]));
        let error = forward.pointer("/field/truths/forward/aee_px").and_then(Value::as_f64).unwrap();
        assert!(error < bar, "{format}: {error}");
    }
    let refused = |more: &[&str]| {
        let out = place.path().join("refused.flo");
        fail(2, &[&["export", path(&dataset), "--format", "flo", "--out", path(&out)], more].concat())
    };
    assert!(refused(&["--displacement", "weighted"]).contains("no column weighted_dx_px"));

    std::fs::write(&table, field(&[Some(0), Some(1), Some(2)])).unwrap();
    assert!(refused(&[]).contains("changes with time; give --pair"));
    assert!(refused(&["--pair", "3"]).contains("no pair 3"));
    let (one, two) =
        (exported(&dataset, "openpiv", &["--pair", "1"]), exported(&dataset, "flo", &["--pair", "2"]));
    let text = std::fs::read_to_string(one).unwrap();
    let first: Vec<f64> = text.lines().nth(1).unwrap().split('\t').map(|t| t.parse().unwrap()).collect();
    assert!((first[2] - 2.5735).abs() < 1e-12, "{first:?}");
    assert!(std::fs::metadata(two).unwrap().len() == 12 + 8 * 160 * 120);

    std::fs::remove_file(&table).unwrap();
    assert!(refused(&[]).contains("has no true displacement field"));
}

/// Recordings have the names of their folders.
#[test]
fn xml_holds_any_name() {
    let place = tempfile::tempdir().unwrap();
    let dataset = generate(place.path(), "pairs", PAIRS);
    let manifest = dataset.join("datapackage.json");
    let text = std::fs::read_to_string(&manifest).unwrap();
    std::fs::write(&manifest, text.replacen("\"name\": \"pairs\"", r#""name": "A & \"B\"""#, 1)).unwrap();
    let xml = std::fs::read_to_string(exported(&dataset, "isbi", &[])).unwrap();
    assert!(xml.contains("scenario=\"A &amp; &quot;B&quot;\""), "{}", &xml[..200]);
}

/// A stack of one file has the images of its dataset.
#[test]
fn stacks_hold_images() {
    let place = tempfile::tempdir().unwrap();
    let scenario = SEQUENCE.replace("calibration: none,", "calibration: every_um(5),");
    let dataset = generate(place.path(), "stacks", &scenario);
    let exported = |format: &str, images: &str| {
        let out = place.path().join(format!("{images}.{format}.tif"));
        run(&["export", path(&dataset), "--format", format, "--images", images, "--out", path(&out)]);
        out
    };
    let counts = |files: &[PathBuf]| {
        let mut all = Vec::new();
        for file in files {
            let reader = std::io::BufReader::new(std::fs::File::open(file).unwrap());
            let mut pages = Pages::open(reader, path(file)).unwrap();
            loop {
                let size = pages.size().unwrap();
                all.push(pages.counts(size).unwrap());
                if !pages.go_on().unwrap() {
                    break;
                }
            }
        }
        all
    };
    let files = |folder: &str| {
        let mut files: Vec<PathBuf> =
            std::fs::read_dir(dataset.join(folder)).unwrap().map(|entry| entry.unwrap().path()).collect();
        files.sort();
        files
    };
    for format in ["ome-tiff", "imagej-stack"] {
        assert_eq!(counts(&[exported(format, "frames")]), counts(&files("images")), "{format}");
        assert_eq!(
            counts(&[exported(format, "calibration")]),
            counts(&files("calibration/images")),
            "{format}"
        );
    }
    let of_other = ["--images", "calibration", "--stack", "d_9um", "--out", "a.tif"];
    let message = fail(2, &[&["export", path(&dataset), "--format", "ome-tiff"], &of_other[..]].concat());
    assert!(message.contains("no stack \"d_9um\""), "{message}");
}
