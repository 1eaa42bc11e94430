//! Images for a round pupil: Hankel transforms of the modes, as products with matrices of Bessel functions.
//!
//! The matrices depend neither on depth nor on the particle. At another wavelength, they apply to scaled
//! radii of the image.

use std::sync::Arc;

use super::bessel::bessel;
use super::matrix::{self, LANES, Panels};
use super::modes::Modes;
use super::pupil::{Pupil, Radii};
use crate::quadrature::gauss_legendre_on;
use crate::render::instructions::InstructionSet;
use crate::render::store::{self, Kernels};

/// Points of the interpolation along the radius.
const TAPS: usize = 6;

/// Kernels J_m(k sigma r / b).
#[derive(Debug)]
pub(super) struct Hankel {
    pub(super) radii: Radii,
    /// Weights of the pupil's radii in an integral over sigma d sigma.
    pub(super) weights: Vec<f64>,
    b: f64,
    /// Spacing of the image's radii at the wavelength of the kernels, um.
    step_um: f64,
    columns: usize,
    /// k step_um / b: factor from sigma to the change of the argument per step, 1/um.
    step: f64,
    bessel: Arc<Bessel>,
}

/// What does not depend on the optics if the radii of the pupil are given in units of its edge.
#[derive(Debug)]
struct Bessel {
    table: Table,
    /// By order, radius of the pupil and radius of the image; empty if they are computed when needed.
    kernels: Vec<Panels<f32>>,
}

/// Numbers of nodes, columns and orders from which kernels follow.
pub(super) struct Counts {
    pub(super) nodes: usize,
    pub(super) columns: usize,
    pub(super) orders: usize,
}

impl Counts {
    /// Rounded up, so that images by other optics have the same.
    fn rounded(self) -> Counts {
        let Counts { nodes, columns, orders } = self;
        let (nodes, columns) = (store::rounded(nodes, 8), store::rounded(columns, 64));
        Counts { nodes, columns, orders: orders.next_multiple_of(ORDERS) }
    }
}

/// Number of orders whose kernels are computed together.
const ORDERS: usize = 8;

/// Kernels that need more memory than this, bytes, are not kept.
const KEPT_BYTES: usize = 128 << 20;

/// Light along the radius of an image.
pub(super) struct Profile {
    step_um: f64,
    /// Values from two steps before the axis on.
    values: Vec<f64>,
}

impl Hankel {
    /// `inner`, `end`: radii in the lens plane between which the pupil is open, um; `counts`: quadrature points
    /// between them, the image's radii at steps of `step_um`, and orders of modes; `shared`: where kernels are
    /// shared with other optics.
    pub(super) fn new(
        pupil: &Pupil,
        k: f64,
        [inner, end]: [f64; 2],
        counts: Counts,
        step_um: f64,
        shared: Option<&Kernels>,
        instructions: InstructionSet,
    ) -> Hankel {
        let (b, step) = (pupil.b(), k * step_um / pupil.b());
        let edge = pupil.sigma(end);
        let Some(shared) = shared.filter(|_| inner == 0.0) else {
            let (q, weights) = gauss_legendre_on(inner, end, counts.nodes);
            let radii = pupil.radii(q, end);
            let weighted = |i: usize| weights[i] * radii.sigma[i] * radii.stretch[i];
            let weights = (0..counts.nodes).map(weighted).collect();
            let bessel = Arc::new(Bessel::new(&radii.sigma, edge, step, &counts, instructions));
            let columns = counts.columns.next_multiple_of(LANES);
            return Hankel { radii, weights, b, step_um, columns, step, bessel };
        };
        let counts = counts.rounded();
        let Counts { nodes, columns, orders } = counts;
        let (unit, unit_weights) = gauss_legendre_on(0.0, 1.0, nodes);
        // The same at nearly all optics.
        let billionths = libm::rint(step * edge * 1e9);
        let key = [nodes as u64, columns as u64, orders as u64, billionths as u64];
        let bessel = shared.get(&key, || {
            let bessel = Bessel::new(&unit, 1.0, billionths * 1e-9, &counts, instructions);
            let bytes = 8 * bessel.table.values.len() + bessel.kernels.len() * nodes * columns * 4;
            (bessel, bytes)
        });
        let sigma: Vec<f64> = unit.iter().map(|u| u * edge).collect();
        let weights = sigma.iter().zip(unit_weights).map(|(sigma, weight)| sigma * weight * edge).collect();
        let radii = pupil.radii(sigma.iter().map(|sigma| pupil.q(*sigma).min(end)).collect(), end);
        Hankel { radii, weights, b, step_um, columns, step, bessel }
    }

