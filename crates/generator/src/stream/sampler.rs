//! Computes samples and caches what many of them share: resolved scenarios, tables of the optics.

use std::sync::{Mutex, MutexGuard, PoisonError};

use flows::Frame;
use microsig_core::Settings;
use microsig_core::render::expected::DEFAULT_TOLERANCE;
use microsig_core::render::{ImageStreams, Renderer, RendererSpec};
use microsig_core::sensor::{Light, Sensor};
use microsig_core::stream::Purpose;

use super::StreamOptions;
use super::distribution::Drawn;
use super::labels::{FirstFrame, FlowField, Sample, frame_labels};
use crate::dataset::truth::Viewer;
use crate::runner::Frames;
use microsig_core::visibility::NoiseFree;
use scenario::Scenario;
use storage::error::Result;

/// Maximum number of cached optics; optics that vary continuously are not reused.
pub(super) const MAX_OPTICS: usize = 8;

/// Maximum number of cached scenarios; each thread that computes a sample takes one.
const MAX_SCENARIOS: usize = 64;

/// Renderers and images that depend only on the optics.
#[derive(Debug, Clone)]
struct Optics {
    key: Key,
    renderer: Renderer,
    /// Renders the noise-free light, if requested.
    clean: Option<Renderer>,
    /// Images of single particles, if labels need them.
    single: Option<NoiseFree>,
}

/// Everything that a renderer and its images depend on.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Key {
    settings: Settings,
    renderer: RendererSpec,
    depth_factor: f64,
    diameters_um: (f64, f64),
    depths_um: (f64, f64),
}

impl Key {
    pub(super) fn of(scenario: &Scenario) -> Self {
        let sizes = scenario.seeding.diameters();
        let gaussian = scenario.spec.optics.gaussian.is_some();
        let gain = if gaussian { scenario.settings.gain } else { 1.0 };
        Key {
            // Background, noise and gain of the sensor do not affect the light.
            settings: Settings {
                background_mean: 0.0,
                background_noise: 0.0,
                gain,
                ..scenario.settings.clone()
            },
            renderer: scenario.spec.renderer(),
            depth_factor: scenario.depth_factor(),
            diameters_um: (sizes.min(), sizes.max()),
            depths_um: (scenario.domain.region().min().z, scenario.domain.region().max().z),
        }
    }
}

/// A resolved scenario that is reused for samples that differ only in replaceable values.
#[derive(Debug)]
struct Prototype {
    scenario: Scenario,
    optics: Optics,
    /// The values that cannot be replaced, as text; `None` for the others.
    fixed: Vec<Option<String>>,
    flow: Option<FlowField>,
}

/// Computes samples with cached scenarios and optics.
#[derive(Debug, Default)]
pub(super) struct Sampler {
    prototypes: Mutex<Vec<Prototype>>,
    optics: Mutex<Vec<Optics>>,
}

impl Sampler {
    /// Computes the sample with an index and seed; `resolve` returns its scenario.
    pub(super) fn sample(
        &self,
        options: &StreamOptions,
        (index, seed): (u64, u64),
        values: &[(&str, Drawn)],
        resolve: impl FnOnce() -> Result<Scenario>,
    ) -> Result<Sample> {
        let mut prototype = match self.find(values) {
            Some(mut prototype) => {
                prototype.scenario.reseed(seed);
                for (path, value) in values {
                    if let Some(number) = replaceable(&prototype.scenario, path, value) {
                        prototype.scenario.replace(path, number)?;
                    }
                }
                prototype
            }
            None => self.prototype(options, values, resolve()?)?,
        };
        let sample = draw(options, index, &mut prototype)?;
        let mut prototypes = self.prototypes.lock().unwrap_or_else(PoisonError::into_inner);
        if prototypes.len() >= MAX_SCENARIOS {
            prototypes.remove(0);
        }
        prototypes.push(prototype);
        Ok(sample)
    }

    fn optics(&self) -> MutexGuard<'_, Vec<Optics>> {
        self.optics.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn find(&self, values: &[(&str, Drawn)]) -> Option<Prototype> {
        let mut prototypes = self.prototypes.lock().unwrap_or_else(PoisonError::into_inner);
        let fits = |prototype: &Prototype| prototype.fixed == fixed(&prototype.scenario, values);
        let found = prototypes.iter().rposition(fits)?;
        Some(prototypes.swap_remove(found))
    }

