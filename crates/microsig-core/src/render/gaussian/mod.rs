//! Classical in-focus particle images: Gaussian spots, integrated over pixels.
//!
//! I(x, y) = I_0 exp(-8 r^2 / d^2) with the e^-2 diameter d (Raffel et al., "Particle Image Velocimetry", 3rd
//! ed., Springer 2018, section 3.2; Okamoto et al., Meas. Sci. Technol. 11 (2000) 685). A pixel collects the
//! integral over its area, a product of differences of erf along columns and rows; I_0 is `peak_counts` times
//! c_int. I_0 is the peak of the irradiance, not of the pixel values: with d = 2.5 px a pixel centered on the
//! spot has 0.82 I_0.
//!
//! All particles are in focus at any depth; a light sheet is modeled by reducing c_int. Of MicroSIG's
//! settings only the sensor's are used (size, pixel_size with magnification, background, gain), not
//! the lens's. Pixels that would receive less than `NEGLIGIBLE` counts from a spot may be skipped; the
//! error of the others is below 5e-6 of the peak, less than the rounding of counts.

mod accumulate;
mod footprint;
mod spot;

use rayon::prelude::*;

use crate::cancel::checkpoint;
use crate::error::Error;
use crate::particle::Particle;
use crate::pool::BufferPool;
use crate::problem::Problems;
use crate::render::instructions::InstructionSet;
use crate::render::interface::{Description, ImageStreams, Render, Traits};
use crate::render::patch::{ExpectedPatch, Window};
use crate::sensor::{Image, Light, Sensor};
use crate::settings::Settings;
use crate::stream::{Purpose, Streams};
use accumulate::Band;
use footprint::{Footprint, Footprints};
pub use spot::GaussianSpot;
use spot::SpotScaling;

/// Rows per band: few enough to fit the caches, and many more than most spots have.
const BAND: usize = 128;

/// Renders particles as Gaussian spots.
#[derive(Debug, Clone)]
pub struct GaussianRenderer {
    settings: Settings,
    spot: GaussianSpot,
    scaling: SpotScaling,
    instructions: InstructionSet,
    /// Working memory, reused from image to image.
    spots: BufferPool<Vec<Footprint>>,
    sums: BufferPool<Vec<f32>>,
}

impl GaussianRenderer {
    /// A renderer for these settings.
    pub fn new(settings: &Settings, spot: GaussianSpot) -> Result<Self, Error> {
        settings.validate()?;
        let mut problems = Problems::default();
        let positive = |v: f64| v > 0.0 && v <= 1000.0;
        let (diameter, reference) = (spot.diameter_px, spot.reference_um.unwrap_or(1.0));
        problems.unless(positive(diameter), "diameter_px", diameter, "a number > 0, at most 1000 px");
        problems.unless(positive(reference), "reference_um", reference, "a number > 0, at most 1000 um");
        let fits = (0.0..=1e9).contains(&spot.peak_counts);
        problems.unless(fits, "peak_counts", spot.peak_counts, "0 to 1e9 counts");
        problems.within("gaussian").finish(Error::Malformed)?;
        Ok(GaussianRenderer {
            settings: settings.clone(),
            spot,
            scaling: SpotScaling::new(spot, settings.gain),
            instructions: InstructionSet::best(),
            spots: BufferPool::default(),
            sums: BufferPool::default(),
        })
    }

    /// The same renderer using the given instruction set; its light is bit-identical.
    pub fn with_instruction_set(self, instructions: InstructionSet) -> Self {
        GaussianRenderer { instructions, ..self }
    }

    /// The spot parameters.
    pub fn spot(&self) -> GaussianSpot {
        self.spot
    }

    /// e^-2 diameter of the image of a particle, px.
    pub fn diameter_px(&self, particle: &Particle) -> f64 {
        self.spot.diameter_px * self.spot.reference_um.map_or(1.0, |reference| particle.d_um / reference)
    }

    /// Columns and rows of the sensor.
    fn sensor(&self) -> (u32, u32) {
        (self.settings.pixel_dim_x, self.settings.pixel_dim_y)
    }

    fn window(&self, particle: &Particle) -> Window {
        Window::around(particle.x_px, particle.y_px, self.image_extent(particle), self.sensor())
    }

    fn spots(&self, particles: &[Particle]) -> Footprints<'_> {
        Footprints::new(particles, self.scaling, self.sensor(), self.instructions, &self.spots)
    }

    /// Computes the light of the rows from `first` on.
    fn band(&self, spots: &Footprints<'_>, first: usize, pixels: &mut [f64]) {
        checkpoint();
        let width = self.settings.pixel_dim_x as usize;
        self.instructions.dispatch(Band { spots, width, first, pixels, pool: &self.sums });
    }

    /// The light of all particles of one image. At each pixel they are summed in the order of the first rows
    /// of their footprints, in steps of 8 px, then in the order of the list.
    pub fn draw(&self, particles: &[Particle]) -> Light {
        let mut light = Light::dark(&self.settings);
        let spots = self.spots(particles);
        // Bands of pixels, not particles, are distributed to threads, so that sums do not depend on the
        // number of threads.
        let bands = light.values.par_chunks_mut(BAND * light.width as usize);
        bands.enumerate().for_each(|(band, pixels)| self.band(&spots, band * BAND, pixels));
        light
    }
}

