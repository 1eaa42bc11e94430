//! Minimum distances between the initial particles.
//!
//! Spheres (disks) placed one after the other at random jam when they fill 0.3841 of the volume (0.5470 of
//! the area; Zhang and Torquato, Phys. Rev. E 88 (2013) 053312). Centers may lie on the boundary, so the
//! spheres fill a box that is larger by one diameter along each axis.

use super::{Arrangement, CHECK, Seed};
use crate::{Diameters, Error, Region, Result};
use glam::DVec3;
use std::collections::HashMap;
use std::f64::consts::PI;

/// Volume fraction that spheres fill when random placement jams.
const JAMMED_SPHERES: f64 = 0.3841;
/// Area fraction that disks fill when random placement jams.
const JAMMED_DISKS: f64 = 0.5470;

/// Checks that `number` particles can be placed in a region at random with their minimum distance. For
/// different sizes it uses the mean diameter: the true limit of the number is lower. Errors: more than the
/// number at which random placement jams.
pub(super) fn check_room(
    (gap, dims): (f64, usize),
    diameters: &Diameters,
    number: f64,
    region: &Region,
) -> Result<()> {
    let distance = diameters.mean() + gap;
    let box_size = region.size() + DVec3::splat(distance);
    let most = if dims == 2 {
        JAMMED_DISKS * box_size.x * box_size.y / (0.25 * PI * distance * distance)
    } else {
        JAMMED_SPHERES * box_size.element_product() / (PI / 6.0 * distance * distance * distance)
    };
    if distance <= 0.0 || number <= most {
        return Ok(());
    }
    let allowed = format!(
        "room for {number:.0} particles with centers {distance} um apart in {:.0} x {:.0} x {:.0} um: random \
         placement ends at {most:.0}; reduce the distance or the number",
        region.size().x,
        region.size().y,
        region.size().z
    );
    Err(CHECK.fault(if dims == 2 { "apart_in_image" } else { "apart" }, gap, &allowed))
}

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
        CHECK.fault("apart", self.gap, "a minimum distance that leaves room for all particles")
    }
}
