//! Where tracers are at first, and where new ones may appear: a Poisson process, uniform over the domain, unless asked otherwise.
//!
//! The number of particles in any part of the domain is a Poisson number, independent of the other parts; given the
//! number, positions are independent and uniform. Optionally the number in one view is fixed, and only the rest of the
//! domain is left to chance. Density means particles over the whole volume between walls; what walls keep free for want
//! of room is shared out over the rest of the depth.

use crate::diameters::Diameters;
use crate::domain::Domain;
use crate::error::{Check, Error, Result};
use crate::region::Region;
use glam::DVec3;
use microsig_core::random::{MAX_POISSON_MEAN, poisson};
use microsig_core::stream::Stream;
use std::collections::HashMap;

const CHECK: Check = Check("seeding");

/// A number of particles, and their sizes.
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
    List(Vec<DVec3>),
}

/// How the particles of the first time are arranged; those that come in later are always independent.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Arrangement {
    Independent,
    JitteredGrid { jitter: f64 },
    Apart { gap: f64, dims: usize },
}

/// A particle without a name yet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Seed {
    pub(crate) position: DVec3,
    pub(crate) d_um: f64,
}

impl Seeding {
    /// A Poisson process of a density in particles per um^3, >= 0.
    pub fn poisson(density: f64, diameters: Diameters) -> Result<Self> {
        let density = CHECK.not_negative("density_per_um3", density)?;
        Ok(Seeding { number: Number::Density(density), diameters, arrangement: Arrangement::Independent })
    }

    /// Exactly `count` particles in `view` (normally what the sensor sees) at the first time, and a Poisson process of
    /// the same density in the rest of the domain. Later the number in the view fluctuates as particles come and go.
    pub fn count_in_view(count: u32, view: Region, diameters: Diameters) -> Self {
        Seeding { number: Number::CountInView(count, view), diameters, arrangement: Arrangement::Independent }
    }

    /// Particles at given places, um, and no others: none come in through open faces.
    pub fn list(positions: Vec<DVec3>, diameters: Diameters) -> Result<Self> {
        for x in &positions {
            CHECK.finite_vector("positions_um", *x)?;
        }
        Ok(Seeding { number: Number::List(positions), diameters, arrangement: Arrangement::Independent })
    }

    /// At the first time one particle in every cell of a grid of cubes, displaced from its middle by up to `jitter` (0 to 1) half edges along each
    /// axis. Of a number by density only; the cubes fill the domain, so that their volume is only nearly 1 / density.
    pub fn on_jittered_grid(self, jitter: f64) -> Result<Self> {
        if !(0.0..=1.0).contains(&jitter) {
            return Err(CHECK.fault("jitter", jitter, "a number from 0 to 1"));
        }
        match self.number {
            Number::Density(_) => Ok(Seeding { arrangement: Arrangement::JitteredGrid { jitter }, ..self }),
            _ => Err(CHECK.fault("seeding", "a jittered grid", "a number per volume with it")),
        }
    }

    /// At the first time centres are at least the mean of two diameters plus `gap` (um, may be negative) apart, by drawing again.
    pub fn apart(self, gap: f64) -> Result<Self> {
        self.apart_in(gap, 3)
    }

    /// The same in the image plane, whatever the depths: particle images of that size do not overlap.
    pub fn apart_in_image(self, gap: f64) -> Result<Self> {
        self.apart_in(gap, 2)
    }

    fn apart_in(self, gap: f64, dims: usize) -> Result<Self> {
        CHECK.finite("min_gap_um", gap)?;
        match self.number {
            Number::List(_) => Err(CHECK.fault("seeding", "a least distance", "places that are not given")),
            _ => Ok(Seeding { arrangement: Arrangement::Apart { gap, dims }, ..self }),
        }
    }

    /// The sizes.
    pub fn diameters(&self) -> &Diameters {
        &self.diameters
    }

    /// Particles per um^3 of the domain.
    ///
    /// `Err` if the view does not lie in the domain, the largest particle does not fit between the walls, or more than
    /// 1e7 particles are expected.
    pub fn density(&self, domain: &Domain) -> Result<f64> {
        domain.room(0.5 * self.diameters.max())?;
        let density = match self.number {
            Number::Density(density) => density,
            Number::List(_) => 0.0,
            Number::CountInView(count, view) => {
                let region = domain.region();
                if view.min().cmplt(region.min()).any() || view.max().cmpgt(region.max()).any() {
                    let (min, max) = (region.min(), region.max());
                    let value = format!("{} to {}", view.min(), view.max());
                    return Err(CHECK.fault("view_um", value, &format!("a box within {min} to {max}")));
                }
                // Squeezed off the walls a view gains or loses room; exact for equal sizes, else to first order.
                let room = domain.room(0.5 * self.diameters.mean())?;
                let corners = (view.min().max(room.min()), view.max().min(room.max()));
                let share = Region::new(corners.0, corners.1)
                    .map_err(|_| {
                        CHECK.fault(
                            "view_um",
                            format!("{} to {}", view.min(), view.max()),
                            "room beside the walls",
                        )
                    })?
                    .volume()
                    / room.volume();
                f64::from(count) / (share * region.volume())
            }
        };
        let expected = density * domain.region().volume();
        if expected <= MAX_POISSON_MEAN {
            Ok(density)
        } else {
            let allowed = format!("at most {MAX_POISSON_MEAN} in the whole domain");
            Err(CHECK.fault("expected number of particles", expected, &allowed))
        }
    }

