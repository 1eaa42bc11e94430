//! Seeding: the initial positions of tracers and the process by which new ones enter; by default a Poisson
//! process, uniform over the domain.
//!
//! The number of particles in any part of the domain is Poisson-distributed and independent of the other
//! parts; given the number, positions are independent and uniform. Optionally the number in one view is
//! fixed, and only the rest of the domain is random.
//!
//! Density is the number of particles per volume of fluid. The layer of one radius at walls that centers
//! cannot enter is compensated for: at walls of the box by squeezing, at walls of a field and at bodies by a
//! correspondingly higher density of candidates, because candidates that would overlap a wall are discarded.
//! A number in a view is the number of particles there, regardless of how much of the view is solid. For
//! polydisperse particles both hold to first order in the size differences.

mod spacing;
#[cfg(test)]
mod tests;

use self::spacing::{Spacing, check_room};
use crate::{Diameters, Domain, Error, FluidRegion, ParameterCheck, Region, Result};
use glam::DVec3;
use microsig_core::cancel::checkpoint;
use microsig_core::random::{MAX_POISSON_MEAN, poisson};
use microsig_core::stream::Stream;

const CHECK: ParameterCheck = ParameterCheck("seeding");

/// Number, sizes and arrangement of the particles.
#[derive(Debug, Clone, PartialEq)]
pub struct Seeding {
    number: Number,
    diameters: Diameters,
    arrangement: Arrangement,
}

#[derive(Debug, Clone, PartialEq)]
enum Number {
    Density(f64),
    CountInView(u32, Region),
    MeanInView(f64, Region),
    List(Vec<DVec3>),
}

/// Arrangement of the initial particles; those that enter later are always independent.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Arrangement {
    Independent,
    JitteredGrid { jitter: f64 },
    MinimumDistance { gap: f64, dims: usize },
}

/// A particle that has no id yet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Seed {
    pub(crate) position: DVec3,
    pub(crate) d_um: f64,
    /// Unit vector along the symmetry axis, if already known.
    pub(crate) axis: Option<DVec3>,
}

impl Seeding {
    /// A Poisson process of `density` (particles per um^3, >= 0).
    pub fn poisson(density: f64, diameters: Diameters) -> Result<Self> {
        let density = CHECK.not_negative("density_per_um3", density)?;
        Ok(Seeding { number: Number::Density(density), diameters, arrangement: Arrangement::Independent })
    }

    /// Exactly `count` particles in `view` (normally the field of view of the sensor) at the first time, and
    /// a Poisson process of the same density in the rest of the domain. Later the number in the view
    /// fluctuates as particles enter and leave.
    pub fn count_in_view(count: u32, view: Region, diameters: Diameters) -> Self {
        Seeding { number: Number::CountInView(count, view), diameters, arrangement: Arrangement::Independent }
    }

    /// A Poisson process whose density gives `mean` (>= 0) particles in `view` on average.
    pub fn mean_in_view(mean: f64, view: Region, diameters: Diameters) -> Result<Self> {
        let mean = CHECK.not_negative("mean number in view", mean)?;
        Ok(Seeding {
            number: Number::MeanInView(mean, view),
            diameters,
            arrangement: Arrangement::Independent,
        })
    }

    /// The same with `share` (>= 0) times the mean number in the view; others stay as they are.
    pub fn with_share_of_mean(self, share: f64) -> Self {
        match self.number {
            Number::MeanInView(mean, view) => {
                Seeding { number: Number::MeanInView(share * mean, view), ..self }
            }
            _ => self,
        }
    }

    /// Particles at given positions (um) only; none enter through open faces.
    pub fn list(positions: Vec<DVec3>, diameters: Diameters) -> Result<Self> {
        for x in &positions {
            CHECK.finite_vector("positions_um", *x)?;
        }
        Ok(Seeding { number: Number::List(positions), diameters, arrangement: Arrangement::Independent })
    }

