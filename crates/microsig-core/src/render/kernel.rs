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
//! d + G (w, -Q) + H (w, Q),   G = (R - D) / N^2,   R = sqrt(D^2 + N^2),   D = w^2 - Q.(u, v),
//! H = (sqrt(E^2 - N^2) - E) / N^2,   E = w^2 + Q.(u, v) + G (w^2 - Q^2);
//!
//! E^2 < N^2 is total reflection. With K = N^2 + R - D, the denominators are gone: E N^2 = 2 w^2 K - N^2 R, and with
//! h = H N^4 the slopes behind the lens are (N^4 (u, v) + (N^4 - N^2 K + h) Q) / (w F), F = N^2 K + h. The place on the
//! sensor is a times q plus b times the slope, the two numbers of the ray transfer matrix behind the lens, one pair for
//! each axis. Two square roots and one division for a ray.
//!
//! A vector of rays waits long for each root, so three of them are under way at a time, one a stage: at the first face, at
//! the second, on the sensor. Places are counted some vectors later, which costs nearly nothing beside the arithmetic,
//! while a place that has just been found is still on its way out of a vector register.

use std::ops::Range;

use pulp::Simd;

use super::instructions::InstructionSet;
use super::lanes::{Floats, Words};
use super::sources::Sources;
use super::tally::{self, Frame, Tally};
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
    /// Whether a and b of the two axes differ.
    astigmatic: bool,
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
            astigmatic: system.cylinder.is_some(),
        }
    }

    /// The rays of a direction of the fan, a unit vector, from neighbouring sources.
    pub(super) fn run(&self, direction: [f32; 3], sources: Range<usize>) -> Run {
        Run { direction: direction.map(|d| d * self.length), sources }
    }
}

/// A direction of the fan and neighbouring sources that can send it into the lens.
#[derive(Debug, Clone)]
pub(super) struct Run {
    direction: [f32; 3],
    sources: Range<usize>,
}

impl Run {
    pub(super) fn rays(&self) -> usize {
        self.sources.len()
    }
}

/// A vector of rays: where its sources begin, and the number of its run.
#[derive(Debug, Clone, Copy)]
pub(super) struct Volley {
    source: u32,
    run: u32,
}

/// Traces the rays of all runs and counts them. `volleys` is working memory.
pub(super) fn trace(
    instructions: InstructionSet,
    lens: &Lens,
    sources: &Sources,
    runs: &[Run],
    volleys: &mut Vec<Volley>,
    tally: &mut Tally,
) {
    match (runs.is_empty(), lens.astigmatic) {
        (true, _) => {}
        (false, false) => instructions.dispatch(Trace::<false> { lens, sources, runs, volleys, tally }),
        (false, true) => instructions.dispatch(Trace::<true> { lens, sources, runs, volleys, tally }),
    }
}

/// The kernel as an operation that is compiled once for every instruction set.
struct Trace<'a, const ASTIGMATIC: bool> {
    lens: &'a Lens,
    sources: &'a Sources,
    runs: &'a [Run],
    volleys: &'a mut Vec<Volley>,
    tally: &'a mut Tally,
}

/// Number of places found and not yet counted.
const WAITING: usize = 64;

/// These places; aligned, because a vector that straddles two lines of the cache is stored at half the speed.
#[repr(align(64))]
struct Waiting([u32; WAITING]);

/// Stages behind the first.
const STAGES_BEHIND: usize = 2;

