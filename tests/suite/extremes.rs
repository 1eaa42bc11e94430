//! Extreme and hostile inputs of single commands: each ends in time, with a message that names the input and
//! what is allowed, or with tables of finite numbers.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::LazyLock;
use std::time::{Duration, Instant};

use suite::microsig::{fail, generate, json, microsig, path, run, told, write};
use suite::scan::write_pages;

const SCENARIO: &str = r#"(
    name: "small",
    optics: (pixel_dim_x: 90, pixel_dim_y: 70, points_per_pixel: 4),
    motion: flow(field: poiseuille()),
    particles: (number: count(8)),
    timing: sequence(frames: 12),
    calibration: none,
)"#;

static DATASET: LazyLock<(tempfile::TempDir, PathBuf)> = LazyLock::new(|| {
    let place = tempfile::tempdir().unwrap();
    let dataset = generate(place.path(), "small", SCENARIO);
    (place, dataset)
});

/// Every cell of the tables in a folder that is a number is finite.
fn numbers_are_finite(folder: &Path) {
    for name in ["per_frame.csv", "matches.csv", "curves.csv"] {
        for record in csv::Reader::from_path(folder.join(name)).unwrap().into_records() {
            for cell in record.unwrap().iter() {
                let lower = cell.to_lowercase();
                assert!(!["nan", "inf", "-inf"].contains(&lower.as_str()), "{name}: {cell}");
            }
        }
    }
}

#[test]
fn tables_of_scores_hold_finite_numbers_only() {
    let place = tempfile::tempdir().unwrap();
    let tracks = std::fs::read_to_string(DATASET.1.join("truth/tracks.csv")).unwrap();
    let header = "frame,track,x_px,y_px,z_um\n";
    let first: Vec<&str> = tracks.lines().nth(1).unwrap().split(',').collect();
    let one = format!("{header}{},{},{},{},{}\n", first[0], first[2], first[3], first[4], first[5]);
    for (name, text) in [
        ("whole", tracks.clone()),
        ("nothing", header.to_owned()),
        ("one", one.clone()),
        ("without depth", format!("frame,x_px,y_px\n{},{},{}\n", first[0], first[3], first[4])),
        ("partly NaN", format!("{one}0,7,NaN,3,1\n0,8,3,3,NaN\n")),
        ("far away", format!("{one}0,7,1e7,-1e7,1e9\n0,8,1e-320,1e-320,-1e9\n")),
    ] {
        let (result, out) = (write(place.path(), "result.csv", text), place.path().join(name));
        run(&["evaluate", path(&DATASET.1), path(&result), "--out", path(&out), "--quiet"]);
        numbers_are_finite(&out);
    }
    // A bare table of a truth; its SNR spans more than numbers can.
    let bare = |snr: [&str; 2]| {
        let mut text = "frame,track,x_px,y_px,z_um,snr\n".to_owned();
        for (k, snr) in snr.iter().enumerate() {
            writeln!(text, "0,{k},{},10,0,{snr}", 10 + 30 * k).unwrap();
        }
        write(place.path(), "truth.csv", text)
    };
    let truth = bare(["1e308", "-1e308"]);
    let said = fail(2, &["evaluate", path(&truth), path(&truth)]);
    assert!(said.contains("truth.csv:2: snr = 1e308: expected at most 1e12 in size"), "{said}");
    let (truth, out) = (bare(["inf", "3"]), place.path().join("bare"));
    run(&["evaluate", path(&truth), path(&truth), "--out", path(&out), "--quiet"]);
    numbers_are_finite(&out);
}

#[test]
fn seeding_without_room_is_refused_before_any_particle_is_placed() {
    let set = |seeding: &str| format!("particles.seeding={seeding}");
    let scenario = DATASET.1.join("scenario.ron");
    let out = DATASET.0.path().join("crowded");
    for (number, seeding) in [("count(100000)", "apart(3)"), ("count(2000)", "apart_in_image(4)")] {
        let number = format!("particles.number={number}");
        let words =
            ["generate", path(&scenario), "--set", &number, "--set", &set(seeding), "--out", path(&out)];
        let said = fail(2, &words);
        assert!(said.contains("expected room for") && said.contains("random placement ends at"), "{said}");
    }
}

