//! Cache of depth tables by depth and size, built when first needed and then shared.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, PoisonError, RwLock};

use rayon::prelude::*;

use super::build::{self, TableRadii};
use super::depth_table::DepthTable;
use super::image_model::ImageModel;
use crate::particle::Particle;
use crate::render::store::store;

/// Memory limit above which tables not needed by the current image are dropped: 512 MB.
const MEMORY: usize = 512 << 20;

/// Diameters that are multiples of 1/20 um have tables of their own; others are interpolated.
const OWN_SIZES_PER_UM: f64 = 20.0;

/// Number of the depth range, and the smallest and largest diameter (as bits, which sort like positive
/// numbers).
type Key = (i64, u64, u64);

/// All tables of a renderer.
#[derive(Debug)]
pub(super) struct TableCache {
    pub(super) model: ImageModel,
    /// Depth range of a table, um: a power of two.
    length_um: f64,
    /// Range of interpolated diameters, um: a power of two.
    sizes_um: f64,
    tables: RwLock<BTreeMap<Key, Arc<DepthTable>>>,
    /// Number of aperture cells per image, by table.
    cells: RwLock<BTreeMap<Key, f64>>,
}

impl TableCache {
    pub(super) fn new(model: ImageModel) -> Self {
        let objective = model.pupil.system.objective;
        let px_per_um = objective.image_distance / objective.object_distance_0 / model.pupil.pixel_size;
        // With a large aperture, light from near the rim lands far outside.
        let aperture_slope = (objective.aperture_radius / objective.object_distance_0).min(0.3);
        TableCache {
            // Over the depth range of a table the edge of an image moves by about 4 px; over its size range
            // the geometric image changes by 2 px.
            length_um: power_of_two_below(4.0 / (px_per_um * aperture_slope)),
            sizes_um: power_of_two_below(2.0 / px_per_um),
            tables: RwLock::default(),
            cells: RwLock::default(),
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
            // Small diameters: ranges of a factor of two.
            let small = power_of_two_below(d);
            (small, 2.0 * small)
        };
        (depth, small.to_bits(), large.to_bits())
    }

    /// The table of a key: from the store, if there is one and it holds the table, or made.
    fn table(&self, key: Key) -> DepthTable {
        let Some(store) = store() else { return self.build(key) };
        let description =
            format!("expected {} {:?} {key:?}", self.model.description(), [self.length_um, self.sizes_um]);
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
        let radii = if small == large { TableRadii::One(small) } else { TableRadii::Between(small, large) };
        build::table(&self.model, depth as f64 * self.length_um, self.length_um, radii)
    }

    /// Number of aperture cells needed for the image of this sphere at the middle of the depth range of its
    /// table.
    pub(super) fn cells(&self, sphere: &Particle) -> f64 {
        let key @ (depth, _, large) = self.key(sphere);
        let known = self.cells.read().unwrap_or_else(PoisonError::into_inner).get(&key).copied();
        known.unwrap_or_else(|| {
            let cells = self.model.cells((depth as f64 + 0.5) * self.length_um, 0.5 * f64::from_bits(large));
            self.cells.write().unwrap_or_else(PoisonError::into_inner).insert(key, cells);
            cells
        })
    }

    /// The table of each of these spheres; missing tables are built in parallel.
    pub(super) fn tables<'a>(&self, spheres: impl Iterator<Item = &'a Particle>) -> Vec<Arc<DepthTable>> {
        let keys: Vec<Key> = spheres.map(|sphere| self.key(sphere)).collect();
        let mut found: BTreeMap<Key, Arc<DepthTable>> = BTreeMap::new();
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
            // No lock is held here; another thread that needs the same table builds an identical one.
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

    /// Number of tables, their memory in bytes and the largest error found in any of them.
    pub(super) fn state(&self) -> (usize, usize, f64) {
        let tables = self.tables.read().unwrap_or_else(PoisonError::into_inner);
        tables.values().fold((0, 0, 0.0), |(n, bytes, error), table| {
            (n + 1, bytes + table.bytes(), f64::max(error, table.error))
        })
    }
}

/// The largest power of two that is at most `v` > 0.
fn power_of_two_below(v: f64) -> f64 {
    // The exponent with a zero mantissa.
    f64::from_bits(v.to_bits() & 0xFFF0_0000_0000_0000)
}
