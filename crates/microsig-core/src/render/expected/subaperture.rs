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
use crate::render::image_sum::LANES;

/// Small images of a surface, one for each phase of its centroid relative to the nodes.
#[derive(Debug, Clone)]
pub(super) struct SubapertureImage {
    /// Number of phases along each axis.
    pub(super) phases: usize,
    /// Number of nodes along columns, a multiple of [`LANES`]; `rows` is that along rows.
    pub(super) columns: usize,
    pub(super) rows: usize,
    /// Fine steps from the first position to the center.
    pub(super) half: [i64; 2],
    /// By phase of the rows, phase of the columns, row, column.
    images: Vec<f32>,
}

/// Steps of a low-discrepancy sequence in the unit square: inverse powers of the real root of x^3 = x + 1.
const STRIDES: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];

impl SubapertureImage {
    /// Fine steps from the center of the subaperture image of a surface to its sides.
    pub(super) fn half(
        surface: &EmittingSurface,
        view: &PupilView,
        footprint: [[f64; 2]; 2],
        fine: usize,
    ) -> [i64; 2] {
        let middle = view.place(surface.centroid);
        let extent = surface.points.iter().fold([0.0f64; 2], |extent, &e| {
            let place = view.place(e);
            [0, 1].map(|axis| extent[axis].max((place[axis] - middle[axis]).abs()))
        });
        [0, 1].map(|axis| {
            let [along, across] = footprint;
            let extent = extent[axis] + 0.5 * (along[axis].abs() + across[axis].abs());
            libm::ceil(extent * fine as f64) as i64 + 1 + fine as i64 / 2
        })
    }

    /// The subaperture image of a surface in `view`, at `distance` (um) from the lens, through the point `q`
    /// of the lens (um), with `per_px` nodes and `fine` steps per px.
    pub(super) fn new(
        surface: &EmittingSurface,
        view: &PupilView,
        distance: f64,
        q: [f64; 2],
        (per_px, fine): (usize, usize),
        footprint: [[f64; 2]; 2],
        half: [i64; 2],
    ) -> SubapertureImage {
        let scale = fine as f64;
        let seen = |e: [f64; 3]| view.place(e).map(|place| place * scale);
        let middle = seen(surface.centroid);
        let places: Vec<[f64; 2]> = surface
            .points
            .iter()
            .enumerate()
            .map(|(k, &e)| {
                let place = seen(e);
                let [u, v] = STRIDES.map(|stride| (k as f64 * stride).fract() - 0.5);
                let [along, across] = footprint;
                [0, 1].map(|axis| place[axis] - middle[axis] + (u * along[axis] + v * across[axis]) * scale)
            })
            .collect();
        let [wide, high] = half.map(|h| 2 * h as usize + 1);

        let mut light = vec![0.0f32; wide * high];
        let share = |[e1, e2, e3]: [f64; 3]| {
            density(distance + e1, (q[0] - e2) * (q[0] - e2) + (q[1] - e3) * (q[1] - e3))
        };
        let per_point = 1.0 / (surface.points.len() as f64 * share(surface.centroid));
        for (&e, &[x, y]) in surface.points.iter().zip(&places) {
            let (x, y) = (x + half[0] as f64, y + half[1] as f64);
            let (column, row) = (x as usize, y as usize);
            let (u, v) = ((x - column as f64) as f32, (y - row as f64) as f32);
            let weight = (share(e) * per_point) as f32;
            let at = row * wide + column;
            light[at] += weight * (1.0 - u) * (1.0 - v);
            light[at + 1] += weight * u * (1.0 - v);
            light[at + wide] += weight * (1.0 - u) * v;
            light[at + wide + 1] += weight * u * v;
        }
        let light = pixels_along_rows(&light, wide, fine);
        let light = pixels_along_columns(&light, wide, fine);

        let phases = fine / per_px;
        let columns = wide.div_ceil(phases).next_multiple_of(LANES);
        let rows = high.div_ceil(phases);
        let mut images = vec![0.0f32; phases * phases * columns * rows];
        for (image, out) in images.chunks_mut(columns * rows).enumerate() {
            let (phase_y, phase_x) = (image / phases, image % phases);
            for (k, out) in out.chunks_mut(columns).enumerate() {
                let Some(line) = light.get((phase_y + k * phases) * wide..).filter(|l| !l.is_empty()) else {
                    break;
                };
                let line = &line[..wide];
                out.iter_mut()
                    .zip(line[phase_x.min(wide)..].iter().step_by(phases))
                    .for_each(|(o, &v)| *o = v);
            }
        }
        SubapertureImage { phases, columns, rows, half, images }
    }

