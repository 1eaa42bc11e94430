//! The folder of a dataset as types: rows of its tables, manifest, facts about the recording.
//!
//! A table is declared once, by the struct of its row in [`rows`]; header, descriptions in the manifest,
//! writing and reading derive from it.

mod hopeless;
pub mod manifest;
mod read;
mod recording;
pub mod rows;
mod table;
mod write;

pub use hopeless::{USUAL_N_S, digits, hopeless, usual_ppp};
pub use read::{Record, TableReader, read_rows};
pub use recording::{LARGEST_UM, RecordingFacts};
pub use rows::{
    BoxRow, CalibrationRow, DepthRow, DisplacementRow, FieldRow, FrameRow, PlaneRow, ScanParticleRow,
    TrackRow, TrueFlow,
};
pub use table::{Cell, Cells, Column, Columns, MISSING, Row, Table, Values};
pub use write::{TableWriter, write_table};
