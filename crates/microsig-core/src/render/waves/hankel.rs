//! Images for a round pupil: Hankel transforms of the modes, as products with matrices of Bessel functions.
//!
//! The matrices depend neither on depth nor on the particle. At another wavelength, they apply to scaled
//! radii of the image.

use super::bessel::bessel;
use super::matrix::{self, LANES};
use super::modes::Modes;
use super::pupil::{Pupil, Radii};
use crate::quadrature::gauss_legendre_on;
use crate::render::instructions::InstructionSet;

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
    table: Table,
    /// Kernels by order, radius of the pupil and radius of the image; empty if they are computed when needed.
    kernels: Vec<Vec<f64>>,
}

/// Kernels that need more memory than this, bytes, are not kept.
const KEPT_BYTES: usize = 128 << 20;

/// Light along the radius of an image.
pub(super) struct Profile {
    step_um: f64,
    /// Values from two steps before the axis on.
    values: Vec<f64>,
}

impl Hankel {
    /// `inner`, `end`: radii in the lens plane between which the pupil is open, um; `nodes`: number of
    /// quadrature points between them; `columns`: number of the image's radii at steps of `step_um`;
    /// `orders`: number of orders of modes.
    pub(super) fn new(
        pupil: &Pupil,
        k: f64,
        [inner, end]: [f64; 2],
        nodes: usize,
        (columns, step_um): (usize, f64),
        orders: usize,
    ) -> Hankel {
        let (q, weights) = gauss_legendre_on(inner, end, nodes);
        let radii = pupil.radii(q, end);
        let weights: Vec<f64> = (0..nodes).map(|i| weights[i] * radii.sigma[i] * radii.stretch[i]).collect();
        let columns = columns.next_multiple_of(LANES);
        let b = pupil.b();
        let table = Table::new(k * pupil.sigma(end) * step_um * columns as f64 / b, orders);
        let mut hankel =
            Hankel { radii, weights, b, step_um, columns, step: k * step_um / b, table, kernels: Vec::new() };
        if orders * nodes * columns * size_of::<f64>() <= KEPT_BYTES {
            hankel.kernels = (0..orders).map(|order| hankel.kernel(order)).collect();
        }
        hankel
    }

    /// J_m(k sigma r / b) by radius of the pupil and radius of the image.
    fn kernel(&self, order: usize) -> Vec<f64> {
        let values = &self.table.orders[order];
        let mut kernel = Vec::with_capacity(self.radii.sigma.len() * self.columns);
        for sigma in &self.radii.sigma {
            let step = self.step * sigma;
            kernel.extend((0..self.columns).map(|column| {
                let (first, weights) = Table::around(step * column as f64);
                weigh(&weights, &values[first..])
            }));
        }
        kernel
    }

    /// The image of these modes at the wave number `k` (1/um); `kernel_k` is that of the kernels.
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
        for of_order in modes.modes.chunk_by(|a, b| a.order == b.order) {
            let order = of_order[0].order;
            if order >= self.table.orders.len() {
                break;
            }
            let made;
            let kernel = match self.kernels.get(order) {
                Some(kernel) => kernel,
                None => {
                    made = self.kernel(order);
                    &made
                }
            };
            left.clear();
            for mode in of_order {
                let part = |i: usize| {
                    let both = mode.values.iter().zip(&carrier);
                    both.map(
                        move |(v, c)| {
                            if i == 0 { v[0] * c[0] - v[1] * c[1] } else { v[0] * c[1] + v[1] * c[0] }
                        },
                    )
                };
                left.extend(part(0));
                left.extend(part(1));
            }
            field.resize(left.len() / nodes * self.columns, 0.0);
            matrix::multiply(instructions, &left, kernel, nodes, self.columns, &mut field);
            let count = of_order[0].count();
            for row in field.chunks_exact(self.columns) {
                light.iter_mut().zip(row).for_each(|(light, u)| *light += count * u * u);
            }
        }
        Profile::new(&light, self.step_um * kernel_k / k)
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
        let cell = libm::floor(place);
        let Some(values) = self.values.get(cell as usize..cell as usize + TAPS) else { return 0.0 };
        weigh(&lagrange6(place - cell), values)
    }
}

/// Bessel functions at equal steps, for interpolation.
#[derive(Debug)]
struct Table {
    /// Values by order, from two steps before 0 on.
    orders: Vec<Vec<f64>>,
}

impl Table {
    /// Steps per unit: the interpolation error with six values is below 1e-9.
    const PER_UNIT: f64 = 20.0;

    fn new(largest: f64, orders: usize) -> Table {
        let n = libm::ceil(largest * Self::PER_UNIT) as usize + TAPS;
        let mut table = vec![vec![0.0; n]; orders];
        let mut of_argument = vec![0.0; orders];
        for i in 0..n {
            let place = i as f64 - 2.0;
            bessel(place.abs() / Self::PER_UNIT, &mut of_argument);
            for (order, (values, value)) in table.iter_mut().zip(&of_argument).enumerate() {
                // J_m(-x) = (-1)^m J_m(x)
                values[i] = if place < 0.0 && order % 2 == 1 { -value } else { *value };
            }
        }
        Table { orders: table }
    }

    fn around(x: f64) -> (usize, [f64; TAPS]) {
        let place = x * Self::PER_UNIT;
        let cell = libm::floor(place);
        (cell as usize, lagrange6(place - cell))
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
