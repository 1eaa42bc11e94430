//! Drawing spheres from their blocks, in f32, many pixels at a time.
//!
//! Planes around the sphere's depth are blended into one. Round ones are drawn by `draw_round`. Of a quadrant, a row of pixels then takes a blend of four rows of it,
//! and each half of that row four neighbouring nodes for each pixel, the same phases of them all along. Only + and * in a
//! fixed order occur, never fused, so that every instruction set gives the same bits.

use super::block::{Block, Form};
use super::draw_round::RoundBrush;
use super::layout::{LANES, Layout, MARGIN};
use super::spline;
use crate::render::instructions::InstructionSet;
use crate::render::patch::Window;

/// A sphere to be drawn.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sphere<'a> {
    pub(super) block: &'a Block,
    pub(super) window: Window,
    pub(super) x_px: f64,
    pub(super) y_px: f64,
    pub(super) z_um: f64,
    pub(super) radius_um: f64,
    /// All its light.
    pub(super) light: f64,
}

/// Pixels of a piece of the sensor.
pub(super) struct Canvas<'a> {
    /// Number of the leftmost column and the topmost row.
    pub(super) x0: i64,
    pub(super) y0: i64,
    pub(super) width: usize,
    pub(super) pixels: &'a mut [f64],
}

impl Canvas<'_> {
    /// The rows of a window that are on the canvas.
    pub(super) fn rows(&self, window: &Window) -> std::ops::Range<i64> {
        let end = self.y0 + (self.pixels.len() / self.width) as i64;
        window.y0.max(self.y0)..(window.y0 + window.height as i64).min(end)
    }

    /// The pixels of a window's row.
    pub(super) fn row(&mut self, window: &Window, y: i64) -> &mut [f64] {
        let first = (y - self.y0) as usize * self.width + (window.x0 - self.x0) as usize;
        &mut self.pixels[first..][..window.width]
    }

    #[inline(always)]
    fn add(&mut self, window: Window, counts: &[f32], factor: f64) {
        for y in self.rows(&window) {
            let counts = &counts[(y - window.y0) as usize * window.width..];
            for (pixel, &count) in self.row(&window, y).iter_mut().zip(counts) {
                *pixel += factor * f64::from(count);
            }
        }
    }
}

/// A particle to be drawn.
pub(super) enum Figure<'a> {
    Sphere(Sphere<'a>),
    /// Light on the pixels of a window, row by row, times a factor.
    Patch {
        window: Window,
        counts: &'a [f32],
        factor: f64,
    },
}

/// Adds particles to a canvas, one after the other.
pub(super) fn draw<'a>(
    instructions: InstructionSet,
    figures: impl Iterator<Item = Figure<'a>>,
    canvas: Canvas,
) {
    instructions.dispatch(Draw { figures, canvas });
}

/// The work as an operation that is compiled once for every instruction set.
struct Draw<'c, I> {
    figures: I,
    canvas: Canvas<'c>,
}

impl<'a, I: Iterator<Item = Figure<'a>>> pulp::WithSimd for Draw<'_, I> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Draw { figures, mut canvas } = self;
        let mut brush = Brush::default();
        for figure in figures {
            match figure {
                Figure::Sphere(sphere) => brush.add(&sphere, &mut canvas),
                Figure::Patch { window, counts, factor } => canvas.add(window, counts, factor),
            }
        }
    }
}

/// Working memory.
#[derive(Default)]
struct Brush {
    quadrant: Vec<f32>,
    line: Vec<f32>,
    values: Vec<f32>,
    round: RoundBrush,
}

impl Brush {
    #[inline(always)]
    fn add(&mut self, sphere: &Sphere, canvas: &mut Canvas) {
        if canvas.rows(&sphere.window).is_empty() || sphere.window.width == 0 {
            return;
        }
        match &sphere.block.form {
            Form::Round(rings) => match rings.orders.div_ceil(2) {
                1 => self.round.add::<1>(sphere, rings, canvas),
                2 => self.round.add::<2>(sphere, rings, canvas),
                _ => self.round.add::<3>(sphere, rings, canvas),
            },
            Form::Quadrant(layout) => self.add_quadrant(sphere, layout, canvas),
        }
    }