    /// Initial positions on a jittered grid: one particle per cubic cell, displaced from the cell center by
    /// up to `jitter` (0 to 1) half edges along each axis. Cells whose particle would overlap a wall remain
    /// empty. Only for seeding by density or mean number; the cells fill the domain exactly, so that their
    /// volume is only approximately 1 / density.
    pub fn on_jittered_grid(self, jitter: f64) -> Result<Self> {
        if !(0.0..=1.0).contains(&jitter) {
            return Err(CHECK.fault("jitter", jitter, "a number from 0 to 1"));
        }
        match self.number {
            Number::Density(_) | Number::MeanInView(..) => {
                Ok(Seeding { arrangement: Arrangement::JitteredGrid { jitter }, ..self })
            }
            _ => Err(CHECK.fault(
                "seeding",
                "a jittered grid",
                "a density or a mean number of particles, not an exact number",
            )),
        }
    }

    /// Initial centers are at least the mean of the two diameters plus `gap` (um, may be negative) apart, by
    /// redrawing.
    pub fn apart(self, gap: f64) -> Result<Self> {
        self.apart_in(gap, 3)
    }

    /// The same for the distance in the image plane, regardless of depth, so that particle images of that
    /// size do not overlap.
    pub fn apart_in_image(self, gap: f64) -> Result<Self> {
        self.apart_in(gap, 2)
    }

    fn apart_in(self, gap: f64, dims: usize) -> Result<Self> {
        CHECK.finite("apart", gap)?;
        match self.number {
            Number::List(_) => {
                Err(CHECK.fault("seeding", "a minimum distance", "random positions, not a list"))
            }
            _ => Ok(Seeding { arrangement: Arrangement::MinimumDistance { gap, dims }, ..self }),
        }
    }

    /// The distribution of diameters.
    pub fn diameters(&self) -> &Diameters {
        &self.diameters
    }

    /// Density of candidates (per um^3 of the domain) at `t` (s); candidates that overlap no wall become
    /// particles. Without walls of a field and bodies it is the density of particles.
    ///
    /// `Err` if the view is not inside the domain or contains no fluid, the largest particle does not fit
    /// between the walls, the expected number of candidates exceeds 1e7, or the particles cannot keep their
    /// minimum distance.
    pub fn density(&self, fluid: &FluidRegion<'_>, t: f64) -> Result<f64> {
        let domain = fluid.domain();
        let (largest, radius) = (0.5 * self.diameters.max(), 0.5 * self.diameters.mean());
        let widest = domain.room(largest)?;
        if fluid.share(&widest, t, largest) == 0.0 {
            let allowed = if fluid.share(domain.region(), t, 0.0) == 0.0 {
                "a flow in view: walls and bodies fill the region of the particles"
            } else {
                "less than the gaps between the walls of the flow and the bodies"
            };
            return Err(CHECK.fault("diameter_um", 2.0 * largest, allowed));
        }
        let density = match self.number {
            Number::List(_) => 0.0,
            Number::Density(density) => {
                let shares = [(*domain.region(), 0.0), (domain.room(radius)?, radius)]
                    .map(|(part, radius)| fluid.share(&part, t, radius));
                if shares[0] == shares[1] { density } else { density * shares[0] / shares[1] }
            }
            Number::CountInView(count, view) => self.density_for_view(f64::from(count), &view, fluid, t)?.0,
            Number::MeanInView(mean, view) => match self.density_for_view(mean, &view, fluid, t)? {
                (_, 1.0) => mean / view.volume(),
                (density, _) => density,
            },
        };
        let expected = density * domain.region().volume();
        if expected > MAX_POISSON_MEAN {
            let allowed = format!("at most {MAX_POISSON_MEAN} in the whole domain");
            return Err(CHECK.fault("expected number of particles", expected, &allowed));
        }
        if let Arrangement::MinimumDistance { gap, dims } = self.arrangement {
            let (number, within) = match &self.number {
                Number::CountInView(count, view) => (f64::from(*count), view),
                // Candidates in solid walls are not placed.
                _ => (expected * fluid.share(domain.region(), t, 0.0), domain.region()),
            };
            check_room((gap, dims), &self.diameters, number, within)?;
        }
        Ok(density)
    }