    /// The image of these modes at the wave number `k` (1/um); `kernel_k` belongs to the kernels.
    pub(super) fn profile(
        &self,
        modes: &Modes,
        k: f64,
        kernel_k: f64,
        instructions: InstructionSet,
    ) -> Profile {
        let nodes = self.weights.len();
        let carrier: Vec<[f64; 2]> = (modes.phase.iter().zip(&self.weights))
            .map(|(phase, weight)| {
                let (sine, cosine) = libm::sincos(k * phase);
                let factor = k / self.b * weight;
                [factor * cosine, factor * sine]
            })
            .collect();
        let mut light = vec![0.0; self.columns];
        let (mut left, mut field) = (Vec::new(), Vec::new());
        // The kernels of some orders, if they are not kept.
        let (mut first, mut block): (usize, Vec<Panels<f32>>) = (0, Vec::new());
        for order_modes in modes.modes.chunk_by(|a, b| a.order == b.order) {
            let order = order_modes[0].order;
            let Bessel { table, kernels } = &*self.bessel;
            if order >= table.orders {
                break;
            }
            // Orders increase.
            if kernels.is_empty() && (block.is_empty() || order >= first + ORDERS) {
                first = order / ORDERS * ORDERS;
                let places = (&self.radii.sigma[..], self.step, self.columns);
                block = table.kernels_from(first, places, instructions).into();
            }
            let kernel = if kernels.is_empty() { &block[order - first] } else { &kernels[order] };
            left.clear();
            for mode in order_modes {
                let part = |i: usize| {
                    let both = mode.values.iter().zip(&carrier);
                    both.map(
                        move |(v, c)| {
                            if i == 0 { v[0] * c[0] - v[1] * c[1] } else { v[0] * c[1] + v[1] * c[0] }
                        },
                    )
                };
                left.extend(part(0).map(|value| value as f32));
                left.extend(part(1).map(|value| value as f32));
            }
            field.resize(left.len() / nodes * self.columns, 0.0);
            matrix::multiply(instructions, &left, kernel, &mut field);
            let count = order_modes[0].count();
            for row in field.chunks_exact(self.columns) {
                light
                    .iter_mut()
                    .zip(row)
                    .for_each(|(light, u)| *light += count * f64::from(*u) * f64::from(*u));
            }
        }
        Profile::new(&light, self.step_um * kernel_k / k)
    }
}

impl Bessel {
    /// For radii of the pupil up to `edge`, and the change of the argument per step of the image's radius in
    /// the inverse unit.
    fn new(radii: &[f64], edge: f64, step: f64, counts: &Counts, instructions: InstructionSet) -> Bessel {
        let Counts { nodes, orders, .. } = *counts;
        let columns = counts.columns.next_multiple_of(LANES);
        let table = Table::new(step * edge * columns as f64, orders);
        let mut kernels = Vec::new();
        if orders * nodes * columns * size_of::<f32>() <= KEPT_BYTES {
            let blocks = (0..orders).step_by(ORDERS);
            let block_kernels = |first| table.kernels_from(first, (radii, step, columns), instructions);
            kernels = blocks.flat_map(block_kernels).collect();
        }
        Bessel { table, kernels }
    }
}

impl Profile {
    fn new(light: &[f64], step_um: f64) -> Profile {
        let values = (-2..light.len() as isize).map(|i| light[i.unsigned_abs()]).collect();
        Profile { step_um, values }
    }

