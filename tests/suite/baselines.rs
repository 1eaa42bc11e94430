//! End-to-end tests of the baseline trackers: a dataset is generated, tracked and scored, and the scores must
//! reach limits.

use std::path::Path;

use serde_json::Value;
use suite::microsig::{fail, generate, json, manifest, path, run, told, write};

/// Defocused particles on 376 x 240 px, mostly isolated.
fn defocused(preset: &str, count: u32, pairs: u32) -> String {
    format!(
        r#"(
            name: "defocused",
            optics: (preset: {preset}, pixel_dim_x: 376, pixel_dim_y: 240),
            motion: flow(field: poiseuille(max_speed_um_s: 1290)),
            particles: (number: count({count})),
            timing: pairs(count: {pairs}, dt_s: 0.002),
        )"#
    )
}

/// In-focus particles displaced by a vortex by up to 3 px.
fn in_focus(ppp: f64) -> String {
    format!(
        r#"(
            name: "in_focus",
            optics: (
                gaussian: (diameter_px: 2.75, reference_um: 1, peak_counts: 1000),
                pixel_dim_x: 160, pixel_dim_y: 160, background_mean: 100, background_noise: 10,
            ),
            motion: flow(field: lamb_oseen(max_speed_um_s: 387, core_radius_um: 20)),
            particles: (number: ppp({ppp}), diameter_um: constant(1)),
            boundaries: (z_um: (-5, 5)),
            timing: pairs(count: 2, dt_s: 0.005),
        )"#
    )
}

/// Tracks the dataset of a folder and returns the score.
fn score(folder: &Path, method: &str) -> Value {
    score_inside(folder, method, 0)
}

/// The same without particles closer than `border` px to the edge.
fn score_inside(folder: &Path, method: &str, border: u32) -> Value {
    let (dataset, result) = (folder.join("dataset"), folder.join(format!("{method}.csv")));
    run(&["track", path(&dataset), "--method", method, "--out", path(&result), "--quiet"]);
    json(&["evaluate", path(&dataset), path(&result), "--border", &border.to_string()])
}

fn number(score: &Value, pointer: &str) -> f64 {
    score.pointer(pointer).and_then(Value::as_f64).unwrap_or_else(|| panic!("{pointer} in {score}"))
}

/// Limits for isolated particles: precision, recall, RMS errors along x and y (px), sigma_z/h.
fn assert_tracks(score: &Value, what: &str, [precision, recall, xy, z]: [f64; 4]) {
    let detection = |key: &str| number(score, &format!("/detection/{key}"));
    let got = ["precision", "recall", "rmse_x_px", "rmse_y_px"].map(detection);
    assert!(got[0] >= precision && got[1] >= recall, "{what}: precision and recall {got:?}");
    assert!(got[2].max(got[3]) <= xy, "{what}: RMS along x and y {got:?}");
    let depth = score.pointer("/gdpt/sigma_z_over_h").and_then(Value::as_f64);
    assert!(depth.is_none_or(|d| d <= z), "{what}: sigma_z/h {depth:?}");
}

#[test]
fn ncc_finds_defocused_particles_and_their_depth() {
    for preset in ["setting1", "setting1a"] {
        let folder = tempfile::tempdir().unwrap();
        generate(folder.path(), "dataset", &defocused(preset, 8, 3));
        let found = score(folder.path(), "ncc");
        assert_tracks(&found, preset, [0.9, 0.9, 0.15, 0.012]);
        assert!(number(&found, "/links/f1") > 0.85, "{preset}: {}", found["links"]);
    }
}