    /// The density of candidates that gives `number` particles in a view, and the fraction of the view's
    /// volume accessible to them.
    fn density_for_view(
        &self,
        number: f64,
        view: &Region,
        fluid: &FluidRegion<'_>,
        t: f64,
    ) -> Result<(f64, f64)> {
        let (region, radius) = (fluid.domain().region(), 0.5 * self.diameters.mean());
        let fault =
            |allowed: &str| Err(CHECK.fault("view_um", format!("{} to {}", view.min(), view.max()), allowed));
        if view.min().cmplt(region.min()).any() || view.max().cmpgt(region.max()).any() {
            return fault(&format!("a box within {} to {}", region.min(), region.max()));
        }
        // Squeezing changes the volume from which the view is filled; exact for equal sizes, otherwise to
        // first order.
        let room = fluid.domain().room(radius)?;
        let Ok(seen) = Region::new(view.min().max(room.min()), view.max().min(room.max())) else {
            return fault("a view in which particles fit between the walls");
        };
        let free = fluid.share(&seen, t, radius);
        if free == 0.0 {
            return fault(
                "a view with fluid in it, in which particles fit between the walls of the flow and the bodies",
            );
        }
        let share = seen.volume() / room.volume() * free;
        Ok((number / (share * region.volume()), free))
    }

    /// The number of particles whose positions are listed; `None` if positions are drawn.
    pub fn listed_places(&self) -> Option<usize> {
        match &self.number {
            Number::List(positions) => Some(positions.len()),
            _ => None,
        }
    }

    /// The initial particles at `t` (s), those in the view first, drawn from candidates of `density`
    /// (1/um^3); none overlaps a wall.
    pub(crate) fn populate(
        &self,
        fluid: &FluidRegion<'_>,
        t: f64,
        density: f64,
        stream: &mut Stream,
    ) -> Result<Vec<Seed>> {
        let domain = fluid.domain();
        let mut spacing = Spacing::new(self.arrangement, &self.diameters);
        let free = |seed: &Seed| fluid.admits(seed.position, t, 0.5 * seed.d_um);
        match self.number {
            Number::Density(_) | Number::MeanInView(..) => {
                if let Arrangement::JitteredGrid { jitter } = self.arrangement {
                    return self.grid(domain, density, jitter, &free, stream);
                }
                let seeds = self.scatter(domain, density, domain.region(), stream);
                seeds
                    .into_iter()
                    .filter(free)
                    .map(|seed| self.settle(seed, domain, &mut spacing, &free, stream))
                    .collect()
            }
            Number::CountInView(count, view) => {
                let mut seeds = self.fill(domain, count, &view, &free, &mut spacing, stream)?;
                for seed in self.scatter(domain, density, domain.region(), stream) {
                    // Particles too close to others are discarded, not redrawn: redrawing could put them into
                    // the view.
                    if !view.contains(seed.position) && free(&seed) && spacing.admits(&seed) {
                        spacing.add(&seed);
                        seeds.push(seed);
                    }
                }
                Ok(seeds)
            }
            Number::List(ref positions) => {
                let seed = |(index, position)| self.listed(index, position, domain, &free, stream);
                positions.iter().copied().enumerate().map(seed).collect()
            }
        }
    }

    /// The particle at a given position, number `index` of the list; `Err` if it is outside the fluid or
    /// overlaps a wall or body.
    fn listed(
        &self,
        index: usize,
        position: DVec3,
        domain: &Domain,
        free: &dyn Fn(&Seed) -> bool,
        stream: &mut Stream,
    ) -> Result<Seed> {
        let fault = |allowed| Err(Error::Place { index, at_um: position, allowed });
        let seed = Seed { position, d_um: self.diameters.draw(stream), axis: None };
        let kept = domain.push_out_of_walls(position, 0.5 * seed.d_um);
        if kept != position || domain.wrap(kept) != kept || domain.is_beyond_open_face(kept) {
            return fault("a position inside the box of the particles, at least one radius from its walls");
        }
        if !free(&seed) {
            return fault(
                "a position in the fluid, at least one radius from the walls of the flow and outside all bodies",
            );
        }
        Ok(seed)
    }

