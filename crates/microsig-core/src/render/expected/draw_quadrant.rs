//! Drawing of images with two mirror symmetries from a spline over one quadrant.
//!
//! The planes are interpolated to lines: rows of nodes, joined with their mirror image. All pixel columns
//! have the same phase relative to the nodes, so that the spline along a line is a sum of four contiguous
//! runs of memory times constant weights; four rows of such values give a row of pixels in the same way.
//! Only + and * in a fixed order occur, never fused, so that every instruction set gives the same bits. Loops
//! run over whole groups and have the same length for a whole sphere: the superfluous work at the corners
//! costs less than mispredicted branches.

use super::depth_table::PlaneLayout;
use crate::bspline;
use crate::render::image_sum::{Group, ImageBand, LANES, SphereImage};
use crate::render::node_layout::{self, NodeLayout};
use crate::render::patch::Window;

type Axis = node_layout::Axis<4>;

/// Number of zero groups before and after a line: the last group of pixels may extend beyond the nodes.
const BEFORE: usize = 1;
const BEHIND: usize = 2;

/// Groups of columns per panel.
const PANEL: usize = 8;

/// Working memory.
#[derive(Debug, Default)]
pub(super) struct QuadrantInterpolator {
    /// Rows of nodes, phase by phase.
    nodes: Vec<f32>,
    /// Lines: for each phase the mirror image and the row itself.
    lines: Vec<f32>,
    /// Values at the columns of a panel, by row of nodes; the last row is followed by a zero row.
    values: Vec<f32>,
}

impl QuadrantInterpolator {
    #[inline(always)]
    pub(super) fn add(
        &mut self,
        sphere: &SphereImage<PlaneLayout>,
        layout: &NodeLayout,
        band: &mut ImageBand,
    ) {
        let Window { x0, width, .. } = sphere.window;
        let pixel_rows = band.rows(&sphere.window);
        let down = Axis::new(pixel_rows.start, sphere.y_px, layout.per_px, bspline::cubic);
        let across = Across::new(&Axis::new(x0, sphere.x_px, layout.per_px, bspline::cubic), layout);
        let count = (pixel_rows.end - pixel_rows.start) as usize;
        let rows = down.nodes(count, layout, 1);
        self.blend(sphere, layout, &rows, across.line);

        let first = band.first(&sphere.window, pixel_rows.start);
        for panel in (0..width.div_ceil(LANES)).step_by(PANEL) {
            let pixels = &mut band.pixels[first + panel * LANES..];
            let left = (width - panel * LANES).min(PANEL * LANES);
            let panel = Panel {
                across: &across,
                down: &down,
                rows: &rows,
                per_px: layout.per_px,
                start: panel * LANES,
                mask: std::array::from_fn(|i| if (left - 1) / LANES * LANES + i < left { 1.0 } else { 0.0 }),
                stride: band.stride,
                count,
            };
            match left.div_ceil(LANES) {
                1 => panel.draw::<1>(&self.lines, &mut self.values, pixels),
                2 => panel.draw::<2>(&self.lines, &mut self.values, pixels),
                3 => panel.draw::<3>(&self.lines, &mut self.values, pixels),
                4 => panel.draw::<4>(&self.lines, &mut self.values, pixels),
                5 => panel.draw::<5>(&self.lines, &mut self.values, pixels),
                6 => panel.draw::<6>(&self.lines, &mut self.values, pixels),
                7 => panel.draw::<7>(&self.lines, &mut self.values, pixels),
                _ => panel.draw::<PANEL>(&self.lines, &mut self.values, pixels),
            }
        }
    }

