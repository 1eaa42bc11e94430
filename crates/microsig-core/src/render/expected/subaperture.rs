//! Subaperture images: the image of a particle through one small part of the aperture, integrated over square
//! pixels.
//!
//! A part of the aperture that is small enough to act as a pinhole images the emitting surface of the
//! particle by an affine map, a parallel projection. This image, averaged over a square pixel, is the
//! subaperture image; the whole image is the sum of subaperture images at the landing positions of their
//! pinholes (`aperture_integral`). A subaperture image is tabulated on a fine grid, as one small image for
//! each sub-node phase of the landing position.

use super::pupil::{PupilView, density};
use super::surface::EmittingSurface;
use crate::pool::{BufferPool, Pooled};
use crate::render::image_sum::LANES;

/// Steps of a low-discrepancy sequence in the unit square, by which points are spread over a cell: inverse
/// powers of the real root of x^5 = x + 1. Those of x^3 = x + 1 make patterns with the spiral of the points.
const STRIDES: [f32; 2] = [0.856_674_9, 0.733_891_85];

/// Buffers that are used again from image to image.
pub(super) type Buffers = BufferPool<Vec<f32>>;

/// The points of a surface as seen through one point of the lens: landing positions relative to the one of the
/// centroid along columns, along rows (px), and the light of each point as a fraction of what the surface
/// would have if all of it were at its centroid.
pub(super) struct SeenPoints<'b>(Pooled<'b, Vec<f32>>);

impl<'b> SeenPoints<'b> {
    /// The points of a surface in `view`, at `distance` (um) from the lens.
    #[inline(always)]
    pub(super) fn new(
        surface: &EmittingSurface,
        view: &PupilView,
        distance: f64,
        buffers: &'b Buffers,
    ) -> SeenPoints<'b> {
        let share = |[e1, e2, e3]: [f64; 3]| {
            let [q_x, q_y] = view.q;
            density(distance + e1, (q_x - e2) * (q_x - e2) + (q_y - e3) * (q_y - e3))
        };
        let n = surface.points.len();
        let (middle, per_point) = (view.place(surface.centroid), 1.0 / (n as f64 * share(surface.centroid)));
        let mut values = buffers.get();
        values.resize(3 * n, 0.0);
        let (x, rest) = values.split_at_mut(n);
        let (y, light) = rest.split_at_mut(n);
        for (((x, y), light), &e) in x.iter_mut().zip(y).zip(light).zip(&surface.points) {
            let place = view.place(e);
            (*x, *y) = ((place[0] - middle[0]) as f32, (place[1] - middle[1]) as f32);
            *light = (share(e) * per_point) as f32;
        }
        SeenPoints(values)
    }

    /// Positions along columns and along rows, and light.
    fn parts(&self) -> [&[f32]; 3] {
        let n = self.0.len() / 3;
        [&self.0[..n], &self.0[n..2 * n], &self.0[2 * n..]]
    }

    /// Fine steps from the center of the subaperture image of these points to its sides, if a cell spreads
    /// them over the parallelogram `footprint` (px).
    pub(super) fn half(&self, footprint: [[f64; 2]; 2], fine: usize) -> [i64; 2] {
        [0, 1].map(|axis| {
            let [along, across] = footprint;
            let extent = self.parts()[axis].iter().fold(0.0f32, |extent, place| extent.max(place.abs()));
            let extent = f64::from(extent) + 0.5 * (along[axis].abs() + across[axis].abs());
            libm::ceil(extent * fine as f64) as i64 + 1 + fine as i64 / 2
        })
    }
}

/// Layout in memory of the subaperture images of an image: small images, one for each phase of the centroid
/// relative to the nodes.
#[derive(Debug, Clone, Copy)]
pub(super) struct SubapertureLayout {
    /// Fine steps per px.
    pub(super) fine: usize,
    /// Number of phases along each axis.
    pub(super) phases: usize,
    /// Number of nodes along columns, a multiple of [`LANES`]; `rows` is that along rows.
    pub(super) columns: usize,
    pub(super) rows: usize,
    /// Fine steps from the first position to the center.
    pub(super) half: [i64; 2],
}

impl SubapertureLayout {
    /// The layout of images that extend `half` fine steps to both sides, with `per_px` nodes and `fine` steps
    /// per px.
    pub(super) fn new(half: [i64; 2], per_px: usize, fine: usize) -> Self {
        let phases = fine / per_px;
        let [columns, rows] = half.map(|half| (2 * half as usize + 1).div_ceil(phases));
        SubapertureLayout { fine, phases, columns: columns.next_multiple_of(LANES), rows, half }
    }
}

/// A subaperture image: small images by phase of the columns, fine step along rows, column.
pub(super) struct SubapertureImage<'b> {
    layout: SubapertureLayout,
    images: Pooled<'b, Vec<f32>>,
}

