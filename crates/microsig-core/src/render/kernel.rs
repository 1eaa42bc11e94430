//! The inner loop: rays of a particle from their source points to pixels, in f32, many at a time.
//!
//! A direction of the fan is taken with all points that can send it into the lens, one point a lane. Only + - * / sqrt
//! and comparisons occur, each correctly rounded and never fused, so that every instruction set gives the same bits. The
//! loops are plain ones that the compiler turns into vector code.
//!
//! The refraction is that of `optics` with everything cancelled that cancels. Lengths are in units of the faces' radius.
//! A ray has the direction d = (w, u, v) and meets the lens at q = Q/w, Q = w e + L (u, v), e being its source point across
//! the axis and L the distance of that from the lens. The normals of the faces are (w, -Q) and (w, Q), of length N,
//! N^2 = w^2 + Q^2. Directions have the length 1/sqrt((n_l/n_m)^2 - 1), with which Snell's law in vector form makes of d
//!
//! d + G (w, -Q) + H (w, Q),   G = (sqrt(D^2 + N^2) - D) / N^2,   D = w^2 - Q.(u, v),
//! H = (sqrt(E^2 - N^2) - E) / N^2,   E = w^2 + Q.(u, v) + G (w^2 - Q^2);
//!
//! E^2 < N^2 is total reflection. With all fractions brought to the denominator N^4, g = G N^2 and h = H N^4, the slopes
//! behind the lens are (N^4 (u, v) + I Q) / (w F), I = h - g N^2 and F = N^4 + g N^2 + h. The place on the sensor is a
//! times q plus b times the slope, the two numbers of the ray transfer matrix behind the lens, one pair for each axis:
//! (b (N^4 (u, v) + I Q) + a F Q) / (w F). Two square roots and one division for a ray.

use std::ops::Range;

use super::sources::{MAX_LANES, Sources};
use super::tally::{Frame, Tally};
use crate::optics::OpticalSystem;

/// 1.5 * 2^23: adding it to a number below 2^22 rounds that to the nearest integer (ties to even, as the original does)
/// and leaves the integer in the low bits, where a conversion would not be done for many numbers at a time.
const ROUND: f32 = 12_582_912.0;
const ROUND_BITS: u32 = ROUND.to_bits();

/// What the kernel knows of the optics.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lens {
    /// Radius of the faces, um: the kernel's unit of length.
    pub(super) unit_um: f64,
    aperture2: f32,
    /// Length of directions.
    length: f32,
    /// a along columns and along rows, over b along rows.
    position: [f32; 2],
    /// b along columns over b along rows; 0 where a cylinder makes an image of the lens along columns.
    slope: f32,
    /// b along rows, px.
    lever: f32,
}

impl Lens {
    pub(super) fn new(system: &OpticalSystem, pixel_size: f64) -> Self {
        let objective = &system.objective;
        let (unit, mu, way) = (objective.face_radius, objective.index_ratio, objective.image_distance);
        let aperture = objective.aperture_radius / unit;
        // Behind the lens: a third of the way, a cylinder with this power along columns, the rest.
        let power = system.cylinder.map_or(0.0, |c| 1.0 / c.focal_length);
        let kept = 1.0 - 2.0 * way / 3.0 * power;
        Lens {
            unit_um: unit,
            aperture2: (aperture * aperture) as f32,
            length: (1.0 / libm::sqrt(1.0 / (mu * mu) - 1.0)) as f32,
            position: [kept, 1.0].map(|a| (a * unit / way) as f32),
            slope: (kept / 3.0 + 2.0 / 3.0) as f32,
            lever: (way / pixel_size) as f32,
        }
    }
}

/// A direction of the fan and neighbouring sources that can send it into the lens.
#[derive(Debug, Clone)]
pub(super) struct Run {
    pub(super) direction: [f32; 3],
    pub(super) sources: Range<usize>,
}

/// Rays in flight; their arrays stay in the first-level cache.
const BLOCK: usize = 512;

/// Rays on their way, in the symbols of this module; reused from particle to particle.
#[derive(Debug, Clone)]
#[repr(align(64))]
pub(super) struct Rays {
    w: [f32; BLOCK],
    u: [f32; BLOCK],
    v: [f32; BLOCK],
    q_x: [f32; BLOCK],
    q_y: [f32; BLOCK],
    /// N^4, N^4 + g N^2 + h, and h - g N^2.
    n4: [f32; BLOCK],
    forward: [f32; BLOCK],
    inward: [f32; BLOCK],
    /// Numbers whose sign is set if a ray is lost.
    signs: [u32; BLOCK],
    places: [u32; BLOCK],
    length: usize,
}

impl Default for Rays {
    fn default() -> Self {
        let zero = [0.0; BLOCK];
        Rays {
            w: zero,
            u: zero,
            v: zero,
            q_x: zero,
            q_y: zero,
            n4: zero,
            forward: zero,
            inward: zero,
            signs: [0; BLOCK],
            places: [0; BLOCK],
            length: 0,
        }
    }
}

/// Traces the rays of all runs and counts them.
pub(super) fn trace(
    arch: pulp::Arch,
    lens: &Lens,
    sources: &Sources,
    runs: &[Run],
    rays: &mut Rays,
    tally: &mut Tally,
) {
    arch.dispatch(Trace { lens, sources, runs, rays, tally });
}

/// The kernel as an operation that is compiled once for every instruction set.
struct Trace<'a> {
    lens: &'a Lens,
    sources: &'a Sources,
    runs: &'a [Run],
    rays: &'a mut Rays,
    tally: &'a mut Tally,
}

