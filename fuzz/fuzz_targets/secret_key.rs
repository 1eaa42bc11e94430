//! `secret_key.txt` of a withheld test split.
#![no_main]

use std::sync::LazyLock;

use storage::dataset::secret;

static FOLDER: LazyLock<tempfile::TempDir> = LazyLock::new(|| tempfile::tempdir().unwrap());

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    std::fs::write(FOLDER.path().join("secret_key.txt"), bytes).unwrap();
    let _ = secret::streams(FOLDER.path());
});
