//! Integration of round images over square pixels.
//!
//! The integral of a round image over a square pixel is not rotationally symmetric: it depends on the azimuth
//! of the pixel as f0(R) + f4(R) cos 4 psi + ... + f16(R) cos 16 psi; higher orders are neglected. Light
//! between two radii falls on a pixel in proportion to the fraction of the annulus inside the square, which
//! is known in closed form.

use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_4;
use std::sync::{Arc, PoisonError, RwLock};

use super::encircled::ANNULI_PER_PX;

/// Number of sampled azimuths, from 0 to 45 degrees in equal steps; also the number of azimuthal orders.
pub(super) const AZIMUTHS: usize = 5;

/// cos (4 order psi) at each azimuth.
fn harmonic(order: usize, azimuth: usize) -> f64 {
    libm::cos((order * azimuth) as f64 * std::f64::consts::PI / (AZIMUTHS - 1) as f64)
}

/// Cosine and sine of a sampled azimuth.
pub(super) fn direction(azimuth: usize) -> [f64; 2] {
    let (sine, cosine) = libm::sincos(azimuth as f64 * FRAC_PI_4 / (AZIMUTHS - 1) as f64);
    [cosine, sine]
}

/// The azimuthal orders of values at all azimuths (a cosine transform).
pub(super) fn harmonics(values: [f64; AZIMUTHS]) -> [f64; AZIMUTHS] {
    let end = |i: usize| if i == 0 || i == AZIMUTHS - 1 { 0.5 } else { 1.0 };
    std::array::from_fn(|order| {
        let sum: f64 = (0..AZIMUTHS).map(|a| end(a) * values[a] * harmonic(order, a)).sum();
        end(order) * sum * 2.0 / (AZIMUTHS - 1) as f64
    })
}

/// The azimuthal orders of radial lines at all azimuths, node by node: one line per order.
pub(super) fn orders(azimuths: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let nodes = azimuths.first().map_or(0, Vec::len);
    let mut orders = vec![vec![0.0; nodes]; AZIMUTHS];
    for node in 0..nodes {
        let node_harmonics = harmonics(std::array::from_fn(|azimuth| azimuths[azimuth][node]));
        orders.iter_mut().zip(node_harmonics).for_each(|(order, value)| order[node] = value);
    }
    orders
}

/// Maximum number of annuli that a pixel overlaps: its diagonal, and one at each end.
const TOUCHED: usize = 48;

/// Fractions of annuli inside pixels whose centers are at the distances k / `per_px` (px) from the axis.
#[derive(Debug)]
struct AnnulusShares {
    per_px: usize,
    nodes: usize,
    /// By node and azimuth; each element has the annuli from `first_ring` on.
    shares: Vec<[f32; TOUCHED]>,
}

/// The first annulus that a pixel at this distance (px) may overlap.
fn first_ring(distance_px: f64) -> usize {
    ((distance_px - std::f64::consts::FRAC_1_SQRT_2) * ANNULI_PER_PX as f64).max(0.0) as usize
}

impl AnnulusShares {
    fn new(per_px: usize, nodes: usize) -> Self {
        let mut shares = Vec::with_capacity(nodes * AZIMUTHS);
        for node in 0..nodes {
            let distance = node as f64 / per_px as f64;
            let first = first_ring(distance);
            for azimuth in 0..AZIMUTHS {
                let center = direction(azimuth).map(|d| distance * d);
                let area = |ring: usize| disc_inside(ring as f64 / ANNULI_PER_PX as f64, center);
                let mut inside = if first == 0 { 0.0 } else { area(first) };
                shares.push(std::array::from_fn(|i| {
                    let ring = first + i;
                    let within = area(ring + 1);
                    let ring_area =
                        (2 * ring + 1) as f64 * std::f64::consts::PI / (ANNULI_PER_PX * ANNULI_PER_PX) as f64;
                    let share = (within - inside) / ring_area;
                    inside = within;
                    share as f32
                }));
            }
        }
        AnnulusShares { per_px, nodes, shares }
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

/// Area of the intersection of the disc of radius `r` about the origin with the unit square about `center`.
fn disc_inside(r: f64, center: [f64; 2]) -> f64 {
    let corner = |x: f64, y: f64| disc_corner(r, center[0] + x, center[1] + y);
    corner(0.5, 0.5) - corner(-0.5, 0.5) - corner(0.5, -0.5) + corner(-0.5, -0.5)
}

/// Area of the part of the disc of radius `r` about the origin with columns up to `x` and rows up to `y`.
fn disc_corner(r: f64, x: f64, y: f64) -> f64 {
    let (x, y) = (x.clamp(-r, r), y.clamp(-r, r));
    let below = |x: f64| {
        // Area between the axis and the circle, from 0 to x.
        0.5 * (x * libm::sqrt((r * r - x * x).max(0.0)) + r * r * libm::asin((x / r).clamp(-1.0, 1.0)))
    };
    // The row y intersects the disc between these columns.
    let chord = libm::sqrt((r * r - y * y).max(0.0));
    let end = x.clamp(-chord, chord);
    let (cut, cap) = (y * (end + chord), below(end) + below(chord));
    if y >= 0.0 { 2.0 * (below(x) + below(r)) + cut - cap } else { cut + cap }
}

/// The fractions by node spacing, computed once: they are geometry alone, the same for all optics.
static KNOWN_SHARES: RwLock<BTreeMap<usize, Arc<AnnulusShares>>> = RwLock::new(BTreeMap::new());

/// Light on the pixels whose centers are `k / per_px` px from the axis, k < `nodes`, for each of the
/// [`AZIMUTHS`], azimuth by azimuth. `encircled` is the light within each radius, [`ANNULI_PER_PX`] per px.
pub(super) fn integrate(encircled: &[f64], per_px: usize, nodes: usize) -> Vec<f64> {
    let known = |map: &BTreeMap<usize, Arc<AnnulusShares>>| {
        map.get(&per_px).filter(|shares| shares.nodes >= nodes).cloned()
    };
    let shares = known(&KNOWN_SHARES.read().unwrap_or_else(PoisonError::into_inner));
    let shares = shares.unwrap_or_else(|| {
        let mut map = KNOWN_SHARES.write().unwrap_or_else(PoisonError::into_inner);
        known(&map).unwrap_or_else(|| {
            let shares = Arc::new(AnnulusShares::new(per_px, nodes.next_power_of_two()));
            map.insert(per_px, Arc::clone(&shares));
            shares
        })
    });
    shares.integrate(encircled, nodes)
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

    /// The areas in the squares that tile the plane add up to the disc's.
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

    /// A uniform disc: a pixel well inside has its density, one centered on its edge about half of it.
    #[test]
    fn a_disc_is_integrated_exactly() {
        let radius = 10.0;
        let rings = 12 * ANNULI_PER_PX;
        let encircled: Vec<f64> =
            (0..=rings).map(|k| (k as f64 / ANNULI_PER_PX as f64 / radius).min(1.0)).map(|r| r * r).collect();
        let nodes = 24;
        let values = integrate(&encircled, 2, nodes);
        let density = 1.0 / (std::f64::consts::PI * radius * radius);
        for azimuth in 0..AZIMUTHS {
            for k in 0..18 {
                // The fractions are stored in f32.
                let value = values[azimuth * nodes + k] / density;
                assert!((value - 1.0).abs() < 1e-5, "{azimuth} {k}: {value}");
            }
        }
        // On the edge along x: half, minus the correction for the curvature of the circle, 1 / (24 radius).
        assert!((values[20] / density - (0.5 - 1.0 / 240.0)).abs() < 5e-4, "{}", values[20] / density);
    }
}
