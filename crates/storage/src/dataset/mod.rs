//! Datasets as types, in a folder or in memory: rows of their tables, manifest, facts about the recording.
//!
//! A table is declared once, by the struct of its row in [`rows`]; header, descriptions in the manifest,
//! writing and reading derive from it.

pub mod cases;
mod hopeless;
pub mod manifest;
mod place;
mod read;
mod recording;
pub mod rows;
pub mod secret;
mod table;
mod true_flow;
mod write;

pub use hopeless::{USUAL_N_S, digits, hopeless, usual_ppp};
pub use place::{DatasetInMemory, DatasetPlace};
pub use read::{Record, TableReader, check_frame, check_position, read_rows};
pub use recording::{LARGEST_UM, RecordingFacts};
pub use rows::{
    BoxRow, CalibrationRow, DepthRow, DisplacementRow, FieldRow, FrameRow, PlaneRow, ScanParticleRow,
    TrackRow,
};
pub use table::{Cell, Cells, Column, Columns, MISSING, Row, Table, Values};
pub use true_flow::{ImageFlow, TrueFlow};
pub use write::{TableWriter, write_table};
