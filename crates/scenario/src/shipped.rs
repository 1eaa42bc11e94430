//! The scenarios, sweeps and suites that are embedded in the program.

use include_dir::{Dir, include_dir};

/// The folder `scenarios/`, found by `build.rs`.
pub static SHIPPED: Dir<'static> = include_dir!("$MICROSIG_SCENARIOS");

/// Name and text of each scenario and sweep, sorted by name.
pub fn shipped() -> Vec<(&'static str, &'static str)> {
    let mut all: Vec<_> = SHIPPED
        .files()
        .filter_map(|file| Some((file.path().to_str()?.strip_suffix(".ron")?, file.contents_utf8()?)))
        .collect();
    all.sort_unstable();
    all
}

/// Names of the suites: the folders that hold a `suite.ron`.
pub fn shipped_suites() -> Vec<&'static str> {
    let is_suite = |folder: &&Dir<'static>| SHIPPED.contains(folder.path().join("suite.ron"));
    SHIPPED.dirs().filter(is_suite).filter_map(|folder| folder.path().to_str()).collect()
}
