//! Tables that outlive a renderer: a store, which a program may give in a [`Context`], keeps them from run to
//! run.
//!
//! A table depends on nothing but its description, so whoever finds it in the store has the same bytes as
//! whoever makes it.

use std::any::Any;
use std::fmt::Debug;
use std::sync::{Arc, Mutex, PoisonError};

/// Where tables of [`super::TabledRenderer`] are kept. All calls may come from many threads at
/// once.
pub trait TableStore: Debug + Send + Sync {
    /// The bytes kept under this description; `None` if there are none, or not the ones that were saved.
    fn load(&self, description: &str) -> Option<Vec<u8>>;

    /// Keeps bytes. A store that cannot keep them keeps quiet.
    fn save(&self, description: &str, bytes: &[u8]);

    /// So many tables will be made; [`TableStore::table_finished`] is called for each.
    fn tables_started(&self, tables: usize) {
        let _ = tables;
    }

    /// A table was built.
    fn table_finished(&self) {}
}

/// What a program gives its renderers to work with; clones share it.
#[derive(Debug, Clone, Default)]
pub struct Context {
    /// Keeps tables from run to run; without one, they live as long as their renderer.
    pub tables: Option<Arc<dyn TableStore>>,
    /// Transform kernels of wave optics that images of different optics share.
    pub kernels: Kernels,
}

/// Kernels that are shared; clones share them. Those not used for the longest time are dropped above 128 MiB.
#[derive(Clone, Default)]
pub struct Kernels(Arc<Mutex<Vec<Kernel>>>);

/// A count rounded up, in steps of at most an eighth or `least`, so that kernels of different optics have the
/// same.
pub(super) fn rounded(count: usize, least: usize) -> usize {
    count.next_multiple_of((count.next_power_of_two() / 16).max(least))
}

/// What a kernel follows from, its memory (bytes), and itself.
type Kernel = (Vec<u64>, usize, Arc<dyn Any + Send + Sync>);

/// Memory of shared kernels, bytes.
const KERNELS: usize = 128 << 20;

impl Debug for Kernels {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Kernels")
    }
}

impl Kernels {
    /// The kernel of a key, which also tells its type; `make` returns it and its memory, bytes.
    pub(super) fn get<T: Send + Sync + 'static>(
        &self,
        key: &[u64],
        make: impl FnOnce() -> (T, usize),
    ) -> Arc<T> {
        let lock = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let find = |all: &mut Vec<Kernel>| {
            let at = all.iter().position(|(of, ..)| of == key)?;
            // The latest is the last.
            all[at..].rotate_left(1);
            Arc::clone(&all.last()?.2).downcast().ok()
        };
        if let Some(known) = find(&mut lock()) {
            return known;
        }
        // No lock is held: another thread that needs the same makes an identical one.
        let (made, bytes) = make();
        let made = Arc::new(made);
        let mut all = lock();
        if let Some(known) = find(&mut all) {
            return known;
        }
        all.push((key.to_vec(), bytes, Arc::clone(&made) as _));
        let mut sum = 0;
        let kept = all.iter().rev().take_while(|(_, bytes, _)| {
            sum += bytes;
            sum <= KERNELS
        });
        let dropped = all.len() - kept.count();
        all.drain(..dropped);
        made
    }
}
