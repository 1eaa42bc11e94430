//! `microsig view`: pages in the browser that show a scenario before it runs and a result where it fails.
//!
//! `server` answers on the loopback address only and lets nobody in who does not know the token of its
//! address; `routes` lists what can be asked for. Requests name things by numbers (`subject::Subject`
//! lists them), never by paths. The page itself is `page/`, embedded into the program by `assets`.

mod assets;
mod board;
mod body;
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
