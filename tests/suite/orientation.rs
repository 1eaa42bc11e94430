//! Scores of the orientation of spheroids.

use std::path::Path;

use serde_json::Value;
use suite::microsig::{path, run};

const SCENARIO: &str = r#"(
    name: "rods",
    seed: 5,
    optics: (pixel_dim_x: 160, pixel_dim_y: 120, points_per_pixel: 4),
    motion: flow(field: shear(rate_per_s: 20, along: x, across: y, center_um: (0, 0, -30))),
    particles: (number: count(8), diameter_um: constant(4), spheroids: (e_p: 3, orientation: random)),
    boundaries: (z_um: (-60, 10)),
    timing: sequence(frames: 6, dt_s: 0.003),
    calibration: none,
)"#;

/// The orientation scores of the truth after `change` of its header and rows.
fn scored(dataset: &Path, change: impl Fn(usize, &csv::StringRecord) -> Vec<String>) -> Value {
    let place = tempfile::tempdir().unwrap();
    let result = place.path().join("result.csv");
    let mut reader =
        csv::ReaderBuilder::new().has_headers(false).from_path(dataset.join("truth/tracks.csv")).unwrap();
    let mut writer = csv::Writer::from_path(&result).unwrap();
    for (i, row) in reader.records().enumerate() {
        writer.write_record(change(i, &row.unwrap())).unwrap();
    }
    writer.flush().unwrap();
    let score = run(&["evaluate", path(dataset), path(&result), "--json", "--quiet"]);
    serde_json::from_str::<Value>(&score).unwrap()["orientation"].clone()
}

#[test]
fn the_truth_has_no_error_of_orientation_and_missed_rods_count_as_90_degrees() {
    let place = tempfile::tempdir().unwrap();
    let (file, dataset) = (place.path().join("rods.ron"), place.path().join("rods"));
    std::fs::write(&file, SCENARIO).unwrap();
    run(&["generate", path(&file), "--out", path(&dataset), "--quiet"]);
    let number = |value: &Value| value.as_f64().unwrap();

    // The angles of MicroSIG's data file.
    let exact = scored(&dataset, |_, row| row.iter().map(str::to_owned).collect());
    assert_eq!(exact["n"], exact["n_true"]);
    assert!(number(&exact["n_true"]) > 20.0 && number(&exact["mean_all_deg"]) < 1e-9, "{exact}");

    // The axis as a vector of any length and sign, turned by 10 degrees about the optical axis.
    let (sin, cos) = 10f64.to_radians().sin_cos();
    let turned = |i: usize, row: &csv::StringRecord| {
        let column = |name: &str| suite_column(&dataset, name);
        let mut kept: Vec<String> = row.iter().take(6).map(str::to_owned).collect();
        if i == 0 {
            kept.extend(["axis_x", "axis_y", "axis_z"].map(str::to_owned));
            return kept;
        }
        let angle = |name: &str| row[column(name)].parse::<f64>().unwrap();
        let (alpha_rad, beta_rad) = (angle("alpha_rad"), angle("beta_rad"));
        let [x, y, z] = microsig_core::Spheroid { e_p: 3.0, alpha_rad, beta_rad }.axis();
        kept.extend(
            [-2.0 * (cos * x - sin * y), -2.0 * (sin * x + cos * y), -2.0 * z].map(|v| v.to_string()),
        );
        kept
    };
    let found = scored(&dataset, turned);
    // An axis with polar angle t turns by 2 asin(sin(5 degrees) sin t): at most 10 degrees.
    let mean = number(&found["mean_deg"]);
    assert!(mean > 4.0 && mean < 10.0, "{found}");
    let [low, high] = [0, 1].map(|i| number(&found["interval_mean_deg"][i]));
    assert!(low <= mean && mean <= high, "{found}");

    // Half of the rods missed: those and the ghosts in their place count as 90 degrees.
    let half = scored(&dataset, |i, row| {
        let all: Vec<String> = row.iter().map(str::to_owned).collect();
        if i % 2 == 0 {
            all
        } else {
            all.iter().enumerate().map(|(k, v)| if k == 3 { "-500".into() } else { v.clone() }).collect()
        }
    });
    let share = 1.0 - number(&half["n"]) / number(&half["n_true"]);
    assert!(share > 0.2, "{half}");
    let unfound = 90.0 * 2.0 * share / (1.0 + share);
    // Rows of rods that are not scored are ghosts too in the wrong place.
    assert!((unfound - 1e-6..90.0).contains(&number(&half["mean_all_deg"])), "{half}");

    // Without an axis each is a guess: of random orientations in few rods the best is somewhat below 1 rad.
    let without = scored(&dataset, |_, row| row.iter().take(6).map(str::to_owned).collect());
    let guess = number(&without["guess_deg"]);
    assert!(without["mean_deg"].is_null() && without["n"] == 0, "{without}");
    assert!(
        (number(&without["mean_all_deg"]) - guess).abs() < 1e-9 && guess > 20.0 && guess < 57.3,
        "{without}"
    );
}

/// Number of a column of the truth.
fn suite_column(dataset: &Path, name: &str) -> usize {
    let mut reader = csv::Reader::from_path(dataset.join("truth/tracks.csv")).unwrap();
    reader.headers().unwrap().iter().position(|header| header == name).unwrap()
}
