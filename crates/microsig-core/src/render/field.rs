//! Particles seen through optics that vary over the field, and images blurred by the detector: what all
//! renderers have in common.
//!
//! A particle is drawn where the optics put it: [`FieldOptics::apparent`]. Wave optics blur the light itself;
//! other renderers' counts are blurred pixel by pixel.

use super::gradient::Gradient;
use super::interface::{Description, ImageStreams, Render, Tables, Traits};
use super::patch::{ExpectedPatch, Window};
use super::renderer::Renderer;
use super::tables::TablesState;
use crate::error::Error;
use crate::optics::FieldOptics;
use crate::particle::Particle;
use crate::sensor::{Image, Light, Sensor};
use crate::settings::Settings;
use crate::stream::{Purpose, Streams};

/// A renderer behind optics that vary over the field, with a detector that blurs.
#[derive(Debug)]
pub(super) struct FieldRenderer {
    inner: Renderer,
    field: FieldOptics,
    blur: Option<Blur>,
}

/// Steps for the derivatives of apparent positions: px, px, um.
const STEPS: [f64; 3] = [1.0, 1.0, 0.1];

impl FieldRenderer {
    /// `blur_um`: standard deviation in the particles' space, 0 if the inner renderer blurs.
    pub(super) fn new(inner: Renderer, field: FieldOptics, blur_um: f64) -> FieldRenderer {
        let Settings { magnification, pixel_size, .. } = *inner.settings();
        let blur = (blur_um > 0.0).then(|| Blur::new(blur_um * magnification / pixel_size));
        FieldRenderer { inner, field, blur }
    }

    fn apparent(&self, particle: &Particle) -> Particle {
        self.field.apparent(self.inner.settings(), particle)
    }

    fn all(&self, particles: &[Particle]) -> Vec<Particle> {
        particles.iter().map(|particle| self.apparent(particle)).collect()
    }

    /// A window with the margin that blur needs, within the sensor.
    fn widened(&self, window: Window) -> Window {
        let Some(blur) = self.blur.as_ref().filter(|_| window.area() > 0) else { return window };
        let reach = blur.reach() as i64;
        let Settings { pixel_dim_x, pixel_dim_y, .. } = *self.inner.settings();
        let along = |first: i64, length: usize, size: u32| {
            let from = (first - reach).max(1);
            (from, ((first + length as i64 - 1 + reach).min(i64::from(size)) - from + 1) as usize)
        };
        let (x0, width) = along(window.x0, window.width, pixel_dim_x);
        let (y0, height) = along(window.y0, window.height, pixel_dim_y);
        Window { x0, y0, width, height }
    }

    fn blurred_patch(&self, patch: ExpectedPatch) -> ExpectedPatch {
        let Some(blur) = &self.blur else { return patch };
        let window = self.widened(patch.window);
        let counts = blur.spread(&patch.counts, patch.window, window);
        ExpectedPatch { window, counts }
    }

    fn blurred(&self, mut light: Light) -> Light {
        if let Some(blur) = &self.blur {
            let Settings { pixel_dim_x, pixel_dim_y, .. } = *self.inner.settings();
            let window = Window { x0: 1, y0: 1, width: pixel_dim_x as usize, height: pixel_dim_y as usize };
            light.values = blur.spread(&light.values, window, window);
        }
        light
    }
}

impl Render for FieldRenderer {
    fn traits(&self) -> Traits {
        self.inner.traits()
    }

    fn settings(&self) -> &Settings {
        self.inner.settings()
    }

    fn description(&self) -> Description {
        let inner = self.inner.description();
        let varying = if self.field == FieldOptics::default() { "" } else { ", varying over the field" };
        let blurred = if self.blur.is_some() { ", blurred by the detector" } else { "" };
        Description { optics: format!("{}{varying}{blurred}", inner.optics), ..inner }
    }

    fn check(&self, particle: &Particle) -> Result<Option<String>, Error> {
        self.inner.check(&self.apparent(particle))
    }

    fn warning(&self) -> Option<String> {
        let noise = (self.blur.is_some() && self.inner.has_ray_noise()).then(|| {
            "blur_um with `mode: rays` also blurs the noise of rays (mode: expected with sensor: (shot_noise: true) has \
             the noise of a camera)"
                .to_owned()
        });
        let warnings: Vec<String> = [self.inner.warning(), noise].into_iter().flatten().collect();
        (!warnings.is_empty()).then(|| warnings.join("; "))
    }

