//! Drawing particles, in f32, many pixels at a time.
//!
//! Planes around a sphere's depth are blended into one, which is drawn by `draw_round` or `draw_quadrant`.

use super::block::{Block, Form};
use super::draw_quadrant::QuadrantBrush;
use super::draw_round::RoundBrush;
use super::layout::LANES;
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
    /// Numbers from a row to the next (see [`stride`]).
    pub(super) stride: usize,
    pub(super) pixels: &'a mut [f32],
}

/// Numbers from a row of so many columns to the next: spheres are drawn in groups of pixels, the last of which may reach beyond
/// the columns.
pub(super) fn stride(columns: usize) -> usize {
    columns + LANES
}

/// Copies rows of so many columns, as many as there is room for.
pub(super) fn copy(canvas: &[f32], columns: usize, pixels: &mut [f64]) {
    for (from, to) in canvas.chunks_exact(stride(columns)).zip(pixels.chunks_exact_mut(columns)) {
        to.iter_mut().zip(from).for_each(|(to, from)| *to = f64::from(*from));
    }
}

impl Canvas<'_> {
    /// The rows of a window that are on the canvas.
    pub(super) fn rows(&self, window: &Window) -> std::ops::Range<i64> {
        let end = self.y0 + (self.pixels.len() / self.stride) as i64;
        window.y0.max(self.y0)..(window.y0 + window.height as i64).min(end)
    }

    /// Where the first pixel of a window's row is.
    pub(super) fn first(&self, window: &Window, row: i64) -> usize {
        (row - self.y0) as usize * self.stride + (window.x0 - self.x0) as usize
    }

    #[inline(always)]
    fn add(&mut self, window: Window, counts: &[f32], factor: f32) {
        for y in self.rows(&window) {
            let counts = &counts[(y - window.y0) as usize * window.width..];
            let first = self.first(&window, y);
            for (pixel, &count) in self.pixels[first..][..window.width].iter_mut().zip(counts) {
                *pixel += factor * count;
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
        factor: f32,
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
    round: RoundBrush,
    quadrant: QuadrantBrush,
}

impl Brush {
    #[inline(always)]
    fn add(&mut self, sphere: &Sphere, canvas: &mut Canvas) {
        if canvas.rows(&sphere.window).is_empty() || sphere.window.width == 0 {
            return;
        }
        match &sphere.block.form {
            Form::Round(rings) => self.round.add(sphere, rings, canvas),
            Form::Quadrant(layout) => self.quadrant.add(sphere, layout, canvas),
        }
    }
}
