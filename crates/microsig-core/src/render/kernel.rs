//! The inner loops: rays of a particle from their source points to pixel numbers, in f32, many at a time.
//!
//! Three stages over a block of rays: turn the candidate directions of each point and bring them to the lens plane;
//! refract and carry them to the sensor; count. Only + - * / sqrt and comparisons occur, each correctly rounded and never
//! fused, so that every instruction set gives the same bits.
//!
//! The refraction is that of `optics` with everything cancelled that cancels. Let d = (1, p) be the ray's direction,
//! n = (R, -q) and n' = (R, q) the normals of the faces, none of them of unit length, N^2 = R^2 + q^2,
//! k = (n_l/n_m)^2 - 1 and s = (1 + p^2) N^2. Snell's law in vector form, times |d|, adds to the direction a multiple of
//! the normal: inside the lens it is (n_m/n_l) (d + G n), G = (sqrt(D^2 + k s) - D) / N^2 with D = d.n = R - q.p, and
//! behind it d + G n + H n', H = (sqrt(E^2 - k s) - E) / N^2 with E = (d + G n).n' = R + q.p + G (R^2 - q^2). The slopes
//! behind the lens are therefore (p + (H - G) q) / (1 + R (G + H)): two square roots and two divisions. E^2 < k s is total
//! reflection.

use super::fan::Candidates;
use super::patch::Window;
use crate::optics::OpticalSystem;

/// Rays in flight: four arrays of this length stay in the first-level cache.
const BLOCK: usize = 1024;

/// Rays refracted in one stroke: one or more registers of every instruction set.
const WIDE: usize = 16;

/// 1.5 * 2^23: adding it to a number below 2^22 rounds that to the nearest integer (ties to even, as the original does)
/// and leaves the integer in the low bits, where a conversion would not be done for many numbers at a time.
const ROUND: f32 = 12_582_912.0;
const ROUND_BITS: u32 = ROUND.to_bits();

/// What the kernel knows of the optics.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lens {
    aperture2: f32,
    face_radius: f32,
    face_radius2: f32,
    /// (n_l/n_m)^2 - 1.
    index_excess: f32,
    /// The way behind the lens, um: to the sensor, or to the cylinder and from there on.
    way: [f32; 2],
    /// 1 / f_cyl; 0 without a cylinder, which leaves the slope alone.
    cylinder_power: f32,
    per_pixel: f32,
}

impl Lens {
    pub(super) fn new(system: &OpticalSystem, pixel_size: f64) -> Self {
        let objective = &system.objective;
        let (r, mu, b) = (objective.face_radius, objective.index_ratio, objective.image_distance);
        Lens {
            aperture2: (objective.aperture_radius * objective.aperture_radius) as f32,
            face_radius: r as f32,
            face_radius2: (r * r) as f32,
            index_excess: (1.0 / (mu * mu) - 1.0) as f32,
            way: [(b / 3.0) as f32, (2.0 * b / 3.0) as f32],
            cylinder_power: system.cylinder.map_or(0.0, |c| (1.0 / c.focal_length) as f32),
            per_pixel: (1.0 / pixel_size) as f32,
        }
    }
}

/// A source point, ready for the kernel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Source {
    /// Position across the axis, um.
    pub(super) e2: f32,
    pub(super) e3: f32,
    /// Way to the lens along the axis, um.
    pub(super) distance: f32,
    /// Angle of the fan, 2^32 per turn.
    pub(super) phase: u32,
    /// Largest azimuth from the axis that can arrive (`fan::half_turns`).
    pub(super) reach: u32,
}

/// Where counts go: a window of the sensor, and the particle's place in it.
pub(super) struct Target<'a> {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Pixel coordinates of the particle's centre, relative to the window's first pixel.
    pub(super) x: f32,
    pub(super) y: f32,
    /// Counts of the window and, at the end, one for all rays that land elsewhere.
    pub(super) counts: &'a mut [u32],
}

impl<'a> Target<'a> {
    pub(super) fn new(window: &Window, x_px: f64, y_px: f64, counts: &'a mut [u32]) -> Self {
        Target {
            width: window.width,
            height: window.height,
            x: (x_px - window.x0 as f64) as f32,
            y: (y_px - window.y0 as f64) as f32,
            counts,
        }
    }
}

/// Rays on their way; reused from particle to particle.
#[derive(Debug, Clone)]
pub(super) struct Block {
    q_x: [f32; BLOCK],
    q_y: [f32; BLOCK],
    p_x: [f32; BLOCK],
    p_y: [f32; BLOCK],
    length: usize,
}

impl Default for Block {
    fn default() -> Self {
        let zero = [0.0; BLOCK];
        Block { q_x: zero, q_y: zero, p_x: zero, p_y: zero, length: 0 }
    }
}