    fn prototype(
        &self,
        options: &StreamOptions,
        values: &[(&str, Drawn)],
        mut scenario: Scenario,
    ) -> Result<Prototype> {
        let key = Key::of(&scenario);
        let known = self.optics().iter().find(|optics| optics.key == key).cloned();
        let optics = match known {
            Some(optics) => optics,
            None => {
                // Without holding the lock: while tables are computed in parallel, this thread may start on
                // another sample.
                let clean = options.labels.clean.then(|| scenario.without_ray_noise(DEFAULT_TOLERANCE));
                let clean = clean.transpose()?;
                let single = options.labels.needs_single_images().then(|| match &clean {
                    // Both share the tables.
                    Some(clean) if scenario.renderer.has_ray_noise() => {
                        NoiseFree::new(scenario.renderer.clone(), Some(clean.clone()))
                    }
                    _ => scenario.noise_free(),
                });
                let made = Optics { renderer: scenario.renderer.clone(), clean, single, key };
                let mut all = self.optics();
                if all.len() >= MAX_OPTICS {
                    all.remove(0);
                }
                all.push(made.clone());
                made
            }
        };
        scenario.renderer = optics.renderer.clone();
        let fixed = fixed(&scenario, values);
        Ok(Prototype { scenario, optics, fixed, flow: None })
    }
}

/// The values that cannot be replaced in a scenario.
fn fixed(scenario: &Scenario, values: &[(&str, Drawn)]) -> Vec<Option<String>> {
    let is_fixed = |path: &str, value: &Drawn| replaceable(scenario, path, value).is_none();
    values.iter().map(|(path, value)| is_fixed(path, value).then(|| value.text.clone())).collect()
}

/// The number that can replace the value at a path; `None` for another key, and for a value that is no number, such as
/// the default of an optional key.
fn replaceable(scenario: &Scenario, path: &str, value: &Drawn) -> Option<f64> {
    value.number.filter(|_| scenario.can_replace(path))
}

/// Computes the sample of a scenario.
fn draw(options: &StreamOptions, index: u64, prototype: &mut Prototype) -> Result<Sample> {
    let Prototype { scenario, optics, flow, .. } = prototype;
    let sensor = scenario.sensor()?;
    let (width, height) = (scenario.settings.pixel_dim_x, scenario.settings.pixel_dim_y);
    let viewer = Viewer { scenario, renderer: &optics.renderer };
    let frames: Vec<Frame> = Frames::new(scenario)?
        .without_velocities()
        .take(options.frames as usize)
        .collect::<Result<Vec<_>>>()?;
    let pixels = width as usize * height as usize;
    let mut sample = Sample { index, images: Vec::with_capacity(pixels * frames.len()), ..Sample::default() };
    for (number, frame) in frames.iter().enumerate() {
        let rendered = if number == 0 {
            let view = viewer.view(frame);
            let shot = FirstFrame {
                scenario,
                view: &view,
                frame,
                next: frames.get(1),
                single: optics.single.as_ref(),
                sensor: &sensor,
            };
            frame_labels(&options.labels, &shot, &mut sample);
            view.rendered
        } else {
            viewer.rendered(frame)
        };
        let random = ImageStreams {
            streams: &scenario.streams,
            rays: Purpose::Rays,
            noise: Purpose::BackgroundNoise,
            frame: frame.index,
        };
        let image = optics.renderer.image(&rendered, &sensor, random);
        sample.images.extend_from_slice(&image.counts.whole());
        if let Some(clean) = &optics.clean {
            let light = clean.light(&rendered, &scenario.streams, Purpose::Rays, frame.index);
            expose(&sensor, &light, &mut sample.clean);
        }
    }
    if let (Some(wanted), [first, second, ..]) = (options.labels.flow, frames.as_slice()) {
        let wanted = (wanted, options.labels.flow_z);
        let interval = (first.t_s, second.t_s);
        if flow.as_ref().is_none_or(|known| known.interval != interval) {
            *flow = Some(FlowField::of(scenario, wanted, interval));
        }
        if let Some(known) = flow {
            sample.flow.extend_from_slice(&known.values);
        }
    }
    Ok(sample)
}

/// Appends the counts for the given light, without noise and before rounding.
fn expose(sensor: &Sensor, light: &Light, into: &mut Vec<f32>) {
    let show = |(pixel, light): (usize, &f64)| {
        let response = sensor.response(pixel);
        (response.background + response.slope * light).min(response.saturation_counts).max(0.0) as f32
    };
    into.extend(light.values.iter().enumerate().map(show));
}
