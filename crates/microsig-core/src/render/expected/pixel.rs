//! The square pixel over a round image.
//!
//! A round image seen by a square pixel is not round: around a circle of pixel positions it varies with the multiples
//! of four of the azimuth, f0(R) + f4(R) cos 4 psi + ... + f16(R) cos 16 psi, higher ones being left out. Light between
//! two radii falls on a pixel by the share of that ring's area that lies inside the square, which is known in closed form.

use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_4;
use std::sync::{Arc, PoisonError, RwLock};

use super::encircled::RINGS;

/// Azimuths of the samples: 0 to 45 degrees in equal steps; as many orders follow from them.
pub(super) const AZIMUTHS: usize = 5;

/// cos (4 order psi) at each azimuth.
fn harmonic(order: usize, azimuth: usize) -> f64 {
    libm::cos((order * azimuth) as f64 * std::f64::consts::PI / (AZIMUTHS - 1) as f64)
}

/// Cosine and sine of an azimuth of the samples.
pub(super) fn direction(azimuth: usize) -> [f64; 2] {
    let (sine, cosine) = libm::sincos(azimuth as f64 * FRAC_PI_4 / (AZIMUTHS - 1) as f64);
    [cosine, sine]
}

/// The harmonics of values at all azimuths (a cosine transform).
pub(super) fn harmonics(values: [f64; AZIMUTHS]) -> [f64; AZIMUTHS] {
    let end = |i: usize| if i == 0 || i == AZIMUTHS - 1 { 0.5 } else { 1.0 };
    std::array::from_fn(|order| {
        let sum: f64 = (0..AZIMUTHS).map(|a| end(a) * values[a] * harmonic(order, a)).sum();
        end(order) * sum * 2.0 / (AZIMUTHS - 1) as f64
    })
}

/// The harmonics of lines at all azimuths, node by node: a line for each order.
pub(super) fn orders(azimuths: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let nodes = azimuths.first().map_or(0, Vec::len);
    let mut orders = vec![vec![0.0; nodes]; AZIMUTHS];
    for node in 0..nodes {
        let of_node = harmonics(std::array::from_fn(|azimuth| azimuths[azimuth][node]));
        orders.iter_mut().zip(of_node).for_each(|(order, value)| order[node] = value);
    }
    orders
}

/// Rings that a pixel touches: its diagonal, and one at each end.
const TOUCHED: usize = 48;

/// Shares of rings in pixels whose centres lie at the distances k / per_px from the axis.
#[derive(Debug)]
struct Shares {
    per_px: usize,
    nodes: usize,
    /// By node, azimuth and ring from `first_ring`.
    shares: Vec<[f32; TOUCHED]>,
}

/// The first ring that a pixel at this distance may touch.
fn first_ring(distance_px: f64) -> usize {
    ((distance_px - std::f64::consts::FRAC_1_SQRT_2) * RINGS as f64).max(0.0) as usize
}

impl Shares {
    fn new(per_px: usize, nodes: usize) -> Self {
        let mut shares = Vec::with_capacity(nodes * AZIMUTHS);
        for node in 0..nodes {
            let distance = node as f64 / per_px as f64;
            let first = first_ring(distance);
            for azimuth in 0..AZIMUTHS {
                let centre = direction(azimuth).map(|d| distance * d);
                let area = |ring: usize| disc_inside(ring as f64 / RINGS as f64, centre);
                let mut inside = if first == 0 { 0.0 } else { area(first) };
                shares.push(std::array::from_fn(|i| {
                    let ring = first + i;
                    let within = area(ring + 1);
                    let of_ring = (2 * ring + 1) as f64 * std::f64::consts::PI / (RINGS * RINGS) as f64;
                    let share = (within - inside) / of_ring;
                    inside = within;
                    share as f32
                }));
            }
        }
        Shares { per_px, nodes, shares }
    }

    fn integrate(&self, encircled: &[f64], nodes: usize) -> Vec<f64> {
        let mut values = vec![0.0; AZIMUTHS * nodes];
        for node in 0..nodes {
            let first = first_ring(node as f64 / self.per_px as f64);
            let rings = encircled.get(first..).unwrap_or_default();
            for azimuth in 0..AZIMUTHS {
                let shares = &self.shares[node * AZIMUTHS + azimuth];
                values[azimuth * nodes + node] =
                    rings.windows(2).zip(shares).map(|(c, &share)| (c[1] - c[0]) * f64::from(share)).sum();
            }
        }
        values
    }
}

