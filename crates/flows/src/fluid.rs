//! The fluid region: the part of the box outside the field's own walls and all bodies.
//!
//! Particle centers stay one radius away from every wall. Seeds are squeezed away from the walls of the box
//! (see [`Domain`]); seeds that would overlap a wall of the field or a body are discarded. A density is a
//! number per volume of fluid, and a number in a view counts the particles in the fluid part of the view, so
//! the density of candidates is divided by the volume fraction accessible to centers
//! ([`FluidRegion::share`]).
//!
//! A Brownian step that ends inside a wall is reflected at the point of the wall nearest to its end. At a
//! plane wall the resulting distribution is exact; at a curved wall the relative error is of the order of the
//! step length over the radius of curvature. A step that cannot be reflected into the fluid is rejected,
//! which also keeps a uniform cloud uniform.

use crate::{Axis, Body, Domain, Region, VelocityField, Wall};
use glam::DVec3;
use microsig_core::stream::Stream;
use std::sync::{Mutex, PoisonError};

/// Maximum number of reflections of one step, and of passes over box, field and bodies when a particle is
/// moved out of walls.
const MAX_ROUNDS: u32 = 8;

/// Standard deviations by which a Brownian path at most leaves the line between its ends, with a probability
/// of 1e-14.
const BRIDGE_SD: f64 = 4.0;

/// Refinement ends when the cells cut by a wall are at most this fraction of the accessible volume.
const UNDECIDED: f64 = 1e-3;
/// Refinement also ends after this many cells.
const MAX_CELLS: f64 = 262_144.0;
/// A cell counts as solid if its center is at least this many half diagonals inside a wall. The factor allows
/// for clearances at curved or joined walls, which may exceed the true distance by up to this factor.
const SOLID_DEPTH: f64 = 3.0;

/// Volume fractions that are kept.
const MAX_KEPT: usize = 16;

/// The latest results of [`FluidRegion::share`] for one field, box and set of bodies, so that a region that
/// is seeded many times is measured once.
#[derive(Debug, Default)]
pub struct FluidFractionCache(Mutex<Vec<(Region, f64, f64, f64)>>);

impl FluidFractionCache {
    /// The fraction for a part, time and radius; `measure` computes values that are not kept.
    fn get(&self, (part, t, radius): (&Region, f64, f64), measure: impl FnOnce() -> f64) -> f64 {
        let lock = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let fits = |kept: &&(Region, f64, f64, f64)| kept.0 == *part && (kept.1, kept.2) == (t, radius);
        if let Some(kept) = lock().iter().find(fits) {
            return kept.3;
        }
        let share = measure();
        let mut kept = lock();
        if kept.len() >= MAX_KEPT {
            kept.remove(0);
        }
        kept.push((*part, t, radius, share));
        share
    }
}

/// The fluid region, bounded by a box, the walls of a field and bodies.
#[derive(Debug, Clone, Copy)]
pub struct FluidRegion<'a> {
    pub(crate) field: &'a dyn VelocityField,
    pub(crate) domain: &'a Domain,
    pub(crate) bodies: &'a [Body],
    pub(crate) kept: Option<&'a FluidFractionCache>,
}

impl<'a> FluidRegion<'a> {
    /// The fluid of `field` inside the box and outside the bodies.
    pub fn new(field: &'a dyn VelocityField, domain: &'a Domain, bodies: &'a [Body]) -> Self {
        FluidRegion { field, domain, bodies, kept: None }
    }

    /// The same region with a cache of volume fractions, which must belong to this field, box and bodies.
    pub fn keeping(self, shares: &'a FluidFractionCache) -> Self {
        FluidRegion { kept: Some(shares), ..self }
    }

