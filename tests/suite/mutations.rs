//! Hostile inputs, without nightly tools: valid files with changed, deleted and duplicated bytes and words never
//! cause a panic, unbounded reading or a run without end. The fuzz targets search the same parsers with
//! coverage.

use std::io::{Cursor, Write};

use arena::release::{Submission, SubmissionFiles};
use arena::report::parse_score;
use dataset::manifest::Manifest;
use flows::RecordedTracks;
use flows::scale::Scale;
use flows::velocity_grid::{GridGeometry, VelocityGrid};
use microsig_core::formats::{data_file, settings_file, tiff};
use microsig_core::render::Context;
use scoring::evaluate::truth::TrueParticles;
use scoring::results::{Conventions, Limits};

use crate::scoring_hints::{scene, scores};

const SCENARIO: &str = r#"(
    name: "hostile",
    optics: (pixel_dim_x: 96, pixel_dim_y: 64, depth_factor: 1.0),
    motion: flow(field: poiseuille(max_speed_um_s: 1290)),
    particles: (number: count(6), diameter_um: normal(mean: 2, sd: 0.1, min: 1, max: 3)),
    boundaries: (z_um: (-40, 20)),
    timing: pairs(count: 1, dt_s: 0.005),
    truth: (gradient: true, boxes: true),
)"#;

const SWEEP: &str = r#"(
    name: "hostile-sweep",
    base: "hostile.ron",
    axes: [(path: "optics.background_noise", values: list([0, 10])), (path: "seed", values: linear(from: 1, to: 2, count: 2))],
)"#;

/// Replacements for a number or word.
const HOSTILE: [&str; 22] = [
    "1e308",
    "-1e308",
    "1e-320",
    "NaN",
    "inf",
    "-1",
    "0",
    "4294967296",
    "18446744073709551615",
    "99999999999999999999",
    "\"\"",
    "()",
    "[",
    ")",
    "{}",
    "\u{0}",
    "\u{feff}",
    "None",
    "../../x",
    "=1+1",
    "true",
    "1e9",
];

/// A file with one to four changes: flipped bits, deleted or duplicated pieces, hostile words.
fn mutation(seed: &[u8], random: &mut impl FnMut(usize) -> usize) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    for _ in 0..=random(4) {
        if bytes.is_empty() {
            break;
        }
        let at = random(bytes.len());
        let behind = |longest: usize| (at + 1 + longest).min(bytes.len());
        match random(7) {
            0 => bytes[at] ^= 1 << random(8),
            1 => bytes.truncate(at),
            2 => drop(bytes.drain(at..behind(random(20)))),
            3 => {
                let part = bytes[at..behind(random(200))].to_vec();
                let to = random(bytes.len());
                bytes.splice(to..to, part);
            }
            4 => drop(bytes.splice(at..at, HOSTILE[random(HOSTILE.len())].bytes())),
            // Instead of a number or word.
            _ => {
                let part_of = |byte: &u8| byte.is_ascii_alphanumeric() || b"._-+".contains(byte);
                let start = bytes[..at].iter().rposition(|byte| !part_of(byte)).map_or(0, |i| i + 1);
                let end = bytes[at..].iter().position(|byte| !part_of(byte)).map_or(bytes.len(), |i| at + i);
                bytes.splice(start..end.max(start), HOSTILE[random(HOSTILE.len())].bytes());
            }
        }
    }
    bytes
}

/// A file and mutations of it.
fn mutations(seed: &[u8], count: usize) -> impl Iterator<Item = Vec<u8>> {
    let mut state = 1u64;
    let mut random = move |below: usize| {
        // Random numbers by Knuth's linear congruential generator.
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below.max(1)
    };
    std::iter::once(seed.to_vec()).chain((0..count).map(move |_| mutation(seed, &mut random)))
}

/// Calls `read` with a file and many mutations of it.
fn mutated(seed: &[u8], mut read: impl FnMut(&[u8])) {
    mutations(seed, 300).for_each(|bytes| read(&bytes));
}

fn text(bytes: &[u8], read: impl FnOnce(&str)) {
    if let Ok(text) = std::str::from_utf8(bytes) {
        read(text);
    }
}

#[test]
fn scores_manifests_and_submissions_are_read_as_hostile_input() {
    let (truth, points) = scene();
    let score = serde_json::to_string(&scores(&truth, &points)).unwrap();
    assert!(parse_score(&score).is_ok());
    mutated(score.as_bytes(), |bytes| text(bytes, |text| drop(parse_score(text))));
    let manifest = r#"{ "name": "a", "microsig": { "timing": { "mode": "pairs", "pairs": 3 }, "depth_range_um": [-5, 5] },
        "resources": [ { "path": "truth/tracks.csv", "bytes": 1, "hash": "sha256:12" } ] }"#;
    assert!(Manifest::parse(manifest, "m").is_ok());
    mutated(manifest.as_bytes(), |bytes| text(bytes, |text| drop(Manifest::parse(text, "m"))));
    let about = r#"{ "team": "A", "method": "m", "version": "1", "params": { "a": [1, {}] }, "runtime_s": 1.5,
        "hardware": "h", "coordinate_declaration": "c", "images_sha256": "0" }"#;
    assert!(Submission::parse(about).is_ok());
    mutated(about.as_bytes(), |bytes| text(bytes, |text| drop(Submission::parse(text))));
    // Deeply nested JSON gives an error, not a stack overflow.
    let deep = "[".repeat(200_000);
    assert!(parse_score(&deep).is_err() && Manifest::parse(&deep, "m").is_err());
}

