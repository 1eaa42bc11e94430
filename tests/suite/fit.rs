//! `microsig fit`: the settings of a microscope from its calibration scan, and inputs that it refuses.

use std::path::Path;

use microsig_core::emission::SpheroidLaw;
use microsig_core::render::expected::{DEFAULT_TOLERANCE, ExpectedRenderer};
use microsig_core::{Particle, Settings};
use serde_json::Value;
use suite::microsig::{fail, path, run};
use suite::scan::{Bead, SimulatedScan, write_pages};

/// Arguments that every fit needs, with the scan and the output folder.
fn arguments<'a>(scan: &'a Path, out: &'a Path) -> Vec<&'a str> {
    vec!["fit", path(scan), "--magnification", "10", "--pixel-size", "6.45", "--out", path(out)]
}

/// A message about a scan of these pages that is refused.
fn refused(pages: &[Vec<u16>], size: (u32, u32), more: &[&str]) -> String {
    let place = tempfile::tempdir().unwrap();
    let (scan, out) = (place.path().join("scan.tif"), place.path().join("out"));
    write_pages(&scan, size, pages).unwrap();
    let message = fail(2, &[&arguments(&scan, &out)[..], more].concat());
    assert!(!out.exists(), "nothing is written");
    message
}

/// A small scan with one particle in the middle of 61 x 61 px.
fn single(n: usize) -> SimulatedScan {
    let four = SimulatedScan::tenfold(n, 6.0);
    SimulatedScan {
        settings: Settings { pixel_dim_x: 61, pixel_dim_y: 61, ..four.settings.clone() },
        beads: vec![Bead { x_px: 30.6, y_px: 31.2, z_um: -12.0, c_int: 1.0 }],
        ..four
    }
}

#[test]
fn scans_that_cannot_be_fitted_are_refused_with_advice() {
    let step = ["--z-step", "5"];
    let scan = single(9);
    let pages = scan.planes(1).unwrap();
    let size = (61, 61);
    let few = refused(&pages[..6], size, &step);
    assert!(few.contains("6 planes; expected at least 7"), "{few}");

    let dark = SimulatedScan { beads: Vec::new(), ..single(9) }.planes(1).unwrap();
    let empty = refused(&dark, size, &step);
    assert!(empty.contains("no particle found") && empty.contains("the threshold is"), "{empty}");

    let full: Vec<Vec<u16>> =
        pages.iter().map(|page| page.iter().map(|&v| if v > 500 { u16::MAX } else { v }).collect()).collect();
    let full = refused(&full, size, &step);
    assert!(full.contains("saturated") && full.contains("exposure"), "{full}");

    let cut = refused(&pages, size, &["--z-step", "5", "--window", "91"]);
    assert!(cut.contains("cut by the edge") && cut.contains("--planes"), "{cut}");

    let unknown = refused(&pages, size, &[]);
    assert!(unknown.contains("give --z or --z-step"), "{unknown}");

    let range = refused(&pages, size, &["--z-step", "5", "--planes", "3-5"]);
    assert!(range.contains("at least 7 planes within 0-8"), "{range}");
}

#[test]
fn a_truncated_scan_is_told() {
    let place = tempfile::tempdir().unwrap();
    let (scan, out) = (place.path().join("scan.tif"), place.path().join("out"));
    write_pages(&scan, (61, 61), &single(9).planes(1).unwrap()).unwrap();
    let bytes = std::fs::read(&scan).unwrap();
    // Its last page lies at the end of the file.
    std::fs::write(&scan, &bytes[..bytes.len() - 2000]).unwrap();
    let message = fail(2, &[&arguments(&scan, &out)[..], &["--z-step", "6"]].concat());
    assert!(message.contains("scan.tif: page 8: it ends before its data do; is it truncated?"), "{message}");
    assert!(!out.exists());
}

