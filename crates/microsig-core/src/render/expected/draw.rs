//! Drawing of particles in f32, vectorized.
//!
//! The planes around the depth of a sphere are interpolated to one plane, which is drawn by `draw_radial` or
//! `draw_quadrant`.

use super::depth_table::{DepthTable, PlaneLayout};
use super::draw_quadrant::QuadrantInterpolator;
use super::draw_radial::RadialInterpolator;
use crate::render::image_sum::{ImageBand, SphereImage};
use crate::render::instructions::InstructionSet;
use crate::render::patch::Window;

/// A particle to draw.
pub(super) enum DrawnParticle<'a> {
    Sphere(SphereImage<'a, DepthTable>),
    /// Light on the pixels of a window, row by row, and a factor on it.
    Patch {
        window: Window,
        counts: &'a [f32],
        factor: f32,
    },
}

/// Adds particles to a band in the given order.
pub(super) fn draw<'a>(
    instructions: InstructionSet,
    particles: impl Iterator<Item = DrawnParticle<'a>>,
    band: ImageBand,
) {
    instructions.dispatch(Draw { particles, band });
}

/// The drawing loop, compiled once for every instruction set.
struct Draw<'c, I> {
    particles: I,
    band: ImageBand<'c>,
}

impl<'a, I: Iterator<Item = DrawnParticle<'a>>> pulp::WithSimd for Draw<'_, I> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Draw { particles, mut band } = self;
        let mut interpolator = Interpolator::default();
        for particle in particles {
            match particle {
                DrawnParticle::Sphere(sphere) => interpolator.add(&sphere, &mut band),
                DrawnParticle::Patch { window, counts, factor } => band.add(window, counts, factor),
            }
        }
    }
}

/// Working memory.
#[derive(Default)]
struct Interpolator {
    round: RadialInterpolator,
    quadrant: QuadrantInterpolator,
}

impl Interpolator {
    #[inline(always)]
    fn add(&mut self, sphere: &SphereImage<DepthTable>, band: &mut ImageBand) {
        if band.rows(&sphere.window).is_empty() || sphere.window.width == 0 {
            return;
        }
        match &sphere.table.layout {
            PlaneLayout::Radial(rings) => self.round.add(sphere, rings, band),
            PlaneLayout::Quadrant(layout) => self.quadrant.add(sphere, layout, band),
        }
    }
}
