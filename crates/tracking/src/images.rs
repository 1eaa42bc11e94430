//! Model of particle images used by the trackers: light as a function of position and depth, with
//! derivatives.

/// The particle image as a function of position and depth.
pub(super) trait ParticleImages: Sync {
    /// Minimum and maximum depth, um.
    fn depths_um(&self) -> [f64; 2];

    /// Half width that contains the images at all depths within `reach_um` of `z_um`, px.
    fn radius_px(&self, z_um: f64, reach_um: f64) -> usize;

    /// The image of a particle of brightness 1 on the square of this half width around its nearest pixel.
    fn patch(&self, at: [f64; 2], z_um: f64, radius: usize) -> ImagePatch;
}

/// A particle image on a square of pixels, row by row.
#[derive(Debug, Clone)]
pub(super) struct ImagePatch {
    /// Column and row of the central pixel, from 0.
    pub(super) middle: [isize; 2],
    /// Half width, px.
    pub(super) radius: usize,
    /// Light in counts, and its derivatives with respect to the particle's x and y (1/px) and depth (1/um).
    pub(super) light: Vec<[f32; 4]>,
}

impl ImagePatch {
    /// The pixels inside an image of this size: index in the image, light and derivatives.
    pub(super) fn pixels(
        &self,
        (width, height): (usize, usize),
    ) -> impl Iterator<Item = (usize, [f32; 4])> + '_ {
        let (r, side) = (self.radius as isize, 2 * self.radius + 1);
        let ([cx, cy], w, h) = (self.middle, width as isize, height as isize);
        let (from, to) = ((cx - r).max(0), (cx + r + 1).min(w));
        ((cy - r).max(0)..(cy + r + 1).min(h)).flat_map(move |y| {
            let row = (y - cy + r) as usize * side;
            (from..to).map(move |x| ((y * w + x) as usize, self.light[row + (x - cx + r) as usize]))
        })
    }
}
