//! Extreme and hostile inputs of single commands: each ends in time, with a message that names the input and
//! what is allowed, or with tables of finite numbers.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::LazyLock;
use std::time::{Duration, Instant};

use suite::microsig::{fail, json, microsig, path, run};

#[cfg(unix)]
use crate::trial::ends;

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
    let out = place.path().join("small");
    let scenario = write(place.path(), "small.ron", SCENARIO.as_bytes());
    run(&["generate", path(&scenario), "--out", path(&out), "--quiet"]);
    (place, out)
});

fn write(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

fn settings() -> String {
    std::fs::read_to_string(DATASET.1.join("settings.txt")).unwrap()
}

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
        let (result, out) = (write(place.path(), "result.csv", text.as_bytes()), place.path().join(name));
        run(&["evaluate", path(&DATASET.1), path(&result), "--out", path(&out), "--quiet"]);
        numbers_are_finite(&out);
    }
    // A bare table of a truth; its SNR spans more than numbers can.
    let bare = |snr: [&str; 2]| {
        let mut text = "frame,track,x_px,y_px,z_um,snr\n".to_owned();
        for (k, snr) in snr.iter().enumerate() {
            writeln!(text, "0,{k},{},10,0,{snr}", 10 + 30 * k).unwrap();
        }
        write(place.path(), "truth.csv", text.as_bytes())
    };
    let truth = bare(["1e308", "-1e308"]);
    let said = fail(2, &["evaluate", path(&truth), path(&truth)]);
    assert!(said.contains("truth.csv:2: snr = 1e308: expected at most 1e12 in size"), "{said}");
    let (truth, out) = (bare(["inf", "3"]), place.path().join("bare"));
    run(&["evaluate", path(&truth), path(&truth), "--out", path(&out), "--quiet"]);
    numbers_are_finite(&out);
}