    #[inline(always)]
    fn add_quadrant(&mut self, sphere: &Sphere, layout: &Layout, canvas: &mut Canvas) {
        let rows = canvas.rows(&sphere.window);
        self.blend(sphere, layout, [rows.start as f64, (rows.end - 1) as f64]);
        let across = sides(sphere, layout);
        for y in rows {
            let lit = self.blend_rows(layout, y as f64 - sphere.y_px);
            if lit > 0 {
                let pixels = canvas.row(&sphere.window, y);
                across.iter().for_each(|side| self.add_side(layout, side, lit, pixels));
            }
        }
    }

    /// Blends the rows of the planes that pixels between these two rows see.
    #[inline(always)]
    fn blend(&mut self, sphere: &Sphere, layout: &Layout, rows: [f64; 2]) {
        let nodes = rows.map(|y| (y - sphere.y_px).abs() * layout.per_px as f64);
        let crosses = rows[0] <= sphere.y_px && sphere.y_px <= rows[1];
        let lowest = if crosses { 0.0 } else { (nodes[0].min(nodes[1]) - 2.0).max(0.0) };
        let start = (lowest as usize).min(layout.rows);
        let end = (nodes[0].max(nodes[1]) as usize + 4).min(layout.rows);
        let length = layout.row();
        self.quadrant.resize(layout.length() + MARGIN * length, 0.0);
        self.quadrant[layout.length()..].fill(0.0);

        let mut planes = sphere.block.around(sphere.z_um, sphere.radius_um);
        let mut fresh = true;
        // Four planes of one size after the other.
        while let (Some(a), Some(b), Some(c), Some(d)) =
            (planes.next(), planes.next(), planes.next(), planes.next())
        {
            let weights = [&a, &b, &c, &d].map(|plane| (plane.weight * sphere.light) as f32);
            for row in start..end {
                let lit = layout.lit(row);
                for phase in 0..layout.per_px {
                    let at = row * length + phase * layout.run;
                    let out = self.quadrant[at..at + lit].as_chunks_mut::<LANES>().0;
                    let [a, b, c, d] =
                        [&a, &b, &c, &d].map(|p| p.coefficients[at..at + lit].as_chunks::<LANES>().0);
                    for ((((out, a), b), c), d) in out.iter_mut().zip(a).zip(b).zip(c).zip(d) {
                        // Out and back in at once: that can be done for many numbers at a time.
                        let mut sums = if fresh { [0.0; LANES] } else { *out };
                        for i in 0..LANES {
                            sums[i] += (weights[0] * a[i] + weights[1] * b[i])
                                + (weights[2] * c[i] + weights[3] * d[i]);
                        }
                        *out = sums;
                    }
                }
            }
            fresh = false;
        }
    }

    /// Blends four rows of the quadrant into the line that a row of pixels at `dy` sees; gives its length that is lit.
    #[inline(always)]
    fn blend_rows(&mut self, layout: &Layout, dy: f64) -> usize {
        let place = dy.abs() * layout.per_px as f64;
        let cell = place as usize;
        let weights = spline::basis(place - cell as f64).0.map(|w| w as f32);
        // Before the first row lies the mirror image, behind the last the dark.
        let rows = [(cell as isize - 1).unsigned_abs(), cell, cell + 1, cell + 2];
        let lit = rows.iter().map(|&row| layout.lit(row)).min().unwrap_or(0);
        if lit == 0 {
            return 0;
        }
        let stride = stride(layout);
        self.line.resize(layout.per_px * stride, 0.0);
        for phase in 0..layout.per_px {
            let line = &mut self.line[phase * stride..][..lit + 3 * LANES];
            let (ahead, rest) = line.split_at_mut(LANES);
            let (out, behind) = rest.split_at_mut(lit);
            ahead.fill(0.0);
            behind.fill(0.0);
            let [a, b, c, d] = rows.map(|row| {
                let at = row * layout.row() + phase * layout.run;
                self.quadrant[at..at + lit].as_chunks::<LANES>().0
            });
            for ((((out, a), b), c), d) in
                out.as_chunks_mut::<LANES>().0.iter_mut().zip(a).zip(b).zip(c).zip(d)
            {
                let mut sums = [0.0; LANES];
                for i in 0..LANES {
                    sums[i] =
                        (weights[0] * a[i] + weights[1] * b[i]) + (weights[2] * c[i] + weights[3] * d[i]);
                }
                *out = sums;
            }
        }
        // Node -1 is node 1.
        let one = self.line[(1 % layout.per_px) * stride + LANES + 1 / layout.per_px];
        self.line[(layout.per_px - 1) * stride + LANES - 1] = one;
        lit
    }

