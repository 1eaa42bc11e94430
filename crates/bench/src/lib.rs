//! The `microsig` command ([`cli`]) and the parts that only it needs: challenges ([`release`]), reports of
//! scores ([`report`]), scores of whole suites ([`suite`]), exports to other formats ([`export`]), plots of
//! flows, and the pages of `microsig view`.

pub mod cli;
pub mod export;
pub mod flow_plot;
pub mod release;
pub mod report;
pub mod suite;
#[cfg(feature = "view")]
pub mod view;
