//! `SHA256SUMS`.
#![no_main]

use storage::checksums;

libfuzzer_sys::fuzz_target!(|text: &str| {
    let _ = checksums::read(text, "fuzz");
});
