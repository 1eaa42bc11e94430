//! Light within a radius: the image of a sphere behind a spherical lens.
//!
//! Rays are not counted one by one. For a source point and an azimuth, the landing radius is followed along a spoke of
//! the lens from the axis to the rim, and the light between two stops on the spoke is spread evenly over the radii
//! between their landing places. So a caustic, where the landing radius turns back and the density is infinite, is
//! integrated as it should be. The far hemisphere's points are turned to the near one (`emission`), so source points are
//! uniform in area over the hemisphere toward the lens: by Archimedes, uniform in depth.

use super::exposure::Fineness;
use super::pupil::{Pupil, View, density};
use crate::render::instructions::InstructionSet;

/// Annuli per px.
pub(super) const RINGS: usize = 32;

/// How finely light that lands near the axis is followed there: few source points reach a pixel, so there are more of them, and
/// the landing radius turns back, so stops are so close, px at fineness 2.
const NEAR_SPOKES: f64 = 2.0;
const NEAR_STEP_PX: f64 = 1.0 / 24.0;

/// Light that lands within this distance of the axis, or so little more than the particle's own radius, lands near it, px.
const NEAR_PX: f64 = 1.0;

/// Spokes, which are pairs of a source point and an azimuth, for a particle whose own image is so wide, px.
fn spokes(Fineness(fine): Fineness, image_px: f64) -> usize {
    (640.0 * fine * (image_px / 3.0).clamp(1.0, 16.0)) as usize
}

/// Stops on a spoke for an image that reaches so far, px.
fn stops(Fineness(fine): Fineness, reach_px: f64) -> usize {
    (0.5 * fine * (32.0 + reach_px.min(500.0))) as usize
}

/// Light within the radius k / RINGS px, k = 0..=rings, as a share of all light that the particle sends toward the lens
/// side.
pub(super) fn encircled(
    pupil: &Pupil,
    z_um: f64,
    radius_um: f64,
    rings: usize,
    fineness: Fineness,
    instructions: InstructionSet,
) -> Vec<f64> {
    let spokes = spokes(fineness, pupil.image_px(z_um, radius_um));
    let distance = pupil.distance(z_um);
    let mut ramps = Ramps::new(rings);
    for run in runs(pupil, z_um, radius_um, rings as f64 / RINGS as f64, fineness) {
        // A point has no size: every spoke is the same.
        let spokes = if radius_um == 0.0 { 1 } else { (run.spokes * spokes as f64) as usize };
        instructions.dispatch(Spread { run: &run, radius_um, distance, spokes, ramps: &mut ramps });
    }
    ramps.cumulative()
}

/// Stops in a row.
struct Run {
    /// Where they are in the lens plane, um, and what is seen there.
    stops: Vec<(f64, View)>,
    /// More spokes than usual.
    spokes: f64,
}

/// The stops whose light lands within `reach_px`. Where a ray is lost, so is the light up to the stops next to it.
fn runs(pupil: &Pupil, z_um: f64, radius_um: f64, reach_px: f64, fineness: Fineness) -> Vec<Run> {
    let q_max = pupil.useful_radius(z_um, radius_um, reach_px);
    let stops = stops(fineness, reach_px);
    let stop = |q: f64| pupil.view(z_um, radius_um, [q, 0.0]).map(|view| (q, view));
    let known: Vec<Option<(f64, View)>> =
        (0..=stops).map(|i| stop(q_max * i as f64 / stops as f64)).collect();
    let is_near = |view: &View| view.landing[0].abs() < radius_um * view.slope() + NEAR_PX;
    let Fineness(fine) = fineness;

    let mut runs: Vec<Run> = Vec::new();
    // What the piece before ended with, if it is to be continued.
    let mut continued = None;
    for pair in known.windows(2) {
        let [Some(a), Some(b)] = [pair[0], pair[1]] else {
            continued = None;
            continue;
        };
        let near = is_near(&a.1) || is_near(&b.1);
        if continued != Some(near) {
            runs.push(Run { stops: vec![a], spokes: if near { NEAR_SPOKES } else { 1.0 } });
        }
        continued = Some(near);
        let Some(run) = runs.last_mut() else { continue };
        let moved = (b.1.landing[0] - a.1.landing[0]).abs();
        let parts = if near { libm::ceil(moved / NEAR_STEP_PX * fine / 2.0).max(1.0) as usize } else { 1 };
        run.stops.extend((1..parts).filter_map(|i| stop(a.0 + (b.0 - a.0) * i as f64 / parts as f64)));
        run.stops.push(b);
    }
    runs.iter_mut().filter(|run| run.spokes == 1.0).for_each(Run::straighten);
    runs
}

