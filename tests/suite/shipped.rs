//! Every scenario and sweep in `scenarios/` runs, verifies, and is reproducible byte for byte, on small
//! images with few frames.

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use suite::microsig::{json, path, run, write};

fn shipped() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios");
    let mut files: Vec<PathBuf> = std::fs::read_dir(&folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.extension() == Some("ron".as_ref()))
        .collect();
    files.sort();
    assert!(files.len() >= 4, "{files:?}");
    files
}

/// Assignments that make a scenario small.
fn smaller(text: &str) -> Vec<&'static str> {
    let code: String = text.lines().filter(|line| !line.trim_start().starts_with("//")).collect();
    // Particles with a minimum distance need space, and a cylinder needs a view beyond it.
    let (width, height) = match code.contains("apart") || code.contains("stokes_cylinder") {
        true => ("optics.pixel_dim_x=240", "optics.pixel_dim_y=160"),
        false => ("optics.pixel_dim_x=64", "optics.pixel_dim_y=48"),
    };
    let mut sets =
        vec![width, height, "optics.points_per_pixel=5", "boundaries.margin_px=20", "calibration=none"];
    for (word, set) in [
        ("pairs(", "timing.pairs.count=2"),
        ("sequence(", "timing.sequence.frames=3"),
        ("four_pulse(", "timing.four_pulse.count=1"),
        ("number: count(", "particles.number.count=5"),
    ] {
        sets.extend(code.contains(word).then_some(set));
    }
    sets
}

#[test]
#[ignore = "slow: .ci/full"]
fn every_shipped_scenario_can_be_made_again_byte_for_byte() {
    shipped().into_par_iter().for_each(|file| {
        let place = tempfile::tempdir().unwrap();
        let text = std::fs::read_to_string(&file).unwrap();
        let is_complete =
            text.starts_with("// Question:") && text.contains("// Expected:") && text.contains("// Cost:");
        assert!(is_complete, "{}", file.display());
        // By default the folder has the name of the dataset, so a sweep must not have the name of its base.
        let name = format!("\n    name: \"{}\",\n", file.file_stem().unwrap().to_string_lossy());
        assert!(text.contains(&name), "{}", file.display());
        if text.contains("axes:") {
            return sweep(place.path(), &file, &text);
        }
        let out = place.path().join(file.file_stem().unwrap());
        let sets = smaller(&text);
        let mut arguments = vec!["generate", "--threads", "1", path(&file), "--out", path(&out)];
        arguments.extend(sets.iter().flat_map(|set| ["--set", set]));
        run(&arguments);
        run(&["verify", "--threads", "1", path(&out), "--regenerate"]);
    });
}

/// Runs a sweep with the same cases over a small base, and regenerates its first and last case.
fn sweep(place: &Path, file: &Path, text: &str) {
    let base = text.split("base: \"").nth(1).and_then(|rest| rest.split('"').next()).unwrap();
    let whole = file.with_file_name(base);
    let small = place.join("small");
    let sets = smaller(&std::fs::read_to_string(&whole).unwrap());
    let mut arguments = vec!["generate", path(&whole), "--out", path(&small)];
    arguments.extend(sets.iter().flat_map(|set| ["--set", set]));
    run(&arguments);
    let name = format!("{}-sweep", file.file_stem().unwrap().to_string_lossy());
    let sweep = write(place, &format!("{name}.ron"), text.replace(base, "small/scenario.ron"));
    let listed: serde_json::Value = json(&["sweep", path(&sweep), "--list"]);
    let cases = listed.as_array().unwrap().len();
    let out = place.join(&name);
    for k in [1, cases] {
        run(&["sweep", path(&sweep), "--out", path(&out), "--shard", &format!("{k}/{cases}")]);
        run(&["verify", path(&out.join(format!("case_{:05}", k - 1))), "--regenerate"]);
    }
    std::fs::remove_dir_all(&small).unwrap();
}