#[test]
fn values_without_sense_are_refused_at_once_and_shown_short() {
    let place = tempfile::tempdir().unwrap();
    let (data, out) = (write(place.path(), "d.txt", b"10 20 -30 2\n"), place.path().join("out"));
    let set = |key: &str, value: &str| {
        let changed: String = settings()
            .lines()
            .map(|line| match line.split_once(" = ") {
                Some((name, _)) if name == key => format!("{key} = {value}\n"),
                _ => format!("{line}\n"),
            })
            .collect();
        write(place.path(), "s.txt", changed.as_bytes())
    };
    let render = |settings: &Path, data: &Path| fail(2, &["render", path(settings), path(data), path(&out)]);
    let said = fail(
        2,
        &[
            "render",
            path(&set("focal_length", "1e308")),
            path(&data),
            path(&out),
            "--mode",
            "waves",
            "--wavelength",
            "0.5",
        ],
    );
    assert!(said.contains("focal_length = 1e308: expected a number > 0 and <= 1e6"), "{said}");
    let said = render(&set("gain", "-1e308"), &data);
    assert!(said.contains("gain = -1e308: expected a number >= 0"), "{said}");
    let good = set("none", "");
    for (row, expected) in
        [("1 1 0 -1e308\n", "d_p = -1e308: expected"), ("1 1 0 1e300\n", "d_p = 1e300 um with")]
    {
        let said = render(&good, &write(place.path(), "wide.txt", row.as_bytes()));
        assert!(said.contains(expected) && said.len() < 300, "{said}");
    }
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
    let settings =
        write(place.path(), "s.txt", settings().replace("n_rays = 500", "n_rays = 1000000").as_bytes());
    // Some minutes of work.
    let rows: String = (0..3000).map(|k| format!("{} {} -60 3\n", 1 + k % 90, 1 + k % 70)).collect();
    let (data, out) = (write(place.path(), "d.txt", rows.as_bytes()), place.path().join("out"));
    let scenario =
        SCENARIO.replace("points_per_pixel: 4", "n_rays: 1000000").replace("count(8)", "count(500)");
    let scenario = write(place.path(), "long.ron", scenario.as_bytes());
    let modes = SCENARIO.replace("poiseuille()", "kraichnan(modes: 100000)").replace("count(8)", "count(20)");
    let other = place.path().join("other");
    let modes = write(place.path(), "modes.ron", modes.replace("frames: 12", "frames: 20000").as_bytes());
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

/// A gray TIFF with as many pages as asked for, each of one strip.
fn tiff(pages: usize, (width, height): (u16, u16)) -> Vec<u8> {
    let mut bytes = b"II*\0".to_vec();
    bytes.extend(8u32.to_le_bytes());
    let size = u32::from(width) * u32::from(height);
    for page in 0..pages {
        let begin = bytes.len() as u32;
        let entries: [(u16, u16, u32); 7] = [
            (256, 3, width.into()),
            (257, 3, height.into()),
            (258, 3, 8),
            (259, 3, 1),
            (262, 3, 1),
            (273, 4, begin + 2 + 7 * 12 + 4),
            (279, 4, size),
        ];
        bytes.extend((entries.len() as u16).to_le_bytes());
        for (tag, kind, value) in entries {
            bytes.extend(tag.to_le_bytes());
            bytes.extend(kind.to_le_bytes());
            bytes.extend(1u32.to_le_bytes());
            bytes.extend(value.to_le_bytes());
        }
        let next = begin + 2 + 7 * 12 + 4 + size;
        bytes.extend(if page + 1 < pages { next } else { 0 }.to_le_bytes());
        bytes.extend(std::iter::repeat_n(100, size as usize));
    }
    bytes
}

#[test]
fn a_background_has_one_page() {
    let place = tempfile::tempdir().unwrap();
    let text = SCENARIO.replace("calibration: none", "sensor: (background: \"b.tif\"), calibration: none");
    let scenario = write(place.path(), "s.ron", text.as_bytes());
    write(place.path(), "b.tif", &tiff(3, (90, 70)));
    let said = fail(2, &["generate", path(&scenario), "--dry-run"]);
    assert!(said.contains("b.tif: 3 pages: expected a file with one image"), "{said}");
    write(place.path(), "b.tif", &tiff(1, (90, 70)));
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
    write(place.path(), "grid.csv", grid.as_bytes());
    let text = SCENARIO.replace("poiseuille()", "gridded(file: \"grid.csv\", interpolation: trilinear)");
    let scenario = write(place.path(), "s.ron", text.as_bytes());
    let warned = |z_um: &str| {
        let set = format!("boundaries.z_um={z_um}");
        let output =
            microsig().args(["generate", path(&scenario), "--dry-run", "--set", &set]).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stderr).unwrap()
    };
    assert!(!warned("(-40, 40)").contains("outside the grid"));
    // A quarter of the depth range from -40 to 40 + 80/3 um.
    let said = warned("(-40, 66.666667)");
    assert!(said.contains("25.0 % of its volume, and of the particles, lie outside the grid"), "{said}");
}

#[test]
fn a_result_that_leaves_out_frames_comes_after_the_complete_one() {
    let place = tempfile::tempdir().unwrap();
    let truth = csv::Reader::from_path(DATASET.1.join("truth/tracks.csv"))
        .unwrap()
        .into_deserialize::<std::collections::BTreeMap<String, String>>()
        .map(Result::unwrap)
        .collect::<Vec<_>>();
    // The same result in all frames, and in all but one.
    let result = |name: &str, keep: &dyn Fn(usize, u32) -> bool| {
        let mut text = "frame,track,x_px,y_px,z_um\n".to_owned();
        for (i, row) in truth.iter().enumerate() {
            let (x, frame) = (row["x_px"].parse::<f64>().unwrap(), row["frame"].parse::<u32>().unwrap());
            if keep(i, frame) {
                writeln!(text, "{frame},{},{},{},{}", row["track"], x, row["y_px"], row["z_um"]).unwrap();
            }
        }
        let (file, out) = (write(place.path(), "r.csv", text.as_bytes()), place.path().join(name));
        run(&["evaluate", path(&DATASET.1), path(&file), "--out", path(&out), "--quiet"]);
        out
    };
    let partial = result("partial", &|i, frame| i % 12 != 7 && frame != 5);
    let complete = result("complete", &|i, _| i % 12 != 7);
    let score: serde_json::Value =
        serde_json::from_slice(&std::fs::read(partial.join("score.json")).unwrap()).unwrap();
    assert_eq!(score["counts"]["frames_missing"], 1);
    let board = place.path().join("board");
    let said = run(&["compare", path(&partial), path(&complete), "--out", path(&board), "--json", "--quiet"]);
    let compared: serde_json::Value = serde_json::from_str(&said).unwrap();
    let of = |i: usize, key: &str| compared["entries"][i][key].clone();
    assert_eq!((of(0, "name"), of(1, "name")), ("complete".into(), "partial".into()), "{said}");
    assert_eq!((of(0, "missing"), of(1, "missing")), (0.into(), 1.into()));
    // The intervals of F1 overlap, which does not make them equal.
    assert!(of(1, "high").as_f64() >= of(0, "low").as_f64(), "{said}");
}

