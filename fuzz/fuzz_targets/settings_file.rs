//! MicroSIG's settings file: writing and reading again gives the same settings.
#![no_main]

use microsig_core::formats::settings_file;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let Ok(file) = settings_file::read(bytes, "fuzz") else { return };
    let mut written = Vec::new();
    settings_file::write(&mut written, &file.settings).unwrap();
    assert_eq!(settings_file::read(&written[..], "fuzz").unwrap().settings, file.settings);
});