/// Diameters by class and by a fit, which is as precise as the bound allows.
#[test]
fn diameters_of_particles_are_measured() {
    let folder = tempfile::tempdir().unwrap();
    let scenario =
        "(name: \"sizes\", seed: 4, optics: (numerical_aperture: 0.3, pixel_dim_x: 400, pixel_dim_y: 400), motion: flow(field: uniform(velocity_um_s: (0, 0, 0))),
        particles: (number: count(40), diameter_um: list([(2, 1), (3, 1)])), boundaries: (z_um: (-12, 4)),
        timing: sequence(frames: 1, dt_s: 0.01), calibration: every_um(2))";
    generate(folder.path(), "dataset", scenario);
    for method in ["ncc", "mle"] {
        let found = score(folder.path(), method);
        assert!(number(&found, "/size/right") > 0.9, "{method}: {}", found["size"]);
    }
    let (dataset, result) = (folder.path().join("dataset"), folder.path().join("d.csv"));
    run(&["track", path(&dataset), "--method", "mle", "--fit-diameter", "--out", path(&result), "--quiet"]);
    let found = json(&["evaluate", path(&dataset), path(&result), "--crlb"]);
    let bins = found.pointer("/crlb/bins").and_then(Value::as_array).unwrap();
    let squares: Vec<f64> = bins.iter().map(|bin| number(bin, "/crlb_d_um").powi(2)).collect();
    let bound = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    // Of normal errors; a pair of overlapping particles may have a large one.
    let deviation = number(&found, "/size/median_abs_um") / 0.6745;
    assert!((0.7..1.6).contains(&(deviation / bound)), "{deviation} um for {bound} um: {}", found["size"]);
    let covered = number(&found, "/uncertainty/z/coverage_2s");
    assert!(covered > 0.85, "z with diameters: {covered} within 2 U");
}

#[test]
fn mle_is_more_precise_and_gives_the_same_bytes_for_any_number_of_threads() {
    for preset in ["setting1", "setting1a"] {
        let folder = tempfile::tempdir().unwrap();
        generate(folder.path(), "dataset", &defocused(preset, 8, 2));
        assert_tracks(&score(folder.path(), "mle"), preset, [0.9, 0.9, 0.1, 0.006]);
    }
    let folder = tempfile::tempdir().unwrap();
    generate(folder.path(), "dataset", &defocused("setting1", 4, 1));
    let dataset = folder.path().join("dataset");
    for method in ["ncc", "mle"] {
        let results = ["1", "7"].map(|threads| {
            let out = folder.path().join(format!("{method}_{threads}.csv"));
            let run_with = ["--out", path(&out), "--threads", threads, "--json"];
            let said = run(&[&["track", path(&dataset), "--method", method][..], &run_with].concat());
            let said: Value = serde_json::from_str(&said).unwrap();
            let [mean, slowest] =
                ["seconds_per_frame", "slowest_frame_seconds"].map(|key| number(&said, &format!("/{key}")));
            assert!(0.0 < mean && mean <= slowest, "{said}");
            std::fs::read(out).unwrap()
        });
        assert!(results.iter().all(|r| *r == results[0]), "{method}");
    }
}

/// Isolated particles with the noise of a camera.
#[test]
fn the_deviations_that_mle_claims_are_those_of_its_errors() {
    let folder = tempfile::tempdir().unwrap();
    let camera = "sensor: (shot_noise: true, quantum_efficiency: 0.7, read_noise_e: 10, gain_counts_per_e: 1,
        photons_per_count: 1, offset_counts: 100), render: (mode: expected),";
    let scenario = defocused("setting1a", 4, 20).replace("timing:", &format!("{camera} timing:"));
    generate(folder.path(), "dataset", &scenario);
    let score = score_inside(folder.path(), "mle", 30);
    for axis in ["x", "y", "z"] {
        let of = |key: &str| number(&score, &format!("/uncertainty/{axis}/{key}"));
        // About 80 errors of each: standard errors of 5 % and 2.5 % of the shares; the ratio is decided by the few
        // particles with the largest errors. With 595 errors: shares of 70 to 74 % and 96 %, ratios of 0.94 to 0.99.
        assert!(of("n") > 70.0, "{axis}: {}", score["uncertainty"]);
        assert!((of("coverage_1s") - 0.72).abs() < 0.15 && of("coverage_2s") > 0.88, "{axis}");
        assert!((0.65..1.35).contains(&of("ratio")), "{axis}: {}", of("ratio"));
    }
}