    /// One particle in every cell of a jittered grid over the domain.
    fn grid(
        &self,
        domain: &Domain,
        density: f64,
        jitter: f64,
        free: &dyn Fn(&Seed) -> bool,
        stream: &mut Stream,
    ) -> Result<Vec<Seed>> {
        let mut seeds = Vec::new();
        if density == 0.0 {
            return Ok(seeds);
        }
        let region = domain.region();
        let cells = (region.size() * libm::cbrt(density)).map(|n| libm::round(n).max(1.0));
        let mut cell = DVec3::ZERO;
        while cell.z < cells.z {
            let d_um = self.diameters.draw(stream);
            let shift = DVec3::new(stream.uniform(), stream.uniform(), stream.uniform()) - 0.5;
            let place = region.at((cell + 0.5 + shift * jitter) / cells);
            let seed = Seed { position: domain.squeeze(place, 0.5 * d_um), d_um, axis: None };
            if free(&seed) {
                seeds.push(seed);
            }
            cell.x += 1.0;
            if cell.x >= cells.x {
                (cell.x, cell.y) = (0.0, cell.y + 1.0);
            }
            if cell.y >= cells.y {
                (cell.y, cell.z) = (0.0, cell.z + 1.0);
            }
        }
        Ok(seeds)
    }

    /// `seed`, redrawn at other positions while it is too close to other particles.
    fn settle(
        &self,
        mut seed: Seed,
        domain: &Domain,
        spacing: &mut Spacing,
        free: &dyn Fn(&Seed) -> bool,
        stream: &mut Stream,
    ) -> Result<Seed> {
        for _ in 0..MAX_TRIES {
            checkpoint();
            if free(&seed) && spacing.admits(&seed) {
                spacing.add(&seed);
                return Ok(seed);
            }
            // The size is kept, so that large particles do not become rarer.
            let unit = DVec3::new(stream.uniform(), stream.uniform(), stream.uniform());
            seed.position = domain.squeeze(domain.region().at(unit), 0.5 * seed.d_um);
        }
        Err(spacing.full())
    }

    /// A Poisson process in a part of the domain that extends from wall to wall.
    pub(crate) fn scatter(
        &self,
        domain: &Domain,
        density: f64,
        part: &Region,
        stream: &mut Stream,
    ) -> Vec<Seed> {
        let number = poisson(stream, density * part.volume());
        (0..number).map(|_| self.place(domain, part, stream)).collect()
    }

    fn place(&self, domain: &Domain, part: &Region, stream: &mut Stream) -> Seed {
        let d_um = self.diameters.draw(stream);
        let unit = DVec3::new(stream.uniform(), stream.uniform(), stream.uniform());
        Seed { position: domain.squeeze(part.at(unit), 0.5 * d_um), d_um, axis: None }
    }

    /// A fixed number of particles of the same process in the view: candidates are drawn from wall to wall
    /// until enough of them are in the view.
    fn fill(
        &self,
        domain: &Domain,
        count: u32,
        view: &Region,
        free: &dyn Fn(&Seed) -> bool,
        spacing: &mut Spacing,
        stream: &mut Stream,
    ) -> Result<Vec<Seed>> {
        let wide = domain.extend_to_walls(view);
        let wanted = count as usize;
        // A view that fills too small a fraction of the distance between the walls is rejected after this
        // many draws.
        let mut patience = u64::from(count) * 1000 + 1_000_000;
        let mut seeds = Vec::with_capacity(wanted);
        while seeds.len() < wanted {
            checkpoint();
            let seed = self.place(domain, &wide, stream);
            let inside = view.contains(seed.position) && free(&seed);
            if inside && spacing.admits(&seed) {
                spacing.add(&seed);
                seeds.push(seed);
            } else if patience > 0 {
                patience -= 1;
            } else if inside {
                return Err(spacing.full());
            } else {
                let value = format!("{} to {}", view.min(), view.max());
                return Err(CHECK.fault(
                    "view_um",
                    value,
                    "at least a thousandth of the distance between the walls",
                ));
            }
        }
        Ok(seeds)
    }
}

/// Maximum number of positions tried for one particle.
const MAX_TRIES: u32 = 10_000;
