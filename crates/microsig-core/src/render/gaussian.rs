//! Classical in-focus particle images: Gaussian spots, integrated over pixels.
//!
//! I(x, y) = I_0 exp(-8 r^2 / d^2) with the e^-2 diameter d (Raffel et al., "Particle Image Velocimetry", 3rd ed., Springer
//! 2018, section 3.2; Okamoto et al., Meas. Sci. Technol. 11 (2000) 685). A pixel takes the integral over its square, a
//! product of differences of erf along columns and rows; I_0 is `peak_counts` times c_int. Not the brightest pixel but the
//! peak of the irradiance is I_0: with d = 2.5 px a pixel in the middle of a spot has 0.82 I_0.
//!
//! In focus means that depth does not matter; whoever wants a light sheet weakens c_int. Of MicroSIG's settings only the
//! sensor's act (size, pixel_size with magnification, background, gain), not the lens's. Pixels to which a spot would add
//! less than `NEGLIGIBLE` counts are left out.

use rayon::prelude::*;

use super::patch::Window;
use super::spots::Band;
use crate::error::{Error, Fault};
use crate::particle::Particle;
use crate::sensor::Light;
use crate::settings::Settings;

/// Counts: what a spot gives to any one pixel that is left out is less. Half a count is not reached before ten tails meet.
const NEGLIGIBLE: f64 = 0.05;

/// What spots look like.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    /// e^-2 diameter, px, > 0, at most 1000.
    pub diameter_px: f64,
    /// The particle diameter that has a spot of `diameter_px`, um, > 0; others have spots in proportion. `None`: all spots
    /// have one diameter.
    pub reference_um: Option<f64>,
    /// Peak of the irradiance of a particle of c_int 1, counts per pixel before gain, 0 to 1e9.
    pub peak_counts: f64,
}

/// Spots behind a gain, which decides how far they reach.
#[derive(Debug, Clone, Copy)]
pub(super) struct Look {
    spot: Spot,
    gain: f64,
}

impl Look {
    #[inline(always)]
    pub(super) fn diameter_px(&self, particle: &Particle) -> f64 {
        self.spot.diameter_px * self.spot.reference_um.map_or(1.0, |reference| particle.d_um / reference)
    }

    #[inline(always)]
    pub(super) fn peak(&self, particle: &Particle) -> f64 {
        self.spot.peak_counts * particle.c_int
    }

    /// The distance at which exp(-8 r^2 / d^2) leaves less than [`NEGLIGIBLE`] counts, px.
    #[inline(always)]
    pub(super) fn reach_px(&self, particle: &Particle) -> f64 {
        let counts = self.peak(particle) * self.gain / NEGLIGIBLE;
        if counts > 1.0 { self.diameter_px(particle) * (above_log(counts) / 8.0).sqrt() } else { 0.0 }
    }
}

/// A bound of log(x) from above, by less than 0.06, for x >= 1: log2(1 + m) <= m + 0.0861 for mantissas m in [0, 1).
#[inline(always)]
fn above_log(x: f64) -> f64 {
    const FRACTION: u64 = (1 << 52) - 1;
    let exponent = (x.to_bits() >> 52) as f64 - 1023.0;
    let mantissa = f64::from_bits(x.to_bits() & FRACTION | 1.0f64.to_bits()) - 1.0;
    std::f64::consts::LN_2 * (exponent + mantissa + 0.0861)
}

/// Draws particles as Gaussian spots.
#[derive(Debug, Clone)]
pub struct GaussianRenderer {
    settings: Settings,
    look: Look,
    arch: pulp::Arch,
}

impl GaussianRenderer {
    /// A renderer for these settings.
    ///
    /// # Errors
    /// [`Error::Malformed`] if a value is out of range.
    pub fn new(settings: &Settings, spot: Spot) -> Result<Self, Error> {
        settings.validate()?;
        let mut faults = Vec::new();
        let mut check = |name: &str, value: f64, fits: bool, allowed: &str| {
            if !fits {
                let message = format!("{name} = {value}: expected {allowed}");
                faults.push(Fault { source_name: "gaussian".to_owned(), line: None, column: None, message });
            }
        };
        let positive = |v: f64| v > 0.0 && v <= 1000.0;
        check("diameter_px", spot.diameter_px, positive(spot.diameter_px), "a number > 0, at most 1000 px");
        let reference = spot.reference_um.unwrap_or(1.0);
        check("reference_um", reference, positive(reference), "a number > 0, at most 1000 um");
        let fits = (0.0..=1e9).contains(&spot.peak_counts);
        check("peak_counts", spot.peak_counts, fits, "0 to 1e9 counts");
        if faults.is_empty() {
            let look = Look { spot, gain: settings.gain };
            Ok(GaussianRenderer { settings: settings.clone(), look, arch: pulp::Arch::new() })
        } else {
            Err(Error::Malformed(faults))
        }
    }