#[test]
fn missing_or_impossible_options_are_refused() {
    let place = tempfile::tempdir().unwrap();
    let (scan, out) = (place.path().join("scan.tif"), place.path().join("out"));
    write_pages(&scan, (61, 61), &single(9).planes(1).unwrap()).unwrap();
    let (scan, out) = (path(&scan), path(&out));
    let without = fail(2, &["fit", scan, "--pixel-size", "6.45", "--z-step", "5", "--out", out]);
    assert!(without.contains("--magnification"), "{without}");
    let without = fail(2, &["fit", scan, "--magnification", "10", "--z-step", "5", "--out", out]);
    assert!(without.contains("--pixel-size"), "{without}");
    let base = ["fit", scan, "--magnification", "10", "--pixel-size", "6.45", "--z-step", "5", "--out", out];
    for (more, expected) in [
        (&["--depth-factor", "0"][..], "--depth-factor 0: expected 0.01 to 10"),
        (&["--diameter", "0"], "--diameter 0: expected 0.001 to 100 um"),
        (&["--model", "waves"], "--wavelength"),
        (&["--wavelength", "0.5"], "--wavelength: expected with --model waves only"),
        (&["--model", "waves", "--wavelength", "50"], "--wavelength 50: expected 0.1 to 2"),
        (&["--planes", "x"], "expected A-B"),
        (&["--field"], "--field: expected with --model waves"),
    ] {
        let message = fail(2, &[&base[..], more].concat());
        assert!(message.contains(expected), "{more:?}: {message}");
    }
    let waves = ["--model", "waves", "--wavelength", "0.5"];
    for (more, expected) in [
        (["--depth-factor", "1.3"], "--depth-factor 1.3 with --model waves: expected 1"),
        (["--free", "pixel-size"], "--free: expected with --model geometric only"),
        (["--bootstrap", "9"], "--bootstrap: expected with --model geometric only"),
        (["--astigmatic", "yes"], "--astigmatic: expected with --model geometric only"),
        (["--flux", "model"], "--flux: expected with --model geometric only"),
    ] {
        let message = fail(2, &[&base[..], &waves, &more].concat());
        assert!(message.contains(expected), "{more:?}: {message}");
    }
    assert!(!Path::new(out).exists());
}

#[test]
fn any_number_of_threads_gives_the_same_settings() {
    let place = tempfile::tempdir().unwrap();
    let truth = single(9);
    truth.write(place.path(), 7).unwrap();
    let (scan, z) = (place.path().join("scan.tif"), place.path().join("z.csv"));
    let fit = |threads: &str| {
        let out = place.path().join(threads);
        let more = ["--z", path(&z), "--diameter", "2", "--z-direction", "away", "--threads", threads];
        run(&[&arguments(&scan, &out)[..], &more].concat());
        ["fit.json", "settings.txt", "scenario.ron", "model.tif"]
            .map(|name| std::fs::read(out.join(name)).unwrap())
    };
    let [one, two] = ["1", "2"].map(fit);
    assert!(one == two);
    let fitted: serde_json::Value = serde_json::from_slice(&one[0]).unwrap();
    let na = fitted["parameters"][0]["value"].as_f64().unwrap();
    // One particle in 9 planes: three times the bar for scans of several particles in 20 planes and more.
    assert!((na / 0.3 - 1.0).abs() < 0.015, "{na}");
    let report = std::fs::read_to_string(place.path().join("1/report.html")).unwrap();
    for part in ["Data, model and residual", "Correlations", "What to do next", "data:image/png;base64"] {
        assert!(report.contains(part), "{part}");
    }
}

/// The result of a fit of a scan's pages, with the scan's own stage positions.
fn fitted(truth: &SimulatedScan, pages: &[Vec<u16>]) -> (tempfile::TempDir, Value) {
    let place = tempfile::tempdir().unwrap();
    truth.write(place.path(), 1).unwrap();
    let settings = &truth.settings;
    let scan = place.path().join("scan.tif");
    write_pages(&scan, (settings.pixel_dim_x, settings.pixel_dim_y), pages).unwrap();
    let (z, out) = (place.path().join("z.csv"), place.path().join("out"));
    let more = ["--z", path(&z), "--quiet"];
    run(&[&arguments(&scan, &out)[..], &more].concat());
    let fit = serde_json::from_slice(&std::fs::read(out.join("fit.json")).unwrap()).unwrap();
    (place, fit)
}

/// Value and standard deviation of a parameter.
fn parameter(fit: &Value, name: &str) -> [f64; 2] {
    let all = fit["parameters"].as_array().unwrap();
    let own = all.iter().find(|parameter| parameter["name"] == name).unwrap();
    ["value", "sd"].map(|key| own[key].as_f64().unwrap())
}

