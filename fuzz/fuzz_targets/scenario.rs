//! Scenarios: a parsed scenario can be written and read again, and it resolves to a scenario or an error.
#![no_main]

use std::path::Path;

use microsig_core::render::Context;
use scenario::{parse, resolve, write};

libfuzzer_sys::fuzz_target!(|text: &str| {
    let Ok(spec) = parse(text, "fuzz") else { return };
    let written = write(&spec).unwrap();
    // NaN is not equal to itself, so the text is compared.
    assert_eq!(write(&parse(&written, "written").unwrap()).unwrap(), written);
    // Some fields are expensive (a sum of many waves); short texts suffice to find errors.
    if text.len() < 2000 {
        let _ = resolve(spec, Path::new("/nonexistent"), &Context::default());
    }
});
