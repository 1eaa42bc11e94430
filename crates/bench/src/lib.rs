//! The `microsig` command ([`cli`]) and the parts that only it needs: exports to other formats ([`export`]),
//! fits with their reports ([`fitting`]), plots of flows, digital twins of recordings, and the pages of `microsig view`.
#![allow(missing_docs, reason = "the command is what users see; fields are named after what they are")]

pub mod cli;
pub mod export;
pub mod fitting;
pub mod flow_plot;
pub mod optics;
pub mod twin;
#[cfg(feature = "view")]
pub mod view;