    /// Light per um^2 at a distance from the axis (um), by polynomial interpolation of six values; 0 beyond
    /// the last.
    pub(super) fn at(&self, radius_um: f64) -> f64 {
        let place = radius_um / self.step_um;
        // Positive, so this rounds down.
        let cell = place as usize;
        let Some(values) = self.values.get(cell..cell + TAPS) else { return 0.0 };
        weigh(&lagrange6(place - cell as f64), values)
    }
}

/// Bessel functions of all orders at equal steps, for interpolation.
#[derive(Debug)]
struct Table {
    /// Number of orders, a multiple of [`ORDERS`].
    orders: usize,
    /// Values of all orders by step, from two steps before 0 on.
    values: Vec<f64>,
}

impl Table {
    /// Steps per unit: the interpolation error with six values is below 2e-8.
    const PER_UNIT: f64 = 8.0;

    fn new(largest: f64, orders: usize) -> Table {
        let orders = orders.next_multiple_of(ORDERS);
        let n = libm::ceil(largest * Self::PER_UNIT) as usize + TAPS;
        let mut values = vec![0.0; n * orders];
        for (i, step_values) in values.chunks_exact_mut(orders).enumerate() {
            let place = i as f64 - 2.0;
            bessel(place.abs() / Self::PER_UNIT, step_values);
            if place < 0.0 {
                // J_m(-x) = (-1)^m J_m(x)
                step_values.iter_mut().skip(1).step_by(2).for_each(|value| *value = -*value);
            }
        }
        Table { orders, values }
    }

    /// J_m of [`ORDERS`] orders by radius of the pupil and radius of the image: radii, change of the argument
    /// per step and unit of them, and number of steps.
    fn kernels_from(
        &self,
        first: usize,
        (radii, step, columns): (&[f64], f64, usize),
        instructions: InstructionSet,
    ) -> [Panels<f32>; ORDERS] {
        let out = std::array::from_fn(|_| Panels::zeros(radii.len(), columns));
        instructions.dispatch(Interpolate { table: self, radii, step, columns, first, out })
    }
}

/// Interpolates Bessel functions of [`ORDERS`] orders.
struct Interpolate<'a> {
    table: &'a Table,
    radii: &'a [f64],
    step: f64,
    columns: usize,
    /// The first of the orders.
    first: usize,
    out: [Panels<f32>; ORDERS],
}

impl pulp::WithSimd for Interpolate<'_> {
    type Output = [Panels<f32>; ORDERS];

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> [Panels<f32>; ORDERS] {
        let Interpolate { table, radii, step, columns, first, mut out } = self;
        for (i, sigma) in radii.iter().enumerate() {
            let step = step * sigma * Table::PER_UNIT;
            for column in 0..columns {
                let place = step * column as f64;
                // Positive, so this rounds down.
                let cell = place as usize;
                let weights = lagrange6(place - cell as f64);
                let mut sums = [0.0; ORDERS];
                for (tap, weight) in weights.iter().enumerate() {
                    let step_values = &table.values[(cell + tap) * table.orders + first..];
                    let Some(step_values) = step_values.first_chunk::<ORDERS>() else { break };
                    for order in 0..ORDERS {
                        sums[order] += weight * step_values[order];
                    }
                }
                for order in 0..ORDERS {
                    out[order].set(i, column, sums[order] as f32);
                }
            }
        }
        out
    }
}

#[inline(always)]
fn weigh(weights: &[f64; TAPS], values: &[f64]) -> f64 {
    let mut sum = 0.0;
    for (weight, value) in weights.iter().zip(values) {
        sum += weight * value;
    }
    sum
}

/// Weights of the values at -2, -1, ..., 3 for polynomial interpolation at `t`.
#[inline(always)]
fn lagrange6(t: f64) -> [f64; TAPS] {
    let (a, b, c, d, e, f) = (t + 2.0, t + 1.0, t, t - 1.0, t - 2.0, t - 3.0);
    [
        -b * c * d * e * f / 120.0,
        a * c * d * e * f / 24.0,
        -a * b * d * e * f / 12.0,
        a * b * c * e * f / 12.0,
        -a * b * c * d * f / 24.0,
        a * b * c * d * e / 120.0,
    ]
}
