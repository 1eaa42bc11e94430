//! Reports and comparisons of scores, pages of fits ([`report`]), challenges with a withheld truth
//! ([`release`]), scores and leaderboards of whole suites ([`suite`]), and the archives of challenges
//! ([`package`]). It uses only the public interfaces of the other crates.
#![allow(missing_docs, reason = "the command is what users see; fields are named after what they are")]

pub mod package;
pub mod release;
pub mod report;
pub mod suite;
