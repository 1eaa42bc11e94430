//! The language that scenarios and sweeps are written in: RON or JSON, described by one schema.
//!
//! [`schema`] describes it, [`text`] parses it, [`read`](read()) checks the tree against the schema and finds
//! problems ([`microsig_core::problem`]), [`graft`] replaces values, [`literal`] reads single values without the
//! schema; [`template`] and [`document`] generate documentation.

pub(crate) mod derive;
pub(crate) mod document;
pub(crate) mod graft;
pub(crate) mod literal;
mod read;
pub(crate) mod schema;
pub(crate) mod template;
#[cfg(test)]
mod tests;
pub(crate) mod text;
pub(crate) mod write;

use microsig_core::problem::{Problem, Problems};
use serde::de::DeserializeOwned;

use schema::Schema;
use text::Node;

/// Converts a tree to a typed value, without invalid values; `None` if required ones are missing.
pub(crate) fn typed<T: DeserializeOwned>(
    root: Schema<'_>,
    node: &Node,
    problems: &mut Problems,
) -> Option<T> {
    let value = read::read(root, node, problems)?;
    // The schema is derived from the type, so a value that fits one fits the other.
    serde_json::from_value(value)
        .map_err(|e| problems.push(Problem::other("", e.to_string()).at(&node.place)))
        .ok()
}
