//! The pre-fit: widths of particle images over depth, compared with a few hundred traced rays; no
//! images are rendered.
//!
//! Widths are the radii that contain 20, 50 and 80 % of the light; with a cylindrical lens, the same
//! quantiles of |u| and |v|, along and across its axis. Moments alone lead to wrong minima because the faint
//! rim dominates them; quantiles do not.

use microsig_core::optics::{OpticalSystem, Ray};
use rayon::prelude::*;

use super::background::Background;
use super::moments::Shape;
use super::optics::{Given, Microscope, Shared};
use super::particles::{Window, Windows};
use super::scan::Scan;
use microsig_core::linear::Symmetric;

/// Fractions of the light.
const FRACTIONS: [f64; 3] = [0.2, 0.5, 0.8];

/// Rays per plane, while starts are compared and at the end.
const FEW_RAYS: usize = 150;
const RAYS: usize = 500;

/// Maximum number of steps in both cases, and the number of starts that are followed to the end.
const FEW_STEPS: usize = 8;
const STEPS: usize = 40;
const FOLLOWED: usize = 2;

/// Windows in which widths are measured, relative to the fit's: the images far from focus may be wider than a window,
/// whose background their light then hides.
const WINDOWS: [f64; 3] = [1.0, 0.7, 0.5];

/// Initial slopes of marginal rays, relative to the widest images: for images wider than a window, these are no measure.
const SLOPES: [f64; 2] = [1.0, 0.5];

/// Starts whose curves fit worse than the best of the same window by this factor are not tried.
const MUCH_WORSE: f64 = 4.0;

/// Starts that agree in the logarithms of slope and focal length within these are one.
const SAME_SLOPE: f64 = 0.03;
const SAME_FOCAL_LENGTH: f64 = 0.2;

/// Initial focal lengths of the pre-fit, um.
const FOCAL_LENGTHS_UM: [f64; 4] = [60.0, 150.0, 350.0, 800.0];

/// Initial values of z, in units of the aberration length.
const STARTS: [f64; 3] = [0.0, 0.5, 1.0];

/// Assumed error of a radius: absolute (px) plus relative.
const RADIUS_ERROR_PX: f64 = 0.15;
const RELATIVE_ERROR: f64 = 0.03;

/// A starting point for the image fit.
#[derive(Debug, Clone)]
pub(super) struct Start {
    pub(super) microscope: Microscope,
    /// +1: stage positions increase away from the lens; -1: toward it.
    pub(super) direction: f64,
    /// Depth of each particle at stage position 0, um of the model.
    pub(super) z_um: Vec<f64>,
    /// Mean loss of the curves (dimensionless).
    cost: f64,
}

impl Start {
    fn is_like(&self, other: &Start) -> bool {
        let far = |shared: Shared| shared.distance(&self.microscope, &other.microscope).abs();
        self.direction == other.direction
            && self.microscope.angle == other.microscope.angle
            && far(Shared::NumericalAperture) < SAME_SLOPE
            && far(Shared::FocalLength) < SAME_FOCAL_LENGTH
    }
}

/// Widths over stage position, averaged over all particles.
struct Curves {
    /// Radius within which light was measured, px.
    half: f64,
    /// Direction of the cylindrical lens, rad.
    angle: f64,
    stage_um: Vec<f64>,
    /// Per plane: three radii, or three |u| and three |v|.
    radii: Vec<Vec<f64>>,
    /// Shift of each particle's curve relative to the first particle's, um of stage position.
    shifts: Vec<f64>,
}

/// Input of the pre-fit.
pub(super) struct Known<'a> {
    pub(super) scan: &'a Scan,
    pub(super) background: Background,
    pub(super) windows: &'a Windows,
    pub(super) shape: &'a Shape,
    pub(super) given: Given,
    /// Particle diameter, um, if given by the user.
    pub(super) diameter_um: Option<f64>,
    /// Directions of the stage to be tried.
    pub(super) directions: &'a [f64],
    pub(super) astigmatic: bool,
}