    fn image_extent(&self, particle: &Particle) -> (f64, f64) {
        let apparent = self.apparent(particle);
        let (x, y) = self.inner.image_extent(&apparent);
        let margin = self.blur.as_ref().map_or(0.0, |blur| blur.reach() as f64);
        let moved = [apparent.x_px - particle.x_px, apparent.y_px - particle.y_px].map(f64::abs);
        (x + moved[0] + margin, y + moved[1] + margin)
    }

    fn patch_window(&self, particle: &Particle) -> Window {
        self.widened(self.inner.patch_window(&self.apparent(particle)))
    }

    fn reaches_sensor(&self, particle: &Particle) -> bool {
        self.inner.reaches_sensor(&self.apparent(particle))
    }

    fn accepted_light(&self, particle: &Particle) -> Option<f64> {
        let apparent = self.apparent(&Particle { c_int: 1.0, ..*particle });
        Some(apparent.c_int * self.inner.accepted_light(&apparent)?)
    }

    fn tables(&self) -> Option<&dyn Tables> {
        self.inner.tables().map(|_| self as &dyn Tables)
    }

    fn light(&self, particles: &[Particle], streams: &Streams, purpose: Purpose, frame: u32) -> Light {
        self.blurred(self.inner.light(&self.all(particles), streams, purpose, frame))
    }

    fn image(&self, particles: &[Particle], sensor: &Sensor, random: ImageStreams<'_>) -> Image {
        if self.blur.is_none() {
            return self.inner.image(&self.all(particles), sensor, random);
        }
        let light = self.light(particles, random.streams, random.rays, random.frame);
        sensor.expose(&light, random.streams, random.noise, random.frame)
    }

    fn mean_light(&self, particle: &Particle) -> Light {
        self.blurred(self.inner.mean_light(&self.apparent(particle)))
    }

    fn mean_patch(&self, particle: &Particle) -> Option<ExpectedPatch> {
        Some(self.blurred_patch(self.inner.mean_patch(&self.apparent(particle))?))
    }

    /// Derivatives with respect to the particle's own position: where the optics put it depends on its depth.
    fn gradient(&self, particle: &Particle, window: Option<Window>) -> Option<Gradient> {
        let particle = Particle { c_int: 1.0, ..*particle };
        let apparent = self.apparent(&particle);
        let wide = match (&self.blur, window) {
            // The light around the window is spread into it.
            (Some(blur), Some(window)) => Some(window.grown(blur.reach())),
            _ => window,
        };
        let inner = self.inner.gradient(&apparent, wide)?;
        // By particle coordinate: apparent x, y and z.
        let jacobian: [[f64; 3]; 3] = std::array::from_fn(|axis| {
            let moved = |by: f64| {
                let mut moved = particle;
                *[&mut moved.x_px, &mut moved.y_px, &mut moved.z_um][axis] += by;
                let at = self.apparent(&moved);
                [at.x_px, at.y_px, at.z_um]
            };
            let (low, high) = (moved(-STEPS[axis]), moved(STEPS[axis]));
            std::array::from_fn(|i| (high[i] - low[i]) / (2.0 * STEPS[axis]))
        });
        let chain_rule = |[value, x, y, z]: &[f64; 4]| {
            let by = jacobian.map(|[by_x, by_y, by_z]| apparent.c_int * (by_x * x + by_y * y + by_z * z));
            [apparent.c_int * value, by[0], by[1], by[2]]
        };
        let mut pixels: Vec<[f64; 4]> = inner.pixels.iter().map(chain_rule).collect();
        let mut seen = inner.window;
        if let Some(blur) = &self.blur {
            seen = window.unwrap_or_else(|| self.widened(inner.window));
            let parts: [Vec<f64>; 4] = std::array::from_fn(|part| {
                let values: Vec<f64> = pixels.iter().map(|pixel| pixel[part]).collect();
                blur.spread(&values, inner.window, seen)
            });
            pixels = (0..seen.area()).map(|i| std::array::from_fn(|part| parts[part][i])).collect();
        }
        Some(Gradient { window: seen, pixels })
    }
}