    /// The small image for a phase, row by row.
    #[inline(always)]
    pub(super) fn image(&self, phase_x: usize, phase_y: usize) -> &[f32] {
        let size = self.columns * self.rows;
        &self.images[(phase_y * self.phases + phase_x) * size..][..size]
    }
}

/// Weight of the two outermost positions of a pixel of `fine` steps. A plain average would have 1/2; the
/// distribution of light between fine positions (variance 1/6 step^2) and the placement of subaperture images
/// at whole steps (1/12 step^2) widen the pixel, which is made narrower to compensate.
fn end_weight(fine: usize) -> f32 {
    let f = fine as f64;
    let m = f / 2.0;
    let inside = (m - 1.0) * m * (2.0 * m - 1.0) / 3.0;
    let variance = f * f / 12.0 - 0.25;
    ((variance * (f - 1.0) - inside) / (f * f / 2.0 - 2.0 * variance)) as f32
}

/// Sums over the pixel width centered on each position, along the lines.
fn pixels_along_rows(light: &[f32], wide: usize, fine: usize) -> Vec<f32> {
    let (m, end) = (fine / 2, end_weight(fine));
    let norm = fine as f32 / ((fine - 1) as f32 + 2.0 * end);
    let mut out = vec![0.0; light.len()];
    let mut sums = vec![0.0f64; wide + 1];
    for (line, out) in light.chunks(wide).zip(out.chunks_mut(wide)) {
        for (i, &v) in line.iter().enumerate() {
            sums[i + 1] = sums[i] + f64::from(v);
        }
        for (i, out) in out.iter_mut().enumerate() {
            let (low, high) = ((i + 1).saturating_sub(m), (i + m).min(wide));
            let left = if i >= m { line[i - m] } else { 0.0 };
            let right = line.get(i + m).copied().unwrap_or(0.0);
            *out = ((sums[high] - sums[low]) as f32 + end * (left + right)) * norm;
        }
    }
    out
}

/// Sums over the pixel height centered on each position, along the columns.
fn pixels_along_columns(light: &[f32], wide: usize, fine: usize) -> Vec<f32> {
    let (m, end) = (fine / 2, end_weight(fine));
    let norm = fine as f32 / ((fine - 1) as f32 + 2.0 * end);
    let high = light.len() / wide;
    let mut sums = vec![0.0f64; (high + 1) * wide];
    for row in 0..high {
        let (before, after) = sums.split_at_mut((row + 1) * wide);
        let before = &before[row * wide..];
        after[..wide]
            .iter_mut()
            .zip(before)
            .zip(&light[row * wide..])
            .for_each(|((s, b), &v)| *s = b + f64::from(v));
    }
    let dark = vec![0.0f32; wide];
    let line = |row: Option<usize>| match row {
        Some(row) if row < high => &light[row * wide..][..wide],
        _ => &dark[..],
    };
    let mut out = vec![0.0; light.len()];
    for (row, out) in out.chunks_mut(wide).enumerate() {
        let (first, last) = ((row + 1).saturating_sub(m), (row + m).min(high));
        let (first, last) = (&sums[first * wide..][..wide], &sums[last * wide..][..wide]);
        let (above, below) = (line(row.checked_sub(m)), line(Some(row + m)));
        for (i, out) in out.iter_mut().enumerate() {
            *out = ((last[i] - first[i]) as f32 + end * (above[i] + below[i])) * norm;
        }
    }
    out
}
