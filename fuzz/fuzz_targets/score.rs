//! `score.json`, as `compare` reads it.
#![no_main]

use std::sync::LazyLock;

use arena::report::compare;

static FOLDER: LazyLock<tempfile::TempDir> = LazyLock::new(|| tempfile::tempdir().unwrap());

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let path = FOLDER.path().join("score.json");
    std::fs::write(&path, bytes).unwrap();
    let _ = compare(&[path.into()], &FOLDER.path().join("comparison"), true);
});