/// Diffracted images, behind a cylindrical lens that is turned.
#[test]
fn mle_fits_images_by_wave_optics() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = r#"(
        name: "diffracted",
        optics: (magnification: 10, numerical_aperture: 0.3, pixel_size: 6.5, pixel_dim_x: 200, pixel_dim_y: 160,
                 lens: aplanatic, cyl_focal_length: 8000, cyl_angle_deg: 20),
        render: (mode: waves, wavelength_um: 0.6),
        particles: (number: count(4)), boundaries: (z_um: (-20, 20)),
        motion: flow(field: poiseuille(max_speed_um_s: 300)), timing: pairs(count: 2, dt_s: 0.002),
    )"#;
    generate(folder.path(), "dataset", scenario);
    assert_tracks(&score(folder.path(), "mle"), "waves", [0.9, 0.9, 0.05, 0.003]);
}

/// Axes to a few degrees; by `mle` at the bound, with uncertainties, and the aspect ratio that all have.
#[test]
fn ncc_measures_the_axes_of_spheroids() {
    // The third is half beyond the edge of the image.
    axes_are_measured("ncc", &["--aspect-ratio", "2.5"], "median_deg", 3.0);
}

#[test]
#[ignore = "slow: .ci/full"]
fn mle_measures_axes_and_aspect_ratios_of_spheroids() {
    axes_are_measured("mle", &[], "mean_deg", 3.0);
    // The third may be taken to lie beyond the edge, and is not reported.
    axes_are_measured("mle", &["--aspect-ratio", "each"], "mean_deg", 2.0);
}

/// At least `found` of three rods, with a mean or median `angle` below 3 degrees.
fn axes_are_measured(method: &str, ratio: &[&str], angle: &str, found: f64) {
    let folder = tempfile::tempdir().unwrap();
    let scenario = r#"(
        name: "rods",
        optics: (magnification: 10, numerical_aperture: 0.3, pixel_size: 6.5, pixel_dim_x: 200, pixel_dim_y: 100,
                 lens: aplanatic, background_noise: 20),
        render: (mode: waves, wavelength_um: 0.6),
        particles: (number: count(3), diameter_um: constant(2), spheroids: (e_p: 2.5, orientation: random)),
        boundaries: (z_um: (4, 14)), motion: flow(field: uniform(velocity_um_s: (0, 0, 0))),
        timing: sequence(frames: 1, dt_s: 0.002), seed: 3,
    )"#;
    generate(folder.path(), "dataset", scenario);
    let (dataset, result) = (folder.path().join("dataset"), folder.path().join("mle.csv"));
    let track = ["track", path(&dataset), "--method", method, "--shape", "spheroid", "--quiet"];
    run(&[&track[..], &["--out", path(&result)], ratio].concat());
    let score = json(&["evaluate", path(&dataset), path(&result), "--crlb"]);
    assert!(number(&score, "/detection/tp") >= found, "{score}");
    assert!(number(&score, &format!("/orientation/{angle}")) < 3.0, "{}", score["orientation"]);
    if method == "mle" {
        assert!(number(&score, "/crlb/efficiency_axis") > 0.3, "{}", score["crlb"]);
        let ratios = aspect_ratios(&result);
        assert_eq!(ratios.iter().all(|of| *of == ratios[0]), ratio.is_empty(), "{ratios:?}");
        for [ratio, sd] in ratios {
            assert!((ratio - 2.5).abs() < (4.0 * sd).max(0.05), "{ratio} +- {sd}");
        }
    }
}

/// Aspect ratios of a result and their standard deviations.
fn aspect_ratios(result: &Path) -> Vec<[f64; 2]> {
    let text = std::fs::read_to_string(result).unwrap();
    let mut lines = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let header = lines.next().unwrap();
    let columns = ["aspect_ratio", "aspect_ratio_sd"]
        .map(|name| header.iter().position(|column| *column == name).unwrap());
    lines.map(|line| columns.map(|k| line[k].parse().unwrap())).collect()
}