    /// Computes the lines of these rows of nodes from the planes around a sphere.
    #[inline(always)]
    fn blend(
        &mut self,
        sphere: &SphereImage<PlaneLayout>,
        layout: &NodeLayout,
        rows: &std::ops::Range<usize>,
        line: usize,
    ) {
        let row_chunks = rows.start * layout.row()..rows.end * layout.row();
        self.nodes.resize(row_chunks.len(), 0.0);
        for (size, four) in
            sphere.table.planes_around(sphere.z_um, sphere.radius_um, sphere.at_px()).enumerate()
        {
            let weights: [f32; 4] = std::array::from_fn(|i| (four[i].weight * sphere.light) as f32);
            let a = &four[0].coefficients[row_chunks.clone()];
            let b = &four[1].coefficients[row_chunks.clone()];
            let c = &four[2].coefficients[row_chunks.clone()];
            let d = &four[3].coefficients[row_chunks.clone()];
            let planes = a.iter().zip(b).zip(c.iter().zip(d));
            let sums = planes.map(|((a, b), (c, d))| {
                (weights[0] * a + weights[1] * b) + (weights[2] * c + weights[3] * d)
            });
            if size == 0 {
                self.nodes.iter_mut().zip(sums).for_each(|(node, sum)| *node = sum);
            } else {
                self.nodes.iter_mut().zip(sums).for_each(|(node, sum)| *node += sum);
            }
        }
        self.lines.resize(rows.len() * layout.per_px * line, 0.0);
        let nodes = self.nodes.as_chunks().0;
        match layout.run / LANES {
            1 => join_all::<1>(nodes, &mut self.lines, layout.per_px),
            2 => join_all::<2>(nodes, &mut self.lines, layout.per_px),
            3 => join_all::<3>(nodes, &mut self.lines, layout.per_px),
            4 => join_all::<4>(nodes, &mut self.lines, layout.per_px),
            5 => join_all::<5>(nodes, &mut self.lines, layout.per_px),
            run => {
                let row_chunks = nodes.chunks_exact(layout.per_px * run);
                for (nodes, lines) in row_chunks.zip(self.lines.chunks_exact_mut(layout.per_px * line)) {
                    let phases = nodes.chunks_exact(run).enumerate();
                    phases.for_each(|(phase, nodes)| join(nodes, lines, line, phase));
                }
            }
        }
    }
}

/// [`join`] for all phases and rows whose runs have this number of groups: short loops of known length are
/// unrolled.
#[inline(always)]
fn join_all<const RUN: usize>(nodes: &[Group], lines: &mut [f32], per_px: usize) {
    let line = (BEFORE + BEHIND + 2 * RUN) * LANES;
    let row_chunks = nodes.as_chunks::<RUN>().0.chunks_exact(per_px);
    for (nodes, lines) in row_chunks.zip(lines.chunks_exact_mut(per_px * line)) {
        for (phase, nodes) in nodes.iter().enumerate() {
            join(nodes, lines, line, phase);
        }
    }
}

/// Writes one phase of a row of nodes, its mirror image, and the zeros around them into a line.
#[inline(always)]
fn join(nodes: &[Group], lines: &mut [f32], line: usize, phase: usize) {
    let run = nodes.len();
    // By symmetry, node -n of phase p is node n of phase per_px - p; phase 0 is its own mirror image and
    // contains the axis once.
    let mirrored = if phase == 0 { 1 } else { lines.len() - phase * line } + BEFORE * LANES;
    let left = lines[mirrored..][..run * LANES].as_chunks_mut::<LANES>().0;
    for (out, nodes) in left.iter_mut().rev().zip(nodes) {
        let mut group = *nodes;
        group.reverse();
        *out = group;
    }
    let right = lines[phase * line..][..line].as_chunks_mut::<LANES>().0;
    right[BEFORE - 1] = Group::default();
    for (out, nodes) in right[BEFORE + run..].iter_mut().zip(nodes) {
        *out = *nodes;
    }
    // Unrolled: a loop over two groups would be compiled to a call.
    right[BEFORE + 2 * run] = Group::default();
    right[BEFORE + 2 * run + BEHIND - 1] = Group::default();
}

