//! Cache of depth tables by depth and size, built when first needed and then shared.

use std::collections::BTreeMap;
use std::sync::{Arc, PoisonError, RwLock};

use super::build;
use super::depth_table::DepthTable;
use super::image_model::ImageModel;
use crate::particle::Particle;
use crate::render::refinement::TableRadii;
use crate::render::store::store;
use crate::render::tables::{Key, SharedTables, TableRanges};

/// All tables of a renderer.
#[derive(Debug)]
pub(super) struct TableCache {
    pub(super) model: ImageModel,
    ranges: TableRanges,
    tables: SharedTables<DepthTable>,
    /// Number of aperture cells per image, by table.
    cells: RwLock<BTreeMap<Key, f64>>,
}

impl TableCache {
    pub(super) fn new(model: ImageModel) -> Self {
        TableCache {
            // Over the depth range of a table the edge of an image moves by about 4 px; over its size range
            // the geometric image changes by 2 px.
            ranges: TableRanges::up_to(4.0 / model.edge_px_per_um(), 2.0 / model.px_per_um()),
            tables: SharedTables::default(),
            cells: RwLock::default(),
            model,
        }
    }

    /// The table of a key: from the store, if there is one and it holds the table, or made.
    fn table(&self, key: Key) -> DepthTable {
        let Some(store) = store() else { return self.build(key) };
        let description = format!(
            "expected {} {:?} {key:?}",
            self.model.description(),
            [self.ranges.length_um, self.ranges.sizes_um]
        );
        let found = store.load(&description).and_then(|bytes| DepthTable::from_bytes(&bytes));
        let table = found.unwrap_or_else(|| {
            let table = self.build(key);
            store.save(&description, &table.to_bytes());
            table
        });
        store.made();
        table
    }

    fn build(&self, (depth, small, large): Key) -> DepthTable {
        let (small, large) = (0.5 * f64::from_bits(small), 0.5 * f64::from_bits(large));
        let radii = TableRadii::new(small, large);
        build::table(&self.model, depth as f64 * self.ranges.length_um, self.ranges.length_um, radii)
    }

    /// Number of aperture cells needed for the image of this sphere at the middle of the depth range of its
    /// table.
    pub(super) fn cells(&self, sphere: &Particle) -> f64 {
        let key @ (depth, _, large) = self.ranges.key(sphere);
        let known = self.cells.read().unwrap_or_else(PoisonError::into_inner).get(&key).copied();
        known.unwrap_or_else(|| {
            let cells =
                self.model.cells((depth as f64 + 0.5) * self.ranges.length_um, 0.5 * f64::from_bits(large));
            self.cells.write().unwrap_or_else(PoisonError::into_inner).insert(key, cells);
            cells
        })
    }

    /// The table of each of these spheres; missing tables are built in parallel.
    pub(super) fn tables<'a>(&self, spheres: impl Iterator<Item = &'a Particle>) -> Vec<Arc<DepthTable>> {
        let keys: Vec<Key> = spheres.map(|sphere| self.ranges.key(sphere)).collect();
        self.tables.get(&keys, |key| self.table(key))
    }

    /// Number of tables that these spheres need and that are not made yet.
    pub(super) fn missing<'a>(&self, spheres: impl Iterator<Item = &'a Particle>) -> usize {
        self.tables.missing(spheres.map(|sphere| self.ranges.key(sphere)))
    }

    /// Number of tables, their memory in bytes and the largest error found in any of them.
    pub(super) fn state(&self) -> (usize, usize, f64) {
        self.tables.state()
    }
}