impl pulp::WithSimd for Trace<'_> {
    type Output = ();

    // Inlined, with all that it calls, into a function for which the instruction set is switched on.
    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Trace { lens, sources, runs, rays, tally } = self;
        rays.length = 0;
        for run in runs {
            let mut rest = run.sources.clone();
            while !rest.is_empty() {
                if rays.length == BLOCK {
                    rays.finish(lens, tally);
                }
                let n = rest.len().min(BLOCK - rays.length);
                let direction = run.direction.map(|d| d * lens.length);
                rays.launch(direction, sources, rest.start..rest.start + n);
                rest.start += n;
            }
        }
        rays.finish(lens, tally);
    }
}

// One loop a stage: each is short enough for a processor to work on several vectors at a time.
impl Rays {
    /// Adds the rays of one direction from a range of sources, carried to the lens plane, and fills the last vector.
    #[inline(always)]
    fn launch(&mut self, [d1, d2, v]: [f32; 3], sources: &Sources, range: Range<usize>) {
        let (first, n) = (range.start, range.len());
        let full = n.next_multiple_of(MAX_LANES);
        let (cosine, sine) = (&sources.cosine[first..first + full], &sources.sine[first..first + full]);
        let (e2, e3) = (&sources.e2[first..first + full], &sources.e3[first..first + full]);
        let distance = &sources.distance[first..first + full];
        let block = self.length..self.length + full;
        let (w_out, u_out) = (&mut self.w[block.clone()], &mut self.u[block.clone()]);
        let (q_x, q_y) = (&mut self.q_x[block.clone()], &mut self.q_y[block.clone()]);
        self.v[block].fill(v);
        for i in 0..full {
            let w = (d1 * cosine[i] - d2 * sine[i]).abs();
            let u = d1 * sine[i] + d2 * cosine[i];
            w_out[i] = w;
            u_out[i] = u;
            q_x[i] = w * e2[i] + distance[i] * u;
            q_y[i] = w * e3[i] + distance[i] * v;
        }
        // The rest of the last vector came from sources of other ranges: rays that miss.
        q_y[n..].fill(f32::INFINITY);
        self.length += full;
    }

    /// Takes the rays through both faces of the lens.
    #[inline(always)]
    fn refract(&mut self, lens: &Lens) {
        let n = self.length;
        let (w, u, v) = (&self.w[..n], &self.u[..n], &self.v[..n]);
        let (q_x, q_y) = (&self.q_x[..n], &self.q_y[..n]);
        let (n4_out, signs) = (&mut self.n4[..n], &mut self.signs[..n]);
        let (forward_out, inward) = (&mut self.forward[..n], &mut self.inward[..n]);
        let aperture2 = lens.aperture2;
        for i in 0..n {
            let (w, u, v, q_x, q_y) = (w[i], u[i], v[i], q_x[i], q_y[i]);
            let w2 = w * w;
            let q2 = q_x * q_x + q_y * q_y;
            let along = q_x * u + q_y * v;
            let n2 = w2 + q2;
            let n4 = n2 * n2;

            let first = w2 - along;
            let g = (first * first + n2).sqrt() - first;
            let second = n2 * (w2 + along) + g * (w2 - q2);
            let squared = second * second - n2 * n4;
            let h = squared.sqrt() - second;
            let gn2 = g * n2;
            let forward = n4 + gn2 + h;

            n4_out[i] = n4;
            forward_out[i] = forward;
            inward[i] = h - gn2;
            // Beside the aperture, a face met from behind, or total reflection: one of these is negative.
            let in_aperture = aperture2 * w2 - q2;
            signs[i] = in_aperture.to_bits()
                | first.to_bits()
                | second.to_bits()
                | squared.to_bits()
                | forward.to_bits();
        }
    }

    /// Takes the rays to their places on the sensor.
    #[inline(always)]
    fn land(&mut self, lens: &Lens, frame: &Frame) {
        let n = self.length;
        let (w, u, v) = (&self.w[..n], &self.u[..n], &self.v[..n]);
        let (q_x, q_y) = (&self.q_x[..n], &self.q_y[..n]);
        let (n4, signs) = (&self.n4[..n], &self.signs[..n]);
        let (forward, inward) = (&self.forward[..n], &self.inward[..n]);
        let places = &mut self.places[..n];
        let Frame { x: x0, y: y0, right, bottom, stride, lost } = *frame;
        let Lens { position: [ax, ay], slope, lever, .. } = *lens;
        let rounding = ROUND_BITS.wrapping_mul(stride + 1);
        for i in 0..n {
            let (n4, forward, inward) = (n4[i], forward[i], inward[i]);
            let per = lever / (w[i] * forward);
            let x = (slope * (n4 * u[i] + inward * q_x[i]) + ax * forward * q_x[i]) * per + x0;
            let y = (n4 * v[i] + (inward + ay * forward) * q_y[i]) * per + y0;

            // Into the frame, if beyond the window; what is no number is lost anyway.
            let x = if x > 0.0 { x } else { 0.0 };
            let y = if y > 0.0 { y } else { 0.0 };
            let column = if x < right { x } else { right } + ROUND;
            let row = if y < bottom { y } else { bottom } + ROUND;
            let place =
                row.to_bits().wrapping_mul(stride).wrapping_add(column.to_bits()).wrapping_sub(rounding);
            places[i] = if (signs[i] as i32) < 0 { lost } else { place };
        }
    }

    /// Takes the rays of the block through lens and sensor and counts them; the block is then empty.
    #[inline(always)]
    fn finish(&mut self, lens: &Lens, tally: &mut Tally) {
        self.refract(lens);
        self.land(lens, &tally.frame());
        tally.count(&self.places[..self.length]);
        self.length = 0;
    }
}