impl Render for GaussianRenderer {
    fn traits(&self) -> Traits {
        Traits {
            name: "gaussian",
            depends_on_depth: false,
            has_ray_noise: false,
            is_diffracted: false,
            is_round: true,
            spheroid_law: None,
        }
    }

    fn description(&self) -> Description {
        let GaussianSpot { diameter_px, reference_um, peak_counts } = self.spot;
        let of = reference_um.map(|d| format!(" for particles of {d} um, others in proportion"));
        Description {
            optics: format!(
                "M {}; Gaussian spots, e^-2 diameter {diameter_px} px{}, peak {peak_counts} counts times c_int",
                self.settings.magnification,
                of.unwrap_or_default()
            ),
            method: "integrates a Gaussian spot over the pixels around each particle, whatever its depth. `settings.txt` and \
                     `particles/` tell sensor and places in MicroSIG's formats, but MicroSIG would make other images of \
                     them, out of focus",
        }
    }

    fn light(&self, particles: &[Particle], _: &Streams, _: Purpose, _: u32) -> Light {
        self.draw(particles)
    }

    /// Faster than an exposure of the light, because light is computed and exposed band by band.
    fn image(&self, particles: &[Particle], sensor: &Sensor, random: ImageStreams<'_>) -> Image {
        let spots = self.spots(particles);
        sensor.expose_bands(
            self.sensor(),
            BAND,
            random.streams,
            random.noise,
            random.frame,
            |first, pixels| self.band(&spots, first, pixels),
        )
    }

    fn settings(&self) -> &Settings {
        &self.settings
    }

    fn check(&self, particle: &Particle) -> Result<Option<String>, Error> {
        if particle.elongated().is_some() {
            return Err(Error::Unsupported("spheroids: Gaussian spots are round; use rays".to_owned()));
        }
        let diameter_px = self.diameter_px(particle);
        if diameter_px > 1000.0 {
            let message = format!("d_p = {} um has a spot of {diameter_px} px; at most 1000", particle.d_um);
            return Err(Error::Unsupported(message));
        }
        Ok(None)
    }

    fn image_extent(&self, particle: &Particle) -> (f64, f64) {
        let diameter = self.scaling.diameter(particle.d_um as f32);
        let reach = f64::from(self.scaling.reach(diameter, particle.c_int as f32));
        (reach, reach)
    }

    fn patch_window(&self, particle: &Particle) -> Window {
        self.window(particle)
    }

    fn reaches_sensor(&self, particle: &Particle) -> bool {
        Window::is_lit(particle.x_px, particle.y_px, self.image_extent(particle), self.sensor())
    }

    fn mean_patch(&self, particle: &Particle) -> Option<ExpectedPatch> {
        let window = self.window(particle);
        if window.area() == 0 {
            return None;
        }
        let diameter = self.scaling.diameter(particle.d_um as f32);
        let per_px = f64::from((2.0 * std::f32::consts::SQRT_2) / diameter);
        let light = f64::from(self.scaling.light(diameter, particle.c_int as f32));
        let across = accumulate::shares(window.x0 as f64 - 0.5 - particle.x_px, window.width, per_px);
        let down = accumulate::shares(window.y0 as f64 - 0.5 - particle.y_px, window.height, per_px);
        let mut counts = Vec::with_capacity(window.area());
        for row_share in &down {
            let factor = light * row_share;
            counts.extend(across.iter().map(|column_share| factor * column_share));
        }
        Some(ExpectedPatch { window, counts })
    }
}

#[cfg(test)]
mod tests {
    use super::spot::NEGLIGIBLE;
    use super::*;

    const SPOT: GaussianSpot = GaussianSpot { diameter_px: 2.7, reference_um: None, peak_counts: 1000.0 };

    fn renderer(width: u32, height: u32, spot: GaussianSpot) -> GaussianRenderer {
        let settings =
            Settings { pixel_dim_x: width, pixel_dim_y: height, gain: 1.0, ..Settings::setting1() };
        GaussianRenderer::new(&settings, spot).unwrap()
    }

