//! The coherent modes of a bead.
//!
//! A ring of incoherent emitters of radius rho around the axis has the mean intensity sum over m of |U_m|^2
//! (Graf's addition theorem, DLMF 10.23.7), where U_m is the image of the pupil function times J_m(k rho H /
//! b) exp(i m psi). Rings at different depths and radii have similar U_m, so they are reduced to the
//! significant singular vectors (a coherent-mode decomposition, Wolf 1982). Relative to the phase of the
//! particle's center, modes are smooth functions of the pupil's radius.

use super::bead::Ring;
use super::bessel::bessel;
use super::pupil::{Pupil, Radii};

/// Maximum number of orders, sufficient for all particles that can be rendered.
const MAX_ORDERS: usize = 400;

/// One mode: a pupil function R(sigma) exp(i m psi) and, for m > 0, the one with -m, which has the same image
/// if the pupil is round.
#[derive(Debug, Clone)]
pub(super) struct Mode {
    /// m >= 0.
    pub(super) order: usize,
    /// Complex amplitude at each radius, with the phase relative to the particle's center: real and
    /// imaginary part, 1/um.
    pub(super) values: Vec<[f64; 2]>,
}

impl Mode {
    /// Multiplicity of its intensity: 2 for m > 0, for m and -m.
    pub(super) fn count(&self) -> f64 {
        if self.order == 0 { 1.0 } else { 2.0 }
    }
}

/// The modes of a particle, and the phase for its center.
#[derive(Debug, Clone)]
pub(super) struct Modes {
    /// Optical path S for the center at each radius, without a cylindrical lens, um.
    pub(super) phase: Vec<f64>,
    pub(super) modes: Vec<Mode>,
}

/// The input for the modes of a particle.
pub(super) struct Bead<'a> {
    pub(super) pupil: &'a Pupil,
    pub(super) radii: &'a Radii,
    /// Weights of the radii in an integral over sigma d sigma.
    pub(super) weights: &'a [f64],
    pub(super) z_um: f64,
    pub(super) rings: &'a [Ring],
    /// 2 pi / wavelength, 1/um.
    pub(super) k: f64,
    /// Radius at which the pupil is truncated, um (see [`Pupil::useful`]).
    pub(super) useful: Option<f64>,
    /// Fraction of the light in the weak modes that are neglected.
    pub(super) share: f64,
}

/// The pupil function of one ring.
struct Column {
    /// Weighted complex amplitude, with the phase relative to the center's.
    value: Vec<[f64; 2]>,
    /// k rho |H| / b.
    argument: Vec<f64>,
}