/// A focus that is tilted by 4 um from the middle of the field to its ends: the optics of the middle would be off by
/// a third of the depth range.
#[test]
fn mle_fits_each_particle_by_the_optics_at_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = r#"(
        name: "tilted",
        optics: (magnification: 10, numerical_aperture: 0.3, pixel_size: 6.5, pixel_dim_x: 200, pixel_dim_y: 160,
                 cyl_focal_length: 0, lens: aplanatic, blur_um: 0.4,
                 field: (focus: (tilt_um_per_mm: (60, 0)), chief_ray: (slope: (0.02, 0), per_mm: 0.3))),
        render: (mode: waves, wavelength_um: 0.6, emission: volume, tolerance: 0.01),
        particles: (number: count(4)), boundaries: (z_um: (6, 18)),
        motion: flow(field: poiseuille(max_speed_um_s: 300)), timing: pairs(count: 2, dt_s: 0.002),
    )"#;
    generate(folder.path(), "dataset", scenario);
    assert_tracks(&score(folder.path(), "mle"), "tilted", [0.9, 0.9, 0.05, 0.005]);
    let by_rays = scenario
        .replace("lens: aplanatic,", "points_per_pixel: 8,")
        .replace("(6, 18)", "(6, 30)")
        .replace("pairs(count: 2", "pairs(count: 1")
        .replace("mode: waves, wavelength_um: 0.6, emission: volume, tolerance: 0.01", "mode: expected");
    let folder = tempfile::tempdir().unwrap();
    generate(folder.path(), "dataset", &by_rays);
    // With the same optics everywhere, these images have the same errors: 0.09 px, and 0.016 of the depth range.
    assert_tracks(&score(folder.path(), "mle"), "tilted, expected", [0.9, 0.9, 0.15, 0.02]);
}

/// A water immersion of NA 1.2, of which the settings file of the calibration stack alone does not know.
/// Above focus only: images of such a corrected objective are the same on both sides.
#[test]
#[ignore = "slow: .ci/full"]
fn immersed_objectives_can_be_tracked() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = r#"(
        name: "immersed",
        optics: (magnification: 60, numerical_aperture: 1.2, pixel_size: 6.5, pixel_dim_x: 240, pixel_dim_y: 200,
                 lens: aplanatic, layers: (n_s: 1.33, n_i: 1.33, n_i_design: 1.33)),
        render: (mode: waves, wavelength_um: 0.52, tolerance: 0.01),
        particles: (number: count(4), diameter_um: constant(0.5)), boundaries: (z_um: (0.5, 3)),
        motion: flow(field: poiseuille(max_speed_um_s: 300)), timing: pairs(count: 1, dt_s: 0.0002),
    )"#;
    generate(folder.path(), "dataset", scenario);
    for method in ["ncc", "mle"] {
        let score = score(folder.path(), method);
        assert!(number(&score, "/detection/recall") >= 0.9, "{method}: {}", score["detection"]);
    }
}