impl<const ASTIGMATIC: bool> pulp::WithSimd for Trace<'_, ASTIGMATIC> {
    type Output = ();

    // Inlined, with all that it calls, into a function for which the instruction set is switched on. (That is why there
    // are no closures: they would not be.)
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Trace { lens, sources, runs, volleys, tally } = self;
        let lanes = S::F32_LANES;
        // Copies of what is small, which the compiler then knows to stay the same.
        let lens = *lens;
        // The last volley of a run goes on into sources of other ranges, whose rays are sure to miss.
        volleys.clear();
        for (run, Run { sources, .. }) in runs.iter().enumerate() {
            let starts = sources.clone().step_by(lanes);
            volleys.extend(starts.map(|source| Volley { source: source as u32, run: run as u32 }));
        }
        // Volleys that miss push the last ones through.
        let blank = Volley { source: sources.number() as u32, run: 0 };
        volleys.resize(volleys.len() + STAGES_BEHIND + WAITING / lanes, blank);

        let frame = tally.frame();
        let mut planes = tally.planes();
        let mut waiting = Waiting([frame.lost; WAITING]);
        let mut oldest = 0;
        let vectors = sources.vectors();
        let mut sent = Sent::new(simd, &lens, vectors, runs, blank);
        let mut inside = sent.enter();
        for &volley in volleys.iter() {
            let places = inside.land::<ASTIGMATIC>(simd, &lens, &frame);
            inside = sent.enter();
            sent = Sent::new(simd, &lens, vectors, runs, volley);
            tally::count(&mut planes, &waiting.0[oldest..oldest + lanes]);
            places.store(&mut waiting.0, oldest);
            oldest = (oldest + lanes) % WAITING;
        }
    }
}

/// Rays at the first face of the lens, in the symbols of this module.
#[derive(Clone, Copy)]
struct Sent<S: Simd> {
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

/// Rays at the second face.
#[derive(Clone, Copy)]
struct Inside<S: Simd> {
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

impl<S: Simd> Sent<S> {
    /// The rays of a volley.
    #[inline(always)]
    fn new(simd: S, lens: &Lens, vectors: [&[f32]; 5], runs: &[Run], volley: Volley) -> Self {
        let [d1, d2, v] = runs[volley.run as usize].direction;
        let (d1, d2, v) = (Floats::splat(simd, d1), Floats::splat(simd, d2), Floats::splat(simd, v));
        let first = volley.source as usize;
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
        // Beside the aperture, or a face met from behind.
        let in_aperture = Floats::splat(simd, lens.aperture2) * w2 - q2;
        Sent { w, u, v, q_x, q_y, w2, n2, d, r, sign: in_aperture.to_bits() | d.to_bits() }
    }

    /// Through the first face.
    #[inline(always)]
    fn enter(self) -> Inside<S> {
        let Sent { w, u, v, q_x, q_y, w2, n2, d, r, sign } = self;
        let n4 = n2 * n2;
        let k = n2 + (r - d);
        let e = (w2 + w2) * k - n2 * r;
        let squared = e * e - n2 * n4;
        // A face met from behind, or total reflection.
        let sign = sign | e.to_bits() | squared.to_bits();
        Inside { w, u, v, q_x, q_y, n4, n2_k: n2 * k, e, root: squared.sqrt(), sign }
    }
}

impl<S: Simd> Inside<S> {
    /// Through the second face to places on the sensor.
    #[inline(always)]
    fn land<const ASTIGMATIC: bool>(self, simd: S, lens: &Lens, frame: &Frame) -> Words<S> {
        let Inside { w, u, v, q_x, q_y, n4, n2_k, e, root, sign } = self;
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

        // Into the frame, if beyond the window.
        let zero = Floats::splat(simd, 0.0);
        let x = (x * per + Floats::splat(simd, frame.x)).clamp(zero, Floats::splat(simd, frame.right));
        let y = (y * per + Floats::splat(simd, frame.y)).clamp(zero, Floats::splat(simd, frame.bottom));
        let round = Floats::splat(simd, ROUND);
        let rounding = Words::splat(simd, ROUND_BITS.wrapping_mul(frame.stride + 1));
        let row = (y + round).to_bits() * Words::splat(simd, frame.stride);
        let place = row + (x + round).to_bits() - rounding;
        place.replace_where_negative(sign | forward.to_bits(), Words::splat(simd, frame.lost))
    }
}
