//! Images of unrounded counts: `image_format: float32`.

use std::path::{Path, PathBuf};

use microsig_core::formats::tiff;
use microsig_core::render::Context;
use microsig_core::sensor::Counts;
use suite::microsig::{fail, generate, json, manifest, path, run};
use suite::{counts, image_size};

const SIDE: u32 = 401;
const BACKGROUND: f64 = 100.0;

/// A dataset of one dim particle in the middle, one frame, by waves, with a float image or a whole one.
fn dataset(place: &Path, name: &str, keys: &str) -> PathBuf {
    std::fs::write(place.join("place.txt"), "201 201 -20 2\n").unwrap();
    let text = format!(
        "(name: \"{name}\", optics: (preset: setting1, pixel_dim_x: {SIDE}, pixel_dim_y: {SIDE}, gain: 0.05, \
         background_mean: {BACKGROUND}, background_noise: 0), motion: flow(field: uniform(velocity_um_s: (0, 0, 0))), \
         particles: (number: file(\"place.txt\")), boundaries: (z_um: (-30, 10)), timing: sequence(frames: 1, dt_s: 1), \
         calibration: none, render: (mode: waves, wavelength_um: 0.52, tolerance: 0.0003){keys})"
    );
    generate(place, name, &text)
}

fn image(dataset: &Path) -> Vec<f64> {
    counts(&dataset.join("images/frame_00000.tif")).unwrap()
}

fn light(counts: &[f64]) -> f64 {
    counts.iter().map(|count| count - BACKGROUND).sum()
}

#[test]
fn unrounded_counts_hold_the_light_that_rounding_loses() {
    let place = tempfile::tempdir().unwrap();
    let whole = dataset(place.path(), "whole", "");
    let float = dataset(place.path(), "float", ", image_format: float32");
    let (rounded, unrounded) = (image(&whole), image(&float));
    for (rounded, unrounded) in rounded.iter().zip(&unrounded) {
        assert_eq!(*rounded, unrounded.round());
    }
    assert!(unrounded.iter().any(|count| count.fract() != 0.0));
    let lost = 1.0 - light(&rounded) / light(&unrounded);
    println!("{:.2} % of {:.0} counts are lost by rounding", 100.0 * lost, light(&unrounded));
    assert!(lost > 0.01, "{lost}");
    // The light of the renderer itself, but for f32.
    let (scenario, _) = scenario::of_dataset(&float, &Context::default()).unwrap();
    let rows = suite::particles(&float.join("particles/frame_00000.txt")).unwrap();
    let drawn = scenario.renderer.light(&rows, &scenario.streams, microsig_core::stream::Purpose::Rays, 0);
    let total = drawn.values.iter().sum::<f64>() * scenario.settings.gain;
    assert!((light(&unrounded) / total - 1.0).abs() < 1e-4, "{} {total}", light(&unrounded));
}

#[test]
fn a_dataset_of_unrounded_counts_is_read_by_everything() {
    let place = tempfile::tempdir().unwrap();
    let made = dataset(place.path(), "float", ", image_format: float32");
    let sensor = &manifest(&made)["sensor"];
    assert_eq!((&sensor["bit_depth"], &sensor["image_format"]), (&32.into(), &"float32".into()));
    let card = std::fs::read_to_string(made.join("README.md")).unwrap();
    assert!(card.contains("32 bit (floating point: counts before rounding and clamping)"), "{card}");
    run(&["verify", path(&made), "--regenerate"]);
    let result = place.path().join("result.csv");
    run(&["track", path(&made), "--method", "spots", "--out", path(&result)]);
    let score = json(&["evaluate", path(&made), path(&result)]);
    assert_eq!(score["detection"]["recall"], 1.0, "{score}");
    let page = place.path().join("page.html");
    run(&["view", path(&made), "--export", path(&page)]);
    assert!(page.is_file());
}

#[test]
fn images_of_data_files_can_be_unrounded() {
    let place = tempfile::tempdir().unwrap();
    let (settings, data) = (place.path().join("settings.txt"), place.path().join("one.txt"));
    let mut text = Vec::new();
    let of_one = microsig_core::Settings {
        pixel_dim_x: 101,
        pixel_dim_y: 91,
        background_noise: 3.0,
        ..microsig_core::Settings::setting1()
    };
    microsig_core::formats::settings_file::write(&mut text, &of_one).unwrap();
    std::fs::write(&settings, text).unwrap();
    std::fs::write(&data, "50 40 -30 2\n").unwrap();
    let rendered = |out: &str, more: &[&str]| {
        let out = place.path().join(out);
        let mut arguments = vec!["render", path(&settings), path(&data), path(&out), "--mode", "expected"];
        arguments.extend(more);
        run(&arguments);
        let file = std::fs::read(out.join("one.tif")).unwrap();
        assert_eq!(image_size(&out.join("one.tif")).unwrap(), (101, 91));
        tiff::read_counts(std::io::Cursor::new(file), "one", (101, 91)).unwrap()
    };
    let float = ["--image-format", "float32"];
    // MicroSIG's rounded noise is added to unrounded light; with --round-once it is not rounded either.
    for rounding in [&[][..], &["--round-once"]] {
        let whole = rendered("whole", &[rounding, &["--force"]].concat());
        let unrounded = rendered("float", &[rounding, &float, &["--force"]].concat());
        assert!(matches!((&whole, &unrounded), (Counts::Whole(_), Counts::Unrounded(_))));
        for (whole, unrounded) in whole.values().zip(unrounded.values()) {
            // Numbers of f32 near ties may round to the other side.
            assert!((whole - unrounded).abs() < 0.5 + 1e-4, "{whole} {unrounded}");
        }
    }
    let said = fail(2, &["render", path(&settings), path(&data), "images", "--image-format", "float64"]);
    assert!(said.contains("float64") && said.contains("float32"), "{said}");
}
