//! Drawing of spheres in f32, vectorized.
//!
//! The planes around the depth of a sphere are interpolated to one plane, which is drawn by `draw_radial` or
//! `draw_quadrant`.

use super::depth_table::PlaneLayout;
use super::draw_quadrant::QuadrantInterpolator;
use super::draw_radial::RadialInterpolator;
use crate::render::image_sum::{ImageBand, SphereImage};
use crate::render::tabled;

/// Working memory.
#[derive(Debug, Default)]
pub struct Pen {
    round: RadialInterpolator,
    quadrant: QuadrantInterpolator,
}

impl tabled::Pen<PlaneLayout> for Pen {
    #[inline(always)]
    fn add(&mut self, sphere: &SphereImage<PlaneLayout>, band: &mut ImageBand) {
        match &sphere.table.layout {
            PlaneLayout::Radial(rings) => self.round.add(sphere, rings, band),
            PlaneLayout::Quadrant(layout) => self.quadrant.add(sphere, layout, band),
        }
    }
}
