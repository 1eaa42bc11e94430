//! `cargo xtask figures`: the pictures of the documentation.

mod flows;
mod keys;
mod paper;

use std::path::Path;

use clap::ValueEnum;

/// What there is to draw.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Kind {
    /// Fig. 3 and 4 of Rossi 2020 with our renderer, into target/figures.
    Paper,
    /// The gallery of all velocity fields, docs/flows.
    Flows,
    /// The reference of all keys, docs/scenario.md, and what they do to the image.
    Keys,
}

impl Kind {
    /// Where they go unless told otherwise.
    fn folder(self) -> &'static Path {
        Path::new(match self {
            Kind::Paper => "target/figures",
            Kind::Flows => "docs/flows",
            Kind::Keys => "docs",
        })
    }
}

/// Draws one kind of figures, or all; `redraw`: also those of keys that are there.
pub(crate) fn run(kind: Option<Kind>, out: Option<&Path>, redraw: bool) -> anyhow::Result<()> {
    let kinds = kind.as_ref().map_or(Kind::value_variants(), std::slice::from_ref);
    for kind in kinds {
        let out = out.unwrap_or(kind.folder());
        match kind {
            Kind::Paper => paper::run(out)?,
            Kind::Flows => flows::run(out)?,
            Kind::Keys => keys::run(out, redraw)?,
        }
    }
    Ok(())
}