impl Bead<'_> {
    pub(super) fn modes(&self) -> Modes {
        let center = self.pupil.fan(self.z_um, self.radii, self.useful);
        let columns = self.columns(&center.phase);
        let total: f64 = columns.iter().map(|column| self.energy(column)).sum();
        let widest = columns.iter().flat_map(|column| &column.argument).copied().fold(0.0, f64::max);
        // Bessel functions of orders beyond the argument decay quickly.
        let orders = (libm::ceil(widest + 4.0 * libm::cbrt(widest)) as usize + 6).min(MAX_ORDERS);
        let bessels = Bessels::new(&columns, orders);
        let mut found: Vec<Found> = Vec::new();
        let mut left = total;
        for order in 0..orders {
            if left < 0.1 * self.share * total {
                break;
            }
            let order_modes = Order::new(order, &columns, &bessels, self.weights);
            left -= order_modes.light;
            found.extend(order_modes.modes());
        }
        let modes = self.kept(found, total, &columns, &bessels);
        Modes { phase: center.phase, modes }
    }

    /// The strongest modes, without the fraction `share` of the light; they are scaled up to the total light.
    fn kept(&self, mut found: Vec<Found>, total: f64, columns: &[Column], bessels: &Bessels) -> Vec<Mode> {
        found.sort_by(|a, b| b.light.total_cmp(&a.light));
        let mut kept = 0.0;
        let strong = found.iter().take_while(|mode| {
            let wanted = kept < (1.0 - self.share) * total;
            kept += if wanted { mode.light } else { 0.0 };
            wanted
        });
        let n = strong.count();
        found.truncate(n);
        // Modes of the same order are consecutive; the factor conserves the total light.
        found.sort_by(|a, b| a.order.cmp(&b.order).then(b.light.total_cmp(&a.light)));
        let factor = libm::sqrt(total / kept.max(f64::MIN_POSITIVE));
        let mode = |found: &Found| {
            let mut values = vec![[0.0; 2]; self.radii.sigma.len()];
            for (i, column) in columns.iter().enumerate() {
                let [x, y] = found.vector[i].map(|v| factor * v);
                for ((sum, v), j) in values.iter_mut().zip(&column.value).zip(bessels.of(found.order, i)) {
                    sum[0] += j * (v[0] * x - v[1] * y);
                    sum[1] += j * (v[0] * y + v[1] * x);
                }
            }
            Mode { order: found.order, values }
        };
        found.iter().map(mode).collect()
    }

    /// Points at these depths relative to the particle's center, um, each with all of the light.
    pub(super) fn points(&self, depths_um: &[f64]) -> Modes {
        let center = self.pupil.fan(self.z_um, self.radii, self.useful);
        let mode = |depth: &f64| Mode { order: 0, values: self.at_depth(*depth, &center.phase).0 };
        Modes { modes: depths_um.iter().map(mode).collect(), phase: center.phase }
    }

    /// Pupil function at a depth relative to the particle's center, with the phase relative to the
    /// center, and its derivative across the axis.
    fn at_depth(&self, depth_um: f64, center: &[f64]) -> (Vec<[f64; 2]>, Vec<f64>) {
        let fan = self.pupil.fan(self.z_um + depth_um, self.radii, self.useful);
        let value = (fan.phase.iter().zip(center).zip(&fan.amplitude))
            .map(|((phase, center), amplitude)| {
                let (sine, cosine) = libm::sincos(self.k * (phase - center));
                [amplitude * cosine, amplitude * sine]
            })
            .collect();
        (value, fan.off_axis)
    }

    fn columns(&self, center: &[f64]) -> Vec<Column> {
        let mut columns: Vec<Column> = Vec::with_capacity(self.rings.len());
        let mut known = None;
        for ring in self.rings {
            // Rings of the same depth are consecutive.
            let (_, value, off_axis) = match known.take() {
                Some((depth, value, off_axis)) if depth == ring.depth_um => (depth, value, off_axis),
                _ => {
                    let (value, off_axis) = self.at_depth(ring.depth_um, center);
                    (ring.depth_um, value, off_axis)
                }
            };
            let root = libm::sqrt(ring.weight);
            columns.push(Column {
                value: value.iter().map(|v| [root * v[0], root * v[1]]).collect(),
                argument: off_axis.iter().map(|h| self.k * ring.radius_um * h.abs()).collect(),
            });
            known = Some((ring.depth_um, value, off_axis));
        }
        columns
    }

    fn energy(&self, column: &Column) -> f64 {
        column.value.iter().zip(self.weights).map(|(v, w)| w * (v[0] * v[0] + v[1] * v[1])).sum()
    }
}

/// A mode as a linear combination of columns.
struct Found {
    order: usize,
    light: f64,
    /// Its coefficient for each column.
    vector: Vec<[f64; 2]>,
}

struct Order {
    order: usize,
    columns: usize,
    /// Gram matrix of the columns.
    gram: Vec<[f64; 2]>,
    /// Total light of the columns.
    light: f64,
}

impl Order {
    fn new(order: usize, columns: &[Column], bessels: &Bessels, weights: &[f64]) -> Order {
        let n = columns.len();
        let values: Vec<Vec<[f64; 2]>> = (columns.iter().enumerate())
            .map(|(i, column)| {
                let bessel = bessels.of(order, i);
                column.value.iter().zip(bessel).map(|(v, j)| [v[0] * j, v[1] * j]).collect()
            })
            .collect();
        let mut gram = vec![[0.0; 2]; n * n];
        for i in 0..n {
            for j in 0..=i {
                let mut sum = [0.0; 2];
                for ((a, b), w) in values[i].iter().zip(&values[j]).zip(weights) {
                    // conj(a) b
                    sum[0] += w * (a[0] * b[0] + a[1] * b[1]);
                    sum[1] += w * (a[0] * b[1] - a[1] * b[0]);
                }
                gram[i * n + j] = sum;
                gram[j * n + i] = [sum[0], -sum[1]];
            }
        }
        let count = if order == 0 { 1.0 } else { 2.0 };
        let light = (0..n).map(|i| gram[i * n + i][0]).sum::<f64>() * count;
        Order { order, columns: n, gram, light }
    }

    fn modes(self) -> impl Iterator<Item = Found> {
        let (order, n) = (self.order, self.columns);
        let count = if order == 0 { 1.0 } else { 2.0 };
        let (energies, vectors) = eigen(self.gram, n);
        energies.into_iter().enumerate().map(move |(i, energy)| Found {
            order,
            light: count * energy,
            vector: (0..n).map(|column| vectors[column * n + i]).collect(),
        })
    }
}

/// Bessel functions of all orders at the arguments of all columns.
struct Bessels {
    columns: usize,
    radii: usize,
    /// By order, column and radius.
    values: Vec<f64>,
}