#[test]
fn archives_and_tables_of_the_truth_are_read_as_hostile_input() {
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("team.zip");
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for (name, text) in [("results.csv", "frame,track,x_px,y_px\n0,1,2,3\n"), ("submission.json", "{}")] {
        zip.start_file(name, zip::write::SimpleFileOptions::default()).unwrap();
        zip.write_all(text.as_bytes()).unwrap();
    }
    let seed = zip.finish().unwrap().into_inner();
    let limits = Limits { bytes: 1 << 16, rows: 100 };
    mutated(&seed, |bytes| {
        std::fs::write(&path, bytes).unwrap();
        drop(SubmissionFiles::open(&path, limits));
    });
    let path = place.path().join("truth.csv");
    let table =
        "frame,t_s,track,x_px,y_px,z_um,visible,snr\n0,0.0,1,2.5,3.5,-1,1,4\n1,0.1,1,2.6,3.5,-1,0,5\n";
    mutated(table.as_bytes(), |bytes| {
        std::fs::write(&path, bytes).unwrap();
        drop(TrueParticles::read(&path, &Conventions::default()));
    });
}

#[test]
fn scenarios_and_sweeps_are_read_as_hostile_input() {
    let place = tempfile::tempdir().unwrap();
    std::fs::write(place.path().join("hostile.ron"), SCENARIO).unwrap();
    mutated(SCENARIO.as_bytes(), |bytes| {
        text(bytes, |text| {
            if let Ok(spec) = scenario::parse(text, "m") {
                drop(scenario::resolve(spec, place.path(), &Context::default()));
            }
        });
    });
    assert_eq!(scenario::parse_sweep(SWEEP, "m", place.path(), None).unwrap().cases.len(), 4);
    mutated(SWEEP.as_bytes(), |bytes| {
        text(bytes, |text| {
            if let Ok(sweep) = scenario::parse_sweep(text, "m", place.path(), None) {
                sweep.cases.iter().take(3).for_each(|case| drop(sweep.scenario(case)));
            }
        });
    });
}

#[test]
fn settings_particles_images_grids_and_tracks_are_read_as_hostile_input() {
    let mut settings = Vec::new();
    settings_file::write(&mut settings, &microsig_core::Settings::setting1()).unwrap();
    mutated(&settings, |bytes| drop(settings_file::read(bytes, "m")));
    mutated(b"25 20 -30 2\n10;10;0;2;0.5\n25 20 -30 6 3 0.4 0.7 0.5\n", |b| drop(data_file::read(b, "m")));
    let image = crate::extremes::tiff(2, (9, 7));
    mutated(&image, |bytes| drop(tiff::read(Cursor::new(bytes), "m", (9, 7))));
    let nodes = "0,0,0,1,0,0\n1,0,0,1,0,0\n0,1,0,1,0,0\n1,1,0,1,0,0\n";
    let grid = format!("x_um,y_um,z_um,u_um_s,v_um_s,w_um_s\n{nodes}");
    assert!(VelocityGrid::from_csv(grid.as_bytes()).is_ok());
    mutated(grid.as_bytes(), |bytes| drop(VelocityGrid::from_csv(bytes)));
    let grid = "# vtk DataFile Version 3.0\nx\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 2 1\nORIGIN 0 0 0\n\
                SPACING 1 1 1\nPOINT_DATA 4\nVECTORS u float\n1 0 0 1 0 0 1 0 0 1 0 0\n";
    assert!(VelocityGrid::from_vtk(grid.as_bytes(), None).is_ok());
    mutated(grid.as_bytes(), |bytes| drop(VelocityGrid::from_vtk(bytes, None)));
    let counts = std::fs::read(suite::data().join("exact/set2_zm10_counts.npy")).unwrap();
    mutated(&counts, |bytes| drop(VelocityGrid::from_npy(bytes, &GridGeometry::default())));
    let scale = Scale::new(0.645, 752, 366, 1.0).unwrap();
    let tracks = b"frame,track,x_um,y_um,z_um\n0,1,2,3,4\n1,1,3,3,4\n";
    assert!(RecordedTracks::from_csv(&tracks[..], &scale).is_ok());
    mutated(tracks, |bytes| drop(RecordedTracks::from_csv(bytes, &scale)));
}

