//! `microsig view`: pages in the browser that show a scenario before it is generated, datasets, and the
//! errors of results.
//!
//! `server` listens on the loopback address only and refuses requests without the token in its address;
//! `routes` lists the requests. Requests refer to datasets and results by index (in the lists of
//! `subject::Subject`), never by path. The page itself is `page/`, embedded in the program.

mod board;
mod columns;
mod dataset;
mod editor;
mod export;
mod keys;
mod optics;
mod preview;
mod result;
mod routes;
mod server;
mod state;
mod subject;
#[cfg(test)]
mod tests;

pub use export::{ExportOptions, Exported, export};
pub use server::{Served, ViewOptions, serve};
pub use subject::Subject;
