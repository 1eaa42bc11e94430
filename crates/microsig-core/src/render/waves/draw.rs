//! Renders images from the splines of tables in f32, many pixels at a time.
//!
//! Planes around a sphere's depth are blended into lines: rows of nodes, joined with their mirror image. From
//! a line follow the spline's values at the columns of pixels. All pixels have the same phase relative to the
//! nodes, so a value is the sum of six products of contiguous memory; likewise, six rows of such values give
//! a row of pixels. Only + and * in a fixed order are used, never fused, so all instruction sets give the
//! same bits.

use super::layout::Layout;
use crate::bspline::{self, QUINTIC_TAPS as TAPS};
use crate::render::image_sum::{ImageBand, LANES, SphereImage};
use crate::render::node_layout::{self, NodeLayout};
use crate::render::patch::Window;
use crate::render::tabled;

type Axis = node_layout::Axis<TAPS>;

/// Zeros before and after a line, as pixels may extend beyond the nodes.
const PADDING: usize = 2 * LANES;

/// Working memory for rendering.
#[derive(Debug, Default)]
pub struct Pen {
    /// A row of nodes, ordered by phase.
    nodes: Vec<f32>,
    /// The same row: for each phase, the mirror image and the row itself.
    line: Vec<f32>,
    /// Values at the columns of pixels, by row of nodes; after the last, a row of zeros.
    values: Vec<f32>,
}

impl tabled::Pen<Layout> for Pen {
    #[inline(always)]
    fn add(&mut self, sphere: &SphereImage<Layout>, band: &mut ImageBand) {
        let Window { x0, width, .. } = sphere.window;
        let pixel_rows = band.rows(&sphere.window);
        let top = pixel_rows.start;
        let layout = &sphere.table.layout.nodes;
        let count = (pixel_rows.end - top) as usize;
        let down = Axis::new(top, sphere.y_px, layout.per_px, bspline::quintic);
        let across = Axis::new(x0, sphere.x_px, layout.per_px, bspline::quintic);
        let rows = down.nodes(count, layout, 1);
        // Number of nodes needed of each phase, a multiple of the lanes.
        let far = across.nodes(width, layout, 0).end;
        let run = (far / layout.per_px + 1).next_multiple_of(LANES).min(layout.run);
        let columns = width.next_multiple_of(LANES);
        self.values_at_columns(sphere, layout, &rows, (&across, run), (width, columns));

        let first = band.first(&sphere.window, top);
        let dark = rows.len();
        for row in 0..count {
            let pixels = &mut band.pixels[first + row * band.stride..][..columns];
            let lines: [&[f32]; TAPS] = std::array::from_fn(|i| {
                let stored = layout.row_of(down.first + (row * layout.per_px + i) as isize);
                let line = stored.filter(|node| rows.contains(node)).map_or(dark, |node| node - rows.start);
                &self.values[line * columns..][..columns]
            });
            for (pixels, six) in pixels.as_chunks_mut::<LANES>().0.iter_mut().zip(chunks(lines)) {
                let mut sums = weighed(&down.weights, six);
                (0..LANES).for_each(|i| sums[i] += pixels[i]);
                *pixels = sums;
            }
        }
    }
}

