//! Scores of displacement fields with known errors.

use std::f64::consts::PI;
use std::path::Path;

use scoring::evaluate::field::FieldScore;
use scoring::evaluate::{EvaluateOptions, evaluate_files};
use suite::microsig::{fail, path, run, write};

/// A grid of `n` x `n` vectors with a spacing of 8 px.
fn lattice(n: usize) -> impl Iterator<Item = (f64, f64)> {
    (0..n * n).map(move |k| (8.0 * (k % n) as f64 + 5.0, 8.0 * (k / n) as f64 + 5.0))
}

const HEADER: &str = "x_px,y_px,dx_px,dy_px,flag\n";

fn table(n: usize, field: impl Fn(f64, f64) -> [f64; 2]) -> String {
    let row = |(x, y): (f64, f64)| {
        let [u, v] = field(x, y);
        format!("{x},{y},{u},{v},0\n")
    };
    HEADER.to_owned() + &lattice(n).map(row).collect::<String>()
}

fn score(truth: &str, result: &str) -> (FieldScore, Vec<String>) {
    let place = tempfile::tempdir().unwrap();
    let (truth, result) =
        (write(place.path(), "truth.csv", truth), write(place.path(), "result.csv", result));
    let score = evaluate_files(&truth, &result, &EvaluateOptions::default()).unwrap().score;
    let caveats = score.caveats().map(str::to_owned).collect();
    (score.field.unwrap(), caveats)
}

/// Rounding of sums of a few hundred products of numbers below 100.
const ROUNDING: f64 = 1e-10;

#[test]
fn errors_of_gradients_are_those_of_linear_fields() {
    // u = 0.02 x - 0.03 y, v = 0.05 x + 0.01 y; the result has an additional vorticity of 0.01 and divergence
    // of 0.004.
    let exact = |x: f64, y: f64| [0.02 * x - 0.03 * y, 0.05 * x + 0.01 * y];
    let found = |x: f64, y: f64| {
        let [u, v] = exact(x, y);
        [u + 0.002 * x - 0.005 * y, v + 0.005 * x + 0.002 * y]
    };
    let (score, warnings) = score(&table(12, exact), &table(12, found));
    let g = score.main.gradients.unwrap();
    assert_eq!((g.n, warnings), (100, vec![]));
    for (what, ours, expected) in [
        ("vorticity", g.vorticity_rms, 0.01),
        ("true vorticity", g.true_vorticity_rms, 0.08),
        ("divergence", g.divergence_rms, 0.004),
        ("true divergence", g.true_divergence_rms, 0.03),
        // The added rotation has no strain: e11 = e22 = 0.002.
        ("strain", g.strain_rms, 0.002 * 2f64.sqrt()),
        (
            "true strain",
            g.true_strain_rms,
            (0.02f64.powi(2) + 0.01f64.powi(2) + 2.0 * 0.01f64.powi(2)).sqrt(),
        ),
    ] {
        assert!((ours.unwrap() - expected).abs() < ROUNDING, "{what}: {ours:?}, expected {expected}");
    }
}

#[test]
fn the_response_to_a_wave_is_what_is_left_of_its_amplitude() {
    let n = 64;
    let length = 8.0 * n as f64;
    // Waves of 2, 5, 10, 20 periods; a filter attenuates each by 1 / (1 + (k / 10)^2).
    let periods = [2.0, 5.0, 10.0, 20.0];
    let left = |k: f64| 1.0 / (1.0 + (k / 10.0).powi(2));
    let wave = |share: &dyn Fn(f64) -> f64, x: f64| -> f64 {
        periods.iter().map(|&k| 1.5 * share(k) * (2.0 * PI * k * x / length + k).sin()).sum()
    };
    let exact = |x: f64, _: f64| [wave(&|_| 1.0, x), 0.0];
    let found = |x: f64, _: f64| [wave(&left, x), 0.0];
    let (score, _) = score(&table(n, exact), &table(n, found));
    let spectra = &score.main.spectra;
    assert_eq!(spectra.len(), 4);
    let u = spectra.iter().find(|s| s.component == "u" && s.along == "x").unwrap();
    assert_eq!((u.lines, u.waves.len()), (n, n / 2));
    for k in periods {
        let wave = &u.waves[k as usize - 1];
        assert!((wave.wavelength_px - length / k).abs() < ROUNDING);
        // A Hann window spreads a wave over its two neighboring bins only, which contain none of the others
        // here.
        assert!((wave.response.unwrap() - left(k)).abs() < 1e-9, "{k}: {wave:?}");
        assert!((wave.found_power_px3 / wave.true_power_px3 - left(k).powi(2)).abs() < 1e-9);
    }
    // Parseval: power densities integrate to the variance, 4 waves of 1.5^2 / 2, if the window weights all
    // phases equally.
    let variance: f64 = u.waves.iter().map(|w| w.true_power_px3 / length).sum();
    assert!((variance / (4.0 * 1.125) - 1.0).abs() < 0.02, "{variance}");
    // 0.8 is crossed between 2 and 5 periods + window (0.96, 0.8), 0.5 at 10 periods.
    assert!(u.wavelength_50_px.is_some_and(|w| (w / (length / 10.0) - 1.0).abs() < 0.1), "{u:?}");
    // There is no variation along y, hence no response.
    let v = spectra.iter().find(|s| s.component == "u" && s.along == "y").unwrap();
    assert!(v.waves.iter().all(|w| w.response.is_none()) && v.wavelength_50_px.is_none());
}

