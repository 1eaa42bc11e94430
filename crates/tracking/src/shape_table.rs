//! Images of spheroids of one size and aspect ratio as a spline over depth, tilt and position.
//!
//! Through round optics, a turn of the axis about the optical axis turns the image. So images are computed at some depths
//! and tilts only; those of other poses are interpolated and turned, which takes a hundredth of the time.

use std::f64::consts::FRAC_PI_2;

use glam::DVec3;
use rayon::prelude::*;

use super::gray_image::{CUBIC, GrayImage, add, filter, prefiltered, weights};
use super::shape_fit::Pose;

/// Depths and tilts beyond the ends, where a spline is less accurate; and tilts that only its coefficients need.
const BEYOND: usize = 2;
const FILTERED: usize = 6;

/// Nodes per pixel along columns and rows.
pub(super) const PER_PX: u32 = 2;

/// Half the difference of tangents over which images are differentiated with respect to turns across the tilt. Derivatives
/// of the azimuth are quotients of small numbers near the optical axis.
const ACROSS: f64 = 0.1;

/// Images of spheroids at brightness 1.
pub(super) struct ShapeTable {
    first_um: f64,
    step_um: f64,
    depths: usize,
    tilts: usize,
    /// Half width of the images, nodes.
    half: usize,
    /// Spline coefficients, by depth, tilt, row and column.
    coefficients: Vec<f32>,
}

impl ShapeTable {
    /// Memory of a table (see [`Self::new`]), bytes.
    pub(super) fn bytes([depths, tilts]: [usize; 2], radius_px: usize) -> usize {
        let side = 2 * PER_PX as usize * radius_px + 1;
        (depths + 2 * BEYOND) * (tilts + 2 * BEYOND) * side * side * size_of::<f32>()
    }

    /// Number of images from which a table is made.
    pub(super) fn images([depths, tilts]: [usize; 2]) -> u64 {
        ((depths + 2 * BEYOND) * tilts) as u64
    }

    /// These numbers of depths over a range (um), and of tilts from the optical axis to the image plane, at least 7; half widths of
    /// `radius_px`. `image(z_um, axis, n)`: light on 2 n by 2 n squares of
    /// side 1/[`PER_PX`] px around the particle, row by row.
    pub(super) fn new(
        [low, high]: [f64; 2],
        [depths, tilts]: [usize; 2],
        radius_px: usize,
        image: impl Fn(f64, DVec3, usize) -> Vec<f64> + Sync,
    ) -> Self {
        let step_um = (high - low) / (depths - 1) as f64;
        let (first_um, depths) = (low - BEYOND as f64 * step_um, depths + 2 * BEYOND);
        let half = PER_PX as usize * radius_px;
        let area = (2 * half + 1).pow(2);
        let node = |k: usize| {
            let angle = (k % tilts) as f64 / (tilts - 1) as f64 * FRAC_PI_2;
            let axis = DVec3::new(angle.sin(), 0.0, angle.cos());
            coefficients(&image(first_um + (k / tilts) as f64 * step_um, axis, half + 1), half)
        };
        let nodes: Vec<Vec<f32>> = (0..depths * tilts).into_par_iter().map(node).collect();
        let at_depth = |nodes: &[Vec<f32>]| -> Vec<f32> {
            // Beyond both ends are the same images, turned by half a turn.
            let mut all = Vec::with_capacity((tilts + 2 * FILTERED) * area);
            nodes[1..=FILTERED].iter().rev().for_each(|image| all.extend(image.iter().rev()));
            nodes.iter().for_each(|image| all.extend(image));
            nodes[tilts - 1 - FILTERED..tilts - 1]
                .iter()
                .rev()
                .for_each(|image| all.extend(image.iter().rev()));
            filter(&mut all, area, &CUBIC);
            all.drain(..(FILTERED - BEYOND) * area);
            all.truncate((tilts + 2 * BEYOND) * area);
            all
        };
        let mut coefficients: Vec<f32> = nodes.par_chunks(tilts).flat_map_iter(at_depth).collect();
        filter(&mut coefficients, (tilts + 2 * BEYOND) * area, &CUBIC);
        ShapeTable { first_um, step_um, depths, tilts, half, coefficients }
    }

