//! `datapackage.json`.
#![no_main]

use storage::dataset::manifest::Manifest;

libfuzzer_sys::fuzz_target!(|text: &str| {
    let _ = Manifest::parse(text, "fuzz");
});