#[test]
#[ignore = "slow: .ci/full"]
fn long_runs_say_how_long_and_stop_at_once() {
    let place = tempfile::tempdir().unwrap();
    let settings = std::fs::read_to_string(DATASET.1.join("settings.txt")).unwrap();
    let settings = write(place.path(), "s.txt", settings.replace("n_rays = 500", "n_rays = 1000000"));
    // Some minutes of work.
    let rows: String = (0..3000).map(|k| format!("{} {} -60 3\n", 1 + k % 90, 1 + k % 70)).collect();
    let (data, out) = (write(place.path(), "d.txt", rows), place.path().join("out"));
    let scenario =
        SCENARIO.replace("points_per_pixel: 4", "n_rays: 1000000").replace("count(8)", "count(500)");
    let scenario = write(place.path(), "long.ron", scenario);
    let modes = SCENARIO.replace("poiseuille()", "kraichnan(modes: 100000)").replace("count(8)", "count(20)");
    let other = place.path().join("other");
    let modes = write(place.path(), "modes.ron", modes.replace("frames: 12", "frames: 20000"));
    for words in [
        vec!["render", path(&settings), path(&data), path(&out)],
        vec!["generate", path(&scenario), "--out", path(&out)],
        vec!["generate", path(&modes), "--out", path(&other)],
    ] {
        let said = write(place.path(), "said", b"");
        let stderr = std::fs::File::create(&said).unwrap();
        let mut child = microsig().args(&words).stdout(Stdio::null()).stderr(stderr).spawn().unwrap();
        let begun = Instant::now();
        let announced = || std::fs::read_to_string(&said).unwrap().contains(", about ");
        while !announced() && begun.elapsed() < Duration::from_secs(120) {
            assert!(
                child.try_wait().unwrap().is_none(),
                "{words:?}: {}",
                std::fs::read_to_string(&said).unwrap()
            );
            std::thread::sleep(Duration::from_millis(20));
        }
        let is_announced = announced();
        let stopped = Instant::now();
        let kill =
            std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
        let status = child.wait().unwrap();
        assert!(is_announced, "{words:?} does not say how long it takes");
        assert!(kill.success() && status.code() == Some(130), "{words:?}: {status}");
        // A second, and as much again for a busy machine.
        assert!(stopped.elapsed() < Duration::from_secs(2), "{words:?}: {:?}", stopped.elapsed());
    }
    // A dry run gives such a time without writing anything.
    let told = json(&["generate", path(&scenario), "--dry-run"]);
    assert!(told["seconds"].as_f64().unwrap() > 60.0, "{told}");
}

#[test]
fn nothing_is_written_into_a_dataset() {
    let (dataset, place) = (&DATASET.1, tempfile::tempdir().unwrap());
    let tracks = dataset.join("truth/tracks.csv");
    let inside = [dataset.join("scores"), dataset.join("truth/tracks.csv"), dataset.join("new/deep.csv")];
    for out in &inside {
        for words in [
            vec!["track", path(dataset), "--method", "spots", "--out", path(out), "--force"],
            vec!["evaluate", path(dataset), path(&tracks), "--out", path(out), "--force"],
            vec!["export", path(dataset), "--format", "trackpy", "--out", path(out), "--force"],
        ] {
            let said = fail(2, &words);
            assert!(said.contains("lies in the dataset") && said.contains("outside of it"), "{said}");
        }
    }
    run(&["verify", path(dataset)]);
    // Beside it is fine, also through a link.
    run(&["track", path(dataset), "--method", "spots", "--out", path(&place.path().join("r.csv"))]);
}

