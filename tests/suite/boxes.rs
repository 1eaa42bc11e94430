//! Truth for detectors: boxes and masks, their exports, and the score of a detector.

use std::io::Cursor;
use std::path::Path;

use microsig_core::formats::tiff;
use serde_json::{Value, json};
use suite::leak::unzip;
use suite::microsig::{fail, generate, json, path, run, write};

/// Noise-free spots far apart and above a dark background, and images of two sizes.
const SPOTS: &str = r#"(
    name: "spots",
    optics: (
        gaussian: (diameter_px: 4, reference_um: 2, peak_counts: 50000), pixel_dim_x: 120, pixel_dim_y: 90, background_mean: 0, background_noise: 0,
    ),
    motion: flow(field: uniform(velocity_um_s: (900, 300, 0))),
    particles: (number: count(3), diameter_um: list([(2, 1), (4, 1)]), seeding: apart_in_image(12)),
    timing: pairs(count: 3),
    truth: (boxes: true),
    calibration: none,
)"#;

const CROWDED: &str = r#"(
    name: "crowded",
    optics: (preset: setting1a, pixel_dim_x: 200, pixel_dim_y: 160),
    motion: flow(field: poiseuille()),
    particles: (number: count(25)),
    timing: pairs(count: 2),
    truth: (boxes: true, box_share: 0.2),
    calibration: none,
)"#;

fn rows(dataset: &Path) -> Vec<csv::StringRecord> {
    let table = csv::Reader::from_path(dataset.join("truth/boxes.csv")).unwrap();
    table.into_records().map(|row| row.unwrap()).collect()
}

fn coco(dataset: &Path) -> Value {
    let out = dataset.with_extension("json");
    run(&["export", path(dataset), "--format", "coco", "--out", path(&out)]);
    serde_json::from_slice(&std::fs::read(out).unwrap()).unwrap()
}

fn score(dataset: &Path, result: &Path) -> Value {
    json(&["evaluate", path(dataset), path(result)])
}

#[test]
fn boxes_are_where_the_images_are_bright() {
    let place = tempfile::tempdir().unwrap();
    let dataset = generate(place.path(), "spots", SPOTS);
    let coco = coco(&dataset);
    let annotations = coco["annotations"].as_array().unwrap();
    assert_eq!(rows(&dataset).len(), annotations.len());
    assert!(annotations.len() >= 12);
    for annotation in annotations {
        let frame = annotation["image_id"].as_u64().unwrap() as usize;
        let file = coco["images"][frame]["file_name"].as_str().unwrap();
        let image = suite::counts(&dataset.join(file)).unwrap();
        let [x, y, w, h] = [0, 1, 2, 3].map(|k| annotation["bbox"][k].as_f64().unwrap() as u32);
        // The light of the box and 2 px around it belongs to this particle alone.
        let near = |at: u32, size: u32, end: u32| at.saturating_sub(2)..(at + size + 2).min(end);
        let pixels = || near(y, h, 90).flat_map(move |row| near(x, w, 120).map(move |column| (column, row)));
        let count = |(column, row): (u32, u32)| image[(row * 120 + column) as usize];
        let peak = pixels().map(count).fold(0.0, f64::max);
        let bright: Vec<(u32, u32)> = pixels().filter(|at| count(*at) > 0.1 * peak).collect();
        assert_eq!(bright.len() as f64, annotation["area"].as_f64().unwrap(), "{annotation}");
        let ends = |of: fn(&(u32, u32)) -> u32| {
            (bright.iter().map(of).min().unwrap(), bright.iter().map(of).max().unwrap())
        };
        assert_eq!((ends(|p| p.0), ends(|p| p.1)), ((x, x + w - 1), (y, y + h - 1)), "{annotation}");
    }
}

