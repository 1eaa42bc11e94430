//! End-to-end tests of motion, timing and illumination: scenarios against data files, truth and images.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use suite::measure::{Measures, measure};
use suite::microsig::{fail, manifest, path, run, write};

/// A small dark sensor: a scenario with these sections.
fn scenario(name: &str, sections: &str) -> String {
    format!(
        "(name: \"{name}\", optics: (pixel_dim_x: 101, pixel_dim_y: 81, background_mean: 0, background_noise: 0), \
         calibration: none, {sections})"
    )
}

fn generate(folder: &Path, name: &str, sections: &str) -> PathBuf {
    suite::microsig::generate(folder, name, &scenario(name, sections))
}

/// The rows of a table, by column name.
fn table(file: &Path) -> Vec<HashMap<String, String>> {
    csv::Reader::from_path(file).unwrap().deserialize().map(Result::unwrap).collect()
}

fn number(row: &HashMap<String, String>, column: &str) -> f64 {
    row[column].parse().unwrap_or_else(|_| panic!("{column} = {:?}", row[column]))
}

fn image(dataset: &Path, stem: &str) -> Measures {
    measure(101, &suite::counts(&dataset.join(format!("images/{stem}.tif"))).unwrap())
}

#[test]
fn a_streak_is_centered_on_the_particle_and_as_long_as_its_path() {
    let place = tempfile::tempdir().unwrap();
    // 12 and 5 um per frame; at the center of the sensor in frame 1.
    let mut rows = "frame,track,x_um,y_um,z_um\n".to_owned();
    for frame in 0..3 {
        let t = f64::from(frame) - 1.0;
        rows += &format!("{frame},1,{},{},-25\n", 12.0 * t, 5.0 * t);
    }
    write(place.path(), "tracks.csv", &rows);
    let sections = |exposure: &str| {
        format!(
            "motion: tracks(file: \"tracks.csv\"), particles: (diameter_um: constant(3)), \
             timing: sequence(frames: 3, dt_s: 0.01{exposure})"
        )
    };
    let sharp = generate(place.path(), "sharp", &sections(""));
    let blurred = generate(place.path(), "blurred", &sections(", exposure_s: 0.008"));
    let (a, b) = (image(&sharp, "frame_00001"), image(&blurred, "frame_00001"));
    let truth = &table(&blurred.join("truth/tracks.csv"))[1];
    // The centroid of some ten thousand rays in an image of 2.7 px: a few hundredths of a pixel at most.
    for m in [&a, &b] {
        assert!((m.cx - number(truth, "x_px")).abs() < 0.05, "{m:?}");
        assert!((m.cy - number(truth, "y_px")).abs() < 0.05, "{m:?}");
    }
    assert_eq!((number(truth, "u_um_s"), number(truth, "v_um_s")), (1200.0, 500.0));
    // The total light is the same, and a streak of length l adds the variance l^2 / 12: 14.9 px along x, 6.2
    // px along y.
    assert!((b.total / a.total - 1.0).abs() < 0.01, "{} {}", a.total, b.total);
    let (lx, ly) = (9.6 / 0.645, 4.0 / 0.645);
    assert!((b.mxx - a.mxx - lx * lx / 12.0).abs() < 0.3, "{} {}", a.mxx, b.mxx);
    assert!((b.myy - a.myy - ly * ly / 12.0).abs() < 0.2, "{} {}", a.myy, b.myy);
    assert!((b.mxy - a.mxy - lx * ly / 12.0).abs() < 0.2, "{} {}", a.mxy, b.mxy);
    // 16.1 px in steps of a quarter pixel: 64 rows that share the light.
    let particles = suite::particles(&blurred.join("particles/frame_00001.txt")).unwrap();
    assert_eq!(particles.len(), 64);
    assert!((particles.iter().map(|p| p.c_int).sum::<f64>() - 1.0).abs() < 1e-12);
    // `microsig render` gives the same image from these data files.
    let again = place.path().join("again");
    let (settings, data) = (blurred.join("settings.txt"), blurred.join("particles"));
    run(&["render", path(&settings), path(&data), path(&again)]);
    let pixels = |file: PathBuf| suite::counts(&file).unwrap();
    assert_eq!(pixels(again.join("frame_00001.tif")), pixels(blurred.join("images/frame_00001.tif")));
}