    /// The integral over the pixel in column `x` and row `y`, by libm.
    fn integral(spot: GaussianSpot, particle: &Particle, x: usize, y: usize) -> f64 {
        let sigma = spot.diameter_px / 4.0;
        let side = |pixel: usize, center: f64| {
            let at = |edge: f64| libm::erf((edge - center) / (sigma * std::f64::consts::SQRT_2));
            let pixel = pixel as f64 + 1.0;
            sigma * libm::sqrt(std::f64::consts::PI / 2.0) * (at(pixel + 0.5) - at(pixel - 0.5))
        };
        spot.peak_counts * particle.c_int * side(x, particle.x_px) * side(y, particle.y_px)
    }

    /// Every pixel of the sensor, near the spot and far from it, at the sensor edges, on sensors narrower
    /// than a tile and of several panels and bands, with profiles in f32 and in f64.
    #[test]
    fn pixels_hold_the_integral_of_the_spot() {
        for (width, height) in [(40, 30), (9, 7), (5, 3), (1, 1), (140, 150)] {
            for diameter_px in [0.3, 1.0, 2.7, 4.2, 7.0, 9.0, 11.9, 12.1, 40.0] {
                let spot = GaussianSpot { diameter_px, ..SPOT };
                let renderer = renderer(width, height, spot);
                let (right, bottom) = (f64::from(width), f64::from(height));
                let places = [(4.3, 2.8), (1.0, 1.0), (-0.4, 3.5), (right - 1.1, bottom + 0.4), (right, 1.5)];
                // Across the edge of two panels, and of two bands.
                for (x, y) in places.into_iter().chain([(64.2, 127.9), (62.7, 129.3)]) {
                    let particle = Particle { c_int: 0.8, ..Particle::sphere(x, y, 50.0, 2.0) };
                    let light = renderer.draw(&[particle]);
                    for (k, &value) in light.values.iter().enumerate() {
                        let expected = integral(spot, &particle, k % width as usize, k / width as usize);
                        // Skipped pixels would receive less than NEGLIGIBLE; the others are accurate to 5e-6
                        // of the peak.
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

    /// The total light of a spot is pi d^2 / 8 times its peak, in closed form.
    #[test]
    fn a_spot_holds_its_light_wherever_it_lies_in_a_pixel() {
        let renderer = renderer(41, 41, SPOT);
        let all = std::f64::consts::PI * SPOT.diameter_px * SPOT.diameter_px / 8.0 * SPOT.peak_counts;
        for step in 0..20 {
            let shift = f64::from(step) / 20.0;
            let light = renderer.draw(&[Particle::sphere(21.0 + shift, 21.0 - 0.7 * shift, 0.0, 1.0)]);
            let total: f64 = light.values.iter().sum();
            // Neglected: the tails beyond exp(-8 r^2 / d^2) = 0.05 / 1000 along both axes.
            assert!((total / all - 1.0).abs() < 5e-5, "{total} {all}");
            let x: f64 = light.values.iter().enumerate().map(|(k, v)| (k % 41 + 1) as f64 * v).sum();
            // The window ends at whole pixels, which shifts the centroid by less than the neglected light.
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
        let light = renderer.draw(&particles);
        for set in InstructionSet::available() {
            assert!(light == renderer.clone().with_instruction_set(set).draw(&particles), "{set}");
        }
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            assert!(light == pool.install(|| renderer.draw(&particles)), "{threads} threads");
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
            let random = ImageStreams { streams: &streams, rays: Purpose::Rays, noise, frame: 2 };
            let image = renderer.image(&particles, &sensor, random);
            assert!(image == sensor.expose(&renderer.draw(&particles), &streams, noise, 2));
            assert!(image.counts.values().any(|count| count > 500.0));
        }
    }

    #[test]
    fn spots_follow_the_diameter_of_their_particle_if_asked_to() {
        let spot = GaussianSpot { reference_um: Some(2.0), ..SPOT };
        let (small, large) = (Particle::sphere(9.0, 9.0, 0.0, 1.0), Particle::sphere(9.0, 9.0, 0.0, 4.0));
        let renderer = renderer(17, 17, spot);
        assert_eq!((renderer.diameter_px(&small), renderer.diameter_px(&large)), (1.35, 5.4));
        assert!(renderer.image_extent(&small).0 < renderer.image_extent(&large).0);
    }

    #[test]
    fn wrong_spots_and_spheroids_are_refused() {
        let spot = GaussianSpot { diameter_px: 0.0, reference_um: Some(-1.0), peak_counts: f64::NAN };
        let message = GaussianRenderer::new(&Settings::setting1(), spot).unwrap_err().to_string();
        assert_eq!(message.lines().count(), 3, "{message}");
        let rod = crate::Spheroid::from_axis(3.0, [1.0, 0.0, 0.0]);
        let rod = Particle { spheroid: Some(rod), ..Particle::sphere(1.0, 1.0, 0.0, 2.0) };
        assert!(renderer(10, 10, SPOT).check(&rod).is_err());
    }
}
