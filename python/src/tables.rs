//! Image tables that stay in the process, so that calls with the same optics do not build them again.

use std::sync::{Arc, LazyLock, Mutex};

use microsig_core::render::{Context, TableStore};

/// Memory above which the tables used least recently are dropped, bytes: 256 MiB.
const MEMORY: usize = 256 << 20;

/// Descriptions and bytes of tables, the latest last.
#[derive(Debug, Default)]
struct KeptTables(Mutex<Vec<(String, Arc<Vec<u8>>)>>);

/// In a forked process the lock may belong to a thread of the parent: it is never waited for.
impl TableStore for KeptTables {
    fn load(&self, description: &str) -> Option<Vec<u8>> {
        let mut all = self.0.try_lock().ok()?;
        let at = all.iter().position(|(of, _)| of == description)?;
        all[at..].rotate_left(1);
        let found = Arc::clone(&all.last()?.1);
        drop(all);
        Some(found.to_vec())
    }

    fn save(&self, description: &str, bytes: &[u8]) {
        let Ok(mut all) = self.0.try_lock() else { return };
        all.push((description.to_owned(), Arc::new(bytes.to_vec())));
        while all.iter().map(|(_, bytes)| bytes.len()).sum::<usize>() > MEMORY {
            all.remove(0);
        }
    }
}

/// Renderers keep their tables in this process.
pub(crate) fn context() -> Context {
    static KEPT: LazyLock<Arc<KeptTables>> = LazyLock::new(Arc::default);
    Context { tables: Some(Arc::clone(&KEPT) as _), ..Context::default() }
}
