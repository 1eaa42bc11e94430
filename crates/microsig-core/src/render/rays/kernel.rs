//! The inner loop: tracing the rays of a particle from source points to pixels, in f32, vectorized.
//!
//! Each direction of the fan is traced from all source points for which it can pass the aperture, one point
//! per lane. Only sums, products, quotients, square roots and comparisons occur, each correctly rounded and
//! never fused, so that every instruction set gives the same bits.
//!
//! The refraction is as in `optics`, simplified algebraically. Lengths are in units of the radius of
//! the faces. A ray has the direction d = (w, u, v) and meets the lens at q = Q/w, Q = w e + L (u, v), where
//! e is the lateral position of its source point and L its distance from the lens. The normals of the faces
//! are (w, -Q) and (w, Q), of length N, N^2 = w^2 + Q^2. Directions are scaled to the length
//! 1/sqrt((n_l/n_m)^2 - 1), so that by Snell's law in vector form the direction behind both faces is
//!
//! d + G (w, -Q) + H (w, Q),   G = (R - D) / N^2,   R = sqrt(D^2 + N^2),   D = w^2 - Q.(u, v),
//! H = (sqrt(E^2 - N^2) - E) / N^2,   E = w^2 + Q.(u, v) + G (w^2 - Q^2);
//!
//! E^2 < N^2 is total internal reflection. With K = N^2 + R - D the denominators cancel: E N^2 = 2 w^2 K -
//! N^2 R, and with h = H N^4 the slopes behind the lens are (N^4 (u, v) + (N^4 - N^2 K + h) Q) / (w F), F =
//! N^2 K + h. The position on the sensor is a times q plus b times the slope, a and b being the elements of
//! the ray transfer matrix behind the lens, one pair per axis. A ray takes two square roots and one division.
//!
//! Square roots have a long latency, so three packets are in flight, one per stage: at the first face, at the
//! second, on the sensor. Pixels are counted some vectors later: by then the stores from the vector registers
//! have completed, and the counting costs little compared with the arithmetic.

use std::ops::Range;

use pulp::Simd;

use super::ray_counter::{self, CountGrid, RayCounter};
use super::sources::Sources;
use crate::optics::OpticalSystem;
use crate::render::instructions::InstructionSet;
use crate::render::lanes::{Floats, Words};

/// 1.5 * 2^23: adding it to a number below 2^22 rounds that to the nearest integer (ties to even, as the
/// original does) and leaves the integer in the low bits; a conversion would not be vectorized.
const ROUND: f32 = 12_582_912.0;
const ROUND_BITS: u32 = ROUND.to_bits();

/// The optical system in the form that the kernel uses.
#[derive(Debug, Clone, Copy)]
pub(super) struct ThinLens {
    /// Radius of the faces, um: the kernel's unit of length.
    pub(super) unit_um: f64,
    aperture2: f32,
    /// Length of the direction vectors.
    length: f32,
    /// a along columns and along rows, each divided by b along rows.
    position: [f32; 2],
    /// b along columns over b along rows; 0 if a cylinder images the lens onto the sensor along columns.
    slope: f32,
    /// b along rows, px.
    lever: f32,
    /// Whether a and b of the two axes differ.
    astigmatic: bool,
}

impl ThinLens {
    pub(super) fn new(system: &OpticalSystem, pixel_size: f64) -> Self {
        let objective = &system.objective;
        let (unit, mu, way) = (objective.face_radius, objective.index_ratio, objective.image_distance);
        let aperture = objective.aperture_radius / unit;
        // Behind the lens: a third of the image distance, a cylinder with this power along columns, the
        // remaining two thirds.
        let power = system.cylinder.map_or(0.0, |c| 1.0 / c.focal_length);
        let kept = 1.0 - 2.0 * way / 3.0 * power;
        ThinLens {
            unit_um: unit,
            aperture2: (aperture * aperture) as f32,
            length: (1.0 / libm::sqrt(1.0 / (mu * mu) - 1.0)) as f32,
            position: [kept, 1.0].map(|a| (a * unit / way) as f32),
            slope: (kept / 3.0 + 2.0 / 3.0) as f32,
            lever: (way / pixel_size) as f32,
            astigmatic: system.cylinder.is_some(),
        }
    }

