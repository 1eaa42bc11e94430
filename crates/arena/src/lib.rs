//! What an organizer needs, on the public interfaces of the other crates: reports and comparisons of scores
//! ([`report`]), challenges with a withheld truth ([`release`]), scores and leaderboards of whole suites ([`suite`]).

pub mod package;
pub mod release;
pub mod report;
pub mod suite;