/// Asserts that the settings found, in a folder and its fit.json, match a scan within relative errors.
/// Returns those written.
fn assert_found(place: &Path, fit: &Value, truth: &SimulatedScan) -> Settings {
    let settings = &truth.settings;
    let written = suite::settings(&place.join("out/settings.txt")).unwrap();
    assert!((written.gain / settings.gain - 1.0).abs() < 0.1, "{} for {}", written.gain, settings.gain);
    let mut expected = vec![
        ("numerical_aperture", settings.numerical_aperture, 0.005),
        ("focal_length", settings.focal_length, 0.015),
        ("particle_diameter_um", truth.diameter_um, 0.02),
    ];
    if settings.cyl_focal_length != 0.0 {
        expected.push(("cyl_focal_length", settings.cyl_focal_length, 0.015));
    }
    for (name, truth, error) in expected {
        let [value, sd] = parameter(fit, name);
        assert!((value / truth - 1.0).abs() < error, "{name}: {value} +- {sd} for {truth}");
    }
    assert_eq!(fit["direction"], truth.direction, "{fit}");
    let chi2 = fit["chi2"].as_f64().unwrap();
    assert!((0.85..1.15).contains(&chi2), "{chi2}");
    let mut found: Vec<[f64; 3]> = fit["particles"]
        .as_array()
        .unwrap()
        .iter()
        .map(|p| ["x_px", "y_px", "z_um"].map(|key| p[key].as_f64().unwrap()))
        .collect();
    found.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut beads: Vec<&Bead> = truth.beads.iter().collect();
    beads.sort_by(|a, b| a.x_px.total_cmp(&b.x_px));
    assert_eq!(found.len(), beads.len());
    for (found, bead) in found.iter().zip(beads) {
        let off = [found[0] - bead.x_px, found[1] - bead.y_px, found[2] - bead.z_um].map(f64::abs);
        assert!(off[0] < 0.02 && off[1] < 0.02 && off[2] < 0.2, "{found:?} for {bead:?}");
    }
    written
}

/// The direction of the stage is reversed. A second scan rendered with the settings found differs from the
/// data by noise only.
#[test]
fn settings_of_a_spherical_scan_are_found() {
    let four = SimulatedScan::tenfold(16, 6.0);
    let truth = SimulatedScan { direction: -1.0, beads: four.beads[..2].to_vec(), ..four };
    let pages = truth.planes(3).unwrap();
    let (place, fit) = fitted(&truth, &pages);
    let settings = assert_found(place.path(), &fit, &truth);
    let expected = ExpectedRenderer::new(&settings, SpheroidLaw::Original, DEFAULT_TOLERANCE).unwrap();
    let second = truth.planes(4).unwrap();
    let per_count = fit["variance_per_count"].as_f64().unwrap();
    let (mut chi2, mut n) = (0.0, 0.0);
    for (i, page) in second.iter().enumerate() {
        let particles: Vec<Particle> = truth.particles(i);
        let counts = expected.draw(&particles).values;
        for (count, light) in page.iter().zip(&counts) {
            let mean = settings.gain * *light;
            let variance = settings.background_noise.powi(2) + per_count * mean;
            let r = f64::from(*count) - settings.background_mean - mean;
            chi2 += r * r / variance;
            n += 1.0;
        }
    }
    assert!(chi2 / n < 1.15, "{} per pixel", chi2 / n);
}

/// A cylindrical lens and its axis are found without being told.
#[test]
#[ignore = "slow: .ci/full"]
fn settings_of_an_astigmatic_scan_are_found() {
    let four = SimulatedScan::tenfold(17, 6.0);
    let settings = Settings {
        numerical_aperture: 0.27,
        focal_length: 310.0,
        cyl_focal_length: -3300.0,
        ..four.settings.clone()
    };
    let bead = |bead: &Bead| Bead { z_um: bead.z_um - 5.0, ..*bead };
    let truth = SimulatedScan { settings, beads: four.beads[..2].iter().map(bead).collect(), ..four };
    let pages = truth.planes(5).unwrap();
    let (place, fit) = fitted(&truth, &pages);
    assert_found(place.path(), &fit, &truth);
}