    /// The particles at the first time, those of the view first; none of them where `taken` says of a place and a radius that something is there.
    pub(crate) fn populate(
        &self,
        domain: &Domain,
        taken: &dyn Fn(DVec3, f64) -> bool,
        stream: &mut Stream,
    ) -> Result<Vec<Seed>> {
        let density = self.density(domain)?;
        let mut crowd = Crowd::new(self.arrangement, &self.diameters);
        let free = |seed: &Seed| !taken(seed.position, 0.5 * seed.d_um);
        match self.number {
            Number::Density(density) => {
                if let Arrangement::JitteredGrid { jitter } = self.arrangement {
                    return self.grid(domain, density, jitter, &free, stream);
                }
                let seeds = self.scatter(domain, density, domain.region(), stream);
                seeds
                    .into_iter()
                    .filter(free)
                    .map(|seed| self.settle(seed, domain, &mut crowd, &free, stream))
                    .collect()
            }
            Number::CountInView(count, view) => {
                let mut seeds = self.fill(domain, count, &view, &free, &mut crowd, stream)?;
                for seed in self.scatter(domain, density, domain.region(), stream) {
                    // Those too close to others are left out, not moved: they could move into the view.
                    if !view.contains(seed.position) && free(&seed) && crowd.admits(&seed) {
                        crowd.add(&seed);
                        seeds.push(seed);
                    }
                }
                Ok(seeds)
            }
            Number::List(ref positions) => {
                let mut seeds = Vec::with_capacity(positions.len());
                for position in positions {
                    let seed = Seed { position: *position, d_um: self.diameters.draw(stream) };
                    let kept = domain.keep_off_walls(*position, 0.5 * seed.d_um);
                    if kept != *position || domain.wrap(kept) != kept || domain.is_beyond_open_face(kept) {
                        return Err(CHECK.fault(
                            "positions_um",
                            position,
                            "a place in the domain and off its walls",
                        ));
                    }
                    if !free(&seed) {
                        return Err(CHECK.fault("positions_um", position, "a place outside all bodies"));
                    }
                    seeds.push(seed);
                }
                Ok(seeds)
            }
        }
    }

    /// One particle in every cell of a grid over the domain.
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
            let seed = Seed { position: domain.squeeze(place, 0.5 * d_um), d_um };
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

    /// A seed, or one in its stead elsewhere if others are too close.
    fn settle(
        &self,
        mut seed: Seed,
        domain: &Domain,
        crowd: &mut Crowd,
        free: &dyn Fn(&Seed) -> bool,
        stream: &mut Stream,
    ) -> Result<Seed> {
        for _ in 0..MAX_TRIES {
            if free(&seed) && crowd.admits(&seed) {
                crowd.add(&seed);
                return Ok(seed);
            }
            // The same size again, so that large particles do not become rarer.
            let unit = DVec3::new(stream.uniform(), stream.uniform(), stream.uniform());
            seed.position = domain.squeeze(domain.region().at(unit), 0.5 * seed.d_um);
        }
        Err(crowd.full())
    }

    /// A Poisson process over a part of the domain that reaches from wall to wall.
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
        Seed { position: domain.squeeze(part.at(unit), 0.5 * d_um), d_um }
    }

    /// A fixed number of particles of the same process in the view: drawn from wall to wall until enough are in it.
    fn fill(
        &self,
        domain: &Domain,
        count: u32,
        view: &Region,
        free: &dyn Fn(&Seed) -> bool,
        crowd: &mut Crowd,
        stream: &mut Stream,
    ) -> Result<Vec<Seed>> {
        let wide = domain.extend_to_walls(view);
        let wanted = count as usize;
        // A view that fills this little of the way between the walls is refused rather than waited for.
        let mut patience = u64::from(count) * 1000 + 1_000_000;
        let mut seeds = Vec::with_capacity(wanted);
        while seeds.len() < wanted {
            let seed = self.place(domain, &wide, stream);
            let inside = view.contains(seed.position) && free(&seed);
            if inside && crowd.admits(&seed) {
                crowd.add(&seed);
                seeds.push(seed);
            } else if patience > 0 {
                patience -= 1;
            } else if inside {
                return Err(crowd.full());
            } else {
                let value = format!("{} to {}", view.min(), view.max());
                return Err(CHECK.fault(
                    "view_um",
                    value,
                    "a thousandth of the distance of the walls or more",
                ));
            }
        }
        Ok(seeds)
    }
}