/// Particles that move in depth only, far from focus, with images that overlap: the search misses some. Where there is
/// no particle, none is measured.
#[test]
fn particles_at_known_positions_are_measured_where_a_search_misses_them() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = r#"(
        name: "at_rest", seed: 3,
        optics: (numerical_aperture: 0.3, pixel_dim_x: 300, pixel_dim_y: 250, background_noise: 20),
        motion: flow(field: uniform(velocity_um_s: (0, 0, 300))), particles: (number: count(25)),
        boundaries: (z_um: (0, 30)), timing: sequence(frames: 3, dt_s: 0.01), calibration: every_um(2),
    )"#;
    let dataset = generate(folder.path(), "dataset", scenario);
    let truth = std::fs::read_to_string(dataset.join("truth/tracks.csv")).unwrap();
    let header: Vec<&str> = truth.lines().next().unwrap().split(',').collect();
    let column = |name: &str| header.iter().position(|own| *own == name).unwrap();
    let columns = ["frame", "visible", "track", "x_px", "y_px"].map(column);
    let cells = truth.lines().skip(1).map(|row| {
        let cells: Vec<&str> = row.split(',').collect();
        columns.map(|column| cells[column])
    });
    let first: Vec<[&str; 5]> = cells.filter(|cells| cells[..2] == ["0", "1"]).collect();
    let known: Vec<String> = first.iter().map(|cells| cells[2..].join(",")).collect();
    let known = format!("track,x_px,y_px\n{}\n900,274,180\n", known.join("\n"));
    let known = write(folder.path(), "known.csv", known);
    for method in ["ncc", "mle"] {
        let searched = score(folder.path(), method);
        let result = folder.path().join("at_known.csv");
        let track = ["track", path(&dataset), "--method", method, "--out", path(&result), "--force"];
        let said = run(&[&track[..], &["--positions", path(&known)]].concat());
        assert!(said.contains("particles at 75 of 78 given positions"), "{method}: {said}");
        let measured = json(&["evaluate", path(&dataset), path(&result)]);
        let recall = [&searched, &measured].map(|score| number(score, "/detection/recall"));
        assert!(recall[0] < 0.88 && recall[1] > 0.92, "{method}: {recall:?}");
        assert!(number(&measured, "/links/f1") > 0.9, "{method}: {}", measured["links"]);
        let rows = std::fs::read_to_string(&result).unwrap();
        let tracks: Vec<&str> = rows.lines().skip(1).filter_map(|row| row.split(',').nth(1)).collect();
        let is_known = |track: &&str| first.iter().any(|cells| cells[2] == *track);
        assert!(tracks.iter().all(is_known), "{method}: {tracks:?}");
    }
    let out = folder.path().join("out.csv");
    let refused = |method: &str, table: &str| {
        let file = write(folder.path(), "wrong.csv", table);
        let options = ["--method", method, "--positions", path(&file), "--out", path(&out)];
        fail(2, &[&["track", path(&dataset)][..], &options].concat())
    };
    let said = refused("spots", "x_px,y_px\n9,9\n");
    assert!(said.contains("--positions: expected with --method ncc or mle and spheres"), "{said}");
    let said = refused("ncc", "x_um,y_um\n9,9\n");
    assert!(said.contains("wrong.csv: column x_px is missing; found x_um, y_um"), "{said}");
    let said = refused("mle", "x_px,y_px\n9,9\n9,251\n");
    assert!(said.contains("wrong.csv:3: y_px = 251: expected 0.5 to 250.5"), "{said}");
    assert!(!out.exists());
}

#[test]
fn a_lost_or_additional_image_is_named_instead_of_shifting_frames() {
    let folder = tempfile::tempdir().unwrap();
    generate(folder.path(), "dataset", &in_focus(0.001));
    let images = folder.path().join("dataset/images");
    let (dataset, out) = (folder.path().join("dataset"), folder.path().join("out.csv"));
    let command = ["track", path(&dataset), "--method", "spots", "--out", path(&out)];
    let (first, other) = (images.join("pair_00000_a.tif"), images.join("pair_00000_a copy.tif"));
    std::fs::rename(&first, &other).unwrap();
    let said = fail(2, &command);
    assert!(said.contains("1 missing: pair_00000_a.tif; 1 unknown: pair_00000_a copy.tif"), "{said}");
    std::fs::rename(&other, &first).unwrap();
    std::fs::File::options().write(true).open(&first).unwrap().set_len(2000).unwrap();
    let said = fail(2, &command);
    assert!(said.contains("pair_00000_a.tif") && said.contains("truncated"), "{said}");
    assert!(!out.exists());
}

#[test]
fn aptv_finds_astigmatic_particles_and_their_depth() {
    let folder = tempfile::tempdir().unwrap();
    generate(folder.path(), "dataset", &defocused("setting1a", 6, 8));
    // Widths can be measured for complete particle images only.
    assert_tracks(&score_inside(folder.path(), "aptv", 36), "aptv", [0.9, 0.6, 0.2, 0.01]);
}

