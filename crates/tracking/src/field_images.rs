//! Particle images that vary over the field of view: an interpolation between the stacks of several places.
//!
//! The image at a position is a weighted sum of the images of the stacks around it. The weights reproduce
//! quantities that vary linearly over the field (moving least squares of first order; Lancaster & Salkauskas
//! 1981, Math. Comput. 37, 141), also beyond the outermost places, so that a tilt of the focal surface is
//! reproduced to first order in the change of the images. Derivatives with respect to the position leave out
//! the change of the weights.

use super::images::{ImagePatch, ParticleImages};
use super::templates::Templates;

/// Reach of a place, in units of the distance between places.
const REACH: f64 = 2.2;

/// Square of the distance, in the same unit, within which a stack is used nearly alone: a wider average would
/// smooth out the curvature of the focal surface.
const OWN: f64 = 0.02;

/// Penalty of the linear terms relative to the weights, for places that hardly determine them.
const PENALTY: f64 = 0.005;

/// Weights below this are left out.
const LEAST_WEIGHT: f64 = 0.02;

/// Places of stacks, px from 0.
#[derive(Debug, Clone)]
pub(super) struct FieldPlaces {
    places: Vec<[f64; 2]>,
    /// Typical distance between neighbors, px.
    spacing: f64,
}

impl FieldPlaces {
    pub(super) fn new(places: Vec<[f64; 2]>) -> Self {
        let nearest = |a: &[f64; 2]| {
            let others = places.iter().map(|b| (a[0] - b[0]).hypot(a[1] - b[1])).filter(|d| *d > 0.0);
            others.fold(f64::INFINITY, f64::min)
        };
        let mut distances: Vec<f64> = places.iter().map(nearest).filter(|d| d.is_finite()).collect();
        distances.sort_by(f64::total_cmp);
        let spacing = distances.get(distances.len() / 2).copied().unwrap_or(1.0);
        FieldPlaces { places, spacing }
    }

    /// Number of places.
    pub(super) fn len(&self) -> usize {
        self.places.len()
    }

    /// The place nearest to a position.
    pub(super) fn nearest(&self, at: [f64; 2]) -> usize {
        let away = |k: &usize| (self.places[*k][0] - at[0]).hypot(self.places[*k][1] - at[1]);
        (0..self.places.len()).min_by(|a, b| away(a).total_cmp(&away(b))).unwrap_or(0)
    }

    /// The weights of places at a position; their sum is 1.
    pub(super) fn weights(&self, at: [f64; 2]) -> Vec<(usize, f64)> {
        let relative: Vec<[f64; 2]> = self
            .places
            .iter()
            .map(|place| [0, 1].map(|axis| (place[axis] - at[axis]) / self.spacing))
            .collect();
        let kernel = |[x, y]: [f64; 2]| {
            let square = x * x + y * y;
            (1.0 - square / (REACH * REACH)).max(0.0).powi(2) / (square + OWN)
        };
        // Sums of kernel times 1, x, y and their products.
        let mut sums = [[0.0; 3]; 3];
        for &[x, y] in &relative {
            let terms = [1.0, x, y];
            for (row, a) in sums.iter_mut().zip(terms) {
                row.iter_mut().zip(terms).for_each(|(sum, b)| *sum += kernel([x, y]) * a * b);
            }
        }
        let total = sums[0][0];
        if total < 1e-9 {
            return vec![(self.nearest(at), 1.0)];
        }
        sums[1][1] += PENALTY * total;
        sums[2][2] += PENALTY * total;
        let [c, a, b] = first_column_of_inverse(sums);
        let weight = |[x, y]: [f64; 2]| kernel([x, y]) * (c + a * x + b * y);
        let mut weights: Vec<(usize, f64)> =
            relative.iter().enumerate().map(|(k, place)| (k, weight(*place))).collect();
        weights.retain(|(_, weight)| weight.abs() > LEAST_WEIGHT);
        let sum: f64 = weights.iter().map(|(_, weight)| weight).sum();
        weights.iter_mut().for_each(|(_, weight)| *weight /= sum);
        weights
    }
}