/// A set of initial values.
#[derive(Clone, Copy)]
struct Guess {
    direction: f64,
    focal_length_um: f64,
    /// z in units of the aberration length.
    z: f64,
    /// See [`SLOPES`].
    slope: f64,
}

/// The best starting points for each direction of the stage, each orientation of the cylindrical lens and each window that
/// differ; the image fit decides between them.
pub(super) fn starts(known: &Known) -> Vec<Start> {
    let axes: &[f64] = if known.astigmatic { &[0.0, std::f64::consts::FRAC_PI_2] } else { &[0.0] };
    let mut different: Vec<Start> = Vec::new();
    for window in WINDOWS {
        let half = window * known.windows.half as f64;
        let mut best: Vec<Start> = Vec::new();
        for turn in axes {
            let curves = Curves::of(known, known.shape.axis + turn, half);
            best.extend(known.directions.iter().filter_map(|&direction| curves.best(known, direction)));
        }
        let least = best.iter().map(|start| start.cost).fold(f64::INFINITY, f64::min);
        best.retain(|start| start.cost <= MUCH_WORSE * least);
        best.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        for start in best {
            if !different.iter().any(|other| other.is_like(&start)) {
                different.push(start);
            }
        }
    }
    different
}

impl Curves {
    fn of(known: &Known, angle: f64, half: f64) -> Curves {
        let scan = known.scan;
        let mean = scan.mean_stage_um();
        let own: Vec<Vec<Vec<f64>>> = known
            .windows
            .particles
            .iter()
            .zip(&known.shape.places)
            .map(|(window, place)| {
                scan.planes
                    .iter()
                    .zip(&scan.stage_um)
                    .map(|(plane, s)| {
                        let middle = [0, 1].map(|i| place[i] + known.shape.drift[i] * (s - mean));
                        radii(plane, known.background, window, half, middle, angle, known.astigmatic)
                    })
                    .collect()
            })
            .collect();
        let shifts: Vec<f64> = own.iter().map(|curve| shift(&scan.stage_um, &own[0], curve)).collect();
        let radii = scan
            .stage_um
            .iter()
            .map(|&s| {
                let all: Vec<Vec<f64>> = own
                    .iter()
                    .zip(&shifts)
                    .filter_map(|(curve, shift)| interpolate(&scan.stage_um, curve, s - shift))
                    .collect();
                (0..own[0][0].len())
                    .map(|i| all.iter().map(|radii| radii[i]).sum::<f64>() / all.len().max(1) as f64)
                    .collect()
            })
            .collect();
        Curves { half, angle, stage_um: scan.stage_um.clone(), radii, shifts }
    }

    /// The best fit for a direction of the stage, from many initial values.
    fn best(&self, known: &Known, direction: f64) -> Option<Start> {
        let guesses: Vec<Guess> = FOCAL_LENGTHS_UM
            .iter()
            .flat_map(|&f| STARTS.iter().map(move |&z| (f, z)))
            .flat_map(|(focal_length_um, z)| {
                SLOPES.iter().map(move |&slope| Guess { direction, focal_length_um, z, slope })
            })
            .collect();
        let cost = |(a, _): &(f64, State), (b, _): &(f64, State)| a.total_cmp(b);
        let mut rough: Vec<(f64, State)> = guesses
            .par_iter()
            .map(|guess| self.minimize(self.first(known, *guess), direction, known, FEW_RAYS, FEW_STEPS))
            .collect();
        rough.sort_by(cost);
        rough.truncate(FOLLOWED);
        let finish = |(_, state): (f64, State)| self.minimize(state, direction, known, RAYS, STEPS);
        let (cost, State { microscope, z0_um }) = rough.into_par_iter().map(finish).min_by(cost)?;
        let depth = |shift: &f64| z0_um + direction * shift / known.given.depth_factor;
        Some(Start { microscope, direction, z_um: self.shifts.iter().map(depth).collect(), cost })
    }

