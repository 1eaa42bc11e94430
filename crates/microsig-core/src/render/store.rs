//! Tables that outlive a renderer: a store, which a program may give in a [`Context`], keeps them from run to
//! run.
//!
//! A table depends on nothing but its description, so whoever finds it in the store has the same bytes as
//! whoever makes it.

use std::fmt::Debug;
use std::sync::Arc;

/// Where tables of [`super::TabledRenderer`] are kept. All calls may come from many threads at
/// once.
pub trait TableStore: Debug + Send + Sync {
    /// The bytes kept under this description; `None` if there are none, or not the ones that were saved.
    fn load(&self, description: &str) -> Option<Vec<u8>>;

    /// Keeps bytes. A store that cannot keep them keeps quiet.
    fn save(&self, description: &str, bytes: &[u8]);

    /// So many tables will be made; [`TableStore::made`] is called for each.
    fn begun(&self, tables: usize) {
        let _ = tables;
    }

    /// One of them is there.
    fn made(&self) {}
}

/// What a program gives its renderers to work with; clones share it.
#[derive(Debug, Clone, Default)]
pub struct Context {
    /// Keeps tables from run to run; without one, they live as long as their renderer.
    pub tables: Option<Arc<dyn TableStore>>,
}

/// Numbers as bytes, the lowest byte first.
#[derive(Debug, Default)]
pub(super) struct Writer(pub(super) Vec<u8>);

impl Writer {
    pub(super) fn whole(&mut self, value: usize) {
        self.0.extend((value as u64).to_le_bytes());
    }

    pub(super) fn number(&mut self, value: f64) {
        self.0.extend(value.to_le_bytes());
    }

    pub(super) fn numbers(&mut self, values: &[f64]) {
        self.whole(values.len());
        values.iter().for_each(|value| self.number(*value));
    }

    pub(super) fn singles(&mut self, values: &[f32]) {
        self.whole(values.len());
        self.0.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    }
}

/// Reads what [`Writer`] writes; `None` where bytes are missing.
#[derive(Debug)]
pub(super) struct Reader<'a>(pub(super) &'a [u8]);

impl Reader<'_> {
    fn eight(&mut self) -> Option<[u8; 8]> {
        let (bytes, rest) = self.0.split_first_chunk::<8>()?;
        self.0 = rest;
        Some(*bytes)
    }

    pub(super) fn whole(&mut self) -> Option<usize> {
        usize::try_from(u64::from_le_bytes(self.eight()?)).ok()
    }

    pub(super) fn number(&mut self) -> Option<f64> {
        Some(f64::from_le_bytes(self.eight()?))
    }

    pub(super) fn numbers(&mut self) -> Option<Vec<f64>> {
        let count = self.whole().filter(|count| *count <= self.0.len() / 8)?;
        (0..count).map(|_| self.number()).collect()
    }

    pub(super) fn singles(&mut self) -> Option<Vec<f32>> {
        let count = self.whole().filter(|count| *count <= self.0.len() / 4)?;
        let (bytes, rest) = self.0.split_at(4 * count);
        self.0 = rest;
        Some(bytes.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect())
    }

    /// Whether all bytes have been read.
    pub(super) fn is_done(&self) -> bool {
        self.0.is_empty()
    }
}