    /// The same renderer without the instructions that not every processor has; its light is the same.
    pub fn with_baseline_instructions(self) -> Self {
        GaussianRenderer { arch: pulp::Arch::Scalar, ..self }
    }

    /// The settings.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// What spots look like.
    pub fn spot(&self) -> Spot {
        self.look.spot
    }

    /// Whether this particle can be drawn.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for a spheroid, or for a spot beyond 1000 px.
    pub fn check(&self, particle: &Particle) -> Result<Option<String>, Error> {
        if particle.spheroid.is_some_and(|s| s.e_p != 1.0) {
            return Err(Error::Unsupported("spheroids: Gaussian spots are round; use rays".to_owned()));
        }
        let diameter_px = self.diameter_px(particle);
        if diameter_px > 1000.0 {
            let message = format!("d_p = {} um has a spot of {diameter_px} px; at most 1000", particle.d_um);
            return Err(Error::Unsupported(message));
        }
        Ok(None)
    }

    /// e^-2 diameter of a particle's image, px.
    pub fn diameter_px(&self, particle: &Particle) -> f64 {
        self.look.diameter_px(particle)
    }

    /// Half width and half height of a particle's image, px.
    pub fn image_extent(&self, particle: &Particle) -> (f64, f64) {
        let reach = self.look.reach_px(particle);
        (reach, reach)
    }

    fn window(&self, particle: &Particle) -> Window {
        Window::around(
            particle.x_px,
            particle.y_px,
            self.image_extent(particle),
            (self.settings.pixel_dim_x, self.settings.pixel_dim_y),
        )
    }

    /// Whether some of a particle's light may fall on the sensor.
    pub fn reaches_sensor(&self, particle: &Particle) -> bool {
        self.window(particle).area() > 0
    }

