//! The truth of datasets: displacement fields against closed forms, and the manifest against the tables.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use serde_json::Value;
use suite::microsig::{generate, json, manifest, path, run};

/// A dataset with a sensor of 128 x 96 px and the other sections given by the test.
fn dataset(place: &Path, name: &str, rest: &str) -> PathBuf {
    let text = format!(
        "(name: \"{name}\", seed: 3, optics: (pixel_dim_x: 128, pixel_dim_y: 96, points_per_pixel: 4), \
         calibration: none, {rest})"
    );
    let out = generate(place, name, &text);
    run(&["verify", path(&out)]);
    out
}

/// The columns of a table by name; empty cells are NaN.
fn table(file: &Path) -> HashMap<String, Vec<f64>> {
    let mut reader = csv::Reader::from_path(file).unwrap();
    let names: Vec<String> = reader.headers().unwrap().iter().map(str::to_owned).collect();
    let mut columns: HashMap<String, Vec<f64>> =
        names.iter().map(|name| (name.clone(), Vec::new())).collect();
    for record in reader.records() {
        for (name, cell) in names.iter().zip(&record.unwrap()) {
            columns.get_mut(name).unwrap().push(cell.parse().unwrap_or(f64::NAN));
        }
    }
    columns
}

#[test]
fn in_uniform_flow_all_definitions_agree_and_a_steady_flow_is_written_once() {
    let place = tempfile::tempdir().unwrap();
    let rest = "motion: flow(field: uniform(velocity_um_s: (129, -64.5, 20))), particles: (number: count(2)), \
                timing: pairs(count: 3, dt_s: 0.01), truth_grid: grid(window_px: 32, backward: true)";
    let field = table(&dataset(place.path(), "uniform", rest).join("truth/field.csv"));
    // 8 x 6 nodes on 5 planes.
    assert_eq!(field["x_px"].len(), 240);
    assert!(field["pair"].iter().all(|pair| pair.is_nan()));
    for kind in ["forward", "central", "weighted", "window", "backward"] {
        for (axis, expected) in [("dx_px", 2.0), ("dy_px", -1.0), ("dz_um", 0.2)] {
            let column = &field[&format!("{kind}_{axis}")];
            // Rounding error of positions of 100 um.
            assert!(column.iter().all(|d| (d - expected).abs() < 1e-12), "{kind}_{axis}: {}", column[0]);
        }
    }
}

/// A hand calculation of the columns, and the same terms in the manifest of a renderer without wave optics.
#[test]
fn truth_and_manifest_tell_what_optics_over_the_field_do() {
    let place = tempfile::tempdir().unwrap();
    let scenario = place.path().join("tilted.ron");
    let text = r#"(name: "tilted", seed: 3, calibration: none,
        optics: (magnification: 10, pixel_size: 5, pixel_dim_x: 201, pixel_dim_y: 101, points_per_pixel: 4,
                 depth_factor: 1.5, blur_um: 0.5,
                 field: (focus: (curvature_um_per_mm2: -500, tilt_um_per_mm: (60, 0)),
                         chief_ray: (slope: (0.02, 0), per_mm: 0.3), distortion_per_mm2: 4)),
        particles: (number: count(9)), motion: flow(field: uniform(velocity_um_s: (10, 0, 0))),
        timing: pairs(count: 1, dt_s: 0.01))"#;
    std::fs::write(&scenario, text).unwrap();
    let out = place.path().join("tilted");
    run(&["generate", path(&scenario), "--out", path(&out)]);
    run(&["verify", path(&out)]);
    let tracks = table(&out.join("truth/tracks.csv"));
    let column = |name: &str| &tracks[name];
    for row in 0..column("x_px").len() {
        // 0.5 um per px.
        let [x, y] = [(column("x_px")[row] - 101.0) * 5e-4, (column("y_px")[row] - 51.0) * 5e-4];
        let r2 = x * x + y * y;
        let focus_um = 60.0 * x - 500.0 * r2;
        let z_um = column("z_um")[row] / 1.5 - focus_um;
        let dx_px = ((0.02 + 0.3 * x) * z_um + 4e3 * r2 * x) / 0.5;
        let dy_px = (0.3 * y * z_um + 4e3 * r2 * y) / 0.5;
        for (name, expected) in
            [("optics_dx_px", dx_px), ("optics_dy_px", dy_px), ("optics_dz_um", -1.5 * focus_um)]
        {
            // Rounding errors.
            assert!(
                (column(name)[row] - expected).abs() < 1e-9,
                "{name}: {}, not {expected}",
                column(name)[row]
            );
        }
    }
    let optics = &manifest(&out)["optics"];
    assert_eq!(
        (&optics["blur_um"], &optics["field"]["distortion_per_mm2"]),
        (&Value::from(0.5), &Value::from(4.0))
    );
}

