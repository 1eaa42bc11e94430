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