    /// The state with these initial values.
    fn first(&self, known: &Known, guess: Guess) -> State {
        let Guess { direction, focal_length_um, .. } = guess;
        let given = known.given;
        let um_per_px = given.pixel_size_um / given.magnification;
        let outer = |radii: &Vec<f64>| radii[radii.len() - 1].max(radii[2]);
        // The side with the wider images determines the slope of the marginal rays.
        let focus_um = 0.5 * (known.shape.focus[0] + known.shape.focus[1]);
        let slope = self
            .stage_um
            .iter()
            .zip(&self.radii)
            .map(|(s, radii)| {
                outer(radii) * um_per_px / (0.9 * ((s - focus_um).abs() / given.depth_factor).max(1e-9))
            })
            .zip(&self.stage_um)
            .filter(|(_, s)| (*s - focus_um).abs() > 0.25 * known.scan.range_um())
            .map(|(slope, _)| slope)
            .fold(0.02f64, f64::max);
        let least = self.radii.iter().map(|radii| radii[0]).fold(f64::INFINITY, f64::min);
        let shift_um = if known.astigmatic {
            let quarter = ((self.angle - known.shape.axis) / std::f64::consts::FRAC_PI_2).round() != 0.0;
            let between = direction * (known.shape.focus[0] - known.shape.focus[1]) / given.depth_factor;
            if quarter { -between } else { between }
        } else {
            0.0
        };
        let microscope = Microscope {
            magnification: given.magnification,
            pixel_size_um: given.pixel_size_um,
            ri_medium: given.ri_medium,
            ri_lens: given.ri_lens,
            depth_factor: given.depth_factor,
            slope: (guess.slope * slope).min(2.0),
            focal_length_um,
            focus_shift_um: shift_um,
            angle: self.angle,
            diameter_um: known.diameter_um.unwrap_or((2.5 * least * um_per_px).clamp(0.2, 10.0)),
        }
        .bounded();
        State {
            microscope,
            z0_um: -guess.z * microscope.aberration_um() - direction * focus_um / given.depth_factor,
        }
    }

    /// Levenberg-Marquardt minimization with a soft L1 loss; returns the mean loss.
    fn minimize(
        &self,
        mut state: State,
        direction: f64,
        known: &Known,
        rays: usize,
        steps: usize,
    ) -> (f64, State) {
        let mut free = vec![Shared::NumericalAperture, Shared::FocalLength];
        if known.diameter_um.is_none() {
            free.push(Shared::Diameter);
        }
        if known.astigmatic {
            free.push(Shared::FocusShift);
        }
        let n = free.len() + 1;
        let residuals = |state: &State| self.residuals(state, direction, known, rays);
        let loss =
            |r: &[f64]| r.iter().map(|r| 2.0 * (libm::sqrt(1.0 + r * r) - 1.0)).sum::<f64>() / r.len() as f64;
        let mut here = residuals(&state);
        let mut damping = 1e-2;
        for _ in 0..steps {
            let columns: Vec<Vec<f64>> = (0..n)
                .map(|k| {
                    let step = free.get(k).map_or(0.5, |s| s.step(&state.microscope).unwrap_or(0.01));
                    let moved = residuals(&state.moved(&free, k, step));
                    moved.iter().zip(&here).map(|(a, b)| (a - b) / step).collect()
                })
                .collect();
            let weights: Vec<f64> = here.iter().map(|r| 1.0 / libm::sqrt(1.0 + r * r)).collect();
            let mut normal = Symmetric::zeros(n);
            let mut right = vec![0.0; n];
            for i in 0..n {
                for j in 0..n {
                    let dot = columns[i].iter().zip(&columns[j]).zip(&weights).map(|((a, b), w)| w * a * b);
                    normal.add(i, j, dot.sum());
                }
                right[i] =
                    -columns[i].iter().zip(&here).zip(&weights).map(|((a, r), w)| w * a * r).sum::<f64>();
            }
            let before = loss(&here);
            let mut accepted = false;
            while damping < 1e6 {
                let mut damped = normal.clone();
                (0..n).for_each(|i| damped.add(i, i, damping * normal.at(i, i) + 1e-12));
                let Some(step) = damped.solve(&right) else {
                    damping *= 10.0;
                    continue;
                };
                let mut next = state.clone();
                for (k, step) in step.iter().enumerate() {
                    let longest = free.get(k).map_or(10.0, |s| s.longest(&state.microscope));
                    next = next.moved(&free, k, step.clamp(-longest, longest));
                }
                next.microscope = next.microscope.bounded();
                let there = residuals(&next);
                if loss(&there) < before {
                    state = next;
                    here = there;
                    damping = (0.3 * damping).max(1e-6);
                    accepted = true;
                    break;
                }
                damping *= 4.0;
            }
            if !accepted || before - loss(&here) < 1e-4 * before {
                break;
            }
        }
        (loss(&here), state)
    }