/// The first column of the inverse of a symmetric matrix.
fn first_column_of_inverse([[a, b, c], [_, d, e], [_, _, f]]: [[f64; 3]; 3]) -> [f64; 3] {
    let cofactors = [d * f - e * e, c * e - b * f, b * e - c * d];
    let determinant = a * cofactors[0] + b * cofactors[1] + c * cofactors[2];
    cofactors.map(|cofactor| cofactor / determinant)
}

/// Images of one size of particles over the field of view.
#[derive(Debug)]
pub(super) struct FieldImages {
    places: FieldPlaces,
    /// The images of each place.
    templates: Vec<Templates>,
}

impl FieldImages {
    /// Images of several places, of which there is at least one.
    pub(super) fn new(places: FieldPlaces, templates: Vec<Templates>) -> Self {
        FieldImages { places, templates }
    }
}

impl ParticleImages for FieldImages {
    fn depths_um(&self) -> [f64; 2] {
        let all = self.templates.iter().map(ParticleImages::depths_um);
        all.fold([f64::NEG_INFINITY, f64::INFINITY], |[low, high], [a, b]| [low.max(a), high.min(b)])
    }

    fn radius_px(&self, z_um: f64, reach_um: f64) -> usize {
        self.templates.iter().map(|templates| templates.radius_px(z_um, reach_um)).max().unwrap_or(0)
    }

    fn patch(&self, at: [f64; 2], z_um: f64, radius: usize) -> ImagePatch {
        let mut sum: Option<ImagePatch> = None;
        for (place, weight) in self.places.weights(at) {
            let weight = weight as f32;
            let patch = self.templates[place].patch(at, z_um, radius);
            match &mut sum {
                None => {
                    let light = patch.light.into_iter().map(|values| values.map(|v| weight * v)).collect();
                    sum = Some(ImagePatch { light, ..patch });
                }
                Some(sum) => {
                    for (own, other) in sum.light.iter_mut().zip(patch.light) {
                        own.iter_mut().zip(other).for_each(|(own, other)| *own += weight * other);
                    }
                }
            }
        }
        sum.unwrap_or_else(|| self.templates[0].patch(at, z_um, radius))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(side: usize) -> FieldPlaces {
        FieldPlaces::new(
            (0..side * side)
                .map(|k| [50.0 + 100.0 * (k % side) as f64, 50.0 + 100.0 * (k / side) as f64])
                .collect(),
        )
    }

    #[test]
    fn weights_reproduce_what_is_linear_over_the_field() {
        let places = grid(3);
        for at in [[150.0, 150.0], [120.0, 190.0], [30.0, 60.0], [0.0, 0.0], [299.0, 299.0]] {
            let weights = places.weights(at);
            let mean = |axis: usize| weights.iter().map(|(k, w)| w * places.places[*k][axis]).sum::<f64>();
            assert!((weights.iter().map(|(_, w)| w).sum::<f64>() - 1.0).abs() < 1e-12);
            // The penalty draws positions beyond the places inward.
            let bar = if at.iter().all(|c| (50.0..=250.0).contains(c)) { 4.0 } else { 12.0 };
            assert!(
                (mean(0) - at[0]).abs() < bar && (mean(1) - at[1]).abs() < bar,
                "{at:?}: {} {}",
                mean(0),
                mean(1)
            );
        }
    }

    #[test]
    fn few_places_have_weights_too() {
        assert_eq!(grid(1).weights([10.0, 10.0]), [(0, 1.0)]);
        let line = FieldPlaces::new(vec![[0.0, 0.0], [100.0, 0.0]]);
        let weights = line.weights([50.0, 40.0]);
        assert!(weights.iter().all(|(_, weight)| (weight - 0.5).abs() < 1e-9), "{weights:?}");
        assert_eq!(line.nearest([60.0, 0.0]), 1);
    }
}
