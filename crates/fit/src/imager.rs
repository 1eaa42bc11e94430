//! Images of single particles for a fit by rays. They are computed directly, without tables: a fit draws most images
//! only once.

use microsig_core::emission::SpheroidLaw;
use microsig_core::render::expected::ExpectedRenderer;

use super::optics::Microscope;
use storage::error::Result;

/// If the cylindrical lens is turned by more than this from the axes of the image (1 - cos 4 angle), the
/// orientation of pixels matters: 0.1 % of the peak.
const TURNED: f64 = 0.1;

/// Number of parts of a pixel along each axis in that case. Geometrical optics gives images on pixels along
/// the axes of the cylindrical lens; a pixel is divided into parts so small that their orientation does not
/// matter (its effect falls with the fourth power of their size). With whole pixels, images with the lens
/// turned by 25 degrees would be off by 1 % of the peak.
const PARTS: usize = 2;

/// Images of the particles of a microscope, of infinitely many rays.
#[derive(Debug)]
pub(super) struct Imager {
    renderer: ExpectedRenderer,
    /// Number of parts of a pixel along each axis.
    parts: usize,
}

impl Imager {
    /// Images on windows of `edge_px` px; `tolerance` is their error relative to the peak.
    pub(super) fn new(microscope: &Microscope, tolerance: f64, edge_px: usize) -> Result<Imager> {
        let turned = microscope.focus_shift_um != 0.0 && 1.0 - libm::cos(4.0 * microscope.angle) > TURNED;
        let parts = if turned { PARTS } else { 1 };
        let mut settings = microscope.settings(parts * edge_px);
        settings.pixel_size /= parts as f64;
        Ok(Imager { renderer: ExpectedRenderer::new(&settings, SpheroidLaw::Original, tolerance)?, parts })
    }

    /// Fractions of the light on pixels at these positions relative to the particle (px), without
    /// derivatives.
    pub(super) fn values(&self, microscope: &Microscope, z_um: f64, places: &[[f64; 2]]) -> Vec<f64> {
        let places = in_cylinder_frame(microscope, places, self.parts);
        let shares = self.renderer.shares(z_um, microscope.diameter_um, &places);
        shares.chunks(self.parts * self.parts).map(|of_pixel| of_pixel.iter().sum()).collect()
    }

    /// Fractions of the light on pixels at these positions relative to the particle (px), with their
    /// derivatives with respect to the particle's x, y (1/px), z (1/um), and the angle of the cylindrical
    /// lens (1/rad).
    pub(super) fn gradients(&self, microscope: &Microscope, z_um: f64, places: &[[f64; 2]]) -> Vec<[f64; 5]> {
        let (c, s) = (libm::cos(microscope.angle), libm::sin(microscope.angle));
        let turned = in_cylinder_frame(microscope, places, self.parts);
        let scale = self.parts as f64;
        let gradients = self.renderer.share_gradients(z_um, microscope.diameter_um, &turned);
        let of_part = |([value, by_u, by_v, by_z], [u, v]): (&[f64; 4], &[f64; 2])| {
            // A displacement of the particle moves the pixel relative to it in the opposite direction.
            let (by_x, by_y) = (-scale * (c * by_u - s * by_v), -scale * (s * by_u + c * by_v));
            [*value, by_x, by_y, *by_z, by_u * v - by_v * u]
        };
        let of_parts: Vec<[f64; 5]> = gradients.iter().zip(&turned).map(of_part).collect();
        let sum = |of_pixel: &[[f64; 5]]| std::array::from_fn(|i| of_pixel.iter().map(|part| part[i]).sum());
        of_parts.chunks(self.parts * self.parts).map(sum).collect()
    }
}

/// Positions of the parts of pixels in the frame of the cylindrical lens, in units of their edge.
fn in_cylinder_frame(microscope: &Microscope, places: &[[f64; 2]], parts: usize) -> Vec<[f64; 2]> {
    let (c, s) = (libm::cos(microscope.angle), libm::sin(microscope.angle));
    let scale = parts as f64;
    let place = |at: f64, part: usize| scale * at + part as f64 - 0.5 * (scale - 1.0);
    let turned = |[x, y]: [f64; 2]| [c * x + s * y, c * y - s * x];
    let of_pixel = |&[x, y]: &[f64; 2]| {
        (0..parts * parts).map(move |i| turned([place(x, i % parts), place(y, i / parts)]))
    };
    places.iter().flat_map(of_pixel).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With the cylindrical lens turned, images on pixels along the image axes agree with those on six times
    /// smaller pixels, whose orientation does not matter, and the derivatives agree with the values.
    #[test]
    fn turned_cylinders_leave_pixels_along_the_images_axes() {
        let microscope = Microscope {
            magnification: 10.0,
            pixel_size_um: 6.45,
            ri_medium: 1.0,
            ri_lens: 1.5,
            depth_factor: 1.0,
            slope: 0.3145,
            focal_length_um: 350.0,
            focus_shift_um: -16.47,
            angle: 25f64.to_radians(),
            diameter_um: 2.0,
        };
        let edge = 25;
        let places: Vec<[f64; 2]> =
            (0..edge * edge).map(|i| [(i % edge) as f64 - 12.2, (i / edge) as f64 - 11.9]).collect();
        let mut settings = microscope.settings(6 * edge);
        settings.pixel_size /= 6.0;
        let fine = ExpectedRenderer::new(&settings, SpheroidLaw::Original, 1e-3).unwrap();
        let imager = Imager::new(&microscope, 1e-3, edge).unwrap();
        for z_um in [-28.0, -12.0] {
            let parts = in_cylinder_frame(&microscope, &places, 6);
            let truth = fine.shares(z_um, 2.0, &parts);
            let truth: Vec<f64> = truth.chunks(36).map(|pixel| pixel.iter().sum()).collect();
            let values = imager.values(&microscope, z_um, &places);
            let peak = truth.iter().copied().fold(0.0, f64::max);
            let most = truth.iter().zip(&values).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(most < 3e-3 * peak, "{z_um}: {}", most / peak);
            let gradients = imager.gradients(&microscope, z_um, &places);
            let moved: Vec<[f64; 2]> = places.iter().map(|[x, y]| [x - 0.01, *y]).collect();
            let turned = Microscope { angle: microscope.angle + 1e-3, ..microscope };
            let by_x = imager.values(&microscope, z_um, &moved);
            let by_angle = imager.values(&turned, z_um, &places);
            for (i, gradient) in gradients.iter().enumerate() {
                assert!(((by_x[i] - values[i]) / 0.01 - gradient[1]).abs() < 0.02 * peak, "{z_um} {i}");
                assert!(((by_angle[i] - values[i]) / 1e-3 - gradient[4]).abs() < 0.02 * peak, "{z_um} {i}");
            }
        }
    }
}
