//! `calibration/calibration.csv` of a dataset, as trackers read it.
#![no_main]

use std::path::PathBuf;
use std::sync::LazyLock;

use microsig_core::render::Context;

use generator::runner::{GenerateOptions, generate};
use storage::Progress;

/// Five depths, so that the stack of the dataset itself is valid.
const SCENARIO: &str = r#"(
    name: "stack",
    optics: (pixel_dim_x: 32, pixel_dim_y: 32, points_per_pixel: 2, n_rays: 10),
    motion: flow(field: poiseuille()),
    particles: (number: count(1)),
    boundaries: (z_um: (-20, 0)),
    timing: pairs(count: 1),
    calibration: every_um(5),
)"#;

static DATASET: LazyLock<(tempfile::TempDir, PathBuf)> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("stack");
    let scenario = scenario::load_text(SCENARIO, ("stack.ron", folder.path()), &[], None, &Context::default())
        .unwrap();
    let options =
        GenerateOptions { out: out.clone(), force: false, resume: false, progress: Progress::default() };
    generate(&scenario, &options).unwrap();
    assert_eq!(tracking::check_calibration(&out).unwrap(), 5);
    (folder, out)
});

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let dataset = &DATASET.1;
    std::fs::write(dataset.join("calibration/calibration.csv"), bytes).unwrap();
    let _ = tracking::check_calibration(dataset);
});