    /// The image on the square of this half width around a pixel, row by row.
    pub(super) fn light(&self, pose: &Pose, middle: [isize; 2], radius: usize) -> Vec<f64> {
        let view = View::new(self, pose, radius);
        let blend = view.blended([[false; 2]]);
        view.places(pose, middle, radius).map(|at| blend.at(at).0[0]).collect()
    }

    /// The same with derivatives with respect to x, y (1/px), z (1/um) and turns of the axis toward two directions (1/rad).
    pub(super) fn gradient(
        &self,
        pose: &Pose,
        middle: [isize; 2],
        radius: usize,
    ) -> (Vec<[f64; 7]>, [DVec3; 2]) {
        let view = View::new(self, pose, radius);
        let blend = view.blended([[false; 2], [true, false], [false, true]]);
        let (sine, cosine) = view.turn;
        let across = view.sign * DVec3::new(-sine, cosine, 0.0);
        let turned = |by: f64| Pose { axis: (pose.axis + by * across).normalize(), ..*pose };
        let [low, high] = [-ACROSS, ACROSS].map(|by| self.light(&turned(by), middle, radius));
        let pixel = |((at, low), high): (([f64; 2], f64), f64)| {
            let ([light, by_depth, by_tilt], [right, down]) = blend.at(at);
            let (x, y) = (sine * down - cosine * right, -sine * right - cosine * down);
            let by_turn = (high - low) / (2.0 * ACROSS);
            [light, x, y, by_depth / self.step_um, by_tilt / self.tilt_step(), by_turn, 0.0]
        };
        let pixels = view.places(pose, middle, radius).zip(low).zip(high).map(pixel).collect();
        (pixels, [across.cross(view.axis), across])
    }

    fn tilt_step(&self) -> f64 {
        FRAC_PI_2 / (self.tilts - 1) as f64
    }
}

/// Where a pose lies in a table.
struct View<'a> {
    table: &'a ShapeTable,
    /// The axis away from the lens, and the sign of the pose's in this direction.
    axis: DVec3,
    sign: f64,
    /// Sine and cosine of its turn about the optical axis.
    turn: (f64, f64),
    /// First coefficients, and their weights and derivatives, in depth and in tilt.
    first: [usize; 2],
    weights: [[[f32; 4]; 2]; 2],
    /// Half width of the part that is seen, nodes.
    half: usize,
}

impl<'a> View<'a> {
    fn new(table: &'a ShapeTable, pose: &Pose, radius: usize) -> Self {
        let sign = if pose.axis.z < 0.0 { -1.0 } else { 1.0 };
        let axis = sign * pose.axis;
        let across = axis.truncate().length();
        let turn = if across > 0.0 { (axis.y / across, axis.x / across) } else { (0.0, 1.0) };
        let depth = (pose.z_um - table.first_um) / table.step_um;
        let tilt = across.atan2(axis.z) / table.tilt_step() + BEYOND as f64;
        let along = |at: f64, n: usize| {
            let at = at.clamp(1.0, (n - 2) as f64);
            let first = (at.floor() as usize).min(n - 3);
            let (values, slopes) = weights((at - first as f64) as f32);
            (first - 1, [values, slopes])
        };
        let [depth, tilt] = [along(depth, table.depths), along(tilt, table.tilts + 2 * BEYOND)];
        let half = table.half.min(PER_PX as usize * (radius + 2) + 2);
        View { table, axis, sign, turn, first: [depth.0, tilt.0], weights: [depth.1, tilt.1], half }
    }

