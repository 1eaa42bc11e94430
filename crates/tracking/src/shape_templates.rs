//! Images of spheroids over depth, axis and aspect ratio, computed from the optical model, as templates.

use std::f64::consts::TAU;
use std::sync::Arc;

use glam::DVec3;
use microsig_core::cancel::checkpoint;
use rayon::prelude::*;

use super::denoise::PixelNoise;
use super::gray_image::GrayImage;
use super::joint_fit::Equations;
use super::mle::{Detail, ShapeImages};
use super::shape_fit::Pose;
use super::shape_table::ShapeTable;
use super::templates::Templates;

/// Images at these depths, brightness 1, on squares of half width `images.radius()`: what `made` makes of the images of each
/// aspect ratio and, of these, each axis.
fn over_depth<T: Send>(
    images: &ShapeImages,
    depths_um: &[f64],
    (aspects, tables): (&[f64], &[Option<Arc<ShapeTable>>]),
    axes: &[DVec3],
    made: impl Fn(f64, Vec<Vec<f64>>) -> T + Sync,
) -> Vec<T> {
    let at_depth = |&z_um: &f64| {
        let of = aspects.iter().zip(tables);
        let poses = of.flat_map(|(e_p, table)| axes.iter().map(move |axis| (*e_p, table, *axis)));
        let all = poses.map(|(e_p, table, axis)| {
            checkpoint();
            let pose = Pose { at: [0.0; 2], z_um, axis, e_p, brightness: 1.0 };
            match table {
                Some(table) => table.light(&pose, [0; 2], images.radius()),
                None => images.light(&pose, [0; 2], images.radius(), Detail::Draft),
            }
        });
        made(z_um, all.collect())
    };
    depths_um.par_iter().map(at_depth).collect()
}

/// `n` equidistant depths over the range of the images, um.
fn depths_um(images: &ShapeImages, n: usize) -> Vec<f64> {
    let [low, high] = images.depths_um();
    (0..n).map(|k| low + (high - low) * k as f64 / (n - 1) as f64).collect()
}

/// The mean of square images.
fn mean(all: &[Vec<f64>]) -> GrayImage {
    let side = all[0].len().isqrt();
    let pixel = |i: usize| all.iter().map(|image| image[i]).sum::<f64>() / all.len() as f64;
    GrayImage { width: side, height: side, counts: (0..side * side).map(|i| pixel(i) as f32).collect() }
}

/// Number of functions of the axis: the monomials of degree 6 of its components.
pub(super) const FUNCTIONS: usize = 28;

/// These functions.
pub(super) fn functions(axis: DVec3) -> [f64; FUNCTIONS] {
    let powers = |v: f64| {
        let square = v * v;
        [1.0, v, square, square * v, square * square, square * square * v, square * square * square]
    };
    let [x, y, z] = axis.to_array().map(powers);
    let mut values = [0.0; FUNCTIONS];
    let exponents = (0..=6).flat_map(|i| (0..=6 - i).map(move |j| (i, j)));
    values.iter_mut().zip(exponents).for_each(|(value, (i, j))| *value = x[i] * y[j] * z[6 - i - j]);
    values
}

/// Number of axes for which images are computed.
const AXES: usize = 60;

/// Images of spheroids at brightness 1 as functions of the axis: for each pixel, a polynomial of its components. On the
/// unit sphere; at degree 6 they span all even functions up to that order of spherical harmonics, and an axis has no sign.
pub(super) struct ShapeTemplates {
    pub(super) depths_um: Vec<f64>,
    pub(super) aspects: Vec<f64>,
    /// Half width of the images at each depth, px.
    radii: Vec<usize>,
    /// For each depth and aspect ratio, [`FUNCTIONS`] images: the coefficients.
    coefficients: Vec<Vec<Vec<Vec<f32>>>>,
    /// For each depth, the mean image over axes and aspect ratios, on squares of the same side.
    pub(super) means: Vec<GrayImage>,
}

impl ShapeTemplates {
    /// Templates at `depths` depths over the depth range of `images`.
    pub(super) fn new(
        images: &ShapeImages,
        aspects: Vec<f64>,
        tables: &[Option<Arc<ShapeTable>>],
        depths: usize,
    ) -> Self {
        let (depths_um, axes) = (depths_um(images, depths), axes(AXES).collect::<Vec<_>>());
        let fit = fit(&axes);
        let made = |z_um: f64, all: Vec<Vec<f64>>| {
            let crop = |image: &Vec<f64>| middle_of(image, images.radius(), images.radius_at(z_um));
            let aspect_mean =
                |images: &[Vec<f64>]| combined(&fit, &images.iter().map(crop).collect::<Vec<_>>());
            (all.chunks_exact(AXES).map(aspect_mean).collect(), mean(&all))
        };
        let made = over_depth(images, &depths_um, (&aspects, tables), &axes, made);
        let radii = depths_um.iter().map(|z_um| images.radius_at(*z_um)).collect();
        let (coefficients, means) = made.into_iter().unzip();
        ShapeTemplates { depths_um, aspects, radii, coefficients, means }
    }

