//! Tables by depth and size, built when first needed and then shared.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, PoisonError, RwLock};

use rayon::prelude::*;

use super::build::{Draft, TableRadii};
use super::model::Model;
use super::table::Table;
use crate::particle::Particle;
use crate::render::store::store;

/// Memory of tables above which those not needed for the current image are dropped, bytes: 512 MiB.
const MEMORY: usize = 512 << 20;

/// Diameters that are multiples of 1/20 um have their own tables; others are interpolated.
const OWN_SIZES_PER_UM: f64 = 20.0;

/// Index of the range of depths, and the smallest and largest diameter (as bits, which sort like the positive
/// numbers).
type Key = (i64, u64, u64);

/// All tables of a renderer.
#[derive(Debug)]
pub(super) struct TableCache {
    pub(super) model: Model,
    farthest_px: [f64; 2],
    /// Length of a table's range of depths, um: a power of two.
    length_um: f64,
    /// Range of interpolated diameters, um: a power of two.
    sizes_um: f64,
    tables: RwLock<BTreeMap<Key, Arc<Table>>>,
}

impl TableCache {
    pub(super) fn new(model: Model, farthest_px: [f64; 2]) -> Self {
        let objective = model.pupil.system.objective;
        let px_per_um = objective.image_distance / objective.object_distance_0 / model.pixel_um;
        // For a wide aperture, light from near the rim lands far away.
        let slope = (model.pupil.radius() / objective.object_distance_0).min(0.3);
        TableCache {
            // Within a table, the edge of an image moves by about 8 px, and sizes of images differ by 2 px.
            length_um: power_of_two_below(8.0 / (px_per_um * slope)),
            sizes_um: power_of_two_below(2.0 / px_per_um),
            farthest_px,
            tables: RwLock::default(),
            model,
        }
    }

    fn key(&self, sphere: &Particle) -> Key {
        let depth = libm::floor(sphere.z_um / self.length_um) as i64;
        let d = sphere.d_um;
        let own = libm::rint(d * OWN_SIZES_PER_UM) / OWN_SIZES_PER_UM;
        let (small, large) = if (d - own).abs() < 1e-9 {
            (own, own)
        } else if d >= self.sizes_um {
            let small = libm::floor(d / self.sizes_um) * self.sizes_um;
            (small, small + self.sizes_um)
        } else {
            // Smaller diameters: ranges of a factor of two.
            let small = power_of_two_below(d);
            (small, 2.0 * small)
        };
        (depth, small.to_bits(), large.to_bits())
    }

    /// The table of a key: loaded from the store if possible, otherwise built.
    fn table(&self, key: Key) -> Table {
        let Some(store) = store() else { return self.build(key) };
        // A table that is not limited by the size of the sensor is stored for all sensors.
        let limit = self.farthest_px.map(|far| libm::ceil(far) as usize);
        let is_whole = |table: &Table| (0..2).all(|axis| table.edge_px[axis] < limit[axis]);
        let whole =
            format!("waves {} {:?} {key:?}", self.model.description(), [self.length_um, self.sizes_um]);
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
            start_um: depth as f64 * self.length_um,
            length_um: self.length_um,
            radii: if small == large { TableRadii::One(small) } else { TableRadii::Between(small, large) },
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
        draft.edges().map(|edge| edge as f64)
    }

    /// The table of each sphere; missing tables are built in parallel.
    pub(super) fn tables<'a>(&self, spheres: impl Iterator<Item = &'a Particle>) -> Vec<Arc<Table>> {
        let keys: Vec<Key> = spheres.map(|sphere| self.key(sphere)).collect();
        let mut found: BTreeMap<Key, Arc<Table>> = BTreeMap::new();
        let mut missing: BTreeSet<Key> = BTreeSet::new();
        {
            let tables = self.tables.read().unwrap_or_else(PoisonError::into_inner);
            for key in &keys {
                match tables.get(key) {
                    Some(table) => {
                        found.entry(*key).or_insert_with(|| Arc::clone(table));
                    }
                    None => {
                        missing.insert(*key);
                    }
                }
            }
        }
        if !missing.is_empty() {
            // No lock is held: another thread that needs the same table builds an identical one.
            let missing: Vec<Key> = missing.into_iter().collect();
            store().into_iter().for_each(|store| store.begun(missing.len()));
            let made: Vec<_> = missing.par_iter().map(|&key| (key, Arc::new(self.table(key)))).collect();
            found.extend(made);
            let mut tables = self.tables.write().unwrap_or_else(PoisonError::into_inner);
            tables.extend(found.iter().map(|(key, table)| (*key, Arc::clone(table))));
            if tables.values().map(|table| table.bytes()).sum::<usize>() > MEMORY {
                tables.retain(|key, _| found.contains_key(key));
            }
        }
        keys.iter().map(|key| Arc::clone(&found[key])).collect()
    }

    /// Number of tables, their memory in bytes and their largest error as a fraction of the peak.
    pub(super) fn state(&self) -> (usize, usize, f64) {
        let tables = self.tables.read().unwrap_or_else(PoisonError::into_inner);
        tables.values().fold((0, 0, 0.0), |(n, bytes, error), table| {
            (n + 1, bytes + table.bytes(), f64::max(error, table.error))
        })
    }
}

/// The largest power of two that is at most `v` > 0; the exponent may be negative.
fn power_of_two_below(v: f64) -> f64 {
    // Keeps the exponent and clears the mantissa.
    f64::from_bits(v.to_bits() & 0xFFF0_0000_0000_0000)
}