    fn residuals(&self, state: &State, direction: f64, known: &Known, rays: usize) -> Vec<f64> {
        let settings = state.microscope.settings(2 * known.windows.half + 1);
        let system = OpticalSystem::new(&settings);
        let mut residuals = Vec::with_capacity(6 * self.radii.len());
        for (s, radii) in self.stage_um.iter().zip(&self.radii) {
            let z_um = direction * s / state.microscope.depth_factor + state.z0_um;
            let ours = traced(&system, &state.microscope, z_um, self.half, known.astigmatic, rays);
            let ours = ours.unwrap_or([0.0; 6]);
            residuals.extend(
                radii.iter().zip(ours).map(|(r, model)| (model - r) / (RADIUS_ERROR_PX + RELATIVE_ERROR * r)),
            );
        }
        residuals
    }
}

#[derive(Debug, Clone)]
struct State {
    microscope: Microscope,
    z0_um: f64,
}

impl State {
    fn moved(&self, free: &[Shared], k: usize, by: f64) -> State {
        match free.get(k) {
            Some(shared) => State { microscope: shared.moved(self.microscope, by), z0_um: self.z0_um },
            None => State { z0_um: self.z0_um + by, ..self.clone() },
        }
    }
}

/// Radii that contain the fractions [`FRACTIONS`] of the light in a window, px.
fn radii(
    plane: &[u16],
    background: Background,
    window: &Window,
    half: f64,
    middle: [f64; 2],
    angle: f64,
    astigmatic: bool,
) -> Vec<f64> {
    let (c, s) = (libm::cos(angle), libm::sin(angle));
    let lit = window.pixels.iter().map(|&(at, [x, y])| {
        let (dx, dy) = (x - middle[0], y - middle[1]);
        ([c * dx + s * dy, c * dy - s * dx], f64::from(plane[at]) - background.mean)
    });
    let lit: Vec<([f64; 2], f64)> = lit.filter(|(p, _)| libm::hypot(p[0], p[1]) <= half).collect();
    let of = |place: &dyn Fn([f64; 2]) -> f64| {
        let mut values: Vec<(f64, f64)> = lit.iter().map(|(p, v)| (place(*p), *v)).collect();
        quantiles(&mut values)
    };
    if astigmatic {
        [of(&|p| p[0].abs()), of(&|p| p[1].abs())].concat()
    } else {
        of(&|p| libm::hypot(p[0], p[1])).to_vec()
    }
}

/// Quantiles of the light; `values` are pairs of coordinate and light.
pub(super) fn quantiles(values: &mut [(f64, f64)]) -> [f64; 3] {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = values.iter().map(|v| v.1).sum();
    FRACTIONS.map(|share| {
        let mut sum = 0.0;
        let mut before = (0.0, 0.0);
        for &(place, light) in values.iter() {
            sum += light;
            if sum >= share * total {
                let part = ((share * total - before.1) / (sum - before.1)).clamp(0.0, 1.0);
                return before.0 + part * (place - before.0);
            }
            before = (place, sum);
        }
        before.0
    })
}

/// The shift of stage positions that fits a curve to the first one best, um.
fn shift(stage_um: &[f64], first: &[Vec<f64>], curve: &[Vec<f64>]) -> f64 {
    let range = (stage_um[stage_um.len() - 1] - stage_um[0]).abs();
    let misfit = |shift: f64| {
        let (mut sum, mut n) = (0.0, 0);
        for (s, here) in stage_um.iter().zip(curve) {
            if let Some(there) = interpolate(stage_um, first, s + shift) {
                sum += here.iter().zip(&there).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
                n += 1;
            }
        }
        if 2 * n < stage_um.len() { f64::INFINITY } else { sum / f64::from(n as u32) }
    };
    let at = |i: i32| f64::from(i) / 400.0 * range;
    let best = (-180..=180).min_by(|&a, &b| misfit(at(a)).total_cmp(&misfit(at(b)))).unwrap_or(0);
    at(best)
}

