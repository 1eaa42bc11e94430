//! Classical in-focus particle images: Gaussian spots, integrated over pixels.
//!
//! I(x, y) = I_0 exp(-8 r^2 / d^2) with the e^-2 diameter d (Raffel et al., "Particle Image Velocimetry", 3rd ed., Springer
//! 2018, section 3.2; Okamoto et al., Meas. Sci. Technol. 11 (2000) 685). A pixel takes the integral over its square, a
//! product of differences of erf along columns and rows; I_0 is `peak_counts` times c_int. Not the brightest pixel but the
//! peak of the irradiance is I_0: with d = 2.5 px a pixel in the middle of a spot has 0.82 I_0.
//!
//! In focus means that depth does not matter; whoever wants a light sheet weakens c_int. Of MicroSIG's settings only the
//! sensor's act (size, pixel_size with magnification, background, gain), not the lens's. Pixels to which a spot would add
//! less than `NEGLIGIBLE` counts may be left out; the others are exact to 5e-6 of its peak, less than the rounding of counts.

use rayon::prelude::*;

use super::instructions::InstructionSet;
use super::patch::Window;
use super::placing::{self, Spots};
use super::strokes::Band;
use crate::error::{Error, Fault};
use crate::particle::Particle;
use crate::sensor::{Image, Light, Sensor};
use crate::settings::Settings;
use crate::shelf::Shelf;
use crate::stream::{Purpose, Streams};

/// Counts: what a spot gives to any one pixel that is left out is less. Half a count is not reached before ten tails meet.
const NEGLIGIBLE: f64 = 0.05;

/// Rows that are drawn at a time: few enough for the caches, and many more than those of most spots.
const BAND: usize = 128;

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

/// Factors of what spots look like behind a gain, which decides how far they reach.
#[derive(Debug, Clone, Copy)]
pub(super) struct Look {
    /// e^-2 diameter of a spot: of one of a particle without extent, and its growth with the particle's diameter.
    diameter_px: f32,
    diameter_px_per_um: f32,
    counts_per_negligible: f32,
    /// Peak times pi / 32: what the square of the diameter makes the integral of the spot, over 4.
    light: f32,
}

impl Look {
    fn new(spot: Spot, gain: f64) -> Self {
        let per_um = spot.reference_um.map(|reference| spot.diameter_px / reference);
        Look {
            diameter_px: if per_um.is_some() { 0.0 } else { spot.diameter_px as f32 },
            diameter_px_per_um: per_um.unwrap_or(0.0) as f32,
            counts_per_negligible: (spot.peak_counts * gain / NEGLIGIBLE) as f32,
            light: (spot.peak_counts * std::f64::consts::PI / 32.0) as f32,
        }
    }

    /// e^-2 diameter of the spot of a particle, px.
    #[inline(always)]
    pub(super) fn diameter(&self, d_um: f32) -> f32 {
        self.diameter_px + self.diameter_px_per_um * d_um
    }

    /// Peak times (sigma sqrt(pi / 2))^2, of a spot of this diameter.
    #[inline(always)]
    pub(super) fn light(&self, diameter: f32, c_int: f32) -> f32 {
        self.light * c_int * diameter * diameter
    }

    /// The distance at which exp(-8 r^2 / d^2) leaves less than [`NEGLIGIBLE`] counts, px.
    #[inline(always)]
    pub(super) fn reach(&self, diameter: f32, c_int: f32) -> f32 {
        let log = above_log(c_int * self.counts_per_negligible);
        diameter * (if log > 0.0 { log * 0.125 } else { 0.0 }).sqrt()
    }
}

/// A bound of log(x) from above, by less than 0.06, for x >= 0: log2(1 + m) <= m + 0.0861 for mantissas m in [0, 1).
#[inline(always)]
fn above_log(x: f32) -> f32 {
    const FRACTION: u32 = (1 << 23) - 1;
    let exponent = (x.to_bits() >> 23) as i32 as f32 - 127.0;
    let mantissa = f32::from_bits(x.to_bits() & FRACTION | 1.0f32.to_bits()) - 1.0;
    std::f32::consts::LN_2 * (exponent + mantissa + 0.0862)
}

