//! Where tracers are at first, and where new ones may appear: a Poisson process, uniform over the domain.
//!
//! The number of particles in any part of the domain is a Poisson number, independent of the other parts; given the
//! number, positions are independent and uniform. Optionally the number in one view is fixed, and only the rest of the
//! domain is left to chance. Density means particles over the whole volume between walls; what walls keep free for want
//! of room is shared out over the rest of the depth.

use crate::diameters::Diameters;
use crate::domain::Domain;
use crate::error::{Check, Result};
use crate::random::{MAX_POISSON_MEAN, poisson};
use crate::region::Region;
use glam::DVec3;
use microsig_core::stream::Stream;

const CHECK: Check = Check("seeding");

/// A number of particles, and their sizes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seeding {
    number: Number,
    diameters: Diameters,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Number {
    Density(f64),
    CountInView(u32, Region),
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
        Ok(Seeding { number: Number::Density(density), diameters })
    }

    /// Exactly `count` particles in `view` (normally what the sensor sees) at the first time, and a Poisson process of
    /// the same density in the rest of the domain. Later the number in the view fluctuates as particles come and go.
    pub fn count_in_view(count: u32, view: Region, diameters: Diameters) -> Self {
        Seeding { number: Number::CountInView(count, view), diameters }
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

    /// The particles at the first time, those of the view first.
    pub(crate) fn populate(&self, domain: &Domain, stream: &mut Stream) -> Result<Vec<Seed>> {
        let density = self.density(domain)?;
        match self.number {
            Number::Density(_) => Ok(self.scatter(domain, density, domain.region(), stream)),
            Number::CountInView(count, view) => {
                let mut seeds = self.fill(domain, count, &view, stream)?;
                let everywhere = self.scatter(domain, density, domain.region(), stream);
                seeds.extend(everywhere.into_iter().filter(|seed| !view.contains(seed.position)));
                Ok(seeds)
            }
        }
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
    fn fill(&self, domain: &Domain, count: u32, view: &Region, stream: &mut Stream) -> Result<Vec<Seed>> {
        let wide = domain.extend_to_walls(view);
        let wanted = count as usize;
        // A view that fills this little of the way between the walls is refused rather than waited for.
        let mut patience = u64::from(count) * 1000 + 1_000_000;
        let mut seeds = Vec::with_capacity(wanted);
        while seeds.len() < wanted {
            let seed = self.place(domain, &wide, stream);
            if view.contains(seed.position) {
                seeds.push(seed);
            } else if patience > 0 {
                patience -= 1;
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
            let seeds = seeding.populate(&domain(), &mut stream(row)).unwrap();
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
        let number: usize =
            (0..20).map(|row| seeding.populate(&domain(), &mut stream(row)).unwrap().len()).sum();
        // 20 x 8000 expected, Poisson error 400.
        assert!((number as f64 - 160_000.0).abs() < 1600.0, "{number}");
        let empty = Seeding::poisson(0.0, Diameters::equal(2.0).unwrap()).unwrap();
        assert!(empty.populate(&domain(), &mut stream(0)).unwrap().is_empty());
    }

    #[test]
    fn what_cannot_be_seeded_is_refused() {
        let two = Diameters::equal(2.0).unwrap();
        let density = |seeding: Seeding| seeding.density(&domain()).unwrap_err().to_string();
        let outside = Region::new(DVec3::splat(-50.0), DVec3::new(300.0, 50.0, 10.0)).unwrap();
        assert!(density(Seeding::count_in_view(5, outside, two)).contains("view_um"));
        let in_wall = Region::new(DVec3::new(0.0, 0.0, -80.0), DVec3::new(9.0, 9.0, -79.0)).unwrap();
        assert!(density(Seeding::count_in_view(5, in_wall, two)).contains("room beside the walls"));
        assert!(density(Seeding::poisson(10.0, two).unwrap()).contains("80000000"));
        let huge = Seeding::poisson(1e-3, Diameters::equal(100.0).unwrap()).unwrap();
        assert!(density(huge).contains("diameter_um = 100"));
        assert!(Seeding::poisson(-1.0, two).is_err());
        // A millionth of the depth takes a million draws per particle.
        let sliver = Region::new(DVec3::new(-200.0, -100.0, -5e-5), DVec3::new(200.0, 100.0, 5e-5)).unwrap();
        let seeds = Seeding::count_in_view(5, sliver, two).populate(&domain(), &mut stream(0));
        assert!(seeds.unwrap_err().to_string().contains("thousandth"));
    }
}
