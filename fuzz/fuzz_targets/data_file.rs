//! MicroSIG's data file in its four layouts: writing and reading again gives the same particles.
#![no_main]

use microsig_core::formats::data_file::{self, Layout};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let Ok(particles) = data_file::read(bytes, "fuzz") else { return };
    let mut written = Vec::new();
    data_file::write(&mut written, &particles, Layout::of(&particles)).unwrap();
    assert_eq!(data_file::read(&written[..], "fuzz").unwrap(), particles);
});
