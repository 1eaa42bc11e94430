//! Encircled light: the image of a sphere through a spherical lens as light within a radius.
//!
//! Rays are not counted one by one. For a source point and an azimuth, the landing radius is computed along a
//! meridian of the lens from the axis to the rim, and the light between two nodes on the meridian is
//! distributed uniformly over the radii between their landing positions. Caustics, where the landing radius
//! has an extremum and the irradiance is infinite, are thus integrated correctly. The points of the far
//! hemisphere are rotated to the near one (`emission`), so source points are uniform in area over the
//! hemisphere facing the lens: by Archimedes' theorem, uniform in depth.

use super::aperture_integral::Fineness;
use super::pupil::{Pupil, PupilView, density};
use crate::render::instructions::InstructionSet;

/// Annuli per px.
pub(super) const ANNULI_PER_PX: usize = 32;

/// Refinement for light that lands near the axis: more meridians by this factor, because few source points
/// contribute to a pixel, and a node spacing (px, at fineness 2) that resolves the extremum of the landing
/// radius.
const NEAR_MERIDIANS: f64 = 2.0;
const NEAR_STEP_PX: f64 = 1.0 / 24.0;

/// Light that lands within this distance (px) of the axis, plus the radius of the geometric particle image,
/// counts as near the axis.
const NEAR_PX: f64 = 1.0;

/// Number of meridians (pairs of a source point and an azimuth) for a particle whose geometric image has this
/// diameter, px.
fn meridians(Fineness(fine): Fineness, image_px: f64) -> usize {
    (640.0 * fine * (image_px / 3.0).clamp(1.0, 16.0)) as usize
}

/// Number of nodes on a meridian for an image of this radius, px.
fn nodes(Fineness(fine): Fineness, reach_px: f64) -> usize {
    (0.5 * fine * (32.0 + reach_px.min(500.0))) as usize
}

/// Light within the radius k / ANNULI_PER_PX px, k = 0..=rings, as a fraction of the light that the particle
/// emits toward the lens side. The resolution has a factor of its own for the number of meridians.
pub(super) fn encircled(
    pupil: &Pupil,
    z_um: f64,
    radius_um: f64,
    rings: usize,
    (fineness, meridian_fineness): (Fineness, f64),
    instructions: InstructionSet,
) -> Vec<f64> {
    let Fineness(fine) = fineness;
    let meridians = meridians(Fineness(meridian_fineness * fine), pupil.image_px(z_um, radius_um));
    let distance = pupil.distance(z_um);
    let mut histogram = RadialHistogram::new(rings);
    for segment in segments(pupil, z_um, radius_um, rings as f64 / ANNULI_PER_PX as f64, fineness) {
        // For a point all meridians are the same.
        let meridians = if radius_um == 0.0 { 1 } else { (segment.meridians * meridians as f64) as usize };
        instructions.dispatch(Spread {
            segment: &segment,
            radius_um,
            distance,
            meridians,
            histogram: &mut histogram,
        });
    }
    histogram.cumulative()
}

/// Consecutive nodes on a meridian.
struct PupilSegment {
    /// Radius in the lens plane (um) and view of the particle at each node.
    nodes: Vec<(f64, PupilView)>,
    /// Factor on the number of meridians.
    meridians: f64,
}

/// The nodes whose light lands within `reach_px`, in segments. If a ray is lost, the light up to the adjacent
/// nodes is omitted.
fn segments(
    pupil: &Pupil,
    z_um: f64,
    radius_um: f64,
    reach_px: f64,
    fineness: Fineness,
) -> Vec<PupilSegment> {
    let q_max = pupil.useful_radius(z_um, radius_um, [reach_px; 2]);
    let nodes = nodes(fineness, reach_px);
    let node = |q: f64| pupil.view(z_um, radius_um, [q, 0.0]).map(|view| (q, view));
    let known: Vec<Option<(f64, PupilView)>> =
        (0..=nodes).map(|i| node(q_max * i as f64 / nodes as f64)).collect();
    let is_near = |view: &PupilView| view.landing[0].abs() < radius_um * view.slope() + NEAR_PX;
    let Fineness(fine) = fineness;

    let mut segments: Vec<PupilSegment> = Vec::new();
    // Whether the previous interval was near the axis; `None` if it cannot be continued.
    let mut continued = None;
    for pair in known.windows(2) {
        let [Some(a), Some(b)] = [pair[0], pair[1]] else {
            continued = None;
            continue;
        };
        let near = is_near(&a.1) || is_near(&b.1);
        if continued != Some(near) {
            segments
                .push(PupilSegment { nodes: vec![a], meridians: if near { NEAR_MERIDIANS } else { 1.0 } });
        }
        continued = Some(near);
        let Some(segment) = segments.last_mut() else { continue };
        let moved = (b.1.landing[0] - a.1.landing[0]).abs();
        let parts = if near { libm::ceil(moved / NEAR_STEP_PX * fine / 2.0).max(1.0) as usize } else { 1 };
        segment.nodes.extend((1..parts).filter_map(|i| node(a.0 + (b.0 - a.0) * i as f64 / parts as f64)));
        segment.nodes.push(b);
    }
    segments.iter_mut().filter(|segment| segment.meridians == 1.0).for_each(PupilSegment::straighten);
    segments
}