    /// Adds up the light of all particles of one image, in their order.
    pub fn light(&self, particles: &[Particle]) -> Light {
        let mut light = Light::dark(&self.settings);
        let (look, sensor) = (self.look, (light.width, light.height));
        let farthest = particles.iter().map(|p| look.reach_px(p)).fold(0.0, f64::max) + 1.0;
        // Bands of pixels, not particles, are dealt out to threads: each pixel sees the particles in order. Every band looks
        // at all particles, so there are no more than threads can use.
        let rows = (light.height as usize).div_ceil(2 * rayon::current_num_threads()).max(64);
        let width = light.width as usize;
        light.values.par_chunks_mut(rows * width).enumerate().for_each(|(band, pixels)| {
            let first = band * rows;
            self.arch.dispatch(Band { particles, look, farthest, sensor, first, pixels });
        });
        light
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SPOT: Spot = Spot { diameter_px: 2.7, reference_um: None, peak_counts: 1000.0 };

    fn renderer(width: u32, height: u32, spot: Spot) -> GaussianRenderer {
        let settings =
            Settings { pixel_dim_x: width, pixel_dim_y: height, gain: 1.0, ..Settings::setting1() };
        GaussianRenderer::new(&settings, spot).unwrap()
    }

    /// The integral over the pixel in column `x` and row `y`, by libm.
    fn integral(spot: Spot, particle: &Particle, x: usize, y: usize) -> f64 {
        let sigma = spot.diameter_px / 4.0;
        let side = |pixel: usize, centre: f64| {
            let at = |edge: f64| libm::erf((edge - centre) / (sigma * std::f64::consts::SQRT_2));
            let pixel = pixel as f64 + 1.0;
            sigma * libm::sqrt(std::f64::consts::PI / 2.0) * (at(pixel + 0.5) - at(pixel - 0.5))
        };
        spot.peak_counts * particle.c_int * side(x, particle.x_px) * side(y, particle.y_px)
    }

    /// Every pixel of the sensor, near the spot and far from it, at its edges and on sensors narrower than a stroke.
    #[test]
    fn pixels_hold_the_integral_of_the_spot() {
        for (width, height) in [(40, 30), (9, 7), (5, 3), (1, 1)] {
            for diameter_px in [0.3, 1.0, 2.7, 9.0] {
                let spot = Spot { diameter_px, ..SPOT };
                let renderer = renderer(width, height, spot);
                for (x, y) in [(4.3, 2.8), (1.0, 1.0), (-0.4, 3.5), (38.9, 30.4), (width as f64, 1.5)] {
                    let particle = Particle { c_int: 0.8, ..Particle::sphere(x, y, 50.0, 2.0) };
                    let light = renderer.light(&[particle]);
                    for (k, &value) in light.values.iter().enumerate() {
                        let expected = integral(spot, &particle, k % width as usize, k / width as usize);
                        // What is left out is below NEGLIGIBLE; what is there is exact to 1e-10 of the peak.
                        let allowed = if value == 0.0 { NEGLIGIBLE } else { 1e-10 * 1000.0 };
                        assert!(
                            (value - expected).abs() < allowed,
                            "{width} x {height}, d {diameter_px}, at {x}, {y}, pixel {k}: {value} {expected}"
                        );
                    }
                }
            }
        }
    }

    /// The closed form: all light of a spot is pi d^2 / 8 times its peak.
    #[test]
    fn a_spot_holds_its_light_wherever_it_lies_in_a_pixel() {
        let renderer = renderer(41, 41, SPOT);
        let all = std::f64::consts::PI * SPOT.diameter_px * SPOT.diameter_px / 8.0 * SPOT.peak_counts;
        for step in 0..20 {
            let shift = f64::from(step) / 20.0;
            let light = renderer.light(&[Particle::sphere(21.0 + shift, 21.0 - 0.7 * shift, 0.0, 1.0)]);
            let total: f64 = light.values.iter().sum();
            // Left out: what lies beyond exp(-8 r^2 / d^2) = 0.05 / 1000, of both axes.
            assert!((total / all - 1.0).abs() < 5e-5, "{total} {all}");
            let x: f64 = light.values.iter().enumerate().map(|(k, v)| (k % 41 + 1) as f64 * v).sum();
            // The window is cut at whole pixels, which moves the centroid by less than what is left out.
            assert!((x / total - 21.0 - shift).abs() < 2e-4, "{} at {shift}", x / total);
        }
    }

    #[test]
    fn light_is_the_same_with_every_instruction_set_and_number_of_threads() {
        let renderer = renderer(300, 500, SPOT);
        let particles: Vec<Particle> = (0..3000u32)
            .map(|k| {
                let at = |step: u32, range: f64| f64::from(k.wrapping_mul(step) >> 8) / 16_777_216.0 * range;
                Particle::sphere(at(2_654_435_769, 306.0) - 3.0, at(1_640_531_527, 506.0) - 3.0, 0.0, 2.0)
            })
            .collect();
        let light = renderer.light(&particles);
        assert_eq!(light, renderer.clone().with_baseline_instructions().light(&particles));
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(light, one.install(|| renderer.light(&particles)));
        assert!(light.values.iter().all(|v| *v >= 0.0) && light.values.iter().any(|v| *v > 1500.0));
    }

    #[test]
    fn spots_follow_the_diameter_of_their_particle_if_asked_to() {
        let spot = Spot { reference_um: Some(2.0), ..SPOT };
        let (small, large) = (Particle::sphere(9.0, 9.0, 0.0, 1.0), Particle::sphere(9.0, 9.0, 0.0, 4.0));
        let renderer = renderer(17, 17, spot);
        assert_eq!((renderer.diameter_px(&small), renderer.diameter_px(&large)), (1.35, 5.4));
        assert!(renderer.image_extent(&small).0 < renderer.image_extent(&large).0);
    }

    #[test]
    fn wrong_spots_and_spheroids_are_refused() {
        let spot = Spot { diameter_px: 0.0, reference_um: Some(-1.0), peak_counts: f64::NAN };
        let message = GaussianRenderer::new(&Settings::setting1(), spot).unwrap_err().to_string();
        assert_eq!(message.lines().count(), 3, "{message}");
        let rod = crate::Spheroid::from_axis(3.0, [1.0, 0.0, 0.0]);
        let rod = Particle { spheroid: Some(rod), ..Particle::sphere(1.0, 1.0, 0.0, 2.0) };
        assert!(renderer(10, 10, SPOT).check(&rod).is_err());
    }
}