#[test]
fn the_truth_of_a_dataset_is_a_table_of_tracks_that_makes_it_again() {
    let place = tempfile::tempdir().unwrap();
    let particles = "particles: (number: ppp(0.001), diameter_um: uniform(min: 1.5, max: 3), c_int: uniform(min: 0.5, max: 1))";
    let timing = "timing: sequence(frames: 4)";
    let flow = generate(
        place.path(),
        "flow",
        &format!("motion: flow(field: lamb_oseen(core_radius_um: 20)), {particles}, {timing}"),
    );
    let tracks = "motion: tracks(file: \"flow/truth/tracks.csv\")";
    let again = generate(place.path(), "again", &format!("{tracks}, {timing}"));
    for frame in 0..4 {
        let file = format!("particles/frame_{frame:05}.txt");
        let (a, b) =
            (suite::particles(&flow.join(&file)).unwrap(), suite::particles(&again.join(&file)).unwrap());
        assert_eq!(a.len(), b.len());
        for (a, b) in a.iter().zip(&b) {
            // Rounding of the conversion to um and back.
            assert!((a.x_px - b.x_px).abs() < 1e-10 && (a.y_px - b.y_px).abs() < 1e-10);
            assert_eq!((a.z_um, a.d_um, a.c_int), (b.z_um, b.d_um, b.c_int));
        }
    }
    let (a, b) =
        (table(&flow.join("truth/displacements.csv")), table(&again.join("truth/displacements.csv")));
    assert_eq!(a.len(), b.len());
    for (a, b) in a.iter().zip(&b) {
        assert!(a["track"] == b["track"] && (number(a, "dx_px") - number(b, "dx_px")).abs() < 1e-9);
    }
    assert!(again.join("inputs/tracks.csv").exists());
    run(&["verify", path(&again), "--regenerate"]);
    // The truth is still a perfect result.
    let truth = again.join("truth/tracks.csv");
    let score = run(&["evaluate", path(&again), path(&truth), "--json"]);
    assert!(score.contains("\"f1\": 1.0") || score.contains("\"f1\":1.0"), "{score}");
}

/// Every timing mode with everything that varies between frames, and a key that lengthens it.
const MODES: [(&str, &str, &str, u32); 4] = [
    (
        "continuing",
        "pairs(count: 1, interval_s: 0.03, seeding: continuing, exposure_s: 0.001, jitter_s: 0.0002)",
        "timing.pairs.count",
        2,
    ),
    (
        "bursts",
        "four_pulse(count: 1, interval_s: 0.1, exposure_s: 0.001, jitter_s: 0.0002)",
        "timing.four_pulse.count",
        2,
    ),
    (
        "sequence",
        "sequence(frames: 2, exposure_s: 0.001, flashes: (count: 2, spacing_s: 0.002), jitter_s: 0.0002)",
        "timing.sequence.frames",
        4,
    ),
    ("fresh", "pairs(count: 1, exposure_s: 0.001, jitter_s: 0.0002)", "timing.pairs.count", 2),
];

