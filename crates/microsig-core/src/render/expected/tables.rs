//! Blocks by depth and size, made when they are first needed and shared from then on.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, PoisonError, RwLock};

use rayon::prelude::*;

use super::block::Block;
use super::build::{Model, Radii};
use crate::particle::Particle;

/// Memory that blocks may take before those that the current image does not need are dropped: 512 MB.
const MEMORY: usize = 512 << 20;

/// Sizes that are whole multiples of 1/20 um have tables of their own; others are interpolated between.
const OWN_SIZES_PER_UM: f64 = 20.0;

/// Number of a range of depths, and the smallest and largest diameter (bits, which order as positive numbers do).
type Key = (i64, u64, u64);

/// All blocks of a renderer.
#[derive(Debug)]
pub(super) struct Tables {
    pub(super) model: Model,
    /// Depth of a block, um: a power of two.
    length_um: f64,
    /// Range of interpolated diameters, um: a power of two.
    sizes_um: f64,
    blocks: RwLock<BTreeMap<Key, Arc<Block>>>,
}

impl Tables {
    pub(super) fn new(model: Model) -> Self {
        let objective = model.pupil.system.objective;
        let px_per_um = objective.image_distance / objective.object_distance_0 / model.pupil.pixel_size;
        // Of a wide aperture, light from near the rim lands far outside.
        let aperture_slope = (objective.aperture_radius / objective.object_distance_0).min(0.3);
        Tables {
            // Over a block the edge of an image moves by about 4 px; sizes differ by 2 px in the image.
            length_um: power_of_two_below(4.0 / (px_per_um * aperture_slope)),
            sizes_um: power_of_two_below(2.0 / px_per_um),
            blocks: RwLock::default(),
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
            // Below that, ranges of a factor of two.
            let small = power_of_two_below(d);
            (small, 2.0 * small)
        };
        (depth, small.to_bits(), large.to_bits())
    }

    fn build(&self, (depth, small, large): Key) -> Block {
        let (small, large) = (0.5 * f64::from_bits(small), 0.5 * f64::from_bits(large));
        let radii = if small == large { Radii::One(small) } else { Radii::Between(small, large) };
        self.model.block(depth as f64 * self.length_um, self.length_um, radii)
    }

    /// The block of each of these spheres; those that are missing are made, in parallel.
    pub(super) fn blocks<'a>(&self, spheres: impl Iterator<Item = &'a Particle>) -> Vec<Arc<Block>> {
        let keys: Vec<Key> = spheres.map(|sphere| self.key(sphere)).collect();
        let mut found: BTreeMap<Key, Arc<Block>> = BTreeMap::new();
        let mut missing: BTreeSet<Key> = BTreeSet::new();
        {
            let blocks = self.blocks.read().unwrap_or_else(PoisonError::into_inner);
            for key in &keys {
                match blocks.get(key) {
                    Some(block) => {
                        found.entry(*key).or_insert_with(|| Arc::clone(block));
                    }
                    None => {
                        missing.insert(*key);
                    }
                }
            }
        }
        if !missing.is_empty() {
            // No lock is held meanwhile: whoever else needs the same block makes the same block.
            let missing: Vec<Key> = missing.into_iter().collect();
            let made: Vec<_> = missing.par_iter().map(|&key| (key, Arc::new(self.build(key)))).collect();
            found.extend(made);
            let mut blocks = self.blocks.write().unwrap_or_else(PoisonError::into_inner);
            blocks.extend(found.iter().map(|(key, block)| (*key, Arc::clone(block))));
            if blocks.values().map(|block| block.bytes()).sum::<usize>() > MEMORY {
                blocks.retain(|key, _| found.contains_key(key));
            }
        }
        keys.iter().map(|key| Arc::clone(&found[key])).collect()
    }

    /// Number of blocks, their memory in bytes and the largest error found in any of them.
    pub(super) fn state(&self) -> (usize, usize, f64) {
        let blocks = self.blocks.read().unwrap_or_else(PoisonError::into_inner);
        blocks.values().fold((0, 0, 0.0), |(n, bytes, error), block| {
            (n + 1, bytes + block.bytes(), f64::max(error, block.error))
        })
    }
}

/// The largest power of two (of any sign of exponent) that is at most `v` > 0.
fn power_of_two_below(v: f64) -> f64 {
    // The exponent alone, without the digits behind it.
    f64::from_bits(v.to_bits() & 0xFFF0_0000_0000_0000)
}
