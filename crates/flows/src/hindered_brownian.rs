//! Brownian motion of a sphere near walls, whose diffusion tensor D = D0 R^-1 depends on the position (R:
//! resistance relative to that far from walls, [`crate::near_walls`]).
//!
//! A step of variance v = 2 D0 h draws a displacement d from the normal distribution of covariance v R(x)^-1,
//! of density q_x(d), and goes to x + d or to x - d with probabilities in the ratio of sqrt(q_(x+d)(d) /
//! q_x(d)) and sqrt(q_(x-d)(d) / q_x(d)) (Livingstone and Zanella, J. R. Stat. Soc. B 84 (2022) 496, choose
//! the sign in this way). A place inside a wall has q = 0. The step to y is accepted with probability min(1,
//! N(x, d) / N(y, d)), where N is the sum of the two square roots; otherwise the sphere stays. The
//! probability of going from x to y, 2 sqrt(q_x q_y) / max(N(x, d), N(y, d)), equals the one of going from y to x. A
//! uniform cloud therefore stays uniform for any step, in one gap or between curved walls, no sphere enters a
//! wall, and steps backward in time have the same statistics as steps forward.
//!
//! A force F tilts the choice: q(d) is multiplied by exp(F x / kB T), and Boltzmann's profile stays as it is.
//! The mean displacement is then D F h / kB T up to a relative error of v (F / kB T)^2 / 4, which
//! [`FORCED_STEP`] keeps at 1 %.
//!
//! To first order in h the choice of the sign gives the mean displacement div D h, without derivatives of D,
//! and 1 - N(x, d) / N(y, d) is of third order in the relative change of D over a step. A step of 0.002 a^2 /
//! D0 changes the variance of displacements by less than 1 % at gaps above a tenth of the radius a. Closer to
//! a wall, where D across it falls to 0 within a step, only the averages over a step length are accurate.

use crate::near_walls::NearWalls;
use glam::{DMat3, DVec3};
use microsig_core::random::normal;
use microsig_core::stream::Stream;

/// Longest step, in units of a^2 / D0.
const STEP: f64 = 0.002;
/// Maximum number of steps in one Brownian step of a recording; longer ones have longer steps.
const MAX_STEPS: f64 = 10_000.0;
/// Longest step, as a standard deviation in units of the length over which the force does the work kB T.
const FORCED_STEP: f64 = 0.2;

#[derive(Debug, Clone, Copy)]
struct Place {
    x: DVec3,
    resistance: DMat3,
    /// ln det R / 2, plus the work of the force over kB T.
    scale: f64,
}

impl Place {
    /// ln q(d) up to a constant, for steps of variance `variance` (um^2).
    fn log_density(&self, d: DVec3, variance: f64) -> f64 {
        self.scale - d.dot(self.resistance * d) / (2.0 * variance)
    }
}

/// The places at both ends of d, with their weights, and the sum of those.
type Ends = ([Option<(Place, f64)>; 2], f64);

impl NearWalls<'_> {
    /// Number of steps into which a Brownian step over a time `h` (s) must be divided for the force on a
    /// sphere that diffuses with `diffusion` (um^2/s); `None` if there would be too many.
    pub(crate) fn forced_steps(&self, diffusion: f64, h: f64) -> Option<f64> {
        let steps = 2.0 * diffusion * h * self.pull.length_squared() / (FORCED_STEP * FORCED_STEP);
        Some(steps).filter(|steps| *steps <= MAX_STEPS)
    }

    /// Position (um) after Brownian motion over a time `h` (s, > 0) at `t` (s) of a sphere that diffuses with
    /// `diffusion` (um^2/s) far from walls, from `x` (um).
    pub(crate) fn diffuse(&self, diffusion: f64, x: DVec3, t: f64, h: f64, stream: &mut Stream) -> DVec3 {
        if self.resistance(x, t).is_none() {
            let xi = DVec3::new(normal(stream), normal(stream), normal(stream));
            return x + self.pull * (diffusion * h) + xi * libm::sqrt(2.0 * diffusion * h);
        }
        let unit = self.radius() * self.radius() / diffusion;
        let forced = self.forced_steps(diffusion, h).unwrap_or(MAX_STEPS);
        let steps = libm::ceil((h / (STEP * unit)).max(forced)).clamp(1.0, MAX_STEPS);
        let variance = 2.0 * diffusion * h / steps;
        let start = self.place(x, t);
        (0..steps as u32).fold(start, |place, _| self.step(place, variance, t, stream)).x
    }

    /// One step of variance `variance` (um^2).
    fn step(&self, from: Place, variance: f64, t: f64, stream: &mut Stream) -> Place {
        let xi = DVec3::new(normal(stream), normal(stream), normal(stream));
        let (side, chance) = (stream.uniform(), stream.uniform());
        let d = spread(&from.resistance, xi) * libm::sqrt(variance);
        let (ends, sum) = self.ends(&from, d, variance, t);
        let [plus, minus] = ends.map(|end| end.map_or(0.0, |(_, weight)| weight));
        debug_assert!(plus >= 0.0 && minus >= 0.0, "{plus} {minus}");
        let chosen = if side * sum < plus { ends[0] } else { ends[1] };
        let Some((to, weight)) = chosen.filter(|(_, weight)| *weight > 0.0) else { return from };
        let on = to.x - from.x;
        // Of the two ends seen from the new place, the one behind is the old place.
        let ahead = self.admitted(to.x + on, t).map_or(0.0, |next| self.weight(&next, &to, d, variance));
        let accepted = chance * (ahead + 1.0 / weight) < sum;
        if accepted { to } else { from }
    }

    fn ends(&self, from: &Place, d: DVec3, variance: f64, t: f64) -> Ends {
        let end = |x: DVec3| {
            let place = self.admitted(x, t)?;
            Some((place, self.weight(&place, from, d, variance)))
        };
        let ends = [end(from.x + d), end(from.x - d)];
        (ends, ends.iter().flatten().map(|(_, weight)| weight).sum())
    }

    /// sqrt(q_end(d) / q_from(d)).
    fn weight(&self, end: &Place, from: &Place, d: DVec3, variance: f64) -> f64 {
        libm::exp(0.5 * (end.log_density(d, variance) - from.log_density(d, variance)))
    }

    fn admitted(&self, x: DVec3, t: f64) -> Option<Place> {
        self.admits(x, t).then(|| self.place(x, t))
    }

    fn place(&self, x: DVec3, t: f64) -> Place {
        let resistance = self.resistance(x, t).unwrap_or(DMat3::IDENTITY);
        Place { x, resistance, scale: 0.5 * libm::log(resistance.determinant()) + self.pull.dot(x) }
    }
}

