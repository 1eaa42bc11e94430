//! Tables of a renderer by depth and size, built when first needed and then shared.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, PoisonError, RwLock};

use rayon::prelude::*;

use super::depth_table::{DepthTable, PlaneLayout};
use super::refinement::TableSpan;
use super::store::Context;
use crate::particle::Particle;

/// Memory of tables above which those not needed for the current image are dropped, bytes: 512 MiB.
const MEMORY: usize = 512 << 20;

/// Diameters that are multiples of 1/20 um have tables of their own; others are interpolated.
const OWN_SIZES_PER_UM: f64 = 20.0;

/// Index of the range of depths, and the smallest and largest diameter, um (as bits, which sort like positive
/// numbers).
pub(super) type Key = (i64, u64, u64);

/// The ranges of depth and size that one table covers, um: powers of two.
#[derive(Debug)]
pub struct TableRanges {
    pub(super) length_um: f64,
    pub(super) sizes_um: f64,
}

impl TableRanges {
    /// The largest powers of two up to these ranges, um.
    pub(super) fn up_to(length_um: f64, sizes_um: f64) -> Self {
        TableRanges { length_um: power_of_two_below(length_um), sizes_um: power_of_two_below(sizes_um) }
    }

    /// The table that a sphere needs.
    pub(super) fn key(&self, sphere: &Particle) -> Key {
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

    /// What the table of a key covers.
    pub(super) fn span(&self, (depth, small, large): Key) -> TableSpan {
        let radii = [small, large].map(|diameter| 0.5 * f64::from_bits(diameter));
        TableSpan { start_um: depth as f64 * self.length_um, length_um: self.length_um, radii }
    }
}

/// The tables built so far.
#[derive(Debug)]
pub(super) struct SharedTables<L>(RwLock<BTreeMap<Key, Arc<DepthTable<L>>>>);

/// Number of tables, their memory and their accuracy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TablesState {
    /// Number of tables.
    pub count: usize,
    /// Their memory.
    pub bytes: usize,
    /// The largest error found in any of them, relative to the peak of an image.
    pub error: f64,
}

impl<L> Default for SharedTables<L> {
    fn default() -> Self {
        SharedTables(RwLock::default())
    }
}

impl<L: PlaneLayout> SharedTables<L> {
    /// The table of each key; missing ones are made in parallel.
    pub(super) fn get(
        &self,
        keys: &[Key],
        context: &Context,
        make: impl Fn(Key) -> DepthTable<L> + Sync,
    ) -> Vec<Arc<DepthTable<L>>> {
        let known = || -> Option<Vec<_>> {
            let tables = self.0.read().unwrap_or_else(PoisonError::into_inner);
            keys.iter().map(|key| tables.get(key).cloned()).collect()
        };
        if let Some(known) = known() {
            return known;
        }
        let mut found: BTreeMap<Key, Arc<DepthTable<L>>> = BTreeMap::new();
        let mut missing: BTreeSet<Key> = BTreeSet::new();
        {
            let tables = self.0.read().unwrap_or_else(PoisonError::into_inner);
            for key in keys {
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
            // No lock is held: another thread that needs the same table makes an identical one.
            let missing: Vec<Key> = missing.into_iter().collect();
            context.tables.iter().for_each(|store| store.tables_started(missing.len()));
            let made: Vec<_> = missing.par_iter().map(|&key| (key, Arc::new(make(key)))).collect();
            found.extend(made);
            let mut tables = self.0.write().unwrap_or_else(PoisonError::into_inner);
            tables.extend(found.iter().map(|(key, table)| (*key, Arc::clone(table))));
            if tables.values().map(|table| table.bytes()).sum::<usize>() > MEMORY {
                tables.retain(|key, _| found.contains_key(key));
            }
        }
        keys.iter().map(|key| Arc::clone(&found[key])).collect()
    }

    /// Number of tables of these keys that are not made yet.
    pub(super) fn missing(&self, keys: impl Iterator<Item = Key>) -> usize {
        let tables = self.0.read().unwrap_or_else(PoisonError::into_inner);
        keys.filter(|key| !tables.contains_key(key)).collect::<BTreeSet<_>>().len()
    }

    pub(super) fn state(&self) -> TablesState {
        let tables = self.0.read().unwrap_or_else(PoisonError::into_inner);
        TablesState {
            count: tables.len(),
            bytes: tables.values().map(|table| table.bytes()).sum(),
            error: tables.values().map(|table| table.error).fold(0.0, f64::max),
        }
    }
}

/// The largest power of two that is at most `v` > 0; the exponent may be negative.
fn power_of_two_below(v: f64) -> f64 {
    // Keeps the exponent and clears the mantissa.
    f64::from_bits(v.to_bits() & 0xFFF0_0000_0000_0000)
}