#[test]
fn the_lines_on_optics_are_of_the_diameters_that_tracks_tell() {
    let place = tempfile::tempdir().unwrap();
    let text = SCENARIO
        .replace("flow(field: poiseuille())", "tracks(file: \"t.csv\")")
        .replace("number: count(8)", "diameter_um: constant(2)")
        .replace("calibration: none,", "boundaries: (z_um: (-40, 20)),\n calibration: none,");
    let scenario = write(place.path(), "s.ron", text.as_bytes());
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

/// A pipe in the place of a file must not be waited for.
#[cfg(unix)]
#[test]
fn pipes_in_the_place_of_files_are_refused_in_time() {
    let place = tempfile::tempdir().unwrap();
    let make = |file: &Path| {
        assert!(std::process::Command::new("mkfifo").arg(file).status().unwrap().success());
    };
    let pipe = place.path().join("pipe");
    make(&pipe);
    let (settings, dataset) = (DATASET.1.join("settings.txt"), path(&DATASET.1));
    let (pipe, out) = (path(&pipe), place.path().join("out"));
    let refused = |words: &[&str]| {
        let (code, message) = ends(words);
        let named = message.contains("pipe") || message.contains("expected a file");
        assert!(code == Some(2) && named, "{words:?}: {code:?} {message}");
    };
    let scan = ["--magnification", "10", "--pixel-size", "6.5", "--z-step", "1", "--out", path(&out)];
    let planes = place.path().join("planes");
    std::fs::create_dir(&planes).unwrap();
    make(&planes.join("a.tif"));
    for words in [
        vec!["sweep", pipe, "--list"],
        vec!["render", pipe, pipe, path(&out)],
        vec!["render", path(&settings), pipe, path(&out)],
        [&["fit", pipe], &scan[..]].concat(),
        [&["fit", path(&planes)], &scan[..]].concat(),
        vec!["evaluate", dataset, pipe],
    ] {
        refused(&words);
    }
    // Named by a scenario.
    for (from, to) in [
        ("pixel_dim_x: 90, pixel_dim_y: 70, points_per_pixel: 4", format!("settings: {pipe:?}")),
        ("field: poiseuille()", format!("field: gridded(file: {pipe:?})")),
        ("flow(field: poiseuille())", format!("tracks(file: {pipe:?})")),
    ] {
        let scenario = write(place.path(), "pipe.ron", SCENARIO.replace(from, &to).as_bytes());
        refused(&["generate", path(&scenario), "--out", path(&out)]);
    }
    // Within a dataset.
    let (copy, found) = (place.path().join("copy"), place.path().join("found.csv"));
    run(&["generate", path(&DATASET.1.join("scenario.ron")), "--out", path(&copy), "--quiet"]);
    let image = copy.join("images/frame_00000.tif");
    std::fs::remove_file(&image).unwrap();
    make(&image);
    refused(&["track", path(&copy), "--method", "spots", "--out", path(&found)]);
}

#[test]
fn images_that_show_nothing_or_saturate_are_told() {
    let place = tempfile::tempdir().unwrap();
    let scenario = write(place.path(), "s.ron", SCENARIO.as_bytes());
    for (set, expected) in [
        ("optics.gain=0", "the particles emit no light"),
        ("optics.gain=1000", "have pixels saturated at 65535 counts"),
        ("particles.number=count(0)", "no particle is in view"),
    ] {
        let out = place.path().join(expected);
        let command = [
            "generate",
            path(&scenario),
            "--out",
            path(&out),
            "--set",
            set,
            "--set",
            "timing.sequence.frames=2",
        ];
        let said = microsig().args(command).output().unwrap();
        let text = String::from_utf8_lossy(&said.stderr);
        assert!(said.status.success() && text.contains(expected), "{set}: {text}");
    }
}
