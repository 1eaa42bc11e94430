//! Tables of sphere images over a range of depths and sizes: planes at equidistant depths, with interpolation
//! between them.
//!
//! A plane contains the coefficients of a spline of the pixel values at its nodes, in a layout of the image
//! model. In depth, another spline interpolates these coefficients, so that images and their derivatives are
//! continuous in depth as well as in the image plane.

use std::fmt::Debug;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::field_nodes::FieldNodes;
use super::spline;
use crate::bspline;

/// Layout of the coefficients of a plane, and the spline that they are the coefficients of.
pub trait PlaneLayout: Debug + Clone + Send + Sync + Serialize + DeserializeOwned {
    /// Factors of the number of coefficients per plane.
    fn sizes(&self) -> [usize; 3];

    /// Number of coefficients per plane.
    fn length(&self) -> usize {
        self.sizes().iter().product()
    }

    /// The light on a pixel at (`dx`, `dy`) from the particle (px), and its derivatives with respect to the
    /// position of the pixel (1/px) and the depth of the particle (1/um): value, d/dx, d/dy, d/dz.
    fn at(&self, plane: &InterpolatedPlane, dx: f64, dy: f64) -> [f64; 4];
}

/// A table of images over a range of depths and sizes.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub struct DepthTable<L> {
    /// Depth of plane 1, um; plane 0 is before the range of the table.
    pub(super) start_um: f64,
    pub(super) step_um: f64,
    /// Number of planes per radius.
    pub(super) planes: usize,
    /// Particle radii at the interpolation nodes, um.
    pub(super) radii: Vec<f64>,
    /// Places in the field of view at which images are computed.
    pub(super) field: FieldNodes,
    pub(super) layout: L,
    /// Half width and half height of the images, px, by plane.
    pub(super) reach_px: Vec<[f64; 2]>,
    /// Coefficients by place in the field, then by radius, then by plane.
    pub(super) coefficients: Vec<f32>,
    /// Estimated error, relative to the peak.
    pub(super) error: f64,
}

pub(super) struct WeightedPlane<'a> {
    pub(super) weight: f64,
    /// Derivative of the weight with respect to depth, 1/um.
    pub(super) by_z: f64,
    pub(super) coefficients: &'a [f32],
}

/// The coefficients at one depth and their derivatives with respect to depth.
#[derive(Debug)]
pub struct InterpolatedPlane {
    pub(super) z_um: f64,
    pub(super) value: Vec<f64>,
    pub(super) by_z: Vec<f64>,
}

impl<L: PlaneLayout> DepthTable<L> {
    /// The image at one depth (um) alone, and its change over `step_um`: on a linear function, the spline in
    /// depth is exact.
    pub(super) fn single(
        (z_um, step_um): (f64, f64),
        layout: L,
        reach_px: [f64; 2],
        plane: &[f32],
        by_step: Option<&[f32]>,
    ) -> Self {
        let coefficients = match by_step {
            None => plane.repeat(4),
            Some(by_step) => [-1.0, 0.0, 1.0, 2.0]
                .iter()
                .flat_map(|i| plane.iter().zip(by_step).map(move |(value, by)| value + i * by))
                .collect(),
        };
        DepthTable {
            start_um: z_um,
            step_um,
            planes: 4,
            radii: vec![0.0],
            field: FieldNodes::one(),
            layout,
            reach_px: vec![reach_px; 4],
            coefficients,
            error: 0.0,
        }
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.coefficients.as_slice())
    }

    /// The first of the four planes around a depth, and the distance of the depth from it, in steps.
    fn first(&self, z_um: f64) -> (usize, f64) {
        let steps = (z_um - self.start_um) / self.step_um;
        let first = (steps.max(0.0) as usize).min(self.planes - 4);
        (first, steps - first as f64)
    }

    /// The planes around a depth and a radius (um): four for each interpolation radius and each place in the
    /// field around a position (px).
    pub(super) fn planes_around(
        &self,
        z_um: f64,
        radius_um: f64,
        at_px: [f64; 2],
    ) -> impl Iterator<Item = [WeightedPlane<'_>; 4]> {
        let length = self.layout.length();
        let (first, place) = self.first(z_um);
        let (weights, slopes) = bspline::cubic(place);
        let sizes = spline::lagrange(&self.radii, radius_um);
        let places = self.field.weights(at_px);
        let images = places.into_iter().flat_map(move |place_weight| {
            let size_weight = sizes.iter().map(|(size_weight, _)| place_weight * size_weight);
            size_weight.collect::<Vec<f64>>()
        });
        images.enumerate().map(move |(image, image_weight)| {
            std::array::from_fn(|i| WeightedPlane {
                weight: image_weight * weights[i],
                by_z: image_weight * slopes[i] / self.step_um,
                coefficients: &self.coefficients[(image * self.planes + first + i) * length..][..length],
            })
        })
    }

    /// The image at a depth and a radius (um) within the range of the table and at a position (px), in f64:
    /// for fits and error bounds.
    pub(super) fn plane_at(&self, z_um: f64, radius_um: f64, at_px: [f64; 2]) -> InterpolatedPlane {
        let length = self.layout.length();
        let (mut value, mut by_z) = (vec![0.0; length], vec![0.0; length]);
        for plane in self.planes_around(z_um, radius_um, at_px).flatten() {
            for ((v, d), &c) in value.iter_mut().zip(&mut by_z).zip(plane.coefficients) {
                *v += plane.weight * f64::from(c);
                *d += plane.by_z * f64::from(c);
            }
        }
        InterpolatedPlane { z_um, value, by_z }
    }

    /// Depth and radius (um) at which the error of the finished table is estimated: midway between nodes.
    pub(super) fn between_nodes(&self) -> (f64, f64) {
        let z_um = self.start_um + self.step_um * (((self.planes - 3) / 2) as f64 + 0.5);
        let radius_um = match self.radii[..] {
            [a, b, ..] => 0.5 * (a + b),
            _ => self.radii[0],
        };
        (z_um, radius_um)
    }

    /// Half width and half height of an image at this depth (um), px.
    pub(super) fn reach(&self, z_um: f64) -> [f64; 2] {
        let (first, _) = self.first(z_um);
        // The maximum of the two nearest planes; the outer two have little weight.
        let [a, b] = [self.reach_px[first + 1], self.reach_px[first + 2]];
        [a[0].max(b[0]), a[1].max(b[1])]
    }

    /// As bytes, for a store.
    pub(super) fn write(&self) -> Vec<u8> {
        postcard::to_allocvec(self).unwrap_or_default()
    }

    /// From such bytes; `None` if they are none.
    pub(super) fn read(bytes: &[u8]) -> Option<Self> {
        let table: Self = postcard::from_bytes(bytes).ok()?;
        let images = table.field.count().checked_mul(table.radii.len())?;
        let mut sizes = [table.planes].into_iter().chain(table.layout.sizes());
        let all = sizes.try_fold(images, usize::checked_mul)?;
        let fits =
            all == table.coefficients.len() && table.reach_px.len() == table.planes && table.planes >= 4;
        fits.then_some(table)
    }
}