#[test]
fn results_in_every_format_are_read_as_hostile_input() {
    let place = tempfile::tempdir().unwrap();
    let given = Conventions {
        um_per_px: Some(0.645),
        depth_um: Some((-80.0, 20.0)),
        height_px: Some(366.0),
        ..Conventions::default()
    };
    let read = |name: &str, seed: &[u8]| {
        let path = place.path().join(name);
        mutated(seed, |bytes| {
            std::fs::write(&path, bytes).unwrap();
            drop(scoring::results::read(&path, &given));
        });
    };
    read("boxes.json", br#"[{"image_id": 0, "category_id": 0, "bbox": [1, 2, 9, 8], "score": 0.5}]"#);
    let mut formats = 0;
    for entry in std::fs::read_dir(suite::data().join("formats")).unwrap() {
        let file = entry.unwrap();
        if file.file_name() != "README.md" {
            formats += 1;
            read(file.file_name().to_str().unwrap(), &std::fs::read(file.path()).unwrap());
        }
    }
    assert!(formats > 10, "{formats} files");
}

/// Runs of the whole command within 6 GiB and a minute of CPU time; what fails leaves nothing behind.
#[cfg(target_os = "linux")]
#[test]
#[ignore = "slow: .ci/full"]
fn the_command_ends_in_time_and_memory_whatever_its_input() {
    use suite::microsig::{generate, path};
    let place = tempfile::tempdir().unwrap();
    let dataset = generate(place.path(), "hostile", SCENARIO);
    std::fs::write(place.path().join("sweep.ron"), SWEEP).unwrap();
    std::fs::copy(dataset.join("truth/tracks.csv"), place.path().join("result.csv")).unwrap();
    let out = place.path().join("out");
    let at = |name: &str| place.path().join(name).display().to_string();
    let (dataset, result, particles) = (path(&dataset), at("result.csv"), at("hostile/particles"));
    let (scenario, sweep, settings) = (at("hostile.ron"), at("sweep.ron"), at("hostile/settings.txt"));
    for (file, arguments) in [
        ("hostile.ron", vec!["generate", &scenario, "--out", path(&out)]),
        ("sweep.ron", vec!["sweep", &sweep, "--out", path(&out)]),
        ("hostile/settings.txt", vec!["render", &settings, &particles, path(&out)]),
        ("hostile/particles/pair_00000_a.txt", vec!["render", &settings, &particles, path(&out)]),
        ("result.csv", vec!["evaluate", dataset, &result, "--out", path(&out)]),
        ("hostile/truth/tracks.csv", vec!["evaluate", dataset, &result, "--out", path(&out)]),
        ("hostile/datapackage.json", vec!["evaluate", dataset, &result, "--out", path(&out)]),
        ("hostile/truth/boxes.csv", vec!["export", dataset, "--format", "masks", "--out", path(&out)]),
        ("hostile/images/pair_00000_a.tif", vec!["track", dataset, "--method", "spots", "--out", path(&out)]),
        (
            "hostile/calibration/calibration.csv",
            vec!["track", dataset, "--method", "aptv", "--out", path(&out)],
        ),
    ] {
        let file = place.path().join(file);
        let seed = std::fs::read(&file).unwrap();
        let mut accepted = 0;
        for bytes in mutations(&seed, 100) {
            std::fs::write(&file, bytes).unwrap();
            let (code, message) = crate::robust::limited("-v 6291456; ulimit -t 60", &arguments);
            assert!(code.is_some_and(|code| (0..=2).contains(&code)), "{arguments:?}: {code:?} {message}");
            assert!(!message.contains("panicked"), "{arguments:?}: {message}");
            assert!(
                code == Some(0) || !message.trim().is_empty(),
                "{arguments:?}: {code:?} without a message"
            );
            accepted += u32::from(code == Some(0));
            // A sweep keeps the reasons why its cases failed.
            let left = clear(&out);
            assert!(
                code == Some(0) || arguments[0] == "sweep" || left.is_empty(),
                "{message} leaves {left:?}"
            );
        }
        assert!(accepted > 0, "{arguments:?} accepts not even the original");
        std::fs::write(&file, &seed).unwrap();
    }
}

/// Removes an output and what lies beside it for it; returns the names.
#[cfg(target_os = "linux")]
pub(crate) fn clear(out: &std::path::Path) -> Vec<String> {
    let mut names = Vec::new();
    for entry in std::fs::read_dir(out.parent().unwrap()).unwrap() {
        let (path, name) = entry.map(|e| (e.path(), e.file_name().to_string_lossy().into_owned())).unwrap();
        if name == "out" || ["out.", ".out", ".unfinished"].iter().any(|begin| name.starts_with(begin)) {
            let _ = std::fs::remove_file(&path);
            let _ = std::fs::remove_dir_all(&path);
            names.push(name);
        }
    }
    names
}