/// The curve at a stage position; `None` outside the scan.
fn interpolate(stage_um: &[f64], curve: &[Vec<f64>], at: f64) -> Option<Vec<f64>> {
    stage_um.windows(2).zip(curve.windows(2)).find_map(|(s, c)| {
        let inside = (at - s[0]) * (at - s[1]) <= 0.0;
        let part = if s[1] == s[0] { 0.0 } else { (at - s[0]) / (s[1] - s[0]) };
        inside.then(|| c[0].iter().zip(&c[1]).map(|(a, b)| a + part * (b - a)).collect())
    })
}

/// Quasi-random points in the six-dimensional unit cube: multiples of inverse powers of the root of x^7 = x +
/// 1 (M. Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018).
fn quasi_random(i: usize) -> [f64; 6] {
    const ROOT: f64 = 1.112_775_684_278_705_5;
    let mut power = 1.0;
    [0; 6].map(|_| {
        power /= ROOT;
        (0.5 + power * (i + 1) as f64).fract()
    })
}

/// The radii (px) of traced rays; `None` if fewer than 5 % of them arrive within the radius `half`.
fn traced(
    system: &OpticalSystem,
    microscope: &Microscope,
    z_um: f64,
    half: f64,
    astigmatic: bool,
    rays: usize,
) -> Option<[f64; 6]> {
    let distance = system.objective.object_distance(z_um);
    let radius = 0.5 * microscope.diameter_um;
    if distance <= 1.01 * radius {
        return None;
    }
    let mut landed: Vec<([f64; 2], f64)> = Vec::with_capacity(rays);
    for i in 0..rays {
        let [a, b, c, d, e, f] = quasi_random(i);
        let q = system.objective.aperture_radius * libm::sqrt(a) * (1.0 - 1e-9);
        let turn = 2.0 * std::f64::consts::PI;
        let (qx, qy) = (q * libm::cos(turn * b), q * libm::sin(turn * b));
        let across = radius * libm::sqrt(1.0 - c * c);
        let (e1, e2, e3) = (-radius * c, across * libm::cos(turn * d), across * libm::sin(turn * d));
        let away = distance + e1;
        let start = Ray { q_x: e2, q_y: e3, p_x: (qx - e2) / away, p_y: (qy - e3) / away };
        let Some((x, y)) = system.trace(start, away) else { continue };
        let place = [x / microscope.pixel_size_um + e - 0.5, y / microscope.pixel_size_um + f - 0.5];
        let r2 = away * away + (qx - e2) * (qx - e2) + (qy - e3) * (qy - e3);
        if libm::hypot(place[0], place[1]) <= half {
            landed.push((place, away / (r2 * libm::sqrt(r2))));
        }
    }
    if landed.len() < rays / 20 {
        return None;
    }
    let of = |place: &dyn Fn([f64; 2]) -> f64| {
        let mut values: Vec<(f64, f64)> = landed.iter().map(|(p, v)| (place(*p), *v)).collect();
        quantiles(&mut values)
    };
    let [a, b] = if astigmatic {
        [of(&|p| p[0].abs()), of(&|p| p[1].abs())]
    } else {
        [of(&|p| libm::hypot(p[0], p[1])), [0.0; 3]]
    };
    Some([a[0], a[1], a[2], b[0], b[1], b[2]])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_of_a_uniform_disc_are_square_roots() {
        let mut disc: Vec<(f64, f64)> =
            (0..10_000).map(|i| (10.0 * libm::sqrt((f64::from(i) + 0.5) / 1e4), 1.0)).collect();
        for (radius, share) in quantiles(&mut disc).into_iter().zip(FRACTIONS) {
            assert!((radius - 10.0 * libm::sqrt(share)).abs() < 1e-2, "{radius} {share}");
        }
    }
}