impl Pen {
    /// The spline's values at the columns of pixels, for each row of nodes, from `run` nodes of each phase.
    /// One row after the other, so that nodes and line stay in the cache.
    #[inline(always)]
    fn values_at_columns(
        &mut self,
        sphere: &SphereImage<Layout>,
        layout: &NodeLayout,
        rows: &std::ops::Range<usize>,
        (axis, run): (&Axis, usize),
        (width, columns): (usize, usize),
    ) {
        let per_px = layout.per_px;
        let length = (2 * (run + PADDING)).max(2 * PADDING + columns);
        let Pen { nodes, line, values } = self;
        nodes.resize(per_px * run, 0.0);
        line.clear();
        line.resize(per_px * length, 0.0);
        values.resize((rows.len() + 1) * columns, 0.0);
        values[rows.len() * columns..].fill(0.0);
        let middle =
            if layout.mirrored { run + PADDING } else { layout.origin[0] / per_px + PADDING } as isize;
        // Pixels far beyond the nodes read only zeros.
        let starts: [usize; TAPS] = std::array::from_fn(|i| {
            let node = axis.first + i as isize;
            let place = middle + node.div_euclid(per_px as isize);
            let place = place.clamp(0, length as isize - columns as isize) as usize;
            node.rem_euclid(per_px as isize) as usize * length + place
        });
        let masked = columns - LANES;
        let planes: Vec<[(f32, &[f32]); 4]> =
            (sphere.table.planes_around(sphere.z_um, sphere.radius_um, sphere.at_px()))
                .map(|four| four.map(|plane| ((plane.weight * sphere.light) as f32, plane.coefficients)))
                .collect();
        for (row, values) in rows.clone().zip(values.chunks_exact_mut(columns)) {
            blend(&planes, row * layout.row(), layout.run, run, nodes);
            for (phase, nodes) in nodes.chunks_exact(run).enumerate() {
                if !layout.mirrored {
                    line[phase * length + PADDING..][..run].copy_from_slice(nodes);
                    continue;
                }
                let right = phase * length + run + PADDING;
                line[right..][..run].copy_from_slice(nodes);
                // The mirror image of a node of phase p has phase per_px - p; for phase 0, the node on the
                // axis is its own mirror image.
                let (mirrored, skip) = if phase == 0 { (0, 0) } else { (per_px - phase, 1) };
                let left = mirrored * length + PADDING - skip;
                for (to, from) in line[left + 1..][..run].iter_mut().rev().zip(nodes) {
                    *to = *from;
                }
            }
            let shifted = starts.map(|start| &line[start..][..columns]);
            for (values, six) in values.as_chunks_mut::<LANES>().0.iter_mut().zip(chunks(shifted)) {
                *values = weighed(&axis.weights, six);
            }
            for (i, value) in values[masked..].iter_mut().enumerate() {
                *value *= if masked + i < width { 1.0 } else { 0.0 };
            }
        }
    }
}

/// The chunks of six lines at the same places. Loops of this constant length have no remainder, which
/// compilers would compute one by one.
#[inline(always)]
fn chunks(lines: [&[f32]; TAPS]) -> impl Iterator<Item = [&[f32; LANES]; TAPS]> {
    let [a, b, c, d, e, f] = lines.map(|line| line.as_chunks::<LANES>().0);
    a.iter().zip(b).zip(c).zip(d).zip(e).zip(f).map(|(((((a, b), c), d), e), f)| [a, b, c, d, e, f])
}

/// Weighted sums of chunks of six lines.
#[inline(always)]
fn weighed(w: &[f32; TAPS], [a, b, c, d, e, f]: [&[f32; LANES]; TAPS]) -> [f32; LANES] {
    std::array::from_fn(|i| {
        (w[0] * a[i] + w[1] * b[i]) + (w[2] * c[i] + w[3] * d[i]) + (w[4] * e[i] + w[5] * f[i])
    })
}

/// Blends a row of nodes, which begins at `at`, of the planes around a sphere: `run` nodes of each phase, of
/// which `stored` are stored.
#[inline(always)]
fn blend(planes: &[[(f32, &[f32]); 4]], at: usize, stored: usize, run: usize, nodes: &mut [f32]) {
    nodes.fill(0.0);
    for four in planes {
        let w = four.map(|(weight, _)| weight);
        for (phase, out) in nodes.chunks_exact_mut(run).enumerate() {
            let runs = four.map(|(_, plane)| plane[at + phase * stored..][..run].as_chunks::<LANES>().0);
            let [a, b, c, d] = runs;
            for ((((out, a), b), c), d) in
                out.as_chunks_mut::<LANES>().0.iter_mut().zip(a).zip(b).zip(c).zip(d)
            {
                let mut sums = *out;
                for i in 0..LANES {
                    sums[i] += (w[0] * a[i] + w[1] * b[i]) + (w[2] * c[i] + w[3] * d[i]);
                }
                *out = sums;
            }
        }
    }
}
