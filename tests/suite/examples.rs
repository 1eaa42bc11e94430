//! The programs of `examples/` run and give what they promise.

use std::path::Path;
use std::process::Command;

use suite::microsig::generate;
use tempfile::tempdir;

/// What a program prints; it runs in this folder.
fn output(name: &str, folder: &Path) -> String {
    let mut program = Command::new(env!("CARGO_BIN_EXE_examples-tested"));
    let output = program.arg(name).current_dir(folder).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn numbers(line: &str) -> Vec<f64> {
    let ends = |c: char| c.is_whitespace() || ",:".contains(c);
    line.split(ends).filter_map(|word| word.parse().ok()).collect()
}

#[test]
fn a_first_recording_has_the_images_of_the_same_scenario() {
    let place = tempdir().unwrap();
    let shown = output("first_recording", place.path());
    let scenario = r#"(
        name: "same", seed: 1, calibration: none, truth_grid: none,
        optics: (preset: setting1, pixel_dim_x: 512, pixel_dim_y: 512), render: (mode: expected),
        motion: flow(field: lamb_oseen(max_speed_um_s: 800)),
        particles: (number: count(500), diameter_um: constant(2)),
        timing: pairs(count: 1, dt_s: 0.005),
    )"#;
    let dataset = generate(place.path(), "same", scenario);
    for (own, name) in [("frame_0.tif", "pair_00000_a"), ("frame_1.tif", "pair_00000_b")] {
        let image = std::fs::read(dataset.join(format!("images/{name}.tif"))).unwrap();
        assert!(std::fs::read(place.path().join(own)).unwrap() == image, "{own}");
    }
    let rows = std::fs::read_to_string(dataset.join("particles/pair_00000_a.txt")).unwrap();
    let first = rows.lines().map(numbers).find(|row| row.len() >= 4).unwrap();
    let line = shown.lines().find(|line| line.trim_start().starts_with("x = ")).unwrap();
    let particle = numbers(line);
    assert!(particle.iter().zip(&first).all(|(own, row)| (own - row).abs() < 0.006), "{line}: {first:?}");
    assert_eq!(particle.len(), 3);
}

#[test]
fn a_piv_pair_correlates_at_its_true_displacement() {
    let shown = output("piv_pair", tempdir().unwrap().path());
    let found: Vec<_> = shown.lines().map(numbers).collect();
    assert_eq!(found, [[5.0, -3.0], [5.0, -3.0]], "{shown}");
}

#[test]
fn an_astigmatic_scan_has_two_focal_planes() {
    let shown = output("astigmatic_scan", tempdir().unwrap().path());
    let rows: Vec<_> = shown.lines().skip(1).map(numbers).collect();
    let narrowest = |axis: usize| rows.iter().min_by(|a, b| a[axis].total_cmp(&b[axis])).unwrap()[0];
    assert_eq!(rows.len(), 11, "{shown}");
    assert!((narrowest(1) - narrowest(2)).abs() >= 20.0, "{shown}");
}

#[test]
fn particles_follow_a_field_of_ones_own() {
    let shown = output("own_field", tempdir().unwrap().path());
    let moved: Vec<_> = shown.lines().filter(|line| line.contains("track")).map(numbers).collect();
    assert_eq!(moved.len(), 8, "{shown}");
    for row in moved {
        let [_, y_px, dx_px] = row[..] else { panic!("{row:?}") };
        // 128 px of 0.645 um, 5 ms; y is printed to 0.1 px.
        let expected = |y_px: f64| 600.0 * ((y_px - 64.5) * 0.645 / 10.0).tanh() * 0.005 / 0.645;
        let (low, high) = (expected(y_px - 0.06), expected(y_px + 0.06));
        assert!(dx_px > low - 1e-3 && dx_px < high + 1e-3, "{shown}");
    }
}

#[test]
fn a_tracker_is_scored_without_files() {
    let place = tempdir().unwrap();
    let shown = output("tracker_in_memory", place.path());
    let found: Vec<_> = shown.lines().map(numbers).collect();
    let [matched, particles, ghosts] = found[0][..] else { panic!("{shown}") };
    assert!(particles > 200.0 && matched > 0.5 * particles && ghosts < 0.2 * matched, "{shown}");
    assert!(found[1][0] < 1.0, "{shown}");
    assert_eq!(std::fs::read_dir(place.path()).unwrap().count(), 0);
}
