//! `--set path=value`: the change is refused or reads back.
#![no_main]

use bench::scenario::{TEMPLATE, assignment, parse, set, write};

libfuzzer_sys::fuzz_target!(|text: &str| {
    let Ok((path, value)) = assignment(text) else { return };
    let template = parse(TEMPLATE, "template").unwrap();
    let Ok(spec) = set(&template, path, value) else { return };
    let written = write(&spec).unwrap();
    assert_eq!(write(&parse(&written, "written").unwrap()).unwrap(), written);
});