    /// The box.
    pub fn domain(&self) -> &'a Domain {
        self.domain
    }

    /// Whether `x` (um) is in the fluid at `t` (s): not behind a wall of the box, nor inside a wall of the
    /// field or a body. The fluid extends beyond open faces.
    pub fn contains(&self, x: DVec3, t: f64) -> bool {
        self.domain.push_out_of_walls(x, 0.0) == x && self.admits(x, t, 0.0)
    }

    /// Whether a particle of `radius` (um) at `x` (um) overlaps neither a wall of the field nor a body at `t`
    /// (s); walls of the box are not checked.
    pub fn admits(&self, x: DVec3, t: f64, radius: f64) -> bool {
        !self.field.wall(x, t).is_some_and(|wall| wall.overlaps(radius))
            && !self.bodies.iter().any(|body| body.touches(x, radius))
    }

    /// Whether a tracer at `x` (um) has entered a drain.
    pub(crate) fn drains(&self, x: DVec3) -> bool {
        self.bodies.iter().any(|body| body.drains(x))
    }

    /// Whether a particle of `radius` (um) may be at `x` (um) at `t` (s): [`FluidRegion::hold`] moves it by
    /// at most `tolerance_um` (um).
    pub fn holds(&self, x: DVec3, t: f64, radius: f64, tolerance_um: f64) -> bool {
        (self.hold(x, t, radius) - x).length() <= tolerance_um
    }

    /// The position (um) nearest to `x` (um) at which a particle of `radius` (um) overlaps no wall of the box
    /// or field and no body at `t` (s). If a descending free surface leaves it no room, the particle rests on
    /// the floor.
    pub fn hold(&self, x: DVec3, t: f64, radius: f64) -> DVec3 {
        let mut x = self.domain.push_out_of_walls(x, radius);
        for _ in 0..MAX_ROUNDS {
            let held = self.domain.push_out_of_walls(self.push(x, t, radius), radius);
            if held == x {
                break;
            }
            x = held;
        }
        x
    }

    /// The end (um) of a Brownian step from `from` to `x` (um) at `t` (s), reflected at walls, repeatedly if
    /// necessary; `from` if the step is rejected.
    pub fn reflect(&self, from: DVec3, x: DVec3, t: f64, radius: f64) -> DVec3 {
        let mut x = self.domain.reflect(x, radius);
        for _ in 0..MAX_ROUNDS {
            let held = self.push(x, t, radius);
            if held == x {
                return x;
            }
            x = self.domain.reflect(held + (held - x), radius);
        }
        from
    }

    /// The walls of the box and the wall of the field (`field_wall`), as seen from `x` (um), without hidden ones.
    pub(crate) fn walls(&self, field_wall: Option<Wall>, x: DVec3) -> impl Iterator<Item = Wall> + use<'a> {
        let domain = self.domain;
        let shown = field_wall.filter(|own| !domain.walls(x).any(|face| face.is_before(own)));
        let faces = domain.walls(x).filter(move |face| !shown.is_some_and(|own| own.is_before(face)));
        faces.chain(shown)
    }

    /// The end (um) of a path of Brownian motion with constant velocity that starts at `from` and would end
    /// at `to` (um) without walls; `variance`: of the displacement along a normal, um^2. The law at a
    /// plane wall is exact (Skorokhod's reflection: the path is moved by its deepest place behind the wall,
    /// which is drawn given its ends), so that settling particles have Boltzmann's profile above a wall.
    /// Bodies are not considered.
    pub(crate) fn settle(
        &self,
        (from, to): (DVec3, DVec3),
        t: f64,
        radius: f64,
        variance: impl Fn(DVec3) -> f64,
        stream: &mut Stream,
    ) -> DVec3 {
        self.walls(self.field.wall(from, t), from).fold(to, |end, wall| {
            let (way, variance) = (wall.normal.dot(to - from), variance(wall.normal));
            let start = (wall.clearance_um - radius).max(0.0);
            // Beyond this distance the path does not reach the wall.
            if start.min(start + way) > BRIDGE_SD * libm::sqrt(variance) {
                return end;
            }
            let log = libm::log(1.0 - stream.uniform());
            let lowest = start + 0.5 * (way - libm::sqrt(way * way - 2.0 * variance * log));
            end + wall.normal * (-lowest).max(0.0)
        })
    }

    /// The fraction of the volume of `part` accessible to the centers of particles of `radius` (um) at `t`
    /// (s), walls of the box not counted; exactly 1 if no wall or body reduces it. Cells are bisected until
    /// few of them are cut by a wall; a cut cell contributes a fraction estimated from the clearance at its
    /// center. The error is about 1e-4 of the accessible volume, and below 1 % even in a capillary that fills
    /// 0.2 % of the box.
    pub fn share(&self, part: &Region, t: f64, radius: f64) -> f64 {
        if self.field.wall(part.at(DVec3::splat(0.5)), t).is_none() && self.bodies.is_empty() {
            return 1.0;
        }
        match self.kept {
            None => self.measured_share(part, t, radius),
            Some(kept) => kept.get((part, t, radius), || self.measured_share(part, t, radius)),
        }
    }

    fn measured_share(&self, part: &Region, t: f64, radius: f64) -> f64 {
        let same = if self.bodies.is_empty() { self.field.walls_same_along() } else { [false; 3] };
        // Cells with the number of equal ones, next to each other along axes along which walls are the same.
        let (mut free, mut cut, mut weight, mut seen) = (0.0, vec![(*part, 1.0)], 1.0, 0.0);
        loop {
            weight *= 0.5;
            let (mut halves, mut undecided, mut parts) = (Vec::new(), 0.0, 0.0);
            for (cell, number) in cut {
                seen += 2.0 * number;
                let axis = longest(&cell);
                let is_same = same[axis as usize];
                let number = if is_same { 2.0 * number } else { number };
                for cell in halved(&cell, axis).into_iter().take(if is_same { 1 } else { 2 }) {
                    let (room, normal) = self.room(cell.at(DVec3::splat(0.5)), t, radius);
                    let reach = 0.5 * cell.size().length();
                    if room >= reach {
                        free += weight * number;
                    } else if room > -SOLID_DEPTH * reach {
                        let depth = normal.abs().dot(cell.size());
                        parts += weight * number * (0.5 + room / depth).clamp(0.0, 1.0);
                        undecided += weight * number;
                        halves.push((cell, number));
                    }
                }
            }
            if undecided <= UNDECIDED * (free + parts) || seen > MAX_CELLS {
                let share = free + parts;
                // Walls that coincide with faces of the box take no volume, up to rounding.
                return if share > 1.0 - 1e-9 { 1.0 } else { share };
            }
            cut = halves;
        }
    }

    /// The fraction of the cross-section of `view` normal to z that contains the tracers at `t` (s); exactly
    /// 1 if no wall or body reduces it.
    ///
    /// If the number n of tracers per image area varies, as in a tube, the effective area is (int n dA)^2 /
    /// int n^2 dA: all tracers on this area would have the mean n that a tracer sees, which determines how
    /// often images overlap.
    pub fn image_share(&self, view: &Region, t: f64) -> f64 {
        /// Number of columns, on a lattice of golden ratios, whose error at straight walls is about its
        /// inverse.
        const COLUMNS: u32 = 4096;
        const GOLDEN: f64 = 0.618_033_988_749_894_9;
        /// Number of cells of a column.
        const CELLS: u32 = 16;
        if self.field.wall(view.at(DVec3::splat(0.5)), t).is_none() && self.bodies.is_empty() {
            return 1.0;
        }
        let height = view.size().z / f64::from(CELLS);
        let (mut sum, mut squares) = (0.0, 0.0);
        for i in (0..COLUMNS).map(|i| f64::from(i) + 0.5) {
            let mut column = 0.0;
            for k in (0..CELLS).map(|k| f64::from(k) + 0.5) {
                let across = [i / f64::from(COLUMNS), (i * GOLDEN).fract(), k / f64::from(CELLS)];
                let (room, normal) = self.room(view.at(DVec3::from_array(across)), t, 0.0);
                let steep = normal.z.abs() * height;
                column += if room.abs() < 0.5 * steep { 0.5 + room / steep } else { f64::from(room > 0.0) };
            }
            sum += column;
            squares += column * column;
        }
        let share = sum * sum / (squares * f64::from(COLUMNS));
        // NaN in a view without fluid; walls that coincide with faces of the box take no area, up to
        // rounding.
        if share < 1.0 - 1e-9 { share } else { 1.0 }
    }

    /// Gap (um) between the surface of a particle of `radius` (um) at `x` and the nearest wall of field or
    /// bodies (negative: overlap), and the normal of that wall.
    fn room(&self, x: DVec3, t: f64, radius: f64) -> (f64, DVec3) {
        let wall = self.field.wall(x, t).map(|wall| (wall.clearance_um - radius, wall.normal));
        let bodies = self.bodies.iter().map(|body| body.room(x, radius));
        bodies.chain(wall).fold(
            (f64::INFINITY, DVec3::X),
            |nearest, next| {
                if next.0 < nearest.0 { next } else { nearest }
            },
        )
    }

    /// `x` (um) moved out of the walls of the field, then out of the bodies.
    fn push(&self, x: DVec3, t: f64, radius: f64) -> DVec3 {
        let x = self.field.confine(x, t, radius);
        self.bodies.iter().fold(x, |x, body| body.push_out(x, radius))
    }
}

/// The axis along which a box is longest.
fn longest(cell: &Region) -> Axis {
    let size = cell.size();
    Axis::ALL.into_iter().fold(Axis::X, |longest, axis| {
        if size[axis as usize] > size[longest as usize] { axis } else { longest }
    })
}

/// The two halves of a box, split across an axis.
fn halved(cell: &Region, axis: Axis) -> [Region; 2] {
    let (low, high) = (cell.min()[axis as usize], cell.max()[axis as usize]);
    let middle = f64::midpoint(low, high);
    // A box too thin to be split in f64 is returned twice.
    let part = |low, high| cell.with_edge(axis, low, high).unwrap_or(*cell);
    [part(low, middle), part(middle, high)]
}