impl Run {
    /// Moves landing places so that the straight pieces between them have the middles of the curve: else a curved image
    /// would be too small or too large by an eighth of its second difference from stop to stop. Stops are evenly spaced.
    fn straighten(&mut self) {
        let landing: Vec<f64> = self.stops.iter().map(|(_, view)| view.landing[0]).collect();
        for (i, (_, view)) in self.stops.iter_mut().enumerate() {
            let middle = i.clamp(1, landing.len().saturating_sub(2).max(1));
            if let Some([a, b, c]) = landing.get(middle - 1..middle + 2) {
                view.landing[0] -= (a - 2.0 * b + c) / 12.0;
            }
        }
    }
}

/// Spreading the light of one run, compiled for every instruction set.
struct Spread<'a> {
    run: &'a Run,
    radius_um: f64,
    distance: f64,
    spokes: usize,
    ramps: &'a mut Ramps,
}

impl pulp::WithSimd for Spread<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Spread { run, radius_um, distance, spokes, ramps } = self;
        // Stops in arrays: what is seen, in rings, the middle up to the next and the area, um and um^2.
        let column = |value: fn(&View) -> f64| -> Vec<f64> {
            run.stops.iter().map(|(_, view)| value(view) * RINGS as f64).collect()
        };
        let landing = column(|view| view.landing[0]);
        let by_e1 = column(|view| view.by_e1[0]);
        let by_e2 = column(|view| view.by_e2[0]);
        let by_e3 = column(|view| view.by_e3[1]);
        let middle: Vec<f64> = run.stops.windows(2).map(|pair| 0.5 * (pair[0].0 + pair[1].0)).collect();
        let turn = 2.0 * std::f64::consts::PI / spokes as f64;
        let area: Vec<f64> =
            run.stops.windows(2).zip(&middle).map(|(pair, q)| (pair[1].0 - pair[0].0) * q * turn).collect();
        let (mut radii, mut slopes) = (vec![0.0; landing.len()], vec![0.0; middle.len()]);
        for spoke in 0..spokes {
            let depth = (spoke as f64 + 0.5) / spokes as f64;
            let azimuth = std::f64::consts::PI * (spoke as f64 * GOLDEN).fract();
            let (sine, cosine) = libm::sincos(azimuth);
            let e1 = -radius_um * depth;
            let offset = radius_um * libm::sqrt(1.0 - depth * depth);
            let (e2, e3) = (offset * cosine, offset * sine);
            for i in 0..radii.len() {
                let x = landing[i] + by_e1[i] * e1 + by_e2[i] * e2;
                let y = by_e3[i] * e3;
                radii[i] = (x * x + y * y).sqrt();
            }
            for i in 0..slopes.len() {
                let q = middle[i];
                let light = area[i] * density(distance + e1, q * q - 2.0 * q * e2 + offset * offset);
                slopes[i] = light / at_least(radii[i + 1] - radii[i], NARROWEST);
            }
            ramps.chain(&radii, &slopes);
        }
    }
}

/// At a turning point of the landing radius a piece has no width; a thousandth of a ring is as good.
const NARROWEST: f64 = 1e-3;

/// A number whose size is at least `least`.
#[inline(always)]
fn at_least(v: f64, least: f64) -> f64 {
    let size = if v.abs() > least { v.abs() } else { least };
    size.copysign(v)
}

/// The golden ratio less one: its multiples modulo 1 fill the unit interval evenly however many are taken.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// A distribution over radii made of uniform pieces, kept as the second differences of its integral: a piece costs four
/// additions however wide it is, and the integral at whole rings is exact.
struct Ramps {
    second: Vec<f64>,
    rings: usize,
}

impl Ramps {
    fn new(rings: usize) -> Self {
        Ramps { second: vec![0.0; rings + 2], rings }
    }

    /// Spreads light evenly between each radius and the next, in rings; `slopes` is light over the step of radius, with its
    /// sign. So the end of one piece is the beginning of the next.
    #[inline(always)]
    fn chain(&mut self, radii: &[f64], slopes: &[f64]) {
        let mut before = 0.0;
        for (&r, &slope) in radii.iter().zip(slopes) {
            self.bend(r, slope - before);
            before = slope;
        }
        if let Some(&last) = radii.last() {
            self.bend(last, -before);
        }
    }

    #[inline(always)]
    fn bend(&mut self, at: f64, slope: f64) {
        let ring = at as usize;
        if ring < self.rings {
            let part = at - ring as f64;
            self.second[ring] += slope * (1.0 - part);
            self.second[ring + 1] += slope * part;
        }
    }

    fn cumulative(mut self) -> Vec<f64> {
        self.second.truncate(self.rings + 1);
        let (mut slope, mut sum) = (0.0, 0.0);
        // At ring k the integral holds all bends before it.
        for value in &mut self.second {
            let bend = *value;
            *value = sum + slope;
            sum = *value;
            slope += bend;
        }
        self.second
    }
}