#[test]
fn a_shorter_dataset_is_the_beginning_of_a_longer_one_in_every_mode() {
    let place = tempfile::tempdir().unwrap();
    let light = "illumination: (shape: sheet(thickness_um: 60), pulse_energies: [1, 0.8], energy_jitter: 0.1, bleaching_s: 1)";
    let mut rows = "frame,track,x_um,y_um,z_um\n".to_owned();
    for frame in 0..8 {
        rows += &format!("{frame},1,{},3,-25\n{frame},2,-9,{},-40\n", frame * frame, 2 * frame);
    }
    write(place.path(), "tracks.csv", &rows);
    let flow =
        "motion: flow(field: lamb_oseen(core_radius_um: 20)), particles: (number: count(4), brownian: ())";
    for (kind, motion) in [("flow", flow), ("tracks", "motion: tracks(file: \"tracks.csv\")")] {
        for (mode, timing, key, longer) in MODES {
            let text = scenario(mode, &format!("{motion}, {light}, timing: {timing}"));
            let file = write(place.path(), &format!("{kind}_{mode}.ron"), &text);
            let [short, long] =
                ["short", "long"].map(|name| place.path().join(format!("{kind}_{mode}_{name}")));
            run(&["generate", path(&file), "--out", path(&short), "--threads", "1"]);
            let set = format!("{key}={longer}");
            run(&["generate", path(&file), "--out", path(&long), "--threads", "3", "--set", &set]);
            let frames = table(&short.join("truth/frames.csv"));
            for (a, b) in frames.iter().zip(table(&long.join("truth/frames.csv"))) {
                assert_eq!(*a, b, "{kind} {mode}");
                for column in ["image", "particles"] {
                    let bytes = |dataset: &Path| std::fs::read(dataset.join(&a[column])).unwrap();
                    assert!(bytes(&short) == bytes(&long), "{kind} {mode}: {}", a[column]);
                }
            }
            let tracks = |dataset: &Path| std::fs::read_to_string(dataset.join("truth/tracks.csv")).unwrap();
            // The last frame has no displacement to a next one.
            let last = format!("{},", frames.len() - 1);
            let known: String =
                tracks(&short).split_inclusive('\n').filter(|row| !row.starts_with(&last)).collect();
            assert!(tracks(&long).starts_with(&known), "{kind} {mode}");
        }
    }
}

#[test]
fn pairs_of_a_continuing_cloud_link_a_to_b_only_and_their_light_is_in_the_data_files() {
    let place = tempfile::tempdir().unwrap();
    let out = generate(
        place.path(),
        "pairs",
        "motion: flow(field: uniform(velocity_um_s: (100, 0, 0))), particles: (number: count(12)), \
         timing: pairs(count: 3, interval_s: 0.02, seeding: continuing), \
         illumination: (shape: sheet(profile: top_hat, thickness_um: 50, center_um: (0, 0, -40)), pulse_energies: [1, 0.8])",
    );
    let tracks = table(&out.join("truth/tracks.csv"));
    let in_frame = |frame: &str| {
        tracks.iter().filter(|r| r["frame"] == frame).map(|r| r["track"].clone()).collect::<Vec<_>>()
    };
    let (first, last) = (in_frame("0"), in_frame("5"));
    assert!(first.iter().filter(|t| last.contains(t)).count() > first.len() / 2, "the same particles");
    let links: Vec<String> = table(&out.join("truth/displacements.csv"))
        .iter()
        .map(|r| format!("{}:{}-{}", r["pair"], r["frame_a"], r["frame_b"]))
        .collect();
    for link in ["0:0-1", "1:2-3", "2:4-5"] {
        assert!(links.iter().any(|l| l == link), "{link}");
    }
    assert!(links.iter().all(|l| ["0:0-1", "1:2-3", "2:4-5"].contains(&l.as_str())));
    let frames = table(&out.join("truth/frames.csv"));
    assert_eq!(
        frames.iter().map(|r| number(r, "energy")).collect::<Vec<_>>(),
        [1.0, 0.8, 1.0, 0.8, 1.0, 0.8]
    );
    assert_eq!(frames.iter().map(|r| r["role"].as_str()).collect::<String>(), "ababab");
    let mut dark = 0;
    for frame in &frames {
        let rows = suite::particles(&out.join(&frame["particles"])).unwrap();
        let truth = tracks.iter().filter(|r| r["frame"] == frame["frame"]);
        let (lit, unlit): (Vec<_>, Vec<_>) = truth.partition(|r| r["rendered"] == "1");
        assert_eq!(rows.len(), lit.len());
        for (row, truth) in rows.iter().zip(lit) {
            assert_eq!(row.c_int, number(truth, "c_int") * number(truth, "light"));
            assert_eq!(number(truth, "light"), number(frame, "energy"));
        }
        // Outside the light sheet there is no light, on the sensor or not.
        for row in unlit.iter().filter(|r| r["visible"] == "1") {
            dark += 1;
            assert!(number(row, "light") == 0.0 && !(-65.0..=-15.0).contains(&number(row, "z_um")));
        }
    }
    assert!(dark > 10, "{dark}");
    // Dark particles are not scored: the light sheet is the depth range of the measurement.
    assert_eq!(manifest(&out)["depth_range_um"], serde_json::json!([-65.0, -15.0]));
}