    /// The rays with one direction of the fan, a unit vector, from a range of sources.
    pub(super) fn run(&self, direction: [f32; 3], sources: Range<usize>) -> SourceRun {
        SourceRun { direction: direction.map(|d| d * self.length), sources }
    }
}

/// A direction of the fan and a range of sources from which it can pass the aperture.
#[derive(Debug, Clone)]
pub(super) struct SourceRun {
    direction: [f32; 3],
    sources: Range<usize>,
}

impl SourceRun {
    pub(super) fn rays(&self) -> usize {
        self.sources.len()
    }
}

/// A vector of rays: the indices of its first source and of its run.
#[derive(Debug, Clone, Copy)]
pub(super) struct RayPacket {
    source: u32,
    run: u32,
}

/// Traces the rays of all runs and counts them. `packets` is working memory.
pub(super) fn trace(
    instructions: InstructionSet,
    lens: &ThinLens,
    sources: &Sources,
    runs: &[SourceRun],
    packets: &mut Vec<RayPacket>,
    counter: &mut RayCounter,
) {
    match (runs.is_empty(), lens.astigmatic) {
        (true, _) => {}
        (false, false) => instructions.dispatch(Trace::<false> { lens, sources, runs, packets, counter }),
        (false, true) => instructions.dispatch(Trace::<true> { lens, sources, runs, packets, counter }),
    }
}

/// The kernel, compiled once for every instruction set.
struct Trace<'a, const ASTIGMATIC: bool> {
    lens: &'a ThinLens,
    sources: &'a Sources,
    runs: &'a [SourceRun],
    packets: &'a mut Vec<RayPacket>,
    counter: &'a mut RayCounter,
}

/// Number of pixels found but not yet counted.
const WAITING: usize = 64;

/// The pixels waiting to be counted; aligned, because a store across two cache lines takes twice as long.
#[repr(align(64))]
struct Waiting([u32; WAITING]);

/// Number of stages after the first.
const STAGES_BEHIND: usize = 2;

impl<const ASTIGMATIC: bool> pulp::WithSimd for Trace<'_, ASTIGMATIC> {
    type Output = ();

    // Must be inlined, with everything it calls, into a function compiled with the instruction set enabled.
    // Closures would not be inlined, so there are none.
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Trace { lens, sources, runs, packets, counter } = self;
        let lanes = S::F32_LANES;
        // A local copy that the compiler can treat as constant in the loop.
        let lens = *lens;
        // The last packet of a run extends into sources of other ranges, whose rays are certain to miss the
        // aperture.
        packets.clear();
        for (run, SourceRun { sources, .. }) in runs.iter().enumerate() {
            let starts = sources.clone().step_by(lanes);
            packets.extend(starts.map(|source| RayPacket { source: source as u32, run: run as u32 }));
        }
        // Packets of rays that miss the aperture flush the pipeline.
        let blank = RayPacket { source: sources.number() as u32, run: 0 };
        packets.resize(packets.len() + STAGES_BEHIND + WAITING / lanes, blank);

        let grid = counter.grid();
        let mut planes = counter.planes();
        let mut waiting = Waiting([grid.lost; WAITING]);
        let mut oldest = 0;
        let vectors = sources.vectors();
        let mut first = AtFirstFace::new(simd, &lens, vectors, runs, blank);
        let mut second = first.enter();
        for &packet in packets.iter() {
            let places = second.land::<ASTIGMATIC>(simd, &lens, &grid);
            second = first.enter();
            first = AtFirstFace::new(simd, &lens, vectors, runs, packet);
            ray_counter::count(&mut planes, &waiting.0[oldest..oldest + lanes]);
            places.store(&mut waiting.0, oldest);
            oldest = (oldest + lanes) % WAITING;
        }
    }
}

/// Rays at the first face of the lens, in the symbols of this module.
#[derive(Clone, Copy)]
struct AtFirstFace<S: Simd> {
    w: Floats<S>,
    u: Floats<S>,
    v: Floats<S>,
    q_x: Floats<S>,
    q_y: Floats<S>,
    w2: Floats<S>,
    n2: Floats<S>,
    d: Floats<S>,
    r: Floats<S>,
    /// Negative for rays that are lost.
    sign: Words<S>,
}

