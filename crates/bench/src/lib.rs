//! The `microsig` command ([`cli`]) and what it alone needs: challenges ([`release`]), reports of scores
//! ([`report`]), scores of whole suites ([`suite`]), results in the formats of others ([`export`]), plots of
//! flows and the pages of `microsig view`.

pub mod cli;
pub mod export;
pub mod flow_plot;
pub mod release;
pub mod report;
pub mod suite;
#[cfg(feature = "view")]
pub mod view;
