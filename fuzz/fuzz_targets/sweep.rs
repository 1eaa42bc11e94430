//! Sweeps over the template: every case of an accepted sweep has a scenario or an error.
#![no_main]

use std::sync::LazyLock;

use scenario::{parse_sweep, template};

static FOLDER: LazyLock<tempfile::TempDir> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("base.ron"), template().unwrap()).unwrap();
    folder
});

libfuzzer_sys::fuzz_target!(|text: &str| {
    let Ok(sweep) = parse_sweep(text, "fuzz", FOLDER.path(), None) else { return };
    for case in sweep.cases.iter().take(3) {
        let _ = sweep.scenario(case);
    }
});
