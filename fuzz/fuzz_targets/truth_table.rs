//! A bare table of the truth, as read by `evaluate`.
#![no_main]

use std::sync::LazyLock;

use scoring::evaluate::truth::TrueParticles;
use scoring::results::Conventions;

static FOLDER: LazyLock<tempfile::TempDir> = LazyLock::new(|| tempfile::tempdir().unwrap());

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let path = FOLDER.path().join("truth.csv");
    std::fs::write(&path, bytes).unwrap();
    let given = Conventions { um_per_px: Some(0.645), depth_um: Some((-80.0, 20.0)), ..Conventions::default() };
    let _ = TrueParticles::read(&path, &given);
});
