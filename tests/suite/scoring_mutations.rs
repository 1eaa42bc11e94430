//! Malicious inputs of the scorer, without nightly tools: valid files with changed, deleted and duplicated
//! bytes never cause a panic or unbounded reading. The fuzz targets `score`, `submission`, `manifest` and
//! `truth_table` do the same with coverage.

use std::io::Write;

use bench::release::{Submission, SubmissionFiles};
use bench::report::parse_score;
use dataset::manifest::Manifest;
use scoring::evaluate::truth::TrueParticles;
use scoring::results::{Conventions, Limits};

use crate::scoring_hints::{scene, scores};

/// Number of mutations of each seed.
const MUTATIONS: u64 = 300;

/// Calls `read` with mutations of a file: changed bytes, deleted or duplicated pieces, truncation.
fn mutated(seed: &[u8], mut read: impl FnMut(&[u8])) {
    let mut state = 1u64;
    let mut random = |below: usize| {
        // Random numbers by Knuth's linear congruential generator.
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below.max(1)
    };
    read(seed);
    for _ in 0..MUTATIONS {
        let mut bytes = seed.to_vec();
        for _ in 0..=random(3) {
            let at = random(bytes.len());
            let end = (at + random(40)).min(bytes.len());
            match random(4) {
                0 if !bytes.is_empty() => bytes[at] = random(256) as u8,
                1 => drop(bytes.drain(at..end)),
                2 => bytes.extend_from_within(at..end),
                _ => bytes.truncate(at),
            }
        }
        read(&bytes);
    }
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
    let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
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