/// A dataset with the truth of two pairs on two planes, three kinds of truth and a mask.
fn dataset(folder: &Path) {
    let mut text =
        "pair,plane,x_px,y_px,z_um,forward_dx_px,forward_dy_px,forward_dz_um,central_dx_px,central_dy_px,\
                    central_dz_um,weighted_dx_px,weighted_dy_px,weighted_dz_um,mask\n"
            .to_owned();
    for pair in 0..2 {
        for (plane, z) in [(0, -10.0), (1, 1.0)] {
            for (x, y) in lattice(6) {
                let u = f64::from(pair + 1) * (1.0 + z / 100.0);
                let mask = u8::from(x < 6.0);
                text += &format!(
                    "{pair},{plane},{x},{y},{z},{},0.5,0,{u},0.5,0,{},0.5,0,{mask}\n",
                    u + 0.1,
                    0.8 * u
                );
            }
        }
    }
    std::fs::create_dir_all(folder.join("truth")).unwrap();
    std::fs::write(folder.join("truth/field.csv"), text).unwrap();
    std::fs::write(folder.join("datapackage.json"), r#"{"name":"hand-made","microsig":{}}"#).unwrap();
}

#[test]
fn a_dataset_s_field_is_scored_pair_by_pair_against_every_truth() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("dataset");
    dataset(&folder);
    let mut text = "pair,x_px,y_px,dx_px,dy_px,flag\n".to_owned();
    for pair in 0..2 {
        for (x, y) in lattice(6) {
            text += &format!("{pair},{x},{y},{},0.5,0\n", 1.01 * f64::from(pair + 1) + 0.02);
        }
    }
    let result = write(place.path(), "result.csv", text);
    let score = evaluate_files(&folder, &result, &EvaluateOptions::default()).unwrap().score;
    let f = score.field.unwrap();
    // One of six columns is masked, so its vectors have no truth.
    assert_eq!((f.n_total, f.n_reported, f.n_outside, f.against.as_str()), (72, 72, 12, "central"));
    let bias = |kind: &str| f.truths[kind].u.bias_px.unwrap();
    // On the plane nearest to focus u = 1.01 and 2.02 px; the errors are 0.02, 0.02 - 0.1 and 0.02 + 0.2 u.
    assert!((bias("central") - 0.02).abs() < ROUNDING);
    assert!((bias("forward") + 0.08).abs() < ROUNDING);
    assert!((bias("weighted") - (0.02 + 0.2 * 1.515)).abs() < ROUNDING);
    let repeated = f.main.repeated.unwrap();
    assert_eq!((repeated.n_places, repeated.mean_repeats), (30, 2.0));
    assert!((repeated.mean_abs_bias_u_px - 0.02).abs() < ROUNDING && repeated.mean_random_u_px < ROUNDING);

    // The plane is the requested one, or else the one nearest to best focus if the manifest has it.
    assert_eq!(f.plane_um, Some(1.0));
    let plane = |asked: Option<f64>| {
        let options = EvaluateOptions { plane_um: asked, ..EvaluateOptions::default() };
        evaluate_files(&folder, &result, &options).unwrap().score.field.unwrap().plane_um
    };
    let manifest = r#"{"name":"hand-made","microsig":{"particle_image":{"focus_um":-12.0}}}"#;
    std::fs::write(folder.join("datapackage.json"), manifest).unwrap();
    assert_eq!((plane(None), plane(Some(0.0)), plane(Some(-4.6))), (Some(-10.0), Some(1.0), Some(-10.0)));

    // Without pair numbers the truth is ambiguous.
    std::fs::write(&result, table(6, |_, _| [1.0, 0.5])).unwrap();
    let warnings = evaluate_files(&folder, &result, &EvaluateOptions::default()).unwrap().score.warnings;
    assert!(warnings.iter().any(|w| w.contains("image pair")), "{warnings:?}");
}