/// The focus of each particle scatters, by the same in both frames of a pair and for each renderer; `z_um` stays.
#[test]
fn the_scatter_of_the_focus_is_a_constant_of_each_track() {
    let place = tempfile::tempdir().unwrap();
    let made = |name: &str, scatter_um: f64, mode: &str| {
        let scenario = place.path().join(format!("{name}.ron"));
        let text = format!(
            "(name: \"{name}\", seed: 3, calibration: none,
            optics: (depth_factor: 1.5, pixel_dim_x: 200, pixel_dim_y: 200, background_noise: 0,
                     field: (focus: (tilt_um_per_mm: (20, 0), scatter_um: {scatter_um}))),
            particles: (number: count(400)), motion: flow(field: uniform(velocity_um_s: (10, 0, 0))),
            timing: pairs(count: 1, dt_s: 0.01), render: (mode: {mode}))"
        );
        std::fs::write(&scenario, text).unwrap();
        let out = place.path().join(name);
        run(&["generate", path(&scenario), "--out", path(&out)]);
        out
    };
    let [none, rays, expected] =
        [("none", 0.0, "expected"), ("rays", 2.0, "rays"), ("expected", 2.0, "expected")]
            .map(|(name, scatter_um, mode)| made(name, scatter_um, mode));
    let tables = [&none, &rays, &expected].map(|out| table(&out.join("truth/tracks.csv")));
    for column in ["z_um", "x_px", "track"] {
        assert_eq!(tables[0][column], tables[2][column]);
    }
    assert_eq!(tables[1]["optics_dz_um"], tables[2]["optics_dz_um"]);
    let scatter = |row: usize| tables[2]["optics_dz_um"][row] - tables[0]["optics_dz_um"][row];
    let mut by_track = std::collections::BTreeMap::new();
    for (row, track) in tables[2]["track"].iter().enumerate() {
        let known = by_track.entry(*track as u64).or_insert(scatter(row));
        assert!((*known - scatter(row)).abs() < 1e-9, "{known}, {}", scatter(row));
    }
    // As in data files: 1.5 times as much is physical. Four standard errors.
    let values: Vec<f64> = by_track.into_values().collect();
    let moment = |k: i32| values.iter().map(|v| (v / 3.0).powi(k)).sum::<f64>() / values.len() as f64;
    let error = 4.0 / (values.len() as f64).sqrt();
    assert!(moment(1).abs() < error && (moment(2) - 1.0).abs() < 1.5 * error, "{} {}", moment(1), moment(2));
    // The peak belongs to the depth at which the particle seems to be.
    assert!(tables[0]["peak_counts"] != tables[2]["peak_counts"]);
}

/// Plane Poiseuille flow with a maximum of 10 px: D(z) = 40 s (1 - s) px, and its mean with the weights of
/// depth.csv.
#[test]
fn the_depth_weighted_mean_of_poiseuille_flow_is_that_of_a_quadrature() {
    let place = tempfile::tempdir().unwrap();
    let rest = "motion: flow(field: poiseuille()), particles: (number: count(2)), timing: pairs(count: 2)";
    let out = dataset(place.path(), "poiseuille", rest);
    let (field, depth) = (table(&out.join("truth/field.csv")), table(&out.join("truth/depth.csv")));
    let profile = |z: f64| 40.0 * (z + 80.0) / 100.0 * (20.0 - z) / 100.0;
    for (z, dx) in field["z_um"].iter().zip(&field["central_dx_px"]) {
        assert!((dx - profile(*z)).abs() < 1e-10, "{z}: {dx}");
    }
    // The squared peaks, interpolated linearly, on a grid ten times finer.
    let (z, peak) = (&depth["z_um"], &depth["peak_counts"]);
    let (mut sum, mut weights) = (0.0, 0.0);
    for k in 0..z.len() - 1 {
        for i in 0..10 {
            let share = (f64::from(i) + 0.5) / 10.0;
            let weight = (1.0 - share) * peak[k] * peak[k] + share * peak[k + 1] * peak[k + 1];
            sum += weight * profile(z[k] + share * (z[k + 1] - z[k]));
            weights += weight;
        }
    }
    for dx in &field["weighted_dx_px"] {
        // The error of the trapezoidal rule with h = 2 um is at most D'' h^2 / 12 = 2.7e-3 px.
        assert!((dx - sum / weights).abs() < 2.7e-3, "{dx} {}", sum / weights);
    }
    // The weighted displacement is that near the focus, not the mean over the channel.
    assert!((field["weighted_dx_px"][0] - 20.0 / 3.0).abs() > 0.5);
    let total: f64 = depth["weight"].iter().sum();
    assert!((total - 1.0).abs() < 1e-12);
}