/// Area of the disc of radius `r` about the origin that lies in the unit square about `centre`.
fn disc_inside(r: f64, centre: [f64; 2]) -> f64 {
    let corner = |x: f64, y: f64| disc_corner(r, centre[0] + x, centre[1] + y);
    corner(0.5, 0.5) - corner(-0.5, 0.5) - corner(0.5, -0.5) + corner(-0.5, -0.5)
}

/// Area of the disc of radius `r` about the origin at columns up to `x` and rows up to `y`.
fn disc_corner(r: f64, x: f64, y: f64) -> f64 {
    let (x, y) = (x.clamp(-r, r), y.clamp(-r, r));
    let below = |x: f64| {
        // Area between the axis and the circle, from the middle to x.
        0.5 * (x * libm::sqrt((r * r - x * x).max(0.0)) + r * r * libm::asin((x / r).clamp(-1.0, 1.0)))
    };
    // Between these columns the row y cuts the disc.
    let chord = libm::sqrt((r * r - y * y).max(0.0));
    let end = x.clamp(-chord, chord);
    let (cut, cap) = (y * (end + chord), below(end) + below(chord));
    if y >= 0.0 { 2.0 * (below(x) + below(r)) + cut - cap } else { cut + cap }
}

/// Pixel integrals of round images; shares are computed once for each spacing of nodes and kept.
#[derive(Debug, Default)]
pub(super) struct Pixels {
    shares: RwLock<BTreeMap<usize, Arc<Shares>>>,
}

impl Pixels {
    /// Light on the pixels whose centres lie `k / per_px` px from the axis, k < `nodes`, at each of [`AZIMUTHS`]:
    /// azimuth by azimuth. `encircled` is the light within each ring, [`RINGS`] per px.
    pub(super) fn integrate(&self, encircled: &[f64], per_px: usize, nodes: usize) -> Vec<f64> {
        let known = |map: &BTreeMap<usize, Arc<Shares>>| {
            map.get(&per_px).filter(|shares| shares.nodes >= nodes).cloned()
        };
        let shares = known(&self.shares.read().unwrap_or_else(PoisonError::into_inner));
        let shares = shares.unwrap_or_else(|| {
            let shares = Arc::new(Shares::new(per_px, nodes.next_power_of_two()));
            self.shares.write().unwrap_or_else(PoisonError::into_inner).insert(per_px, Arc::clone(&shares));
            shares
        });
        shares.integrate(encircled, nodes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn harmonics_sum_to_the_values() {
        let values = [1.0, -0.3, 0.7, 2.0, 0.1];
        let orders = harmonics(values);
        for (azimuth, value) in values.into_iter().enumerate() {
            let sum: f64 = (0..AZIMUTHS).map(|o| orders[o] * harmonic(o, azimuth)).sum();
            assert!((sum - value).abs() < 1e-14);
        }
    }

    /// All of a disc is in the squares that tile the plane.
    #[test]
    fn pixels_share_out_a_disc() {
        for (r, x, y) in [(0.2, 0.1, 0.3), (1.7, 0.4, -0.2), (5.3, 0.0, 0.5), (0.6, 0.0, 0.0)] {
            let mut sum = 0.0;
            for i in -8..=8 {
                for j in -8..=8 {
                    sum += disc_inside(r, [f64::from(i) + x, f64::from(j) + y]);
                }
            }
            assert!((sum - std::f64::consts::PI * r * r).abs() < 1e-11, "r {r}: {sum}");
        }
    }

    /// A disc of even light: a pixel well inside has the disc's density, one on its straight edge about half of it.
    #[test]
    fn a_disc_is_integrated_exactly() {
        let radius = 10.0;
        let rings = 12 * RINGS;
        let encircled: Vec<f64> =
            (0..=rings).map(|k| (k as f64 / RINGS as f64 / radius).min(1.0)).map(|r| r * r).collect();
        let nodes = 24;
        let values = Pixels::default().integrate(&encircled, 2, nodes);
        let density = 1.0 / (std::f64::consts::PI * radius * radius);
        for azimuth in 0..AZIMUTHS {
            for k in 0..18 {
                // Shares are kept in f32.
                let value = values[azimuth * nodes + k] / density;
                assert!((value - 1.0).abs() < 1e-5, "{azimuth} {k}: {value}");
            }
        }
        // On the rim along x: half, less the sagitta of the circle, 1 / (24 radius).
        assert!((values[20] / density - (0.5 - 1.0 / 240.0)).abs() < 5e-4, "{}", values[20] / density);
    }
}
