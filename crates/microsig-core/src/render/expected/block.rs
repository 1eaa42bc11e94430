//! Images of spheres over a range of depths, and of sizes: planes at equal steps of depth, interpolated between.
//!
//! A plane holds coefficients of a spline through the light on pixels at its nodes. Between planes another spline goes
//! through the coefficients, so that images and their derivatives are continuous in depth as well as in the plane.

use super::layout::Layout;
use super::rings::Rings;
use super::spline;

/// What a plane is made of.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Form {
    /// Behind a spherical lens: orders of the azimuth along the radius, of a quadratic spline.
    Round(Rings),
    /// With a cylindrical lens: a quadrant, of a cubic spline.
    Quadrant(Layout),
}

impl Form {
    /// Numbers of a plane.
    pub(super) fn length(&self) -> usize {
        match self {
            Form::Round(rings) => rings.length(),
            Form::Quadrant(layout) => layout.length(),
        }
    }
}

/// Images over a range of depths and sizes.
#[derive(Debug)]
pub(super) struct Block {
    /// Depth of the plane with number 1; number 0 lies before the block's range.
    pub(super) start_um: f64,
    pub(super) step_um: f64,
    /// Planes for each radius.
    pub(super) planes: usize,
    /// Radii of the nodes of interpolation, um.
    pub(super) radii: Vec<f64>,
    pub(super) form: Form,
    /// Half width and half height of the images, px.
    pub(super) reach_px: [f64; 2],
    /// By radius and plane.
    pub(super) coefficients: Vec<f32>,
    /// The error found, as a share of the peak.
    pub(super) error: f64,
}

impl Block {
    /// The planes around a depth and a radius: four of each size that the radius lies between.
    pub(super) fn around(&self, z_um: f64, radius_um: f64) -> impl Iterator<Item = [Neighbour<'_>; 4]> {
        let length = self.form.length();
        let steps = (z_um - self.start_um) / self.step_um;
        let first = (steps.max(0.0) as usize).min(self.planes - 4);
        let (weights, slopes) = spline::basis(steps - first as f64);
        let sizes = spline::lagrange(&self.radii, radius_um);
        sizes.into_iter().enumerate().map(move |(size, (of_size, _))| {
            std::array::from_fn(|i| Neighbour {
                weight: of_size * weights[i],
                by_z: of_size * slopes[i] / self.step_um,
                coefficients: &self.coefficients[(size * self.planes + first + i) * length..][..length],
            })
        })
    }

    /// Memory of the block, bytes.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.coefficients.as_slice())
    }
}

/// A plane near a sphere.
pub(super) struct Neighbour<'a> {
    pub(super) weight: f64,
    /// Derivative of the weight by depth, 1/um.
    pub(super) by_z: f64,
    pub(super) coefficients: &'a [f32],
}