#[test]
fn a_background_has_one_page() {
    let place = tempfile::tempdir().unwrap();
    let text = SCENARIO.replace("calibration: none", "sensor: (background: \"b.tif\"), calibration: none");
    let scenario = write(place.path(), "s.ron", text);
    let background =
        |pages| write_pages(&place.path().join("b.tif"), (90, 70), &vec![vec![100; 6300]; pages]).unwrap();
    background(3);
    let said = fail(2, &["generate", path(&scenario), "--dry-run"]);
    assert!(said.contains("b.tif: 3 pages: expected a file with one image"), "{said}");
    background(1);
    run(&["generate", path(&scenario), "--dry-run"]);
}

#[test]
fn a_velocity_grid_smaller_than_the_box_is_told() {
    let place = tempfile::tempdir().unwrap();
    let mut grid = "x_um,y_um,z_um,u_um_s,v_um_s,w_um_s\n".to_owned();
    for k in 0..8 {
        let at = |bit: usize, size: f64| if k >> bit & 1 == 0 { -size } else { size };
        writeln!(grid, "{},{},{},100,0,0", at(0, 1000.0), at(1, 1000.0), at(2, 40.0)).unwrap();
    }
    write(place.path(), "grid.csv", grid);
    let text = SCENARIO.replace("poiseuille()", "gridded(file: \"grid.csv\", interpolation: trilinear)");
    let scenario = write(place.path(), "s.ron", text);
    let warned = |z_um: &str| {
        let set = format!("boundaries.z_um={z_um}");
        told(&["generate", path(&scenario), "--dry-run", "--set", &set])
    };
    assert!(!warned("(-40, 40)").contains("outside the grid"));
    // A quarter of the depth range from -40 to 40 + 80/3 um.
    let said = warned("(-40, 66.666667)");
    assert!(said.contains("25.0 % of its volume, and of the particles, lie outside the grid"), "{said}");
}

#[test]
fn the_lines_on_optics_are_of_the_diameters_that_tracks_tell() {
    let place = tempfile::tempdir().unwrap();
    let text = SCENARIO
        .replace("flow(field: poiseuille())", "tracks(file: \"t.csv\")")
        .replace("number: count(8)", "diameter_um: constant(2)")
        .replace("calibration: none,", "boundaries: (z_um: (-40, 20)),\n calibration: none,");
    let scenario = write(place.path(), "s.ron", text);
    write(
        place.path(),
        "t.csv",
        b"frame,track,x_um,y_um,z_um,d_um\n0,0,0,0,-30,5\n1,0,1,0,-30,5\n0,1,9,0,-30,7\n1,1,9,0,-30,7\n",
    );
    let said = run(&["generate", path(&scenario), "--out", path(&place.path().join("d"))]);
    assert!(said.contains("images of 5.000 um are") && said.contains("of 7.000 um best at"), "{said}");
    let told: serde_json::Value = json(&["optics", path(&scenario)]);
    let sizes: Vec<f64> =
        told["sizes"].as_array().unwrap().iter().map(|s| s["d_um"].as_f64().unwrap()).collect();
    assert_eq!(sizes, [5.0, 7.0]);
}

#[test]
fn images_that_show_nothing_or_saturate_are_told() {
    let place = tempfile::tempdir().unwrap();
    // A byte order mark is skipped.
    let scenario = write(place.path(), "s.ron", format!("\u{feff}{SCENARIO}"));
    for (set, expected) in [
        ("optics.gain=0", "the particles emit no light"),
        ("optics.gain=1000", "have pixels saturated at 65535 counts"),
        ("particles.number=count(0)", "no particle is in view"),
        ("motion.flow.field=uniform(velocity_um_s: (1e9, 0, 0))", "no particle is in both frames"),
    ] {
        let out = place.path().join(expected);
        let sets = ["--set", set, "--set", "timing.sequence.frames=2"];
        let command = [&["generate", path(&scenario), "--out", path(&out)], &sets[..]].concat();
        let said = told(&command);
        assert!(said.contains(expected), "{set}: {said}");
    }
}