    /// The middles of images: for each, whether it is a derivative by depth or by tilt (per step).
    fn blended<const N: usize>(&self, kinds: [[bool; 2]; N]) -> Blend<N> {
        let table = self.table;
        let (from, side) = (2 * table.half + 1, 2 * self.half + 1);
        let off = table.half - self.half;
        let images = kinds.map(|kind| {
            let [by_depth, by_tilt] = [0, 1].map(|axis| self.weights[axis][usize::from(kind[axis])]);
            let mut image = vec![0.0; side * side];
            for (j, k) in (0..4).flat_map(|j| (0..4).map(move |k| (j, k))) {
                let plane = (self.first[0] + j) * (table.tilts + 2 * BEYOND) + self.first[1] + k;
                let rows = table.coefficients[plane * from * from..][..from * from].chunks_exact(from);
                for (sums, row) in image.chunks_exact_mut(side).zip(rows.skip(off)) {
                    add(sums, by_depth[j] * by_tilt[k], &row[off..]);
                }
            }
            image
        });
        Blend { images, half: self.half }
    }

    /// Pixels of a square relative to the particle, turned like the images of the table, px.
    fn places(
        &self,
        pose: &Pose,
        middle: [isize; 2],
        radius: usize,
    ) -> impl Iterator<Item = [f64; 2]> + use<> {
        let ((sine, cosine), r) = (self.turn, radius as isize);
        let [x, y] = [0, 1].map(|axis| middle[axis] as f64 - pose.at[axis]);
        (-r..=r).flat_map(move |row| {
            (-r..=r).map(move |column| {
                let (x, y) = (x + column as f64, y + row as f64);
                [cosine * x + sine * y, cosine * y - sine * x]
            })
        })
    }
}

/// Spline coefficients of the images of one pose.
struct Blend<const N: usize> {
    images: [Vec<f32>; N],
    half: usize,
}

impl<const N: usize> Blend<N> {
    /// The values at a place (px), and the derivatives of the first along columns and rows, 1/px.
    #[inline]
    fn at(&self, at: [f64; 2]) -> ([f64; N], [f64; 2]) {
        let side = 2 * self.half + 1;
        let place = at.map(|at| at * f64::from(PER_PX) + self.half as f64);
        let inside = 1.0..(side - 2) as f64;
        if !place.iter().all(|at| inside.contains(at)) {
            return ([0.0; N], [0.0; 2]);
        }
        let [x, y] = place.map(|at| at as usize);
        let [(wx, sx), (wy, sy)] =
            [weights((place[0] - x as f64) as f32), weights((place[1] - y as f64) as f32)];
        let (mut values, mut slopes) = ([0.0f32; N], [0.0f32; 2]);
        for j in 0..4 {
            let first = (y + j - 1) * side + x - 1;
            for (k, (value, image)) in values.iter_mut().zip(&self.images).enumerate() {
                let taps = &image[first..first + 4];
                let dot =
                    |by: [f32; 4]| by[0] * taps[0] + by[1] * taps[1] + (by[2] * taps[2] + by[3] * taps[3]);
                let row = dot(wx);
                *value += wy[j] * row;
                if k == 0 {
                    slopes[0] += wy[j] * dot(sx);
                    slopes[1] += sy[j] * row;
                }
            }
        }
        (values.map(f64::from), slopes.map(|slope| f64::from(slope) * f64::from(PER_PX)))
    }
}

