//! Tables of sphere images over a range of depths and sizes: planes at equidistant depths, with interpolation
//! between them.
//!
//! A plane contains the coefficients of a spline of the pixel values at its nodes. In depth, another spline
//! interpolates these coefficients, so that images and their derivatives are continuous in depth as well as
//! in the image plane.

use super::quadrant_layout::QuadrantLayout;
use super::radial_layout::RadialLayout;
use crate::bspline;
use crate::render::spline;
use crate::render::store::{Reader, Writer};

/// Layout of the coefficients of a plane.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum PlaneLayout {
    /// Spherical lens: azimuthal orders of a quadratic spline along the radius.
    Radial(RadialLayout),
    /// A cubic spline over one quadrant: always with a cylindrical lens, otherwise if few nodes suffice.
    Quadrant(QuadrantLayout),
}

impl PlaneLayout {
    /// Number of coefficients per plane.
    pub(super) fn length(&self) -> usize {
        match self {
            PlaneLayout::Radial(rings) => rings.length(),
            PlaneLayout::Quadrant(layout) => layout.length(),
        }
    }

    /// The same of a layout that was read; `None` if no plane is so large.
    fn checked_length(&self) -> Option<usize> {
        match self {
            PlaneLayout::Radial(rings) => rings.orders.checked_mul(rings.columns),
            PlaneLayout::Quadrant(layout) => layout.per_px.checked_mul(layout.run)?.checked_mul(layout.rows),
        }
    }
}

/// A table of images over a range of depths and sizes.
#[derive(Debug, PartialEq)]
pub(super) struct DepthTable {
    /// Depth of plane 1, um; plane 0 is before the range of the table.
    pub(super) start_um: f64,
    pub(super) step_um: f64,
    /// Number of planes per radius.
    pub(super) planes: usize,
    /// Particle radii at the interpolation nodes, um.
    pub(super) radii: Vec<f64>,
    pub(super) layout: PlaneLayout,
    /// Half width and half height of the images, px.
    pub(super) reach_px: [f64; 2],
    /// Coefficients by radius, then by plane.
    pub(super) coefficients: Vec<f32>,
    /// Estimated error, relative to the peak.
    pub(super) error: f64,
}

impl crate::render::tables::Table for DepthTable {
    fn bytes(&self) -> usize {
        size_of_val(self.coefficients.as_slice())
    }

    fn error(&self) -> f64 {
        self.error
    }
}

impl DepthTable {
    /// The planes around a depth and a radius (um): four for each interpolation radius.
    pub(super) fn planes_around(
        &self,
        z_um: f64,
        radius_um: f64,
    ) -> impl Iterator<Item = [WeightedPlane<'_>; 4]> {
        let length = self.layout.length();
        let steps = (z_um - self.start_um) / self.step_um;
        let first = (steps.max(0.0) as usize).min(self.planes - 4);
        let (weights, slopes) = bspline::cubic(steps - first as f64);
        let sizes = spline::lagrange(&self.radii, radius_um);
        sizes.into_iter().enumerate().map(move |(size, (of_size, _))| {
            std::array::from_fn(|i| WeightedPlane {
                weight: of_size * weights[i],
                by_z: of_size * slopes[i] / self.step_um,
                coefficients: &self.coefficients[(size * self.planes + first + i) * length..][..length],
            })
        })
    }

    /// As bytes, for a store.
    pub(super) fn to_bytes(&self) -> Vec<u8> {
        let mut out = Writer::default();
        match &self.layout {
            PlaneLayout::Radial(layout) => {
                out.whole(0);
                layout.write(&mut out);
            }
            PlaneLayout::Quadrant(layout) => {
                out.whole(1);
                [layout.per_px, layout.rows, layout.run].into_iter().for_each(|value| out.whole(value));
            }
        }
        let [x, y] = self.reach_px;
        [self.start_um, self.step_um, x, y, self.error].into_iter().for_each(|value| out.number(value));
        out.whole(self.planes);
        out.numbers(&self.radii);
        out.singles(&self.coefficients);
        out.0
    }

    /// From such bytes; `None` if they are no table.
    pub(super) fn from_bytes(bytes: &[u8]) -> Option<DepthTable> {
        let mut from = Reader(bytes);
        let layout = match from.whole()? {
            0 => PlaneLayout::Radial(RadialLayout::read(&mut from)?),
            1 => {
                let [per_px, rows, run] = [from.whole()?, from.whole()?, from.whole()?];
                PlaneLayout::Quadrant(QuadrantLayout { per_px, rows, run })
            }
            _ => return None,
        };
        let [start_um, step_um, x, y, error] =
            [from.number()?, from.number()?, from.number()?, from.number()?, from.number()?];
        let planes = from.whole()?;
        let (radii, coefficients) = (from.numbers()?, from.singles()?);
        let length = radii.len().checked_mul(planes)?.checked_mul(layout.checked_length()?)?;
        let table =
            DepthTable { start_um, step_um, planes, radii, layout, reach_px: [x, y], coefficients, error };
        (table.coefficients.len() == length && planes >= 4 && from.is_done()).then_some(table)
    }
}

/// A plane with its interpolation weight.
pub(super) struct WeightedPlane<'a> {
    pub(super) weight: f64,
    /// Derivative of the weight with respect to depth, 1/um.
    pub(super) by_z: f64,
    pub(super) coefficients: &'a [f32],
}