#[test]
fn places_in_bodies_and_behind_walls_are_masked() {
    let place = tempfile::tempdir().unwrap();
    let rest = "motion: flow(field: uniform(velocity_um_s: (100, 0, 0))), particles: (number: count(2)), \
                boundaries: (bodies: [cylinder(center_um: (0, 0), radius_um: 20)]), timing: pairs(count: 1), \
                truth_grid: grid(planes: at_um([-90, -30, 0, 25]))";
    let out = dataset(place.path(), "pillar", rest);
    let field = table(&out.join("truth/field.csv"));
    let mut masked = 0;
    for (i, (x_px, y_px)) in field["x_px"].iter().zip(&field["y_px"]).enumerate() {
        let (x, y) = ((x_px - 64.5) * 0.645, (y_px - 48.5) * 0.645);
        let z = field["z_um"][i];
        let solid = x * x + y * y < 400.0 || !(-80.0..=20.0).contains(&z);
        assert_eq!(field["mask"][i] == 1.0, solid, "{x} {y} {z}");
        assert_eq!(field["central_dx_px"][i].is_nan(), solid);
        masked += u32::from(solid);
    }
    // 8 x 6 nodes on each of two planes outside the channel, and those in the pillar on the two planes
    // inside.
    assert!(masked > 96 && masked < 150, "{masked}");
}

/// In a channel that takes a part of the image, images overlap as its particles do, which `n_s` asks for and
/// states.
#[test]
fn the_source_density_within_walls_is_that_of_the_channel() {
    let place = tempfile::tempdir().unwrap();
    // 31 um of 96 px of 0.645 um: half of the image.
    let rest = "motion: flow(field: duct(width_um: 30.96)), particles: (number: n_s(0.5), diameter_um: constant(0.5)), \
                timing: pairs(count: 40), boundaries: (z_um: (-60, 20))";
    let out = dataset(place.path(), "channel", rest);
    let facts = manifest(&out);
    let number = |key: &str| facts[key].as_f64().unwrap();
    let (pixels, share) = (128.0 * 96.0, number("image_share"));
    assert!((share - 0.5).abs() < 5e-3, "{share}");
    assert!((number("n_s") - number("n_p") * number("a_pi_px") / (share * pixels)).abs() < 1e-12);
    assert!((number("n_ppp") - number("n_p") / pixels).abs() < 1e-12);
    let areas = &table(&out.join("truth/depth.csv"))["area_px"];
    assert!((areas.iter().sum::<f64>() / areas.len() as f64 / number("a_pi_px") - 1.0).abs() < 1e-9);
    let expected = 0.5 * share * pixels / number("a_pi_px");
    assert!(
        (number("n_p") - expected).abs() < 4.0 * (expected / 40.0).sqrt(),
        "{} {expected}",
        number("n_p")
    );
    let card = std::fs::read_to_string(out.join("README.md")).unwrap();
    assert!(card.contains("in the 50 % of the image that walls and bodies leave"), "{card}");
    assert!(facts["concentration_definition"].as_str().unwrap().contains("image_share"));
}

