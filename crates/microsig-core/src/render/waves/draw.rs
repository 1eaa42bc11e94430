//! Renders images from the splines of tables in f32, many pixels at a time.
//!
//! Planes around a sphere's depth are blended into lines: rows of nodes, joined with their mirror image. From
//! a line follow the spline's values at the columns of pixels. All pixels have the same phase relative to the
//! nodes, so a value is the sum of six products of contiguous memory; likewise, six rows of such values give
//! a row of pixels. Only + and * in a fixed order are used, never fused, so all instruction sets give the
//! same bits.

use super::layout::Layout;
use super::table::Table;
use crate::bspline::{self, QUINTIC_TAPS as TAPS};
use crate::render::image_sum::{ImageBand, LANES, SphereImage};
use crate::render::instructions::InstructionSet;
use crate::render::patch::Window;

/// Adds spheres to a band, in order.
pub(super) fn draw<'a>(
    instructions: InstructionSet,
    spheres: impl Iterator<Item = SphereImage<'a, Table>>,
    band: ImageBand<'_>,
) {
    instructions.dispatch(Draw { spheres, band });
}

struct Draw<'b, I> {
    spheres: I,
    band: ImageBand<'b>,
}

impl<'a, I: Iterator<Item = SphereImage<'a, Table>>> pulp::WithSimd for Draw<'_, I> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Draw { spheres, mut band } = self;
        let mut scratch = Scratch::default();
        for sphere in spheres {
            scratch.add(&sphere, &mut band);
        }
    }
}

/// Position of pixels relative to the nodes along an axis: consecutive pixels are `per_px` nodes apart and
/// have the same weights.
struct Axis {
    /// The first of the six nodes around the first pixel, counted from the sphere.
    first: isize,
    weights: [f32; TAPS],
}

impl Axis {
    fn new(first_px: i64, sphere_px: f64, per_px: usize) -> Axis {
        let place = (first_px as f64 - sphere_px) * per_px as f64;
        let cell = libm::floor(place);
        Axis { first: cell as isize - 2, weights: bspline::quintic(place - cell).0.map(|w| w as f32) }
    }

    /// The stored nodes that contribute to `pixels` pixels.
    fn nodes(&self, pixels: usize, layout: &Layout, origin: usize, end: usize) -> std::ops::Range<usize> {
        let last = self.first + (TAPS - 1 + (pixels - 1) * layout.per_px) as isize;
        if !layout.mirrored {
            let within = |node: isize| (node + origin as isize).clamp(0, end as isize) as usize;
            return within(self.first)..within(last + 1);
        }
        let crosses = self.first <= 0 && 0 <= last;
        let nearest = if crosses { 0 } else { self.first.unsigned_abs().min(last.unsigned_abs()) };
        let end = (self.first.unsigned_abs().max(last.unsigned_abs()) + 1).min(end);
        nearest.min(end)..end
    }
}

/// Zeros before and after a line, as pixels may extend beyond the nodes.
const PADDING: usize = 2 * LANES;

/// Working memory for rendering.
#[derive(Default)]
struct Scratch {
    /// Rows of nodes, ordered by phase.
    nodes: Vec<f32>,
    /// One row of nodes: for each phase, the mirror image and the row itself.
    line: Vec<f32>,
    /// Values at the columns of pixels, by row of nodes; after the last, a row of zeros.
    values: Vec<f32>,
}

impl Scratch {
    #[inline(always)]
    fn add(&mut self, sphere: &SphereImage<Table>, band: &mut ImageBand) {
        let Window { x0, width, .. } = sphere.window;
        let pixel_rows = band.rows(&sphere.window);
        if width == 0 || pixel_rows.is_empty() {
            return;
        }
        let top = pixel_rows.start;
        let layout = &sphere.table.layout;
        let count = (pixel_rows.end - top) as usize;
        let down = Axis::new(top, sphere.y_px, layout.per_px);
        let across = Axis::new(x0, sphere.x_px, layout.per_px);
        let rows = down.nodes(count, layout, layout.origin[1], layout.rows);
        // Number of nodes needed of each phase, a multiple of the lanes.
        let far = across.nodes(width, layout, layout.origin[0], layout.row()).end;
        let run = (far / layout.per_px + 1).next_multiple_of(LANES).min(layout.run);
        self.blend(sphere, layout, &rows, run);
        let columns = width.next_multiple_of(LANES);
        self.across(layout, &across, rows.len(), run, width, columns);

        let first = band.first(&sphere.window, top);
        let dark = rows.len();
        for row in 0..count {
            let pixels = &mut band.pixels[first + row * band.stride..][..columns];
            let lines: [&[f32]; TAPS] = std::array::from_fn(|i| {
                let stored = layout.row_of(down.first + (row * layout.per_px + i) as isize);
                let line = stored.filter(|node| rows.contains(node)).map_or(dark, |node| node - rows.start);
                &self.values[line * columns..][..columns]
            });
            let w = down.weights;
            let [a, b, c, d, e, f] = lines;
            for i in 0..columns {
                pixels[i] +=
                    (w[0] * a[i] + w[1] * b[i]) + (w[2] * c[i] + w[3] * d[i]) + (w[4] * e[i] + w[5] * f[i]);
            }
        }
    }

