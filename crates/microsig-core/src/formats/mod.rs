//! MicroSIG's files: settings, particle data, 16-bit TIFF. All on readers and writers, none on paths.

pub mod data_file;
pub mod number;
pub mod settings_file;
pub mod tiff;
