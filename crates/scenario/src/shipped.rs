//! The scenarios, sweeps and suites that are embedded in the program.

use std::sync::Arc;

use microsig_core::problem::Source;

use include_dir::{Dir, File, include_dir};

use super::language::text;

/// The folder `scenarios/`, found by `build.rs`.
pub static SHIPPED: Dir<'static> = include_dir!("$MICROSIG_SCENARIOS");

/// A scenario or sweep that is embedded in the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Shipped {
    /// Name of its file, without extension.
    pub name: &'static str,
    /// Its text.
    pub text: &'static str,
}

impl Shipped {
    /// The scenario or sweep of this name.
    pub fn named(name: &str) -> Option<Self> {
        shipped().into_iter().find(|shipped| shipped.name == name)
    }

    /// The question that it answers, with which its comment begins.
    pub fn question(&self) -> &'static str {
        self.text.lines().next().unwrap_or_default().trim_start_matches("// Question: ")
    }

    /// Whether it is a sweep.
    pub fn is_sweep(&self) -> bool {
        text::parse(&Arc::new(Source::file(self.name, self.text))).is_ok_and(|tree| tree.find("axes").1)
    }

    /// The embedded files that it refers to.
    pub fn files(&self) -> impl Iterator<Item = &'static File<'static>> {
        let text = self.text;
        SHIPPED.files().filter(move |file| text.contains(&format!("\"{}\"", file.path().display())))
    }
}

/// All of them, sorted by name.
pub fn shipped() -> Vec<Shipped> {
    let of = |file: &'static File<'static>| {
        Some(Shipped { name: file.path().to_str()?.strip_suffix(".ron")?, text: file.contents_utf8()? })
    };
    let mut all: Vec<Shipped> = SHIPPED.files().filter_map(of).collect();
    all.sort_unstable();
    all
}

/// Names of the suites: the folders that hold a `suite.ron`.
pub fn shipped_suites() -> Vec<&'static str> {
    let is_suite = |folder: &&Dir<'static>| SHIPPED.contains(folder.path().join("suite.ron"));
    SHIPPED.dirs().filter(is_suite).filter_map(|folder| folder.path().to_str()).collect()
}