    /// Templates over about `depths` depths, of each aspect ratio and each of `n` axes.
    pub(super) fn over_axes(&self, n: usize, depths: usize, noise: PixelNoise) -> Vec<Templates> {
        let stride = self.depths_um.len().div_ceil(depths);
        let chosen: Vec<usize> = (0..self.depths_um.len()).step_by(stride).collect();
        let largest = self.radii.iter().copied().max().unwrap_or(0);
        let axis_values = |(aspect, axis): (usize, DVec3)| {
            let depths_um = chosen.iter().map(|&k| self.depths_um[k]).collect();
            let image = |&k: &usize| {
                let (r, counts) = (self.radii[k], self.image(k, aspect, axis));
                let inner = |at: usize| (at + r).checked_sub(largest).filter(|at| *at <= 2 * r);
                let pixel = |x, y| Some(counts[inner(y)? * (2 * r + 1) + inner(x)?]);
                GrayImage::from_fn((2 * largest + 1, 2 * largest + 1), |x, y| pixel(x, y).unwrap_or(0.0))
            };
            Templates::new(depths_um, chosen.iter().map(image).collect(), noise)
        };
        let all: Vec<(usize, DVec3)> =
            (0..self.aspects.len()).flat_map(|aspect| axes(n).map(move |axis| (aspect, axis))).collect();
        all.into_par_iter().map(axis_values).collect()
    }

    /// Half width at a depth, px.
    pub(super) fn radius(&self, depth: usize) -> usize {
        self.radii[depth]
    }

    /// The images whose sum, weighted by [`functions`], is the image at a depth of an aspect ratio, both by their index.
    pub(super) fn coefficients(&self, depth: usize, aspect: usize) -> &[Vec<f32>] {
        &self.coefficients[depth][aspect]
    }

    /// The image with the particle on the central pixel of a square.
    pub(super) fn image(&self, depth: usize, aspect: usize, axis: DVec3) -> Vec<f32> {
        let mut image = vec![0.0; (2 * self.radii[depth] + 1).pow(2)];
        for (weight, part) in functions(axis).into_iter().zip(self.coefficients(depth, aspect)) {
            image.iter_mut().zip(part).for_each(|(image, part)| *image += weight as f32 * part);
        }
        image
    }
}

/// For each function, the weights of values at these axes by which its coefficient fits them best.
fn fit(axes: &[DVec3]) -> Vec<Vec<f64>> {
    let values: Vec<[f64; FUNCTIONS]> = axes.iter().map(|axis| functions(*axis)).collect();
    let product = |i: usize, j: usize| values.iter().map(|values| values[i] * values[j]).sum();
    let matrix: Vec<f64> = (0..FUNCTIONS).flat_map(|i| (0..FUNCTIONS).map(move |j| product(i, j))).collect();
    let axis_values = |values: &[f64; FUNCTIONS]| {
        Equations { matrix: matrix.clone(), right: values.to_vec() }
            .solved(0.0)
            .unwrap_or(vec![0.0; FUNCTIONS])
    };
    let by_axis: Vec<Vec<f64>> = values.iter().map(axis_values).collect();
    (0..FUNCTIONS).map(|i| by_axis.iter().map(|axis_values| axis_values[i]).collect()).collect()
}

/// Sums of images with these weights.
fn combined(weights: &[Vec<f64>], images: &[Vec<f32>]) -> Vec<Vec<f32>> {
    let sum = |weights: &Vec<f64>| {
        let pixel =
            |i: usize| weights.iter().zip(images).map(|(weight, image)| weight * f64::from(image[i])).sum();
        (0..images[0].len())
            .map(|i| {
                let sum: f64 = pixel(i);
                sum as f32
            })
            .collect()
    };
    weights.iter().map(sum).collect()
}

/// The middle of a square of half width `from`, with half width `to`.
fn middle_of(light: &[f64], from: usize, to: usize) -> Vec<f32> {
    let (side, off) = (2 * from + 1, from.saturating_sub(to));
    let rows = light.chunks_exact(side).skip(off).take(side - 2 * off);
    rows.flat_map(|row| row[off..side - off].iter().map(|light| *light as f32)).collect()
}

/// Directions that cover half the sphere evenly.
pub(super) fn axes(n: usize) -> impl Iterator<Item = DVec3> {
    let golden = TAU * (1.0 - 2.0 / (1.0 + 5f64.sqrt()));
    (0..n).map(move |k| {
        let z = (k as f64 + 0.5) / n as f64;
        let (sine, cosine) = (golden * k as f64).sin_cos();
        DVec3::new((1.0 - z * z).sqrt() * cosine, (1.0 - z * z).sqrt() * sine, z)
    })
}

/// The axis tilted the other way with respect to the image plane: toward the lens instead of away from it.
pub(super) fn mirrored(axis: DVec3) -> DVec3 {
    DVec3::new(axis.x, axis.y, -axis.z)
}

/// Angle between axes, which have no sign, rad.
pub(super) fn angle(a: DVec3, b: DVec3) -> f64 {
    a.dot(b).abs().min(1.0).acos()
}