/// Replaces the manifest of [`dataset`].
fn tell(folder: &Path, facts: &str) {
    let manifest = format!(r#"{{"name":"hand-made","microsig":{facts}}}"#);
    std::fs::write(folder.join("datapackage.json"), manifest).unwrap();
}

#[test]
fn a_plane_without_fluid_is_not_taken_unless_it_is_asked_for() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("dataset");
    dataset(&folder);
    let field = folder.join("truth/field.csv");
    let masked = |depths: &[&str]| {
        let text = std::fs::read_to_string(&field).unwrap();
        let row = |line: &str| match depths.contains(&line.split(',').nth(4).unwrap()) {
            true => format!("{}1\n", &line[..line.len() - 1]),
            false => format!("{line}\n"),
        };
        std::fs::write(&field, text.lines().map(row).collect::<String>()).unwrap();
    };
    masked(&["-10"]);
    tell(&folder, r#"{"particle_image":{"focus_um":-12.0}}"#);
    let result = write(place.path(), "result.csv", table(6, |_, _| [1.0, 0.5]));
    let of = |plane_um: Option<f64>| {
        evaluate_files(&folder, &result, &EvaluateOptions { plane_um, ..EvaluateOptions::default() })
    };
    assert_eq!(of(None).unwrap().score.field.unwrap().plane_um, Some(1.0));
    let message = of(Some(-9.0)).unwrap_err().to_string();
    assert!(message.contains("z = -10 um is masked everywhere; there is fluid at z = 1 um"), "{message}");
    let out = place.path().join("field.txt");
    let export = ["export", path(&folder), "--format", "openpiv", "--pair", "0", "--out", path(&out)];
    assert!(run(&export).contains("30 "), "30 of 36 nodes are not masked");
    // It marks the masked vectors as invalid, which does not matter: they have no truth.
    let text = std::fs::read_to_string(&field).unwrap();
    let first = text.lines().filter(|l| !l.starts_with("1,")).map(|l| format!("{l}\n"));
    std::fs::write(&field, first.collect::<String>()).unwrap();
    let score = evaluate_files(&folder, &out, &EvaluateOptions::default()).unwrap().score.field.unwrap();
    assert_eq!((score.n_total, score.n_reported), (36, 30));
    assert_eq!((score.main.valid_vector_probability, score.main.aee_px), (Some(1.0), Some(0.0)));
    masked(&["1"]);
    assert!(of(None).unwrap_err().to_string().contains("no plane has a node that is not masked"));
    assert!(fail(2, &[&export[..], &["--force"]].concat()).contains("no plane has a node"));
}

#[test]
fn where_all_depths_are_seen_alike_their_mean_is_the_truth() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("dataset");
    dataset(&folder);
    tell(&folder, r#"{"depth_range_um":[-5,1],"particle_image":{"focus_um":null}}"#);
    let result = write(place.path(), "result.csv", "pair,x_px,y_px,dx_px,dy_px\n0,13,13,1,0.5\n");
    let scored = |plane_um: Option<f64>| {
        let score =
            evaluate_files(&folder, &result, &EvaluateOptions { plane_um, ..EvaluateOptions::default() })
                .unwrap()
                .score;
        let field = score.field.unwrap();
        (
            field.against,
            field.plane_um.unwrap(),
            score.assumptions.iter().any(|a| a.contains("equally sharp")),
        )
    };
    // The center of the depth range is nearer to the plane at 1 um.
    assert_eq!(scored(None), ("weighted".to_owned(), 1.0, true));
    assert_eq!(scored(Some(-8.0)), ("central".to_owned(), -10.0, false));
}

#[test]
fn image_pairs_that_are_not_there_are_told() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("dataset");
    dataset(&folder);
    // A steady field is the truth of all existing pairs.
    let field = folder.join("truth/field.csv");
    let text = std::fs::read_to_string(&field).unwrap();
    let steady = text.lines().filter(|l| !l.starts_with("1,")).map(|l| match l.strip_prefix("0,") {
        Some(rest) => format!(",{rest}\n"),
        None => format!("{l}\n"),
    });
    std::fs::write(&field, steady.collect::<String>()).unwrap();
    let rows = "pair,x_px,y_px,dx_px,dy_px\n1,13,13,1,0.5\n2,13,13,1,0.5\n99,13,13,1,0.5\n";
    let result = write(place.path(), "result.csv", rows);
    for (timing, lost, named) in [
        (r#"{"mode":"pairs","pairs":2}"#, 2, "(2, 99)"),
        (r#"{"mode":"sequence","frames":4}"#, 1, "(99)"),
        (r#"{"mode":"four_pulse","frames":8}"#, 1, "(99)"),
    ] {
        tell(&folder, &format!(r#"{{"timing":{timing}}}"#));
        let score = evaluate_files(&folder, &result, &EvaluateOptions::default()).unwrap().score;
        assert_eq!(score.field.unwrap().n_outside, lost, "{timing}");
        let expected = format!("{lost} vectors belong to image pairs that the dataset does not have {named}");
        assert!(score.warnings.contains(&expected), "{timing}: {:?}", score.warnings);
        let message = fail(2, &["evaluate", path(&folder), path(&result), "--validate-only"]);
        assert!(message.contains("result.csv:4: pair = 99: the dataset has no such"), "{message}");
        let out = place.path().join("out.flo");
        let export = ["export", path(&folder), "--format", "openpiv", "--out", path(&out), "--pair"];
        assert!(fail(2, &[&export[..], &["99"]].concat()).contains("no pair 99"));
    }
}
