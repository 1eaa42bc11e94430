//! A model of the optics of a recording: a scenario, such as `microsig fit` writes, and where its focus lies
//! on the axis of the stage.
//!
//! The model has its own z = 0, the stage another one. The distance between them is that at which the images
//! of the model correlate best with the central calibration stack.

use generator::dataset::manifest::{self, wave_facts};
use microsig_core::render::Context;
use microsig_core::{Particle, Settings};
use rayon::prelude::*;
use scenario::Scenario;
use storage::InputFile;
use storage::dataset::manifest::{OpticsFacts, WaveFacts};
use storage::error::{Error, Result};
use storage::progress::Bar;
use tracking::GrayImage;

use super::stacks::Stacks;

/// Images of the model per step of the scan.
const PER_STEP: usize = 4;

/// How far beyond the ends of the scan the model is computed, as a share of its length.
const BEYOND: f64 = 0.25;

/// Error of its images relative to their peaks: a correlation hardly depends on it, the time very much.
const TOLERANCE: f64 = 0.02;

/// Least correlation of model and stack: below the first an error, below the second a warning.
const LEAST: (f64, f64) = (0.6, 0.95);

/// By how much the correlation of the other direction of the stage must be better for a warning.
const REVERSED: f64 = 0.01;

pub(crate) struct Optics {
    scenario: Scenario,
    file: String,
}

/// The model at its place on the axis of the stage.
pub(crate) struct Model {
    pub(crate) waves: Option<WaveFacts>,
    pub(crate) optics: Option<OpticsFacts>,
    pub(crate) renderer: &'static str,
    pub(crate) description: String,
    /// Settings with a sensor of the size of the calibration images.
    pub(crate) settings: Settings,
    pub(crate) d_um: f64,
    pub(crate) depth_factor: f64,
    /// Stage position of the model's z = 0, um.
    pub(crate) zero_um: f64,
    correlation: f64,
    /// The best correlation if the stage moved the other way.
    reversed: f64,
}

impl Optics {
    pub(crate) fn read(file: &InputFile, context: &Context) -> Result<Self> {
        Ok(Optics { scenario: scenario::load(file, &[], None, context)?, file: file.display().to_string() })
    }

    /// Edge of a pixel in object space, um.
    pub(crate) fn um_per_px(&self) -> f64 {
        self.scenario.scale.um_per_px()
    }

    /// Finds the place of the model on the axis of the stage.
    pub(crate) fn at(&self, made: &Stacks, spinner: &Bar) -> Result<Model> {
        spinner.set_message("comparing the optics with the scan");
        let scenario = &self.scenario;
        let depth_factor = scenario.depth_factor();
        let [_, d_um, _] = scenario.diameters_um();
        let stack = &made.central().images;
        let side = stack[0].width as u32;
        let settings = Settings { pixel_dim_x: side, pixel_dim_y: side, ..scenario.settings.clone() };
        let (low, high) = (made.depths_um[0], made.depths_um[made.depths_um.len() - 1]);
        let step = (high - low) / (made.depths_um.len() - 1) as f64 / PER_STEP as f64;
        let reach = BEYOND * (high - low);
        let n = ((high - low + 2.0 * reach) / step) as usize + 1;
        let first = low - reach;
        let renderer =
            scenario.spec.renderer().with_derivatives(TOLERANCE).build(&settings, &scenario.context)?;
        let middle = f64::from(side / 2 + 1);
        let at = |k: usize| Particle::sphere(middle, middle, (first + step * k as f64) / depth_factor, d_um);
        let particles: Vec<Particle> = (0..n).map(at).collect();
        renderer.prepare(&[&particles]);
        let images: Vec<Vec<f64>> =
            particles.par_iter().map(|particle| renderer.mean_light(particle).values).collect();
        // Model depth = stage position - zero: candidates for zero are whole steps.
        let most = (reach / step) as isize;
        let correlations = |direction: f64| -> Vec<f64> {
            let at = |shift: isize| {
                let place = |z: f64| ((direction * z - first) / step - shift as f64).round();
                correlation(stack, made.depths_um.iter().map(|z| images.get(place(*z) as usize)))
            };
            (-most..=most).into_par_iter().map(at).collect()
        };
        let (place, correlation) = best(&correlations(1.0));
        // Turned around the middle of the scan.
        let (_, reversed) = best(&correlations(-1.0));
        if correlation.is_nan() || correlation < LEAST.0 {
            return Err(Error::input(format!(
                "{}: images of these optics correlate with the scan by {correlation:.2} at best; expected at least {}; \
                 `microsig fit` finds the optics of a scan",
                self.file, LEAST.0
            )));
        }
        Ok(Model {
            waves: wave_facts(scenario, None),
            renderer: scenario.renderer.name(),
            optics: manifest::optics(scenario),
            description: scenario.renderer.description().optics,
            settings,
            d_um,
            depth_factor,
            zero_um: step * (place - most as f64),
            correlation,
            reversed,
        })
    }
}

impl Model {
    /// Depth of the model in its own coordinate, as in data files, at a position of the stage, um.
    pub(crate) fn depth_um(&self, stage_um: f64) -> f64 {
        (stage_um - self.zero_um) / self.depth_factor
    }

    /// A warning about a model that differs from the scan.
    pub(crate) fn warning(&self) -> Option<String> {
        if self.reversed > self.correlation + REVERSED {
            return Some(format!(
                "the optics correlate with the scan by {:.3}, and by {:.3} if the stage moves the other way; check its direction",
                self.correlation, self.reversed
            ));
        }
        (self.correlation < LEAST.1)
            .then(|| format!("the optics correlate with the scan by {:.3} (1 is perfect)", self.correlation))
    }
}

/// Correlation of a stack with images of a model, of which none may be missing.
fn correlation<'m>(stack: &[GrayImage], model: impl Iterator<Item = Option<&'m Vec<f64>>>) -> f64 {
    let (mut own, mut both, mut seen) = (0.0, 0.0, 0.0);
    for (image, model) in stack.iter().zip(model) {
        let Some(model) = model else { return f64::NEG_INFINITY };
        for (count, light) in image.counts.iter().zip(model) {
            let count = f64::from(*count);
            own += light * light;
            both += light * count;
            seen += count * count;
        }
    }
    both / libm::sqrt(own * seen)
}

/// Fractional index and value of the maximum, by a parabola.
fn best(values: &[f64]) -> (f64, f64) {
    let Some((k, most)) = values.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1)) else {
        return (0.0, f64::NAN);
    };
    let around = k.checked_sub(1).and_then(|before| Some((*values.get(before)?, *values.get(k + 1)?)));
    let part = around.map_or(0.0, |(before, after)| 0.5 * (before - after) / (before - 2.0 * most + after));
    (k as f64 + if part.is_finite() { part } else { 0.0 }, most)
}