impl Bessels {
    fn new(columns: &[Column], orders: usize) -> Bessels {
        let radii = columns.first().map_or(0, |column| column.argument.len());
        let mut values = vec![0.0; orders * columns.len() * radii];
        let mut by_order = vec![0.0; orders];
        for (i, column) in columns.iter().enumerate() {
            for (j, &argument) in column.argument.iter().enumerate() {
                bessel(argument, &mut by_order);
                for (order, value) in by_order.iter().enumerate() {
                    values[(order * columns.len() + i) * radii + j] = *value;
                }
            }
        }
        Bessels { columns: columns.len(), radii, values }
    }

    fn of(&self, order: usize, column: usize) -> &[f64] {
        &self.values[(order * self.columns + column) * self.radii..][..self.radii]
    }
}

/// Eigenvalues in descending order and eigenvectors (columns) of a Hermitian matrix, by Jacobi rotations.
fn eigen(mut a: Vec<[f64; 2]>, n: usize) -> (Vec<f64>, Vec<[f64; 2]>) {
    let mut vectors = vec![[0.0; 2]; n * n];
    (0..n).for_each(|i| vectors[i * n + i] = [1.0, 0.0]);
    let trace: f64 = (0..n).map(|i| a[i * n + i][0]).sum();
    for _ in 0..30 {
        let mut off = 0.0;
        for p in 0..n {
            for q in p + 1..n {
                let [x, y] = a[p * n + q];
                let size2 = x * x + y * y;
                off += size2;
                if size2 <= 1e-32 * trace * trace {
                    continue;
                }
                let size = libm::sqrt(size2);
                // a_pq = size exp(i alpha): a rotation of the phase by alpha makes the element real.
                let (cos_alpha, sin_alpha) = (x / size, y / size);
                let theta = (a[q * n + q][0] - a[p * n + p][0]) / (2.0 * size);
                let tangent = theta.signum() / (theta.abs() + libm::sqrt(1.0 + theta * theta));
                let cosine = 1.0 / libm::sqrt(1.0 + tangent * tangent);
                let sine = tangent * cosine;
                let turn = |u: [f64; 2], v: [f64; 2], sign: f64| {
                    // v exp(-+ i alpha)
                    let w = [
                        v[0] * cos_alpha + sign * v[1] * sin_alpha,
                        v[1] * cos_alpha - sign * v[0] * sin_alpha,
                    ];
                    (
                        [cosine * u[0] - sine * w[0], cosine * u[1] - sine * w[1]],
                        [sine * u[0] + cosine * w[0], sine * u[1] + cosine * w[1]],
                    )
                };
                for matrix in [&mut a, &mut vectors] {
                    for row in matrix.chunks_exact_mut(n) {
                        (row[p], row[q]) = turn(row[p], row[q], 1.0);
                    }
                }
                for column in 0..n {
                    let (u, v) = turn(a[p * n + column], a[q * n + column], -1.0);
                    (a[p * n + column], a[q * n + column]) = (u, v);
                }
            }
        }
        if off <= 1e-28 * trace * trace {
            break;
        }
    }
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&i, &j| a[j * n + j][0].total_cmp(&a[i * n + i][0]));
    let values = order.iter().map(|&i| a[i * n + i][0]).collect();
    let mut sorted = vec![[0.0; 2]; n * n];
    for (to, &from) in order.iter().enumerate() {
        (0..n).for_each(|row| sorted[row * n + to] = vectors[row * n + from]);
    }
    (values, sorted)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eigenvectors_rebuild_the_matrix() {
        let n = 5;
        let number = |i: usize| ((i * 7919 + 13) % 1009) as f64 / 1009.0 - 0.5;
        let mut a = vec![[0.0; 2]; n * n];
        for i in 0..n {
            for j in 0..=i {
                let value = [number(i * n + j), if i == j { 0.0 } else { number(71 * i + 5 * j) }];
                a[i * n + j] = value;
                a[j * n + i] = [value[0], -value[1]];
            }
        }
        let (values, vectors) = eigen(a.clone(), n);
        assert!(values.windows(2).all(|pair| pair[0] >= pair[1]));
        for i in 0..n {
            for j in 0..n {
                let mut sum = [0.0; 2];
                for (k, value) in values.iter().enumerate() {
                    let (u, v) = (vectors[i * n + k], vectors[j * n + k]);
                    // u value conj(v)
                    sum[0] += value * (u[0] * v[0] + u[1] * v[1]);
                    sum[1] += value * (u[1] * v[0] - u[0] * v[1]);
                }
                let [x, y] = a[i * n + j];
                assert!((sum[0] - x).abs() < 1e-13 && (sum[1] - y).abs() < 1e-13, "{i} {j}");
            }
        }
    }
}