/// What in a good scenario is replaced, by what, and the message about it.
const REFUSED: &str = r#"
flow(field: poiseuille()) => tracks(file: "none.csv") => none.csv
flow(field: poiseuille()), particles: (number: count(2)) => tracks(file: "high.csv") => line 3 of the tracks: 
flow(field: poiseuille()) => tracks(file: "high.csv") => particles.number: expected nothing, as motion.tracks
poiseuille() => womersley(frequency_hz: 1e6, viscosity_um2_s: 1) => womersley
poiseuille() => duct(walls_z_um: (20, -80)) => walls_z_um
pairs(count: 1) => pairs(count: 1), illumination: (pulse_energies: []) => illumination.pulse_energies = 0 values: expected 1 to
pairs(count: 1) => pairs(count: 1), illumination: (shape: sheet(thickness_um: 5, center_um: (0, 0, 90))) => illumination.shape.sheet = 87.5 to 92.5 um: expected a sheet that crosses the depth range
count(2)) => file("inside.txt")), boundaries: (bodies: [sphere(center_um: (0, 0, -30), radius_um: 20)]) => from the walls of the flow and outside all bodies
"#;

#[test]
fn wrong_motion_and_light_name_what_is_wrong() {
    let place = tempfile::tempdir().unwrap();
    write(place.path(), "high.csv", "frame,track,x_um,y_um,z_um\n0,1,0,0,-30\n0,2,0,0,-9999\n");
    write(place.path(), "inside.txt", "51 41 -30 2\n");
    let good = "motion: flow(field: poiseuille()), particles: (number: count(2)), timing: pairs(count: 1)";
    for line in REFUSED.trim().lines() {
        let [from, to, expected] = line.split(" => ").collect::<Vec<_>>()[..] else { panic!("{line}") };
        let file = write(place.path(), "wrong.ron", scenario("wrong", &good.replace(from, to)));
        let message = fail(2, &["generate", path(&file), "--dry-run"]);
        assert!(message.contains(expected), "{to}: {message}");
    }
}

#[test]
fn photons_refer_to_the_mean_diameter_of_the_tracks() {
    let place = tempfile::tempdir().unwrap();
    write(place.path(), "tracks.csv", "frame,track,x_um,y_um,z_um,d_um\n0,1,-10,0,-25,3\n0,2,10,0,-25,5\n");
    let image_of = |name: &str, reference: &str| {
        let sections = format!(
            "motion: tracks(file: \"tracks.csv\"), particles: (diameter_um: constant(2), \
             photons: (emitted: constant(1e6){reference})), timing: sequence(frames: 1)"
        );
        suite::counts(&generate(place.path(), name, &sections).join("images/frame_00000.tif")).unwrap()
    };
    let default = image_of("default", "");
    assert_eq!(default, image_of("four", ", reference_um: 4"));
    assert_ne!(default, image_of("two", ", reference_um: 2"));
}