/// Traces all sources and counts their rays. Gives the farthest landing places from the particle's centre on the two
/// axes, px, seen among all rays that pass the lens, and the number of rays traced.
pub(super) fn trace(
    arch: pulp::Arch,
    lens: &Lens,
    candidates: &Candidates,
    sources: &[Source],
    block: &mut Block,
    target: &mut Target<'_>,
) -> Traced {
    arch.dispatch(Trace { lens, candidates, sources, block, target })
}

/// The kernel as an operation that is compiled once for every instruction set.
struct Trace<'a, 'b> {
    lens: &'a Lens,
    candidates: &'a Candidates,
    sources: &'a [Source],
    block: &'a mut Block,
    target: &'a mut Target<'b>,
}

impl pulp::WithSimd for Trace<'_, '_> {
    type Output = Traced;

    // Inlined, with all that it calls, into a function for which the instruction set is switched on.
    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> Traced {
        trace_generic(self.lens, self.candidates, self.sources, self.block, self.target)
    }
}

/// What a pass of the kernel saw.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Traced {
    /// Farthest landing place from the particle's centre along columns, px.
    pub(super) extent_x: f32,
    /// Likewise along rows.
    pub(super) extent_y: f32,
    /// Rays traced.
    pub(super) rays: u64,
}

/// Farthest landing places so far, lane by lane: bits of f32 >= 0, which compare like the numbers.
#[derive(Debug, Clone, Copy, Default)]
struct Farthest {
    x: [u32; WIDE],
    y: [u32; WIDE],
}

#[inline(always)]
fn trace_generic(
    lens: &Lens,
    candidates: &Candidates,
    sources: &[Source],
    block: &mut Block,
    target: &mut Target<'_>,
) -> Traced {
    let mut traced = Traced::default();
    let mut farthest = Farthest::default();
    block.length = 0;
    for source in sources {
        let mut run = candidates.run(source.phase, source.reach);
        traced.rays += run.len() as u64;
        let turn = cos_sin(source.phase);
        while !run.is_empty() {
            if block.length == BLOCK {
                flush(lens, block, target, &mut farthest);
            }
            let n = run.len().min(BLOCK - block.length);
            to_lens(source, turn, candidates, run.start, n, block);
            run.start += n;
        }
    }
    // The last block is filled up with rays that miss.
    let end = block.length.next_multiple_of(WIDE).min(BLOCK);
    block.q_x[block.length..end].fill(f32::INFINITY);
    block.length = end;
    flush(lens, block, target, &mut farthest);
    let extent = |bits: [u32; WIDE]| f32::from_bits(bits.into_iter().fold(0, u32::max));
    traced.extent_x = extent(farthest.x);
    traced.extent_y = extent(farthest.y);
    traced
}

/// Turns `n` directions and carries them to the lens plane, at the end of the block.
#[inline(always)]
fn to_lens(
    source: &Source,
    turn: (f32, f32),
    candidates: &Candidates,
    start: usize,
    n: usize,
    block: &mut Block,
) {
    let (cosine, sine) = turn;
    let at = block.length;
    let (d1, d2, d3) = (
        &candidates.d1[start..start + n],
        &candidates.d2[start..start + n],
        &candidates.d3[start..start + n],
    );
    let (q_x, q_y) = (&mut block.q_x[at..at + n], &mut block.q_y[at..at + n]);
    let (p_x, p_y) = (&mut block.p_x[at..at + n], &mut block.p_y[at..at + n]);
    for i in 0..n {
        let forward = 1.0 / (d1[i] * cosine - d2[i] * sine).abs();
        let slope_x = (d1[i] * sine + d2[i] * cosine) * forward;
        let slope_y = d3[i] * forward;
        p_x[i] = slope_x;
        p_y[i] = slope_y;
        q_x[i] = source.e2 + source.distance * slope_x;
        q_y[i] = source.e3 + source.distance * slope_y;
    }
    block.length += n;
}

/// Refracts the rays of a block, carries them to the sensor and counts them.
#[inline(always)]
fn flush(lens: &Lens, block: &mut Block, target: &mut Target<'_>, farthest: &mut Farthest) {
    let Block { q_x, q_y, p_x, p_y, length } = block;
    // A copy that nothing else can refer to stays in registers.
    let mut local = *farthest;
    let lanes = |values: &[f32; BLOCK], i: usize| -> [f32; WIDE] { std::array::from_fn(|k| values[i + k]) };
    for i in (0..*length).step_by(WIDE) {
        let (q_x, q_y, p_x, p_y) = (lanes(q_x, i), lanes(q_y, i), lanes(p_x, i), lanes(p_y, i));
        let pixels = to_sensor(lens, target, &mut local, q_x, q_y, p_x, p_y);
        for pixel in pixels {
            target.counts[pixel as usize] += 1;
        }
    }
    *farthest = local;
    *length = 0;
}

