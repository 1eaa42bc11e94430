//! Sums of subaperture images at the nodes of a grid.
//!
//! Cells of the aperture are collected and sorted by the subaperture images that they add, so that these are
//! read from the nearest cache.

use super::subaperture::{Buffers, SubapertureLayout};
use crate::pool::Pooled;
use crate::render::image_sum::LANES;

/// A grid of nodes with equal spacing along columns and rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Grid {
    /// Nodes per px.
    pub(super) per_px: usize,
    /// Position of the first node relative to the particle, px.
    pub(super) first_px: [f64; 2],
    pub(super) columns: usize,
    pub(super) rows: usize,
}

impl Grid {
    /// The grid symmetric about the particle whose quadrant, axes included, has these numbers of columns and
    /// rows.
    pub(super) fn about(per_px: usize, columns: usize, rows: usize) -> Grid {
        let first = |n: usize| -((n - 1) as f64) / per_px as f64;
        Grid { per_px, first_px: [first(columns), first(rows)], columns: 2 * columns - 1, rows: 2 * rows - 1 }
    }

    /// Distance of the farthest node from the particle along columns and along rows, px.
    pub(super) fn sides_px(&self) -> [f64; 2] {
        let side = |axis: usize, n: usize| {
            let first = self.first_px[axis];
            first.abs().max((first + (n - 1) as f64 / self.per_px as f64).abs())
        };
        [side(0, self.columns), side(1, self.rows)]
    }
}

/// A cell of the aperture: which subaperture images it adds, where, and with which weights.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Cell {
    /// Zone and sector of the images at its corners, and their phases along rows and columns.
    pub(super) images: [u16; 4],
    /// Index of the first node.
    node: u32,
    /// Light times the weights of the four images in bilinear interpolation.
    weights: [f32; 4],
}

/// The cells in the order of their images, so that those are read from the nearest cache.
pub(super) fn sorted(cells: &[Cell]) -> Vec<Cell> {
    let most = cells
        .iter()
        .fold([0; 4], |most: [u16; 4], cell| std::array::from_fn(|i| most[i].max(cell.images[i] + 1)));
    let most = most.map(usize::from);
    let key = |cell: &Cell| {
        let [zone, sector, phase_y, phase_x] = cell.images.map(usize::from);
        ((zone * most[1] + sector) * most[2] + phase_y) * most[3] + phase_x
    };
    // A counting sort, which is stable.
    let mut ends = vec![0; most.iter().product::<usize>() + 1];
    cells.iter().for_each(|cell| ends[key(cell) + 1] += 1);
    for i in 1..ends.len() {
        ends[i] += ends[i - 1];
    }
    let mut sorted = vec![Cell::default(); cells.len()];
    for cell in cells {
        let next = &mut ends[key(cell)];
        sorted[*next] = *cell;
        *next += 1;
    }
    sorted
}

/// The sums at the nodes, with a margin for subaperture images at the edge.
pub(super) struct Accumulator<'b> {
    grid: Grid,
    layout: SubapertureLayout,
    /// Zones and sectors of the aperture.
    sections: [usize; 2],
    margin: usize,
    stride: usize,
    height: usize,
    values: Pooled<'b, Vec<f32>>,
}

impl<'b> Accumulator<'b> {
    /// Makes positions positive, for which truncation is rounding down.
    const LIFT: f64 = 1_073_741_824.0;

    /// Sums of zero, for subaperture images of this layout and these numbers of zones and sectors.
    pub(super) fn new(
        grid: Grid,
        layout: SubapertureLayout,
        sections: [usize; 2],
        buffers: &'b Buffers,
    ) -> Self {
        let margin = layout.columns.max(layout.rows) + 1;
        let (stride, height) = (grid.columns + 2 * margin, grid.rows + 2 * margin);
        let mut values = buffers.get();
        values.resize(stride * height, 0.0);
        Accumulator { grid, layout, sections, margin, stride, height, values }
    }

    /// Distances (px) from the particle along the two axes beyond which light contributes to no node.
    pub(super) fn reach_px(&self) -> [f64; 2] {
        self.grid.sides_px().map(|side| side + self.margin as f64 / self.grid.per_px as f64)
    }