/// Particles of 2 and 5 um: a stack for each, which all methods use. With the stack of one size, fewer are
/// found.
#[test]
fn mixtures_of_sizes_are_tracked_with_a_stack_for_each() {
    let folder = tempfile::tempdir().unwrap();
    let mixed = |calibration: &str| {
        let text = defocused("setting1", 8, 3);
        let text = text.replace("number: count(8)", "number: count(8), diameter_um: list([(2, 3), (5, 1)])");
        text.replace("timing:", &format!("{calibration} timing:"))
    };
    let dataset = generate(folder.path(), "dataset", &mixed(""));
    let table = std::fs::read_to_string(dataset.join("calibration/calibration.csv")).unwrap();
    assert!(table.lines().next().unwrap().ends_with(",d_um"), "{table}");
    assert_eq!(manifest(&dataset)["calibration_d_um"], serde_json::json!([2.0, 5.0]));
    let card = std::fs::read_to_string(dataset.join("README.md")).unwrap();
    assert!(
        card.contains("particles of 2 and 5 um") && card.contains("| images of 5 um over depth"),
        "{card}"
    );
    let of = |score: &Value, key: &str| number(score, &format!("/detection/{key}"));
    let ncc = score(folder.path(), "ncc");
    assert_tracks(&ncc, "ncc", [0.95, 0.9, 0.1, 0.01]);
    assert_tracks(&score(folder.path(), "mle"), "mle", [0.95, 0.9, 0.1, 0.01]);

    let alone = tempfile::tempdir().unwrap();
    let file = write(alone.path(), "one.ron", mixed("calibration: sizes(diameters_um: [2.75]),"));
    let out = alone.path().join("dataset");
    let said = told(&["generate", path(&file), "--out", path(&out)]);
    assert!(
        said.contains("a single stack of a particle of 2.75 um represents particles of 2 to 5 um"),
        "{said}"
    );
    let one = score(alone.path(), "ncc");
    assert!(of(&one, "rmse_z_um") > 2.0 * of(&ncc, "rmse_z_um"), "{} {}", one["detection"], ncc["detection"]);
}

#[test]
fn spots_finds_particles_in_focus() {
    let folder = tempfile::tempdir().unwrap();
    generate(folder.path(), "dataset", &in_focus(0.003));
    assert_tracks(&score(folder.path(), "spots"), "spots", [0.98, 0.9, 0.15, 1.0]);
    let (dataset, out) = (folder.path().join("dataset"), folder.path().join("ncc.csv"));
    let said = fail(2, &["track", path(&dataset), "--method", "ncc", "--out", path(&out)]);
    assert!(said.contains("calibration"), "{said}");
}

#[test]
fn piv_measures_a_vortex_far_better_than_a_field_of_zeros() {
    let folder = tempfile::tempdir().unwrap();
    generate(folder.path(), "dataset", &in_focus(0.03));
    let [measured, zeros] = ["piv", "static"].map(|method| score(folder.path(), method));
    assert!(number(&measured, "/field/aee_px") < 0.2, "{}", measured["field"]["aee_px"]);
    assert!(number(&measured, "/field/valid_vector_probability") > 0.9);
    assert!(number(&zeros, "/field/aee_px") > 1.0, "{}", zeros["field"]["aee_px"]);
}

#[test]
fn anchors_score_what_they_are_made_of() {
    let folder = tempfile::tempdir().unwrap();
    generate(folder.path(), "dataset", &defocused("setting1", 8, 3));
    let noisy = score(folder.path(), "truth-noise");
    let near = |pointer: &str, value: f64| {
        let got = number(&noisy, pointer);
        assert!((got - value).abs() < 0.35 * value, "{pointer}: {got}, made with {value}");
    };
    near("/detection/rmse_x_px", 0.1);
    near("/detection/rmse_z_um", 1.0);
    assert_eq!(number(&noisy, "/detection/recall"), 1.0);

    let off = score(folder.path(), "offset");
    assert!((number(&off, "/detection/bias_x_px") + 1.0).abs() < 1e-9);
    assert!(off["hints"][0]["what"].as_str().unwrap().contains("origin"), "{}", off["hints"]);

    let nothing = score(folder.path(), "empty");
    assert_eq!(number(&nothing, "/detection/recall"), 0.0);
    assert!(nothing["detection"]["precision"].is_null());
}
