//! Minimum distances between the initial particles.

use super::{Arrangement, CHECK, Seed};
use crate::diameters::Diameters;
use crate::error::Error;
use glam::DVec3;
use std::collections::HashMap;

/// The particles placed so far, in a cell list whose cells are as wide as the largest minimum distance.
pub(super) struct Spacing {
    gap: f64,
    /// Number of dimensions of the distance: 3, 2 (image plane), or 0 for no minimum distance.
    dims: usize,
    cell: f64,
    members: HashMap<[i64; 3], Vec<Seed>>,
}

impl Spacing {
    pub(super) fn new(arrangement: Arrangement, diameters: &Diameters) -> Spacing {
        let (gap, dims) = match arrangement {
            Arrangement::MinimumDistance { gap, dims } if diameters.max() + gap > 0.0 => (gap, dims),
            _ => (0.0, 0),
        };
        Spacing { gap, dims, cell: diameters.max() + gap, members: HashMap::new() }
    }

    /// The position in the dimensions of the distance.
    fn place(&self, seed: &Seed) -> DVec3 {
        if self.dims == 2 { seed.position.with_z(0.0) } else { seed.position }
    }

    fn key(&self, seed: &Seed) -> [i64; 3] {
        self.place(seed).to_array().map(|x| libm::floor(x / self.cell) as i64)
    }

    pub(super) fn add(&mut self, seed: &Seed) {
        if self.dims > 0 {
            self.members.entry(self.key(seed)).or_default().push(*seed);
        }
    }

    /// Whether a particle keeps its minimum distance from all others.
    pub(super) fn admits(&self, seed: &Seed) -> bool {
        if self.dims == 0 {
            return true;
        }
        let [i, j, k] = self.key(seed);
        let near = (0..27).map(|n| [i + n % 3 - 1, j + n / 3 % 3 - 1, k + n / 9 - 1]);
        near.filter_map(|key| self.members.get(&key)).flatten().all(|other| {
            let least = 0.5 * (seed.d_um + other.d_um) + self.gap;
            least <= 0.0 || (self.place(seed) - self.place(other)).length() >= least
        })
    }

    pub(super) fn full(&self) -> Error {
        CHECK.fault("apart", self.gap, "a least distance that leaves room for all particles")
    }
}
