//! Tables of images of spheres over a range of depths and sizes: planes at equal steps in depth, with
//! interpolation.
//!
//! A plane contains the coefficients of a quintic spline through the light on pixels. Coefficients are
//! interpolated between planes by a cubic spline, so images and their derivatives are continuous in depth and
//! in the plane.

use super::layout::Layout;
use crate::bspline::{self, QUINTIC_TAPS as TAPS};
use crate::render::spline;
use crate::render::store::{Reader, Writer};

/// Images over a range of depths and sizes.
#[derive(Debug, PartialEq)]
pub(super) struct Table {
    /// Depth of plane 1, um; plane 0 is before the table's range.
    pub(super) start_um: f64,
    pub(super) step_um: f64,
    /// Number of planes for each radius.
    pub(super) planes: usize,
    /// Radii of spheres at the nodes of interpolation, um.
    pub(super) radii: Vec<f64>,
    pub(super) layout: Layout,
    /// Half width and half height of the computed area, px.
    pub(super) edge_px: [usize; 2],
    /// Half width and half height beyond which images are not rendered, px, by plane.
    pub(super) reach_px: Vec<[f64; 2]>,
    /// Coefficients by radius and plane.
    pub(super) coefficients: Vec<f32>,
    /// The error found, as a fraction of the peak.
    pub(super) error: f64,
}

/// A plane near a sphere.
pub(super) struct Neighbor<'a> {
    pub(super) weight: f64,
    /// Derivative of the weight with respect to depth, 1/um.
    pub(super) by_z: f64,
    pub(super) coefficients: &'a [f32],
}

impl crate::render::tables::Table for Table {
    fn bytes(&self) -> usize {
        size_of_val(self.coefficients.as_slice())
    }

    fn error(&self) -> f64 {
        self.error
    }
}

impl Table {
    /// The first of the four planes around a depth, and the distance of the depth from it, in steps.
    fn first(&self, z_um: f64) -> (usize, f64) {
        let steps = (z_um - self.start_um) / self.step_um;
        let first = (steps.max(0.0) as usize).min(self.planes - 4);
        (first, steps - first as f64)
    }

    /// The planes around a depth, four for each radius of the table, with weights for interpolation in depth
    /// and radius.
    pub(super) fn around(&self, z_um: f64, radius_um: f64) -> impl Iterator<Item = [Neighbor<'_>; 4]> {
        let length = self.layout.length();
        let (first, place) = self.first(z_um);
        let (weights, slopes) = bspline::cubic(place);
        let sizes = spline::lagrange(&self.radii, radius_um);
        sizes.into_iter().enumerate().map(move |(size, (of_size, _))| {
            std::array::from_fn(|i| Neighbor {
                weight: of_size * weights[i],
                by_z: of_size * slopes[i] / self.step_um,
                coefficients: &self.coefficients[(size * self.planes + first + i) * length..][..length],
            })
        })
    }

    /// Half width and half height of an image at depth `z_um`, px.
    pub(super) fn reach(&self, z_um: f64) -> [f64; 2] {
        let (first, _) = self.first(z_um);
        // The maximum of the two nearest planes; the outer two have little weight.
        let [a, b] = [self.reach_px[first + 1], self.reach_px[first + 2]];
        [a[0].max(b[0]), a[1].max(b[1])]
    }

    /// The table as bytes, for a store.
    pub(super) fn to_bytes(&self) -> Vec<u8> {
        let Layout { per_px, columns, rows, mirrored, origin, .. } = self.layout;
        let mut out = Writer::default();
        [self.start_um, self.step_um, self.error].into_iter().for_each(|value| out.number(value));
        [self.planes, per_px, columns, rows, usize::from(mirrored)]
            .into_iter()
            .for_each(|value| out.whole(value));
        origin.into_iter().chain(self.edge_px).for_each(|value| out.whole(value));
        out.numbers(&self.radii);
        out.numbers(self.reach_px.as_flattened());
        out.singles(&self.coefficients);
        out.0
    }

    /// Reads a table from bytes; `None` if they are invalid.
    pub(super) fn from_bytes(bytes: &[u8]) -> Option<Table> {
        let mut from = Reader(bytes);
        let [start_um, step_um, error] = [from.number()?, from.number()?, from.number()?];
        let [planes, per_px, columns, rows, mirrored] =
            [from.whole()?, from.whole()?, from.whole()?, from.whole()?, from.whole()?];
        let [origin, edge_px] = [[from.whole()?, from.whole()?], [from.whole()?, from.whole()?]];
        let (radii, reach) = (from.numbers()?, from.numbers()?);
        let layout = Layout::stored_as(per_px, [columns, rows], mirrored == 1, origin)?;
        let table = Table {
            start_um,
            step_um,
            planes,
            layout,
            edge_px,
            reach_px: reach.as_chunks::<2>().0.to_vec(),
            coefficients: from.singles()?,
            radii,
            error,
        };
        let length = table.radii.len().checked_mul(planes)?.checked_mul(table.layout.length())?;
        let fits = table.coefficients.len() == length && table.reach_px.len() == planes && planes >= 4;
        (fits && from.is_done()).then_some(table)
    }
}

/// One sphere's image and its derivatives in f64, for fits and Cramer-Rao bounds.
pub(super) struct Interpolated<'a> {
    layout: &'a Layout,
    value: Vec<f64>,
    by_z: Vec<f64>,
}

impl<'a> Interpolated<'a> {
    pub(super) fn new(table: &'a Table, z_um: f64, radius_um: f64) -> Self {
        let layout = &table.layout;
        let (mut value, mut by_z) = (vec![0.0; layout.length()], vec![0.0; layout.length()]);
        for plane in table.around(z_um, radius_um).flatten() {
            for ((v, d), &c) in value.iter_mut().zip(&mut by_z).zip(plane.coefficients) {
                *v += plane.weight * f64::from(c);
                *d += plane.by_z * f64::from(c);
            }
        }
        Interpolated { layout, value, by_z }
    }

    /// The light on a pixel at `dx`, `dy` from the particle (px), and its derivatives with respect to the
    /// pixel's position x and y (1/px) and the particle's depth z (1/um).
    pub(super) fn at(&self, dx: f64, dy: f64) -> [f64; 4] {
        let scale = self.layout.per_px as f64;
        let axis = |at: f64| {
            let cell = libm::floor(at * scale);
            let (weights, slopes) = bspline::quintic(at * scale - cell);
            (cell as isize - 2, weights, slopes)
        };
        let ((first_x, weights_x, slopes_x), (first_y, weights_y, slopes_y)) = (axis(dx), axis(dy));
        let mut sum = [0.0; 4];
        for j in 0..TAPS {
            let Some(row) = self.layout.row_of(first_y + j as isize) else { continue };
            let (mut value, mut slope, mut by_z) = (0.0, 0.0, 0.0);
            for i in 0..TAPS {
                let Some(column) = self.layout.column_of(first_x + i as isize) else { continue };
                let at = row * self.layout.row() + self.layout.place(column);
                value += weights_x[i] * self.value[at];
                slope += slopes_x[i] * self.value[at];
                by_z += weights_x[i] * self.by_z[at];
            }
            sum[0] += weights_y[j] * value;
            sum[1] += weights_y[j] * slope * scale;
            sum[2] += slopes_y[j] * value * scale;
            sum[3] += weights_y[j] * by_z;
        }
        sum
    }
}
