//! `--set path=value`: the change is refused, or the result can be written and read again.
#![no_main]

use scenario::{Assignment, parse, set, template, write};

libfuzzer_sys::fuzz_target!(|text: &str| {
    let Ok(Assignment { path, value }) = text.parse() else { return };
    let base = parse(&template().unwrap(), "template").unwrap();
    let Ok(spec) = set(&base, &path, &value) else { return };
    let written = write(&spec).unwrap();
    assert_eq!(write(&parse(&written, "written").unwrap()).unwrap(), written);
});