    /// Adds the line's spline to the pixels on one side of the sphere.
    #[inline(always)]
    fn add_side(&mut self, layout: &Layout, side: &Side, lit: usize, pixels: &mut [f64]) {
        // The pixel behind the last lit node still sees it.
        let n = side.pixels.min((lit + 1).saturating_sub(side.skipped));
        if n == 0 {
            return;
        }
        self.values.resize(stride(layout), 0.0);
        let full = n.next_multiple_of(LANES);
        let lines = side.lines.map(|start| self.line[start..start + full].as_chunks::<LANES>().0);
        let [a, b, c, d] = lines;
        let weights = side.weights;
        let values = self.values[..full].as_chunks_mut::<LANES>().0;
        for ((((out, a), b), c), d) in values.iter_mut().zip(a).zip(b).zip(c).zip(d) {
            let mut sums = [0.0; LANES];
            for i in 0..LANES {
                sums[i] = (weights[0] * a[i] + weights[1] * b[i]) + (weights[2] * c[i] + weights[3] * d[i]);
            }
            *out = sums;
        }
        let values = &self.values[..n];
        if side.leftward {
            let pixels = &mut pixels[side.first + 1 - n..=side.first];
            for (pixel, value) in pixels.iter_mut().rev().zip(values) {
                *pixel += f64::from(*value);
            }
        } else {
            for (pixel, value) in pixels[side.first..side.first + n].iter_mut().zip(values) {
                *pixel += f64::from(*value);
            }
        }
    }
}

/// Numbers between the beginnings of two phases of a line: there are dark places on both sides of a run.
fn stride(layout: &Layout) -> usize {
    layout.run + 3 * LANES
}

/// The pixels of a row to the left of a sphere or to its right.
struct Side {
    leftward: bool,
    /// The pixel of the window that is nearest to the sphere, and how many there are.
    first: usize,
    pixels: usize,
    /// Pixels between the sphere and the first one.
    skipped: usize,
    /// Where in the line the four neighbouring nodes of the first pixel lie; of the others, behind that.
    lines: [usize; 4],
    weights: [f32; 4],
}

/// Both sides, of those that are in the window.
#[inline(always)]
fn sides(sphere: &Sphere, layout: &Layout) -> [Side; 2] {
    let Window { x0, width, .. } = sphere.window;
    let (start, end) = (x0, x0 + width as i64);
    let right = libm::ceil(sphere.x_px) as i64;
    [true, false].map(|leftward| {
        // From the nearest pixel outward.
        let nearest = if leftward { right - 1 } else { right };
        let first = if leftward { nearest.min(end - 1) } else { nearest.max(start) };
        let pixels = if leftward { first - start + 1 } else { end - first }.max(0) as usize;
        let skipped = (first - nearest).unsigned_abs() as usize;
        let place = (nearest as f64 - sphere.x_px).abs() * layout.per_px as f64;
        let cell = place as usize;
        let lines = [0, 1, 2, 3].map(|k| {
            // One before the cell: at the axis that is the place ahead of the last phase's run.
            let node = cell + k + layout.per_px - 1;
            let (phase, i) = (node % layout.per_px, node / layout.per_px);
            phase * stride(layout) + LANES - 1 + i + skipped.min(layout.run + 1)
        });
        let weights = spline::basis(place - cell as f64).0.map(|w| w as f32);
        Side { leftward, first: (first - start).max(0) as usize, pixels, skipped, lines, weights }
    })
}