impl PupilSegment {
    /// Shifts the landing positions so that the midpoints of the linear pieces between them are on the curve;
    /// otherwise the image would be too small or too large by an eighth of the second difference between
    /// nodes. The nodes are equidistant.
    fn straighten(&mut self) {
        let landing: Vec<f64> = self.nodes.iter().map(|(_, view)| view.landing[0]).collect();
        for (i, (_, view)) in self.nodes.iter_mut().enumerate() {
            let middle = i.clamp(1, landing.len().saturating_sub(2).max(1));
            if let Some([a, b, c]) = landing.get(middle - 1..middle + 2) {
                view.landing[0] -= (a - 2.0 * b + c) / 12.0;
            }
        }
    }
}

/// Distribution of the light of one segment over the annuli, compiled for every instruction set.
struct Spread<'a> {
    segment: &'a PupilSegment,
    radius_um: f64,
    distance: f64,
    meridians: usize,
    histogram: &'a mut RadialHistogram,
}

impl pulp::WithSimd for Spread<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Spread { segment, radius_um, distance, meridians, histogram } = self;
        // A structure of arrays: views in units of annuli, midpoints up to the next node (um) and areas
        // (um^2).
        let column = |value: fn(&PupilView) -> f64| -> Vec<f64> {
            segment.nodes.iter().map(|(_, view)| value(view) * ANNULI_PER_PX as f64).collect()
        };
        // For a source point at (e1, e2, e3) the slopes are (q - e2) / (a + e1) and -e3 / (a + e1).
        let by_slope_x = column(|view| view.by_slope[0][0]);
        let by_slope_y = column(|view| view.by_slope[1][1]);
        let landing = column(|view| view.landing[0]);
        let q_slopes: Vec<f64> = by_slope_x.iter().zip(&segment.nodes).map(|(by, (q, _))| by * q).collect();
        let start: Vec<f64> =
            landing.iter().zip(&q_slopes).map(|(x, q_slopes)| x - q_slopes / distance).collect();
        let middle: Vec<f64> = segment.nodes.windows(2).map(|pair| 0.5 * (pair[0].0 + pair[1].0)).collect();
        let turn = 2.0 * std::f64::consts::PI / meridians as f64;
        let area: Vec<f64> = segment
            .nodes
            .windows(2)
            .zip(&middle)
            .map(|(pair, q)| (pair[1].0 - pair[0].0) * q * turn)
            .collect();
        let (mut radii, mut slopes) = (vec![0.0; landing.len()], vec![0.0; middle.len()]);
        for meridian in 0..meridians {
            let depth = (meridian as f64 + 0.5) / meridians as f64;
            let azimuth = std::f64::consts::PI * (meridian as f64 * GOLDEN).fract();
            let (sine, cosine) = libm::sincos(azimuth);
            let e1 = -radius_um * depth;
            let offset = radius_um * libm::sqrt(1.0 - depth * depth);
            let (e2, e3) = (offset * cosine, offset * sine);
            let per = 1.0 / (distance + e1);
            for i in 0..radii.len() {
                let x = start[i] + (q_slopes[i] - by_slope_x[i] * e2) * per;
                let y = by_slope_y[i] * e3 * per;
                radii[i] = (x * x + y * y).sqrt();
            }
            for i in 0..slopes.len() {
                let q = middle[i];
                let light = area[i] * density(distance + e1, q * q - 2.0 * q * e2 + offset * offset);
                slopes[i] = light / clamp_magnitude(radii[i + 1] - radii[i], NARROWEST);
            }
            histogram.add_chain(&radii, &slopes);
        }
    }
}

/// Minimum width of a piece, in annuli: at an extremum of the landing radius the width vanishes.
const NARROWEST: f64 = 1e-3;

/// `v` with its magnitude raised to at least `least`.
#[inline(always)]
fn clamp_magnitude(v: f64, least: f64) -> f64 {
    let size = if v.abs() > least { v.abs() } else { least };
    size.copysign(v)
}

/// The golden ratio minus one: its multiples modulo 1 are a low-discrepancy sequence in the unit interval.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// A distribution over radii composed of uniform pieces, stored as the second differences of its integral: a
/// piece costs four additions whatever its width, and the integral at whole annuli is exact.
struct RadialHistogram {
    second: Vec<f64>,
    rings: usize,
}

impl RadialHistogram {
    fn new(rings: usize) -> Self {
        RadialHistogram { second: vec![0.0; rings + 2], rings }
    }

    /// Distributes light uniformly between each radius and the next (in annuli); `slopes` is the light
    /// divided by the signed step of the radius. The end of one piece is the start of the next.
    #[inline(always)]
    fn add_chain(&mut self, radii: &[f64], slopes: &[f64]) {
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
        // The integral at annulus k includes all second differences before it.
        for value in &mut self.second {
            let bend = *value;
            *value = sum + slope;
            sum = *value;
            slope += bend;
        }
        self.second
    }
}