#[derive(Clone, Copy)]
struct AtSecondFace<S: Simd> {
    w: Floats<S>,
    u: Floats<S>,
    v: Floats<S>,
    q_x: Floats<S>,
    q_y: Floats<S>,
    n4: Floats<S>,
    n2_k: Floats<S>,
    /// E N^2, and the square root of its square less N^6.
    e: Floats<S>,
    root: Floats<S>,
    sign: Words<S>,
}

impl<S: Simd> AtFirstFace<S> {
    #[inline(always)]
    fn new(simd: S, lens: &ThinLens, vectors: [&[f32]; 5], runs: &[SourceRun], packet: RayPacket) -> Self {
        let [d1, d2, v] = runs[packet.run as usize].direction;
        let (d1, d2, v) = (Floats::splat(simd, d1), Floats::splat(simd, d2), Floats::splat(simd, v));
        let first = packet.source as usize;
        let [cosine, sine, e2, e3, distance] = vectors;
        let (cosine, sine) = (Floats::load(simd, cosine, first), Floats::load(simd, sine, first));
        let (e2, e3) = (Floats::load(simd, e2, first), Floats::load(simd, e3, first));
        let distance = Floats::load(simd, distance, first);

        let w = (d1 * cosine - d2 * sine).abs();
        let u = d1 * sine + d2 * cosine;
        let q_x = w * e2 + distance * u;
        let q_y = w * e3 + distance * v;
        let w2 = w * w;
        let q2 = q_x * q_x + q_y * q_y;
        let n2 = w2 + q2;
        let d = w2 - (q_x * u + q_y * v);
        let r = (d * d + n2).sqrt();
        // Negative: outside the aperture, or incidence on a face from behind.
        let in_aperture = Floats::splat(simd, lens.aperture2) * w2 - q2;
        AtFirstFace { w, u, v, q_x, q_y, w2, n2, d, r, sign: in_aperture.to_bits() | d.to_bits() }
    }

    #[inline(always)]
    fn enter(self) -> AtSecondFace<S> {
        let AtFirstFace { w, u, v, q_x, q_y, w2, n2, d, r, sign } = self;
        let n4 = n2 * n2;
        let k = n2 + (r - d);
        let e = (w2 + w2) * k - n2 * r;
        let squared = e * e - n2 * n4;
        // Negative: incidence on a face from behind, or total internal reflection.
        let sign = sign | e.to_bits() | squared.to_bits();
        AtSecondFace { w, u, v, q_x, q_y, n4, n2_k: n2 * k, e, root: squared.sqrt(), sign }
    }
}

impl<S: Simd> AtSecondFace<S> {
    /// Traces the rays through the second face and returns the pixels on the sensor.
    #[inline(always)]
    fn land<const ASTIGMATIC: bool>(self, simd: S, lens: &ThinLens, grid: &CountGrid) -> Words<S> {
        let AtSecondFace { w, u, v, q_x, q_y, n4, n2_k, e, root, sign } = self;
        let [a_x, a_y] = lens.position;
        let (a_x, a_y) = (Floats::splat(simd, a_x), Floats::splat(simd, a_y));
        let h = root - e;
        let forward = n2_k + h;
        let inward = (n4 - n2_k) + h;
        let per = Floats::splat(simd, lens.lever) / (w * forward);
        let both = inward + a_y * forward;
        let x = if ASTIGMATIC {
            Floats::splat(simd, lens.slope) * (n4 * u + inward * q_x) + a_x * forward * q_x
        } else {
            n4 * u + both * q_x
        };
        let y = n4 * v + both * q_y;

        // Positions outside the window are clamped to the frame around it.
        let zero = Floats::splat(simd, 0.0);
        let x = (x * per + Floats::splat(simd, grid.x)).clamp(zero, Floats::splat(simd, grid.right));
        let y = (y * per + Floats::splat(simd, grid.y)).clamp(zero, Floats::splat(simd, grid.bottom));
        let round = Floats::splat(simd, ROUND);
        let rounding = Words::splat(simd, ROUND_BITS.wrapping_mul(grid.stride + 1));
        let row = (y + round).to_bits() * Words::splat(simd, grid.stride);
        let place = row + (x + round).to_bits() - rounding;
        place.replace_where_negative(sign | forward.to_bits(), Words::splat(simd, grid.lost))
    }
}