    /// Blends rows of nodes of the planes around a sphere, `run` nodes of each phase.
    #[inline(always)]
    fn blend(
        &mut self,
        sphere: &SphereImage<Table>,
        layout: &Layout,
        rows: &std::ops::Range<usize>,
        run: usize,
    ) {
        self.nodes.resize(rows.len() * layout.per_px * run, 0.0);
        for (size, four) in sphere.table.around(sphere.z_um, sphere.radius_um).enumerate() {
            let w: [f32; 4] = std::array::from_fn(|i| (four[i].weight * sphere.light) as f32);
            let of_rows = rows.start * layout.row()..rows.end * layout.row();
            let [a, b, c, d] = four.map(|plane| plane.coefficients[of_rows.clone()].chunks_exact(layout.run));
            for ((((out, a), b), c), d) in self.nodes.chunks_exact_mut(run).zip(a).zip(b).zip(c).zip(d) {
                let (a, b, c, d) = (&a[..run], &b[..run], &c[..run], &d[..run]);
                if size == 0 {
                    for i in 0..run {
                        out[i] = (w[0] * a[i] + w[1] * b[i]) + (w[2] * c[i] + w[3] * d[i]);
                    }
                } else {
                    for i in 0..run {
                        out[i] += (w[0] * a[i] + w[1] * b[i]) + (w[2] * c[i] + w[3] * d[i]);
                    }
                }
            }
        }
    }

    /// The spline's values at the columns of pixels, for each row of nodes.
    #[inline(always)]
    fn across(
        &mut self,
        layout: &Layout,
        axis: &Axis,
        rows: usize,
        run: usize,
        width: usize,
        columns: usize,
    ) {
        let per_px = layout.per_px;
        let length = (2 * (run + PADDING)).max(2 * PADDING + columns);
        self.line.clear();
        self.line.resize(per_px * length, 0.0);
        self.values.resize((rows + 1) * columns, 0.0);
        self.values[rows * columns..].fill(0.0);
        let middle =
            if layout.mirrored { run + PADDING } else { layout.origin[0] / per_px + PADDING } as isize;
        // Pixels far beyond the nodes read only zeros.
        let starts: [usize; TAPS] = std::array::from_fn(|i| {
            let node = axis.first + i as isize;
            let place = middle + node.div_euclid(per_px as isize);
            let place = place.clamp(0, length as isize - columns as isize) as usize;
            node.rem_euclid(per_px as isize) as usize * length + place
        });
        let w = axis.weights;
        let masked = columns - LANES;
        let of_rows = self.nodes.chunks_exact(per_px * run).zip(self.values.chunks_exact_mut(columns));
        for (nodes, values) in of_rows {
            for (phase, nodes) in nodes.chunks_exact(run).enumerate() {
                if !layout.mirrored {
                    self.line[phase * length + PADDING..][..run].copy_from_slice(nodes);
                    continue;
                }
                let right = phase * length + run + PADDING;
                self.line[right..][..run].copy_from_slice(nodes);
                // The mirror image of a node of phase p has phase per_px - p; for phase 0, the node on the
                // axis is its own mirror image.
                let (mirrored, skip) = if phase == 0 { (0, 0) } else { (per_px - phase, 1) };
                let left = mirrored * length + PADDING - skip;
                for (to, from) in self.line[left + 1..][..run].iter_mut().rev().zip(nodes) {
                    *to = *from;
                }
            }
            let [a, b, c, d, e, f] = starts.map(|start| &self.line[start..][..columns]);
            for i in 0..columns {
                values[i] =
                    (w[0] * a[i] + w[1] * b[i]) + (w[2] * c[i] + w[3] * d[i]) + (w[4] * e[i] + w[5] * f[i]);
            }
            for (i, value) in values[masked..].iter_mut().enumerate() {
                *value *= if masked + i < width { 1.0 } else { 0.0 };
            }
        }
    }
}