#[inline(always)]
fn groups(numbers: &[f32]) -> &[Group] {
    numbers.as_chunks().0
}

#[inline(always)]
fn weigh(weights: &[f32; 4], a: &Group, b: &Group, c: &Group, d: &Group) -> Group {
    let mut sum = Group::default();
    for i in 0..LANES {
        sum[i] = (weights[0] * a[i] + weights[1] * b[i]) + (weights[2] * c[i] + weights[3] * d[i]);
    }
    sum
}

/// Interpolation of lines at the columns of a window.
struct Across {
    /// Number of values per phase in a line.
    line: usize,
    /// Positions in a line of the four nodes around the first column; for column k they are k positions
    /// further.
    starts: [usize; 4],
    weights: [f32; 4],
}

impl Across {
    fn new(axis: &Axis, layout: &NodeLayout) -> Across {
        let line = (BEFORE + BEHIND) * LANES + 2 * layout.run;
        let (middle, per_px) = ((BEFORE * LANES + layout.run) as isize, layout.per_px as isize);
        let starts = [0, 1, 2, 3].map(|k| {
            let node = axis.first + k;
            node.rem_euclid(per_px) as usize * line + (middle + node.div_euclid(per_px)) as usize
        });
        Across { line, starts, weights: axis.weights }
    }
}

/// A panel of columns of a window.
struct Panel<'a> {
    across: &'a Across,
    down: &'a Axis,
    /// The rows of nodes for which there are lines.
    rows: &'a std::ops::Range<usize>,
    per_px: usize,
    /// The first column.
    start: usize,
    /// 1 for the columns of the last group that are in the window, 0 for the others.
    mask: Group,
    /// Distance in memory between rows of pixels; `count` is the number of rows.
    stride: usize,
    count: usize,
}

impl Panel<'_> {
    /// Adds the values of the spline to `GROUPS` groups of columns. The lengths of both inner loops are
    /// compile-time constants, and the loops are written in a form that the compiler vectorizes.
    #[inline(always)]
    fn draw<const GROUPS: usize>(&self, lines: &[f32], values: &mut Vec<f32>, pixels: &mut [f32]) {
        let columns = GROUPS * LANES;
        values.resize((self.rows.len() + 1) * columns, 0.0);
        let dark = self.rows.len();
        values[dark * columns..].fill(0.0);

        let Across { line, starts, weights } = *self.across;
        let row_chunks = values.chunks_exact_mut(columns).zip(lines.chunks_exact(self.per_px * line));
        for (values, lines) in row_chunks {
            let a = &lines[starts[0] + self.start..][..columns];
            let b = &lines[starts[1] + self.start..][..columns];
            let c = &lines[starts[2] + self.start..][..columns];
            let d = &lines[starts[3] + self.start..][..columns];
            for i in 0..columns {
                values[i] = (weights[0] * a[i] + weights[1] * b[i]) + (weights[2] * c[i] + weights[3] * d[i]);
            }
            for (value, mask) in values[columns - LANES..].iter_mut().zip(self.mask) {
                *value *= mask;
            }
        }

        let weights = self.down.weights;
        // The values of each row of nodes; rows beyond the last are zero.
        let at = |node: isize| {
            let row = (node.unsigned_abs() - self.rows.start).min(dark);
            &values[row * columns..][..columns]
        };
        for (row, pixels) in pixels.chunks_mut(self.stride).take(self.count).enumerate() {
            let first = self.down.first + (row * self.per_px) as isize;
            let (a, b, c, d) = (at(first), at(first + 1), at(first + 2), at(first + 3));
            let (a, b, c, d) = (groups(a), groups(b), groups(c), groups(d));
            for (group, pixels) in pixels[..columns].as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
                let light = weigh(&weights, &a[group], &b[group], &c[group], &d[group]);
                for i in 0..LANES {
                    pixels[i] += light[i];
                }
            }
        }
    }
}
