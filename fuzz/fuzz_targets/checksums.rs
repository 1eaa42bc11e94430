//! `SHA256SUMS`.
#![no_main]

use bench::dataset::checksums;

libfuzzer_sys::fuzz_target!(|text: &str| {
    let _ = checksums::read(text, "fuzz");
});
