//! Scenarios: what can be read can be written and read again, and resolving it is an error or a scenario.
#![no_main]

use std::path::Path;

use bench::scenario::{parse, resolve, write};

libfuzzer_sys::fuzz_target!(|text: &str| {
    let Ok(spec) = parse(text, "fuzz") else { return };
    let written = write(&spec).unwrap();
    // NaN is not equal to itself, so the text is compared.
    assert_eq!(write(&parse(&written, "written").unwrap()).unwrap(), written);
    // A field may ask for much work (a sum of many waves); short texts are enough to find mistakes.
    if text.len() < 2000 {
        let _ = resolve(spec, Path::new("/nonexistent"));
    }
});
