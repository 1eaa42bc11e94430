//! File formats: MicroSIG's settings and particle data, gray TIFF images, and NumPy arrays. All functions take
//! readers and writers, not paths.

pub mod arrangement;
pub mod data_file;
mod gray;
pub mod npy;
pub mod number;
pub mod pages;
pub mod settings_file;
pub mod stack;
mod text_line;
pub mod tiff;
