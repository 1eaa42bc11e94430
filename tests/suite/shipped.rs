//! Every scenario and sweep in `scenarios/` can be run, verifies, and can be made again byte for byte: on small images of few
//! frames.

use std::path::{Path, PathBuf};

use suite::microsig::{path, run};

fn shipped() -> (PathBuf, Vec<PathBuf>) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios");
    let mut files: Vec<PathBuf> = std::fs::read_dir(&folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.extension() == Some("ron".as_ref()))
        .collect();
    files.sort();
    assert!(files.len() >= 4, "{files:?}");
    (folder, files)
}

/// What makes a scenario small, whatever it is about.
fn smaller(text: &str) -> Vec<&'static str> {
    let mut sets = vec![
        "optics.pixel_dim_x=96",
        "optics.pixel_dim_y=64",
        "optics.points_per_pixel=6",
        "calibration=none",
    ];
    sets.extend(text.contains("pairs(").then_some("timing.pairs.count=2"));
    sets.extend(text.contains("sequence(").then_some("timing.sequence.frames=4"));
    sets.extend(text.contains("number: count(").then_some("particles.number.count=6"));
    sets
}

#[test]
fn every_shipped_scenario_can_be_made_again_byte_for_byte() {
    let place = tempfile::tempdir().unwrap();
    let (_, files) = shipped();
    let is_sweep = |text: &str| text.contains("axes:");
    for file in files {
        let text = std::fs::read_to_string(&file).unwrap();
        assert!(
            text.starts_with("// Question:") && text.contains("// Expected:") && text.contains("// Cost:"),
            "{}",
            file.display()
        );
        if is_sweep(&text) {
            sweep(place.path(), &file, &text);
            continue;
        }
        let out = place.path().join(file.file_stem().unwrap());
        let sets = smaller(&text);
        let mut arguments = vec!["generate", path(&file), "--out", path(&out)];
        arguments.extend(sets.iter().flat_map(|set| ["--set", set]));
        run(&arguments);
        run(&["verify", path(&out), "--regenerate"]);
    }
}

/// A sweep of the same cases over a small base: its first and last case are made again.
fn sweep(place: &Path, file: &Path, text: &str) {
    let base = text.split("base: \"").nth(1).and_then(|rest| rest.split('"').next()).unwrap();
    let whole = file.with_file_name(base);
    let small = place.join("small");
    let sets = smaller(&std::fs::read_to_string(&whole).unwrap());
    let mut arguments = vec!["generate", path(&whole), "--out", path(&small)];
    arguments.extend(sets.iter().flat_map(|set| ["--set", set]));
    run(&arguments);
    let name = format!("{}-sweep", file.file_stem().unwrap().to_string_lossy());
    let sweep = place.join(format!("{name}.ron"));
    std::fs::write(&sweep, text.replace(base, "small/scenario.ron")).unwrap();
    let listed: serde_json::Value =
        serde_json::from_str(&run(&["sweep", path(&sweep), "--list", "--json"])).unwrap();
    let cases = listed.as_array().unwrap().len();
    let out = place.join(&name);
    for k in [1, cases] {
        run(&["sweep", path(&sweep), "--out", path(&out), "--shard", &format!("{k}/{cases}")]);
        run(&["verify", path(&out.join(format!("case_{:05}", k - 1))), "--regenerate"]);
    }
    std::fs::remove_dir_all(&small).unwrap();
}