impl<'b> SubapertureImage<'b> {
    /// The subaperture image of points that a cell spreads over the parallelogram `footprint` (px).
    #[inline(always)]
    pub(super) fn new(
        points: &SeenPoints<'_>,
        footprint: [[f64; 2]; 2],
        layout: SubapertureLayout,
        buffers: &'b Buffers,
    ) -> SubapertureImage<'b> {
        let SubapertureLayout { fine, phases, columns, rows, half } = layout;
        let [wide, high] = half.map(|h| 2 * h as usize + 1);
        // Half a pixel of dark rows before and after, for sums along the columns.
        let before = fine / 2;
        let mut light = buffers.get();
        light.resize(wide * (high + 2 * before), 0.0);
        let scale = fine as f32;
        let [along, across] = footprint.map(|side| side.map(|px| px as f32 * scale));
        let middle = [half[0] as f32, (half[1] as usize + before) as f32];
        let [x, y, weights] = points.parts();
        let mut within = [0.5; 2];
        for ((&x, &y), &weight) in x.iter().zip(y).zip(weights) {
            let [u, v] = [within[0] - 0.5, within[1] - 0.5];
            for (at, stride) in within.iter_mut().zip(STRIDES) {
                *at += stride;
                *at -= if *at >= 1.0 { 1.0 } else { 0.0 };
            }
            let x = x * scale + (u * along[0] + v * across[0]) + middle[0];
            let y = y * scale + (u * along[1] + v * across[1]) + middle[1];
            // Fine steps are few enough for 32 bits, conversions to which are fast.
            let (column, row) = (x as i32, y as i32);
            let (u, v) = (x - column as f32, y - row as f32);
            let at = row as usize * wide + column as usize;
            let (above, below) = (weight * (1.0 - v), weight * v);
            light[at] += above * (1.0 - u);
            light[at + 1] += above * u;
            light[at + wide] += below * (1.0 - u);
            light[at + wide + 1] += below * u;
        }
        let (mut sums, mut other) = (buffers.get(), buffers.get());
        pixel_sums(&mut light, 1, fine, (&mut sums, &mut other));

        let (mut images, mut phase_image) = (buffers.get(), buffers.get());
        for phase in 0..phases {
            phase_image.clear();
            for (row, line) in light.chunks_exact(wide).enumerate() {
                phase_image.extend(line.iter().skip(phase).step_by(phases));
                phase_image.resize((row + 1) * columns, 0.0);
            }
            pixel_sums(&mut phase_image, columns, fine, (&mut sums, &mut other));
            images.extend_from_slice(&phase_image[before * columns..][..high * columns]);
            // Rows beyond the last are dark.
            images.resize((phase + 1) * rows * phases * columns, 0.0);
        }
        SubapertureImage { layout, images }
    }

    /// The small image for a phase: row `k` begins at `k * phases * columns`.
    pub(super) fn image(&self, phase_x: usize, phase_y: usize) -> &[f32] {
        let SubapertureLayout { phases, columns, rows, .. } = self.layout;
        &self.images[(phase_x * rows * phases + phase_y) * columns..]
    }
}

/// Weight of the two outermost positions of a pixel of `fine` steps. A plain average would have 1/2; the
/// distribution of light between fine positions and the placement of subaperture images at whole steps (each
/// with a variance of 1/6 step^2) widen the pixel, which is made narrower to compensate.
fn end_weight(fine: usize) -> f32 {
    let f = fine as f64;
    let m = f / 2.0;
    let inside = (m - 1.0) * m * (2.0 * m - 1.0) / 3.0;
    let variance = f * f / 12.0 - 1.0 / 3.0;
    ((variance * (f - 1.0) - inside) / (f * f / 2.0 - 2.0 * variance)) as f32
}

/// Replaces values by sums over the steps of a pixel centered on each, along values `stride` apart. Half a
/// pixel of values is dark at both ends of every line of such values; `fine` is a power of two.
#[inline(always)]
fn pixel_sums(values: &mut [f32], stride: usize, fine: usize, (sums, other): (&mut Vec<f32>, &mut Vec<f32>)) {
    // Sums of 2, 4, ... values from each on; those that extend beyond the end are not used.
    let n = values.len();
    sums.clear();
    sums.extend_from_slice(values);
    other.resize(n, 0.0);
    let mut width = stride;
    while width < fine * stride {
        for ((sum, first), second) in other.iter_mut().zip(&*sums).zip(&sums[width..]) {
            *sum = first + second;
        }
        std::mem::swap(sums, other);
        width *= 2;
    }
    let end = end_weight(fine);
    let whole = fine as f32 / ((fine - 1) as f32 + 2.0 * end);
    let (inside, outside) = (0.5 * whole, (end - 0.5) * whole);
    // Values at which both sums end within the line; those after them are dark.
    let (shift, count) = (fine / 2 * stride, n + 1 - (fine + 1) * stride);
    let ends = values.iter().zip(&values[fine * stride..]);
    let sum_pairs = sums.iter().zip(&sums[stride..]);
    other[..shift].fill(0.0);
    other[shift + count..].fill(0.0);
    let out = other[shift..][..count].iter_mut();
    for ((out, (first, last)), (a, b)) in out.zip(ends).zip(sum_pairs) {
        *out = inside * (a + b) + outside * (first + last);
    }
    values.copy_from_slice(other);
}