    /// The cell at a point of the aperture, in units of zones and sectors, centered on `place` (px, relative
    /// to the particle), which is rounded to fine steps: down where its fraction of a step is less than 1 -
    /// `dither`. `None`: its image is not on the grid.
    #[inline(always)]
    pub(super) fn cell(&self, at: [f64; 2], place: [f64; 2], light: f64, dither: [f64; 2]) -> Option<Cell> {
        let SubapertureLayout { fine, phases, columns, rows, half, .. } = self.layout;
        let phases = phases as i64;
        // Fine steps from the first node of the margin to the first position of the subaperture image.
        let first = |axis: usize| {
            let steps = (place[axis] - self.grid.first_px[axis]) * fine as f64;
            (steps + dither[axis] + Self::LIFT) as i64 - Self::LIFT as i64 - half[axis]
                + self.margin as i64 * phases
        };
        let first = [first(0), first(1)];
        if first[0] < 0 || first[1] < 0 {
            return None;
        }
        let node = |axis: usize| (first[axis] + phases - 1) / phases;
        let phase = |axis: usize| (node(axis) * phases - first[axis]) as u16;
        let [column, row] = [node(0) as usize, node(1) as usize];
        if column + columns > self.stride || row + rows > self.height {
            return None;
        }
        let section = |axis: usize| (at[axis] as usize).min(self.sections[axis] - 1);
        let [zone, sector] = [section(0), section(1)];
        let (u, v) = (at[0] - zone as f64, at[1] - sector as f64);
        let weights = [(1.0 - u) * (1.0 - v), (1.0 - u) * v, u * (1.0 - v), u * v];
        Some(Cell {
            images: [zone as u16, sector as u16, phase(1), phase(0)],
            node: (row * self.stride + column) as u32,
            weights: weights.map(|weight| (weight * light) as f32),
        })
    }

    /// Adds four images with the weights of each cell.
    #[inline(always)]
    pub(super) fn add(&mut self, images: [&[f32]; 4], cells: &[Cell]) {
        const WIDE: usize = 4;
        let groups = self.layout.columns / LANES;
        for cell in cells {
            for wide in 0..groups / WIDE {
                self.add_columns::<WIDE>(images, cell, wide * WIDE * LANES);
            }
            for group in groups / WIDE * WIDE..groups {
                self.add_columns::<1>(images, cell, group * LANES);
            }
        }
    }

    /// Adds this number of groups of columns, from one column on: a loop of known length is unrolled.
    #[inline(always)]
    fn add_columns<const GROUPS: usize>(&mut self, images: [&[f32]; 4], cell: &Cell, column: usize) {
        let (step, weights) = (self.layout.phases * self.layout.columns, cell.weights);
        for row in 0..self.layout.rows {
            let out = &mut self.values[cell.node as usize + row * self.stride + column..];
            let [a, b, c, d] = images.map(|image| image[row * step + column..].as_chunks::<LANES>().0);
            let (out, _) = out.as_chunks_mut::<LANES>();
            let (Some(out), Some(a), Some(b), Some(c), Some(d)) = (
                out.first_chunk_mut::<GROUPS>(),
                a.first_chunk::<GROUPS>(),
                b.first_chunk::<GROUPS>(),
                c.first_chunk::<GROUPS>(),
                d.first_chunk::<GROUPS>(),
            ) else {
                return;
            };
            for group in 0..GROUPS {
                let mut sum = out[group];
                for i in 0..LANES {
                    sum[i] += (weights[0] * a[group][i] + weights[1] * b[group][i])
                        + (weights[2] * c[group][i] + weights[3] * d[group][i]);
                }
                out[group] = sum;
            }
        }
    }

    pub(super) fn nodes(self) -> Vec<f32> {
        let Grid { columns, rows, .. } = self.grid;
        let line = |row: usize| &self.values[(row + self.margin) * self.stride + self.margin..][..columns];
        (0..rows).flat_map(|row| line(row).iter().copied()).collect()
    }
}
