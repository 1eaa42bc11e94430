//! Tables by depth and size, built when first needed and then shared.

use std::sync::Arc;

use super::build::Draft;
use super::model::Model;
use super::table::Table;
use crate::particle::Particle;
use crate::render::refinement::TableRadii;
use crate::render::store::store;
use crate::render::tables::{Key, SharedTables, TableRanges};

/// All tables of a renderer.
#[derive(Debug)]
pub(super) struct TableCache {
    pub(super) model: Model,
    farthest_px: [f64; 2],
    ranges: TableRanges,
    tables: SharedTables<Table>,
}

impl TableCache {
    pub(super) fn new(model: Model, farthest_px: [f64; 2]) -> Self {
        let objective = model.pupil.system.objective;
        let px_per_um = objective.image_distance / objective.object_distance_0 / model.pixel_um;
        // For a wide aperture, light from near the rim lands far away.
        let slope = (model.pupil.radius() / objective.object_distance_0).min(0.3);
        TableCache {
            // Within a table, the edge of an image moves by about 8 px, and sizes of images differ by 2 px.
            ranges: TableRanges::up_to(8.0 / (px_per_um * slope), 2.0 / px_per_um),
            farthest_px,
            tables: SharedTables::default(),
            model,
        }
    }

    /// The table of a key: loaded from the store if possible, otherwise built.
    fn table(&self, key: Key) -> Table {
        let Some(store) = store() else { return self.build(key) };
        // A table that is not limited by the size of the sensor is stored for all sensors.
        let limit = self.farthest_px.map(|far| libm::ceil(far) as usize);
        let is_whole = |table: &Table| (0..2).all(|axis| table.edge_px[axis] < limit[axis]);
        let whole = format!(
            "waves {} {:?} {key:?}",
            self.model.description(),
            [self.ranges.length_um, self.ranges.sizes_um]
        );
        let cut = format!("{whole} {:?}", self.farthest_px);
        let load = |description: &str| Table::from_bytes(&store.load(description)?);
        let found = load(&whole).filter(is_whole).or_else(|| load(&cut));
        let table = found.unwrap_or_else(|| {
            let table = self.build(key);
            store.save(if is_whole(&table) { &whole } else { &cut }, &table.to_bytes());
            table
        });
        store.made();
        table
    }

    fn build(&self, (depth, small, large): Key) -> Table {
        let (small, large) = (0.5 * f64::from_bits(small), 0.5 * f64::from_bits(large));
        Draft {
            model: &self.model,
            start_um: depth as f64 * self.ranges.length_um,
            length_um: self.ranges.length_um,
            radii: TableRadii::new(small, large),
            farthest_px: self.farthest_px,
        }
        .table()
    }

    /// Half width and half height of a sphere's image, px, without building its table.
    pub(super) fn extent_px(&self, z_um: f64, radius_um: f64) -> [f64; 2] {
        let radii = TableRadii::One(radius_um);
        let draft = Draft {
            model: &self.model,
            start_um: z_um,
            length_um: 0.0,
            radii,
            farthest_px: self.farthest_px,
        };
        draft.extent().map(|edge| edge as f64)
    }

    /// Range of depths of a table, um.
    pub(super) fn length_um(&self) -> f64 {
        self.ranges.length_um
    }

    /// The table of each sphere; missing tables are built in parallel.
    pub(super) fn tables<'a>(&self, spheres: impl Iterator<Item = &'a Particle>) -> Vec<Arc<Table>> {
        let keys: Vec<Key> = spheres.map(|sphere| self.ranges.key(sphere)).collect();
        self.tables.get(&keys, |key| self.table(key))
    }

    /// Number of tables that these spheres need and that are not made yet.
    pub(super) fn missing<'a>(&self, spheres: impl Iterator<Item = &'a Particle>) -> usize {
        self.tables.missing(spheres.map(|sphere| self.ranges.key(sphere)))
    }

    /// Number of tables, their memory in bytes and their largest error as a fraction of the peak.
    pub(super) fn state(&self) -> (usize, usize, f64) {
        self.tables.state()
    }
}