/// Draws particles as Gaussian spots.
#[derive(Debug, Clone)]
pub struct GaussianRenderer {
    settings: Settings,
    spot: Spot,
    look: Look,
    instructions: InstructionSet,
    /// Working memory, kept from image to image.
    spots: Shelf<Vec<placing::Spot>>,
    sums: Shelf<Vec<f32>>,
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
            let look = Look::new(spot, settings.gain);
            Ok(GaussianRenderer {
                settings: settings.clone(),
                spot,
                look,
                instructions: InstructionSet::best(),
                spots: Shelf::default(),
                sums: Shelf::default(),
            })
        } else {
            Err(Error::Malformed(faults))
        }
    }

    /// The same renderer, restricted to an instruction set; its light is the same.
    pub fn with_instruction_set(self, instructions: InstructionSet) -> Self {
        GaussianRenderer { instructions, ..self }
    }

    /// The settings.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// What spots look like.
    pub fn spot(&self) -> Spot {
        self.spot
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
        self.spot.diameter_px * self.spot.reference_um.map_or(1.0, |reference| particle.d_um / reference)
    }

    /// Half width and half height of a particle's image, px.
    pub fn image_extent(&self, particle: &Particle) -> (f64, f64) {
        let diameter = self.look.diameter(particle.d_um as f32);
        let reach = f64::from(self.look.reach(diameter, particle.c_int as f32));
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

    fn spots(&self, particles: &[Particle]) -> Spots<'_> {
        let sensor = (self.settings.pixel_dim_x, self.settings.pixel_dim_y);
        Spots::new(particles, self.look, sensor, self.instructions, &self.spots)
    }

    /// The light of the rows from `first` on.
    fn band(&self, spots: &Spots<'_>, first: usize, pixels: &mut [f64]) {
        let width = self.settings.pixel_dim_x as usize;
        self.instructions.dispatch(Band { spots, width, first, pixels, shelf: &self.sums });
    }

    /// Adds up the light of all particles of one image: each pixel sees them in the order of their first rows, in steps of
    /// 8 px, and then in that of the list.
    pub fn light(&self, particles: &[Particle]) -> Light {
        let mut light = Light::dark(&self.settings);
        let spots = self.spots(particles);
        // Bands of pixels, not particles, are dealt out to threads, so that sums do not depend on how many there are.
        let bands = light.values.par_chunks_mut(BAND * light.width as usize);
        bands.enumerate().for_each(|(band, pixels)| self.band(&spots, band * BAND, pixels));
        light
    }

    /// The image that `sensor`, one of these settings, makes of [`GaussianRenderer::light`], faster: light is exposed where it
    /// is made, a band at a time.
    pub fn image(
        &self,
        particles: &[Particle],
        sensor: &Sensor,
        streams: &Streams,
        purpose: Purpose,
        frame: u32,
    ) -> Image {
        let spots = self.spots(particles);
        let size = (self.settings.pixel_dim_x, self.settings.pixel_dim_y);
        sensor.expose_bands(size, BAND, streams, purpose, frame, |first, pixels| {
            self.band(&spots, first, pixels)
        })
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

    /// Every pixel of the sensor, near the spot and far from it, at its edges, on sensors narrower than a stroke and of several
    /// panels and bands, with profiles in f32 and in f64.
    #[test]
    fn pixels_hold_the_integral_of_the_spot() {
        for (width, height) in [(40, 30), (9, 7), (5, 3), (1, 1), (140, 150)] {
            for diameter_px in [0.3, 1.0, 2.7, 4.2, 7.0, 9.0, 11.9, 12.1, 40.0] {
                let spot = Spot { diameter_px, ..SPOT };
                let renderer = renderer(width, height, spot);
                let (right, bottom) = (f64::from(width), f64::from(height));
                let places = [(4.3, 2.8), (1.0, 1.0), (-0.4, 3.5), (right - 1.1, bottom + 0.4), (right, 1.5)];
                // Across the edge of two panels, and of two bands.
                for (x, y) in places.into_iter().chain([(64.2, 127.9), (62.7, 129.3)]) {
                    let particle = Particle { c_int: 0.8, ..Particle::sphere(x, y, 50.0, 2.0) };
                    let light = renderer.light(&[particle]);
                    for (k, &value) in light.values.iter().enumerate() {
                        let expected = integral(spot, &particle, k % width as usize, k / width as usize);
                        // What is left out is below NEGLIGIBLE; what is there is exact to 5e-6 of the peak.
                        let allowed = if value == 0.0 { NEGLIGIBLE } else { 5e-6 * 1000.0 };
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
        for set in InstructionSet::available() {
            assert!(light == renderer.clone().with_instruction_set(set).light(&particles), "{set}");
        }
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            assert!(light == pool.install(|| renderer.light(&particles)), "{threads} threads");
        }
        assert!(light.values.iter().all(|v| *v >= 0.0) && light.values.iter().any(|v| *v > 1500.0));
    }

    #[test]
    fn an_image_is_the_exposure_of_its_light() {
        let renderer = renderer(90, 200, SPOT);
        let places = (0..400u32).map(|k| (f64::from(k * 37 % 95) - 2.3, f64::from(k * 53 % 211) - 5.1));
        let particles: Vec<Particle> = places.map(|(x, y)| Particle::sphere(x, y, 0.0, 2.0)).collect();
        let streams = Streams::new(3);
        let detector =
            crate::sensor::Detector { shot_noise: true, prnu: 0.1, bits: 12, ..Default::default() };
        let settings = renderer.settings();
        for sensor in [Sensor::new(settings), Sensor::with_detector(settings, detector, &streams).unwrap()] {
            let noise = Purpose::BackgroundNoise;
            let image = renderer.image(&particles, &sensor, &streams, noise, 2);
            assert!(image == sensor.expose(&renderer.light(&particles), &streams, noise, 2));
            assert!(image.counts.iter().any(|&count| count > 500));
        }
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