impl Tables for FieldRenderer {
    fn missing(&self, particles: &[Particle]) -> usize {
        self.inner.missing_tables(&self.all(particles))
    }

    fn prepare(&self, particles: &[&[Particle]]) {
        let all: Vec<Vec<Particle>> = particles.iter().map(|particles| self.all(particles)).collect();
        self.inner.prepare(&all.iter().map(Vec::as_slice).collect::<Vec<_>>());
    }

    fn state(&self) -> TablesState {
        self.inner.tables().map_or(TablesState { count: 0, bytes: 0, error: 0.0 }, Tables::state)
    }

    fn shortfall(&self) -> Result<Option<String>, Error> {
        self.inner.shortfall()
    }
}

/// A Gaussian blur of counts on pixels.
#[derive(Debug, Clone)]
struct Blur {
    /// Weights of the pixel itself and those farther and farther away on one side; all sum to 1.
    kernel: Vec<f64>,
}

impl Blur {
    /// With this standard deviation of the weights, px.
    fn new(sd_px: f64) -> Blur {
        let variance = sd_px * sd_px;
        // The integral of a Gaussian over a pixel has the variances of Gaussian and pixel.
        let own = variance - 1.0 / 12.0;
        let kernel = if own < 0.3 {
            vec![1.0 - variance, 0.5 * variance]
        } else {
            let scale = 1.0 / libm::sqrt(2.0 * own);
            let last = libm::ceil(4.5 * sd_px) as usize;
            let step =
                |i: usize| 0.5 * (libm::erf((i as f64 + 0.5) * scale) - libm::erf((i as f64 - 0.5) * scale));
            (0..=last).map(step).collect()
        };
        let sum = kernel[0] + 2.0 * kernel[1..].iter().sum::<f64>();
        Blur { kernel: kernel.into_iter().map(|weight| weight / sum).collect() }
    }

    /// Distance in pixels to which a count is spread.
    fn reach(&self) -> usize {
        self.kernel.len() - 1
    }

    /// Values on one window, spread to the pixels of another.
    fn spread(&self, values: &[f64], from: Window, to: Window) -> Vec<f64> {
        let (left, above) = ((to.x0 - from.x0) as isize, (to.y0 - from.y0) as isize);
        let mut rows = vec![0.0; from.height * to.width];
        for (out, line) in rows.chunks_exact_mut(to.width.max(1)).zip(values.chunks_exact(from.width.max(1)))
        {
            for (i, out) in out.iter_mut().enumerate() {
                *out = self.weighed(i as isize + left, |at| line.get(at).copied());
            }
        }
        let mut spread = vec![0.0; to.area()];
        for (row, out) in spread.chunks_exact_mut(to.width.max(1)).enumerate() {
            for (i, out) in out.iter_mut().enumerate() {
                let column = |at: usize| rows.get(at * to.width + i).copied();
                *out = self.weighed(row as isize + above, column);
            }
        }
        spread
    }

    fn weighed(&self, at: isize, value: impl Fn(usize) -> Option<f64>) -> f64 {
        let at_offset = |offset: isize| usize::try_from(at + offset).ok().and_then(&value).unwrap_or(0.0);
        let sides = self.kernel[1..].iter().zip(1..);
        sides.fold(self.kernel[0] * at_offset(0), |sum, (weight, i)| {
            sum + weight * (at_offset(-i) + at_offset(i))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blur_conserves_light_and_has_its_variance() {
        for sd_px in [0.1, 0.25, 0.3, 0.5, 0.9, 2.3] {
            let blur = Blur::new(sd_px);
            let from = Window { x0: 20, y0: 20, width: 1, height: 1 };
            let to = from.grown(blur.reach());
            let spread = blur.spread(&[3.0], from, to);
            let middle = blur.reach() as f64;
            let sum: f64 = spread.iter().sum();
            let moment = |i: usize| {
                let at = (i % to.width) as f64 - middle;
                at * at
            };
            let variance = spread.iter().enumerate().map(|(i, v)| v * moment(i)).sum::<f64>() / sum;
            assert!((sum - 3.0).abs() < 1e-12, "{sd_px}: {sum}");
            assert!((libm::sqrt(variance) / sd_px - 1.0).abs() < 2e-4, "{sd_px}: {}", libm::sqrt(variance));
        }
    }
}
