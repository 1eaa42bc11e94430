//! `cargo xtask figures`: the figures of the documentation.

mod field;
mod flows;
mod keys;
mod microscope;
mod paper;

use std::path::Path;

use clap::ValueEnum;

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Kind {
    /// Figures 3 and 4 of Rossi (2020), into target/figures.
    Paper,
    /// The gallery of all velocity fields, docs/flows.
    Flows,
    /// The reference of all keys, docs/scenario.md, with pictures of their effects.
    Keys,
    /// Renderers side by side and a preview of optics, docs/microscope.
    Microscope,
    /// Optics that vary over the field, docs/microscope/field.
    Field,
}

impl Kind {
    /// Default output folder.
    fn folder(self) -> &'static Path {
        Path::new(match self {
            Kind::Paper => "target/figures",
            Kind::Flows => "docs/flows",
            Kind::Keys => "docs",
            Kind::Microscope => "docs/microscope",
            Kind::Field => "docs/microscope/field",
        })
    }
}

/// Draws one kind of figures, or all; with `redraw`, also existing pictures of keys.
pub(crate) fn run(kind: Option<Kind>, out: Option<&Path>, redraw: bool) -> anyhow::Result<()> {
    let kinds = kind.as_ref().map_or(Kind::value_variants(), std::slice::from_ref);
    for kind in kinds {
        let out = out.unwrap_or(kind.folder());
        match kind {
            Kind::Paper => paper::run(out)?,
            Kind::Flows => flows::run(out)?,
            Kind::Keys => keys::run(out, redraw)?,
            Kind::Microscope => microscope::run(out)?,
            Kind::Field => field::run(out)?,
        }
    }
    Ok(())
}