/// A vector of covariance R^-1 from a vector of covariance 1: C^-T xi, where R = C C^T (Cholesky).
fn spread(r: &DMat3, xi: DVec3) -> DVec3 {
    let (x, y, z) = (r.x_axis, r.y_axis, r.z_axis);
    let a = libm::sqrt(x.x);
    let (b, c) = (x.y / a, x.z / a);
    let d = libm::sqrt(y.y - b * b);
    let e = (y.z - b * c) / d;
    let f = libm::sqrt(z.z - c * c - e * e);
    let last = xi.z / f;
    let middle = (xi.y - e * last) / d;
    DVec3::new((xi.x - b * middle - c * last) / a, middle, last)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fields::{Linear, Tube, TubeParams};
    use crate::hindered::{resistance_across, resistance_along};
    use crate::{Boundary, Domain, FluidRegion, Region};
    use microsig_core::stream::{Purpose, Streams};
    use rayon::prelude::*;

    const RADIUS: f64 = 0.25;
    const DIFFUSION: f64 = 0.98;
    /// a^2 / D0, s.
    const UNIT_S: f64 = RADIUS * RADIUS / DIFFUSION;

    fn plates(height: f64) -> Domain {
        let region = Region::new(DVec3::new(-50.0, -50.0, 0.0), DVec3::new(50.0, 50.0, height)).unwrap();
        Domain::new(region, [Boundary::Open, Boundary::Open, Boundary::Wall])
    }

    fn rest() -> Linear {
        Linear::uniform(DVec3::ZERO).unwrap()
    }

    /// Chi-square of the numbers of `shares` (0 to 1) in equal bins.
    fn chi_square(shares: &[f64], bins: usize) -> f64 {
        let mut counts = vec![0.0; bins];
        for share in shares {
            counts[((share * bins as f64) as usize).min(bins - 1)] += 1.0;
        }
        let mean = shares.len() as f64 / bins as f64;
        counts.iter().map(|count| (count - mean) * (count - mean) / mean).sum()
    }

    /// Heights of `number` spheres between plates 1 um apart, as shares of the accessible height, after
    /// `steps` steps over `h` (s); at first they are uniform. None touches a plate.
    fn heights(number: u32, steps: u32, h: f64) -> Vec<f64> {
        let (field, domain) = (rest(), plates(1.0));
        let walls = NearWalls::new(FluidRegion::new(&field, &domain, &[]), RADIUS);
        let end = |row: u32| {
            let mut stream = Streams::new(5).stream(Purpose::Brownian, 0, row);
            let start = DVec3::Z * (RADIUS + 0.5 * (f64::from(row) + 0.5) / f64::from(number));
            let mut place = walls.place(start, 0.0);
            for _ in 0..steps {
                place = walls.step(place, 2.0 * DIFFUSION * h, 0.0, &mut stream);
                assert!((RADIUS..=1.0 - RADIUS).contains(&place.x.z), "{}", place.x);
            }
            (place.x.z - RADIUS) / 0.5
        };
        (0..number).into_par_iter().map(end).collect()
    }

    /// The longest step that a recording takes, and one fifty times as long, of the order of the height.
    const STEPS_S: [f64; 2] = [STEP * UNIT_S, 50.0 * STEP * UNIT_S];

    #[test]
    fn spheres_between_plates_stay_uniform_and_off_the_walls() {
        for h in STEPS_S {
            let found = chi_square(&heights(5000, 40, h), 20);
            // 19 degrees of freedom: 43.8 is exceeded with a probability of 0.1 %.
            assert!(found < 43.8, "{h}: {found}");
        }
    }

    #[test]
    fn spheres_in_a_tube_stay_uniform() {
        let tube = Tube::new(&TubeParams {
            radius_um: Some(0.6),
            center_yz_um: Some([0.0, 0.0]),
            ..TubeParams::default()
        })
        .unwrap();
        let region = Region::new(DVec3::splat(-50.0), DVec3::splat(50.0)).unwrap();
        let domain = Domain::new(region, [Boundary::Open; 3]);
        let walls = NearWalls::new(FluidRegion::new(&tube, &domain, &[]), RADIUS);
        let end = |row: u32| {
            let mut stream = Streams::new(6).stream(Purpose::Brownian, 0, row);
            let r = 0.35 * libm::sqrt((f64::from(row) + 0.5) / 4000.0);
            let start = DVec3::new(0.0, r * 0.6, r * 0.8);
            let x = walls.diffuse(DIFFUSION, start, 0.0, 100.0 * STEP * UNIT_S, &mut stream);
            x.with_x(0.0).length_squared() / (0.35 * 0.35)
        };
        let ends: Vec<f64> = (0..4000).into_par_iter().map(end).collect();
        assert!(ends.iter().all(|share| *share < 1.0 + 1e-8));
        let found = chi_square(&ends, 20);
        assert!(found < 43.8, "{found}");
    }

    /// Mean of dz, and of dx^2 + dy^2 and dz^2 over twice the time, of spheres at a gap after a time (units
    /// of a^2 / D0), with their standard errors; in units of a and D0.
    fn moments(gap: f64, time: f64, steps: u32, number: u32) -> [(f64, f64); 3] {
        let (field, domain) = (rest(), plates(500.0));
        let walls = NearWalls::new(FluidRegion::new(&field, &domain, &[]), RADIUS);
        let start = DVec3::Z * (RADIUS * (1.0 + gap));
        let variance = 2.0 * DIFFUSION * time * UNIT_S / f64::from(steps);
        let displacement = |row: u32| {
            let mut stream = Streams::new(7).stream(Purpose::Brownian, 0, row);
            let first = walls.place(start, 0.0);
            let end = (0..steps).fold(first, |place, _| walls.step(place, variance, 0.0, &mut stream));
            (end.x - start) / RADIUS
        };
        let all: Vec<DVec3> = (0..number).into_par_iter().map(displacement).collect();
        let mean = |f: &dyn Fn(&DVec3) -> f64| {
            let n = f64::from(number);
            let mean = all.iter().map(f).sum::<f64>() / n;
            let square = all.iter().map(|d| f(d) * f(d)).sum::<f64>() / n;
            (mean, libm::sqrt((square - mean * mean) / n))
        };
        [
            mean(&|d| d.z),
            mean(&|d| (d.x * d.x + d.y * d.y) / (4.0 * time)),
            mean(&|d| d.z * d.z / (2.0 * time)),
        ]
    }

    #[test]
    fn displacements_at_six_gaps_have_the_known_mean_and_squares() {
        for gap in [0.05, 0.1, 0.3, 1.0, 3.0, 10.0_f64] {
            // The relative change of D across the wall over the step is below 6 %.
            let time = 1.5e-3 * gap.min(1.0);
            let [drift, along, across] = moments(gap, time, 1, 60_000);
            let mobility = |gap: f64| 1.0 / resistance_across(gap);
            let slope = (mobility(gap * 1.001) - mobility(gap * 0.999)) / (0.002 * gap);
            let known = [slope * time, 1.0 / resistance_along(gap), mobility(gap)];
            for ((found, error), known) in [drift, along, across].into_iter().zip(known) {
                assert!((found - known).abs() < 2.0 * error, "{gap}: {found} +- {error}, {known}");
            }
        }
    }

    #[test]
    #[ignore = "slow: .ci/full"]
    fn the_steps_of_a_recording_give_the_moments_of_shorter_ones() {
        for gap in [0.1, 0.5] {
            let steps = (0.1 / STEP) as u32;
            let (few, many) = (moments(gap, 0.1, steps, 100_000), moments(gap, 0.1, 10 * steps, 100_000));
            for ((found, error), (fine, fine_error)) in few.into_iter().zip(many) {
                let allowed = 0.01 * fine + 3.0 * libm::hypot(error, fine_error);
                assert!((found - fine).abs() < allowed, "{gap}: {found} {fine}");
            }
        }
    }
}