/// The spline coefficients of an image at nodes, of light on squares of one node: each pixel is [`PER_PX`] by [`PER_PX`] of them.
fn coefficients(squares: &[f64], half: usize) -> Vec<f32> {
    let (from, side) = (2 * half + 2, 2 * half + 1);
    let at = |x: usize, y: usize| {
        let first = y * from + x;
        squares[first] + squares[first + 1] + squares[first + from] + squares[first + from + 1]
    };
    // The axis is parallel to the columns, and the image its own mirror image.
    let pixel = |x: usize, y: usize| (0.5 * (at(x, y) + at(x, side - 1 - y))) as f32;
    prefiltered(&GrayImage::from_fn((side, side), pixel), &CUBIC).counts
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The light of a blurred rod without sharp edges: a Gaussian, longer along the projected axis, shifted to the end that is
    /// nearer to focus.
    fn light(z_um: f64, axis: DVec3, [x, y]: [f64; 2]) -> f64 {
        let along = 6.0 * axis.truncate().dot(glam::DVec2::new(x, y) / 6.0);
        let shift = 0.05 * z_um * axis.z;
        let width = 4.0 + 0.01 * z_um * z_um;
        let (x, y) = (x - shift * axis.x, y - shift * axis.y);
        (-(x * x + y * y - 0.4 * along * along) / (2.0 * width)).exp()
    }

    #[test]
    fn images_of_any_pose_with_their_derivatives() {
        let image = |z_um: f64, axis: DVec3, n: usize| -> Vec<f64> {
            let at = |k: usize| (k as f64 + 0.5 - n as f64) / f64::from(PER_PX);
            (0..4 * n * n).map(|k| 0.25 * light(z_um, axis, [at(k % (2 * n)), at(k / (2 * n))])).collect()
        };
        let table = ShapeTable::new([-10.0, 10.0], [12, 8], 14, image);
        let radius = 10;
        for (k, z_um) in [-9.7, -3.1, 0.4, 6.2, 10.0].into_iter().enumerate() {
            for (j, tilt) in [0.0f64, 0.05, 0.7, 1.3, 1.57, 2.0, 3.1].into_iter().enumerate() {
                let (sine, cosine) = (k as f64 + 2.3 * j as f64).sin_cos();
                let axis = DVec3::new(tilt.sin() * cosine, tilt.sin() * sine, tilt.cos());
                let pose = Pose { at: [100.3, 49.8], z_um, axis, e_p: 2.0, brightness: 1.0 };
                // A pixel is the sum of four squares.
                let exact = |pose: &Pose| -> Vec<f64> {
                    let squares = |x: f64, y: f64| {
                        let corners = [[-0.25, -0.25], [-0.25, 0.25], [0.25, -0.25], [0.25, 0.25]];
                        corners
                            .iter()
                            .map(|by| 0.25 * light(pose.z_um, pose.axis, [x + by[0], y + by[1]]))
                            .sum::<f64>()
                    };
                    let pixel =
                        |i: usize, n: usize| [(i % n) as f64, (i / n) as f64].map(|at| at - radius as f64);
                    (0..441)
                        .map(|i| pixel(i, 21))
                        .map(|[x, y]| squares(x + 100.0 - pose.at[0], y + 50.0 - pose.at[1]))
                        .collect()
                };
                let (pixels, turns) = table.gradient(&pose, [100, 50], radius);
                assert_eq!(
                    table.light(&pose, [100, 50], radius),
                    pixels.iter().map(|pixel| pixel[0]).collect::<Vec<_>>()
                );
                assert!(
                    turns
                        .iter()
                        .all(|turn| turn.dot(axis).abs() < 1e-9 && (turn.length() - 1.0).abs() < 1e-9)
                );
                let difference = |p: usize, by: f64| {
                    let moved = |by: f64| {
                        let mut moved = pose;
                        match p {
                            1 | 2 => moved.at[p - 1] += by,
                            3 => moved.z_um += by,
                            _ => moved.axis = (axis + by * turns[p - 4]).normalize(),
                        }
                        exact(&moved)
                    };
                    moved(by)
                        .iter()
                        .zip(moved(-by))
                        .map(|(high, low)| (high - low) / (2.0 * by))
                        .collect::<Vec<f64>>()
                };
                for p in 0..6 {
                    let expected = if p == 0 { exact(&pose) } else { difference(p, 1e-3) };
                    let scale = [1.0, 0.3, 0.3, 0.1, 1.0, 1.0][p];
                    let off = pixels
                        .iter()
                        .zip(&expected)
                        .map(|(pixel, expected)| (pixel[p] - expected).abs())
                        .fold(0.0, f64::max);
                    assert!(off < 0.02 * scale, "z {z_um}, tilt {tilt}, parameter {p}: {off}");
                }
            }
        }
    }
}