/// Visibility of particles: isolated ones have the peak of depth.csv, close ones overlap, and scores are
/// binned by SNR and overlap.
#[test]
fn tracks_tell_how_visible_every_particle_is() {
    let place = tempfile::tempdir().unwrap();
    // Two close to each other, one isolated, one at the edge.
    std::fs::write(place.path().join("places.txt"), "40 48 0 2\n42 48 0 2\n90 48 -12 2\n128 20 -30 2\n")
        .unwrap();
    let rest = "motion: flow(field: poiseuille()), particles: (number: file(\"places.txt\")), \
                timing: pairs(count: 1), truth: (gradient: true)";
    let out = dataset(place.path(), "visible", rest);
    let (tracks, depth) = (table(&out.join("truth/tracks.csv")), table(&out.join("truth/depth.csv")));
    let at = |z: f64| depth["z_um"].iter().position(|d| *d == z).unwrap();
    let first = |name: &str, k: usize| tracks[name][k];
    for (k, z) in [(0, 0.0), (1, 0.0), (2, -12.0)] {
        // depth.csv has the mean of ray images, whose peak is noisy, tracks.csv the limit of many rays.
        assert!((first("peak_counts", k) / depth["peak_counts"][at(z)] - 1.0).abs() < 0.03, "{k}");
        assert!((first("snr", k) * 10.0 - first("peak_counts", k)).abs() < 1e-9);
    }
    // 2 px apart with a width of 9 px: most of the light overlaps, equally for both except for pixelation.
    assert!(first("overlap", 0) > 0.4 && (first("overlap", 0) - first("overlap", 1)).abs() < 0.01);
    assert!(first("overlap", 2) < 0.01);
    assert!(tracks["saturated"].iter().all(|s| *s == 0.0));

    // du/dz of plane Poiseuille flow, and a velocity that is constant along the path.
    for k in 0..4 {
        let z = first("z_um", k);
        let slope = 4.0 * 1290.0 / 100.0 * (1.0 - 2.0 * (z + 80.0) / 100.0);
        assert!((first("du_dz_1_s", k) - slope).abs() < 1e-9 && first("dw_dx_1_s", k) == 0.0);
        assert!((first("u_mid_um_s", k) - first("u_um_s", k)).abs() < 1e-9);
    }
    assert!(tracks["frame"].iter().zip(&tracks["u_mid_um_s"]).all(|(f, u)| (*f == 1.0) == u.is_nan()));

    let result = path(&out.join("truth/tracks.csv")).to_owned();
    let score: Value = json(&["evaluate", path(&out), &result]);
    let against: Vec<&str> =
        score["curves"].as_array().unwrap().iter().map(|c| c["against"].as_str().unwrap()).collect();
    assert!(against.contains(&"snr") && against.contains(&"overlap"), "{against:?}");
    assert_eq!(score["detection"]["f1"], 1.0);
}

/// On the circular paths of a vortex the velocity half-way is that at the middle of the arc: parallel to the
/// chord.
#[test]
fn the_velocity_half_way_is_along_the_displacement() {
    let place = tempfile::tempdir().unwrap();
    let rest = "motion: flow(field: lamb_oseen(core_radius_um: 15)), particles: (number: count(20)), \
                boundaries: (z_um: (-30, 0), z: open), timing: sequence(frames: 3)";
    let out = dataset(place.path(), "vortex", rest);
    let (tracks, moves) = (table(&out.join("truth/tracks.csv")), table(&out.join("truth/displacements.csv")));
    let mut rows = HashMap::new();
    for (k, (frame, track)) in tracks["frame"].iter().zip(&tracks["track"]).enumerate() {
        rows.insert((*frame as u32, *track as u64), k);
    }
    let (mut compared, mut at_start) = (0, 0.0f64);
    for k in 0..moves["track"].len() {
        let row = rows[&(moves["frame_a"][k] as u32, moves["track"][k] as u64)];
        let (dx, dy) = (moves["dx_px"][k], moves["dy_px"][k]);
        let turn = |u: &str, v: &str| {
            let (u, v) = (tracks[u][row], tracks[v][row]);
            (u * dy - v * dx) / (u.hypot(v) * dx.hypot(dy))
        };
        // The path is a circle up to the integration error of 1e-10 um.
        assert!(turn("u_mid_um_s", "v_mid_um_s").abs() < 1e-7);
        at_start = at_start.max(turn("u_um_s", "v_um_s").abs());
        compared += 1;
    }
    // The velocity at the start is not: the fastest particles move 10 px on a radius of 23 px, half of which
    // is 0.2 rad.
    assert!(compared > 20 && at_start > 0.05, "{compared} {at_start}");
}