#[test]
fn exports_hold_all_boxes_and_the_truth_scores_one() {
    let place = tempfile::tempdir().unwrap();
    let dataset = generate(place.path(), "crowded", CROWDED);
    run(&["verify", path(&dataset)]);
    let rows = rows(&dataset);
    assert!(rows.iter().any(|row| row[9].parse::<f64>().unwrap() > 0.0), "some are partly hidden");
    let coco = coco(&dataset);
    let annotations = coco["annotations"].as_array().unwrap();
    let visible = annotations.iter().filter(|one| one["iscrowd"] == 0).count();
    assert!(visible > 50 && visible < annotations.len());

    let result = |k: usize, one: &Value| json!({"image_id": one["image_id"], "category_id": 0, "bbox": one["bbox"], "score": 1.0 - 1e-3 * k as f64});
    let found: Vec<Value> = annotations.iter().enumerate().map(|(k, one)| result(k, one)).collect();
    let file = write(place.path(), "found.json", Value::from(found).to_string());
    let perfect = score(&dataset, &file);
    for key in ["ap", "ap50", "ap75", "ar", "recall_at_1_percent_ghosts"] {
        let value = perfect["boxes"][key].as_f64().unwrap();
        assert!((value - 1.0).abs() < 1e-12, "{key}: {value}");
    }
    assert_eq!(perfect["boxes"]["n_truth"], visible);

    // The same boxes in the other formats of results.
    let (own, ai) = (place.path().join("own.csv"), place.path().join("ai.csv"));
    let (mut table, mut other) =
        ("frame,x_px,y_px,w_px,h_px,score\n".to_owned(), "fr,X,Y,Z,W,H\n".to_owned());
    for row in rows.iter().filter(|row| &row[10] == "1") {
        let frame: u32 = row[0].parse().unwrap();
        table += &format!("{frame},{},{},{},{},0.5\n", &row[2], &row[3], &row[4], &row[5]);
        other += &format!("{},{},{},0.5,{},{}\n", frame + 1, &row[2], &row[3], &row[4], &row[5]);
    }
    std::fs::write(&own, table).unwrap();
    std::fs::write(&ai, other).unwrap();
    assert_eq!(score(&dataset, &own)["boxes"]["ap50"], score(&dataset, &ai)["boxes"]["ap50"]);
    assert!(score(&dataset, &own)["boxes"]["ap"].as_f64().unwrap() > 1.0 - 1e-12);

    let export = |format: &str| {
        let out = place.path().join(format!("{format}.zip"));
        run(&["export", path(&dataset), "--format", format, "--out", path(&out)]);
        unzip(&out).unwrap()
    };
    let yolo = export("yolo");
    assert_eq!(yolo.len(), 4);
    let lines: usize = yolo.values().map(|text| text.iter().filter(|byte| **byte == b'\n').count()).sum();
    assert_eq!(lines, visible);
    assert!(yolo.contains_key("labels/pair_00000_a.txt"), "{:?}", yolo.keys());
    for (name, bytes) in export("masks") {
        let labels = tiff::read(Cursor::new(bytes), &name, (200, 160)).unwrap();
        let most = labels.into_iter().fold(0.0, f64::max);
        assert!(most > 20.0, "{name}: {most}");
    }
}

#[test]
fn boxes_need_a_truth_with_boxes() {
    let place = tempfile::tempdir().unwrap();
    let dataset = generate(place.path(), "plain", &SPOTS.replace("truth: (boxes: true),", ""));
    let (out, own) = (place.path().join("x.json"), place.path().join("own.csv"));
    let message = fail(2, &["export", path(&dataset), "--format", "coco", "--out", path(&out)]);
    assert!(message.contains("truth/boxes.csv") && message.contains("boxes: true"), "{message}");
    std::fs::write(&own, "frame,x_px,y_px,w_px,h_px\n0,20,30,5,5\n").unwrap();
    let score = score(&dataset, &own);
    assert!(score["boxes"].is_null() && score["warnings"].to_string().contains("truth/boxes.csv"));
    for (text, told) in [
        ("frame,x_px,y_px,w_px,h_px\n0,20,30,-5,5\n", ":2: width = -5"),
        ("frame,x_px,y_px,w_px,h_px\n0,20,30,5,NaN\n", ":2: height = NaN"),
        ("[{\"image_id\": 0, \"bbox\": [1, 2, 3]}]", "found.txt:1: invalid length 3"),
        ("[{\"image_id\": -1, \"bbox\": [1, 2, 3, 4]}]", "result 0: frame"),
        ("[{\"image_id\": 0, \"bbox\": [1, 2, 3, 4]}", "found.txt:1: "),
    ] {
        let file = write(place.path(), "found.txt", text);
        let message = fail(2, &["evaluate", path(&dataset), path(&file)]);
        assert!(message.contains(told), "{text}: {message}");
    }
}