/// Places tried for one particle among others.
const MAX_TRIES: u32 = 10_000;

/// Particles that others must keep away from, in cells as wide as the largest distance to keep.
struct Crowd {
    gap: f64,
    /// Axes along which distance counts; 0: none is kept.
    dims: usize,
    cell: f64,
    members: HashMap<[i64; 3], Vec<Seed>>,
}

impl Crowd {
    fn new(arrangement: Arrangement, diameters: &Diameters) -> Crowd {
        let (gap, dims) = match arrangement {
            Arrangement::Apart { gap, dims } if diameters.max() + gap > 0.0 => (gap, dims),
            _ => (0.0, 0),
        };
        Crowd { gap, dims, cell: diameters.max() + gap, members: HashMap::new() }
    }

    /// The place as far as distance counts.
    fn place(&self, seed: &Seed) -> DVec3 {
        if self.dims == 2 { seed.position.with_z(0.0) } else { seed.position }
    }

    fn key(&self, seed: &Seed) -> [i64; 3] {
        self.place(seed).to_array().map(|x| libm::floor(x / self.cell) as i64)
    }

    fn add(&mut self, seed: &Seed) {
        if self.dims > 0 {
            self.members.entry(self.key(seed)).or_default().push(*seed);
        }
    }

    /// Whether a particle is far enough from all others.
    fn admits(&self, seed: &Seed) -> bool {
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

    fn full(&self) -> Error {
        CHECK.fault("min_gap_um", self.gap, "a gap that leaves room for all particles")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::Boundary::{Open, Wall};
    use microsig_core::stream::{Purpose, Streams};

    fn domain() -> Domain {
        let region = Region::new(DVec3::new(-200.0, -100.0, -80.0), DVec3::new(200.0, 100.0, 20.0)).unwrap();
        Domain::new(region, [Open, Wall, Wall])
    }

    fn stream(row: u32) -> Stream {
        Streams::new(5).stream(Purpose::Seeding, 0, row)
    }

    #[test]
    fn the_view_holds_the_count_and_the_rest_has_the_same_density() {
        // The view is away from the side walls, big particles are squeezed by 10 % along y and 20 % along z.
        let view = Region::new(DVec3::new(-100.0, -50.0, -80.0), DVec3::new(100.0, 50.0, 20.0)).unwrap();
        let seeding = Seeding::count_in_view(1000, view, Diameters::equal(20.0).unwrap());
        let mut outside = 0.0;
        for row in 0..20 {
            let seeds = seeding.populate(&domain(), &|_, _| false, &mut stream(row)).unwrap();
            assert_eq!(seeds.iter().filter(|seed| view.contains(seed.position)).count(), 1000);
            assert!(seeds[..1000].iter().all(|seed| view.contains(seed.position)));
            assert!(seeds.iter().all(|seed| domain().room(9.999).unwrap().contains(seed.position)));
            outside += seeds.len() as f64 - 1000.0;
        }
        // Over the room of 400 x 180 um the view of 200 x 100 leaves 2.6 times itself; Poisson error of 52000.
        assert!((outside - 52_000.0).abs() < 4.0 * 228.0, "{outside}");
    }

    #[test]
    fn a_density_is_a_number_per_volume_between_the_walls() {
        let seeding = Seeding::poisson(1e-3, Diameters::equal(20.0).unwrap()).unwrap();
        let number: usize = (0..20)
            .map(|row| seeding.populate(&domain(), &|_, _| false, &mut stream(row)).unwrap().len())
            .sum();
        // 20 x 8000 expected, Poisson error 400.
        assert!((number as f64 - 160_000.0).abs() < 1600.0, "{number}");
        let empty = Seeding::poisson(0.0, Diameters::equal(2.0).unwrap()).unwrap();
        assert!(empty.populate(&domain(), &|_, _| false, &mut stream(0)).unwrap().is_empty());
    }

    #[test]
    fn what_cannot_be_seeded_is_refused() {
        let two = Diameters::equal(2.0).unwrap();
        let density = |seeding: Seeding| seeding.density(&domain()).unwrap_err().to_string();
        let outside = Region::new(DVec3::splat(-50.0), DVec3::new(300.0, 50.0, 10.0)).unwrap();
        assert!(density(Seeding::count_in_view(5, outside, two.clone())).contains("view_um"));
        let in_wall = Region::new(DVec3::new(0.0, 0.0, -80.0), DVec3::new(9.0, 9.0, -79.0)).unwrap();
        assert!(density(Seeding::count_in_view(5, in_wall, two.clone())).contains("room beside the walls"));
        assert!(density(Seeding::poisson(10.0, two.clone()).unwrap()).contains("80000000"));
        let huge = Seeding::poisson(1e-3, Diameters::equal(100.0).unwrap()).unwrap();
        assert!(density(huge).contains("diameter_um = 100"));
        assert!(Seeding::poisson(-1.0, two.clone()).is_err());
        // A millionth of the depth takes a million draws per particle.
        let sliver = Region::new(DVec3::new(-200.0, -100.0, -5e-5), DVec3::new(200.0, 100.0, 5e-5)).unwrap();
        let seeds = Seeding::count_in_view(5, sliver, two).populate(&domain(), &|_, _| false, &mut stream(0));
        assert!(seeds.unwrap_err().to_string().contains("thousandth"));
    }

    #[test]
    fn least_distances_are_kept_in_space_or_in_the_image() {
        let sizes = Diameters::uniform(2.0, 8.0).unwrap();
        let worst = |seeding: &Seeding, flat: bool| {
            let seeds = seeding.populate(&domain(), &|_, _| false, &mut stream(1)).unwrap();
            let place = |seed: &Seed| if flat { seed.position.with_z(0.0) } else { seed.position };
            let mut worst = f64::INFINITY;
            for (i, a) in seeds.iter().enumerate() {
                for b in &seeds[..i] {
                    worst = worst.min((place(a) - place(b)).length() - 0.5 * (a.d_um + b.d_um));
                }
            }
            (seeds.len(), worst)
        };
        let view = Region::new(DVec3::new(-100.0, -50.0, -80.0), DVec3::new(100.0, 50.0, 20.0)).unwrap();
        let dense = Seeding::poisson(2e-4, sizes.clone()).unwrap();
        assert!(worst(&dense, false).1 < 0.0);
        let apart = worst(&dense.clone().apart(1.5).unwrap(), false);
        assert!(apart.0 > 1400 && apart.1 >= 1.5, "{apart:?}");
        let counted = Seeding::count_in_view(60, view, sizes.clone()).apart_in_image(2.0).unwrap();
        let flat = worst(&counted, true);
        assert!(flat.0 > 100 && flat.1 >= 2.0, "{flat:?}");
        // 1600 discs of 25 um cannot lie in 400 x 200 um.
        let full = dense.apart_in_image(20.0).unwrap().populate(&domain(), &|_, _| false, &mut stream(1));
        assert!(full.unwrap_err().to_string().contains("min_gap_um = 20"));
    }

    #[test]
    fn a_grid_has_one_particle_in_every_cell() {
        let two = Diameters::equal(2.0).unwrap();
        let seeding = Seeding::poisson(1e-3, two.clone()).unwrap().on_jittered_grid(0.8).unwrap();
        let seeds = seeding.populate(&domain(), &|_, _| false, &mut stream(1)).unwrap();
        assert_eq!(seeds.len(), 8000);
        let mut cells: Vec<[i64; 3]> =
            seeds.iter().map(|seed| (seed.position / 10.0).floor().to_array().map(|x| x as i64)).collect();
        cells.sort_unstable();
        cells.dedup();
        assert_eq!(cells.len(), 8000);
        assert!(seeding.on_jittered_grid(1.5).is_err());
        let view = *domain().region();
        assert!(Seeding::count_in_view(5, view, two).on_jittered_grid(0.5).is_err());
    }

    #[test]
    fn lists_are_kept_and_checked() {
        let two = Diameters::equal(2.0).unwrap();
        let places = vec![DVec3::new(1.0, 2.0, 3.0), DVec3::new(-4.0, 5.0, -6.0)];
        let seeding = Seeding::list(places.clone(), two.clone()).unwrap();
        let seeds = seeding.populate(&domain(), &|_, _| false, &mut stream(0)).unwrap();
        assert_eq!(seeds.iter().map(|seed| seed.position).collect::<Vec<_>>(), places);
        assert_eq!(seeding.density(&domain()).unwrap(), 0.0);
        let fault = |x: DVec3, taken: bool| {
            let seeding = Seeding::list(vec![x], two.clone()).unwrap();
            seeding.populate(&domain(), &|_, _| taken, &mut stream(0)).unwrap_err().to_string()
        };
        assert!(
            fault(DVec3::Z * 19.5, false).contains("off its walls")
                && fault(DVec3::X * 201.0, false).contains("201")
        );
        assert!(fault(DVec3::ZERO, true).contains("outside all bodies"));
        assert!(Seeding::list(vec![DVec3::NAN], two.clone()).is_err());
    }
}