/// From the lens plane to pixel numbers of the target, for one set of lanes.
#[inline(always)]
fn to_sensor(
    lens: &Lens,
    target: &Target<'_>,
    farthest: &mut Farthest,
    q_x: [f32; WIDE],
    q_y: [f32; WIDE],
    p_x: [f32; WIDE],
    p_y: [f32; WIDE],
) -> [u32; WIDE] {
    let elsewhere = (target.width * target.height) as u32;
    let (width, height) = (target.width as f32, target.height as f32);
    let row_length = target.width as u32;
    let mut pixels = [elsewhere; WIDE];

    for i in 0..WIDE {
        let (q_x, q_y, p_x, p_y) = (q_x[i], q_y[i], p_x[i], p_y[i]);
        let q2 = q_x * q_x + q_y * q_y;
        let p2 = p_x * p_x + p_y * p_y;
        let qp = q_x * p_x + q_y * p_y;
        let n2 = lens.face_radius2 + q2;
        let per_n2 = 1.0 / n2;
        let ks = lens.index_excess * (n2 + n2 * p2);

        let first = lens.face_radius - qp;
        let bend1 = ((ks + first * first).sqrt() - first) * per_n2;
        let second = lens.face_radius + qp + bend1 * (lens.face_radius2 - q2);
        let squared = second * second - ks;
        let bend2 = (squared.sqrt() - second) * per_n2;

        let forward = 1.0 + lens.face_radius * (bend1 + bend2);
        let per_forward = 1.0 / forward;
        let inward = bend2 - bend1;
        let (p_x, p_y) = ((p_x + q_x * inward) * per_forward, (p_y + q_y * inward) * per_forward);
        let (q_x, q_y) = (q_x + lens.way[0] * p_x, q_y + lens.way[0] * p_y);
        let p_x = p_x - q_x * lens.cylinder_power;
        let x = (q_x + lens.way[1] * p_x) * lens.per_pixel;
        let y = (q_y + lens.way[1] * p_y) * lens.per_pixel;

        // Comparisons with NaN (total reflection) are false, so that such a ray is lost.
        let arrives =
            (q2 <= lens.aperture2) & (first > 0.0) & (squared >= 0.0) & (second > 0.0) & (forward > 0.0);
        farthest.x[i] = farthest.x[i].max(if arrives { x.abs().to_bits() } else { 0 });
        farthest.y[i] = farthest.y[i].max(if arrives { y.abs().to_bits() } else { 0 });
        let (column, row) = (x + target.x + ROUND, y + target.y + ROUND);
        let (nearest_column, nearest_row) = (column - ROUND, row - ROUND);
        let inside = arrives
            & (nearest_column >= 0.0)
            & (nearest_column < width)
            & (nearest_row >= 0.0)
            & (nearest_row < height);
        let (column, row) =
            (column.to_bits().wrapping_sub(ROUND_BITS), row.to_bits().wrapping_sub(ROUND_BITS));
        let pixel = row.wrapping_mul(row_length).wrapping_add(column);
        pixels[i] = if inside { pixel } else { elsewhere };
    }
    pixels
}

/// Cosine and sine of an angle given in 2^32 per turn, to 1e-7.
#[inline(always)]
fn cos_sin(phase: u32) -> (f32, f32) {
    // Split off the nearest multiple of a quarter turn; the rest lies within 45 degrees.
    let quarter = phase.wrapping_add(1 << 29) >> 30;
    let rest = phase.wrapping_sub(quarter << 30) as i32;
    let x = rest as f32 * (std::f32::consts::PI / 2_147_483_648.0);
    let x2 = x * x;
    // Taylor series; the first neglected terms are x^9/9! = 3e-7 x and x^10/10! = 2e-8 at 45 degrees.
    let sine =
        x * (1.0 - x2 * (1.0 / 6.0 - x2 * (1.0 / 120.0 - x2 * (1.0 / 5040.0 - x2 * (1.0 / 362_880.0)))));
    let cosine = 1.0 - x2 * (0.5 - x2 * (1.0 / 24.0 - x2 * (1.0 / 720.0 - x2 * (1.0 / 40_320.0))));
    match quarter & 3 {
        0 => (cosine, sine),
        1 => (-sine, cosine),
        2 => (-cosine, -sine),
        _ => (sine, -cosine),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cosine_and_sine_of_a_phase() {
        for step in 0..10_000u32 {
            let phase = step.wrapping_mul(429_497);
            let (sine, cosine) =
                libm::sincos(f64::from(phase) / 4_294_967_296.0 * 2.0 * std::f64::consts::PI);
            let (c, s) = cos_sin(phase);
            assert!(
                (f64::from(c) - cosine).abs() < 2e-7 && (f64::from(s) - sine).abs() < 2e-7,
                "phase {phase}"
            );
        }
    }
}
