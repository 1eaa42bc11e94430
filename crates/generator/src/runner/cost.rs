//! Estimates the cost of a dataset before it is generated: frames, particles, time, memory, disk.
//!
//! Memory and disk are calculated from the sizes of buffers and files, rounded up. Time is measured: the
//! motion of two frames, and truth and images of some particles of the first frame.

use std::path::Path;
use std::time::Instant;

use flows::{Frame, Tracer};
use microsig_core::{Particle, emission};
use serde::Serialize;

use super::frames::{TRACERS_PER_THREAD, frames_per_batch};
use super::recording::Frames;
use crate::dataset::Camera;
use crate::dataset::manifest::bit_depth;
use crate::dataset::truth::Truth;
use scenario::{MotionSource, Scenario};
use storage::error::{Error, Result};
use storage::memory::{free_memory, size_text};

/// Cost of a dataset.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Cost {
    /// Number of frames.
    pub frames: u32,
    /// Mean number of particles per frame, including those outside the image.
    pub particles_per_frame: f64,
    /// Number of pixels of an image.
    pub pixels: u64,
    /// Number of threads that generate it.
    pub threads: usize,
    /// Duration, s; `None` if it was not measured.
    pub seconds: Option<f64>,
    /// Peak memory, bytes.
    pub memory_bytes: u64,
    /// Free memory, bytes; `None` if the system does not report it.
    pub memory_free_bytes: Option<u64>,
    /// Size of the dataset, bytes.
    pub disk_bytes: u64,
    /// Free disk space, bytes; `None` if the system does not report it.
    pub disk_free_bytes: Option<u64>,
}

/// Memory per pixel while a frame is generated, bytes: its light (f32), counts, its tile of the contact
/// sheet; if a detector blurs, the light three times (f64).
const BYTES_PER_PIXEL: u64 = 4 + 4 + 1;
const BYTES_PER_BLURRED_PIXEL: u64 = 24 + 4;

/// Memory per pixel of a part of a frame that is processed at a time, bytes, and the largest number of such
/// pixels: light of particles and their sum (f64).
const BYTES_PER_PIXEL_OF_PART: u64 = 8 + 8;
const PIXELS_OF_PART: u64 = 1 << 24;

/// Memory per tracer while a frame is generated, bytes, in addition to the tracer and its particle:
/// visibility, rows of tables and of the data file.
const BYTES_PER_ROW: u64 = 1_000;

/// Memory per source point of a particle whose rays are counted, bytes: its position, its azimuth, and its
/// rows in the tables of the kernel, which grow by doubling.
const BYTES_PER_POINT: u64 = 128;

/// Size on disk per tracer and frame, bytes, in tables and data file; measured on the shipped scenarios.
const BYTES_ON_DISK: f64 = 650.0;

/// Size on disk per node of `truth/field.csv`, bytes.
const BYTES_PER_NODE: u64 = 250;

/// Memory for the images of the frames that are generated at a time, bytes.
fn image_bytes(scenario: &Scenario) -> u64 {
    let pixels = u64::from(scenario.settings.pixel_dim_x) * u64::from(scenario.settings.pixel_dim_y);
    let is_blurred = scenario.spec.optics.blur_um.is_some();
    let per_pixel = if is_blurred { BYTES_PER_BLURRED_PIXEL } else { BYTES_PER_PIXEL };
    let at_a_time = rayon::current_num_threads().min(frames_per_batch(scenario));
    let of_frame = pixels * per_pixel + pixels.min(PIXELS_OF_PART) * BYTES_PER_PIXEL_OF_PART;
    of_frame * (at_a_time as u64).min(u64::from(scenario.recordings.frames()))
}

impl Cost {
    /// Calculates everything except the duration; `out` is the folder of the dataset.
    pub fn of(scenario: &Scenario, out: &Path) -> Result<Self> {
        let settings = &scenario.settings;
        let (frames, threads) = (scenario.recordings.frames(), rayon::current_num_threads());
        let pixels = u64::from(settings.pixel_dim_x) * u64::from(settings.pixel_dim_y);
        let particles_per_frame = match &scenario.motion {
            MotionSource::Field(field) => match scenario.seeding.listed_places() {
                Some(number) => number as f64,
                None => {
                    let (fluid, region) = (scenario.fluid(field.as_ref()), scenario.domain.region());
                    scenario.seeding.density(&fluid, 0.0)? * region.volume() * fluid.share(region, 0.0, 0.0)
                }
            },
            MotionSource::Tracks(tracks) => tracks.rows().len() as f64 / f64::from(frames.max(1)),
        };
        // Tracers are advanced, rendered and written in batches of this many frames.
        let batch = (TRACERS_PER_THREAD * threads) as f64 / particles_per_frame.max(1.0) + 1.0;
        let most = frames_per_batch(scenario).min(frames.max(1) as usize);
        let batch = batch.min(most as f64);
        let per_tracer = size_of::<Tracer>() as u64 + size_of::<Particle>() as u64 + BYTES_PER_ROW;
        let memory_bytes = image_bytes(scenario)
            + (2.0 * batch * particles_per_frame) as u64 * per_tracer
            + points(scenario) * BYTES_PER_POINT * threads as u64;
        let nodes =
            scenario.truth_grid().map_or(0, |n| (n.x_px.len() * n.y_px.len() * n.planes_um.len()) as u64);
        let image = pixels * u64::from(bit_depth(scenario).next_multiple_of(8)) / 8 + 512;
        let rows = (particles_per_frame * BYTES_ON_DISK) as u64;
        Ok(Cost {
            frames,
            particles_per_frame,
            pixels,
            threads,
            seconds: None,
            memory_bytes,
            memory_free_bytes: free_memory(),
            disk_bytes: u64::from(frames) * (image + rows) + nodes * BYTES_PER_NODE,
            disk_free_bytes: free_disk(out),
        })
    }

    /// Adds the duration of frames and images; calibration and tables of images come on top. Errors: a
    /// trajectory that cannot be integrated; settings that cannot be rendered.
    pub fn timed(self, scenario: &Scenario) -> Result<Self> {
        let camera = Camera::of_dataset(scenario, scenario.renderer.clone(), scenario.detector.as_ref())?;
        let truth = Truth::new(scenario, camera.renderer())?;
        self.timed_by(&FirstFrames::new(scenario)?, &truth, &camera)
    }

    /// [`Cost::timed`] with objects that a run has anyway.
    pub(super) fn timed_by(self, first: &FirstFrames, truth: &Truth<'_>, camera: &Camera) -> Result<Self> {
        let Some(frame) = &first.frame else { return Ok(self) };
        let tables = || truth.missing_tables(frame);
        let measure = |camera: &Camera| {
            ImageTime::measure(frame.tracers.len(), tables, |n| {
                let mut part = truth.frame(&some_of(frame, n), None)?;
                camera.image(&std::mem::take(&mut part.particles), frame.index);
                Ok(())
            })
        };
        let scenario = truth.scenario();
        let time = match share_of_rays(scenario) {
            None => measure(camera)?,
            // The time is a constant and a part that grows with the number of rays.
            Some(share) => {
                let few = measure(&with_share_of_rays(scenario, share / 4.0)?)?;
                let more = measure(&with_share_of_rays(scenario, share)?)?;
                let slope = (more.particle_s - few.particle_s).max(0.0) / (0.75 * share);
                ImageTime { particle_s: more.particle_s + slope * (1.0 - share), ..more }
            }
        };
        let images = time.seconds(f64::from(self.frames), self.particles_per_frame * f64::from(self.frames));
        Ok(Cost { seconds: Some(first.seconds * f64::from(self.frames) + images), ..self })
    }

    /// The cost as a sentence if it takes long.
    pub(super) fn warning(&self) -> Option<String> {
        self.seconds.filter(|s| *s > LONG_S).map(|_| self.text())
    }

    /// Checks that memory and disk space are sufficient. Errors: [`Error::Input`] with required and free
    /// bytes and the key to change.
    pub fn check_resources(&self, scenario: &Scenario) -> Result<()> {
        let mut problems = Vec::new();
        if let Some(free) = self.memory_free_bytes.filter(|free| self.memory_bytes > *free) {
            let settings = &scenario.settings;
            let (width, height) = (settings.pixel_dim_x, settings.pixel_dim_y);
            let margin_px = scenario.spec.boundaries.margin_px.unwrap_or(0.0);
            let size = f64::from(width.max(height));
            let key = if 2 * image_bytes(scenario) > self.memory_bytes {
                format!(
                    "optics.pixel_dim_x = {width} and optics.pixel_dim_y = {height}, or the number of threads"
                )
            } else if 2 * points(scenario) * BYTES_PER_POINT * self.threads as u64 > self.memory_bytes {
                format!("optics.points_per_pixel = {}, or the number of threads", settings.points_per_pixel)
            } else if margin_px > size {
                format!("boundaries.margin_px = {margin_px}")
            } else {
                "particles.number".to_owned()
            };
            problems.push(format!(
                "the dataset needs about {} of memory ({:.0} particles per frame), but only {} are free; reduce {key}",
                size_text(self.memory_bytes),
                self.particles_per_frame,
                size_text(free)
            ));
        }
        if let Some(free) = self.disk_free_bytes.filter(|free| self.disk_bytes > *free) {
            problems.push(format!(
                "the dataset needs about {} on disk ({} frames), but only {} are free; reduce the frames of timing.{}",
                size_text(self.disk_bytes),
                self.frames,
                size_text(free),
                scenario.recordings.timing().mode()
            ));
        }
        if problems.is_empty() { Ok(()) } else { Err(Error::Input(problems)) }
    }

    /// The cost as a sentence.
    pub fn text(&self) -> String {
        let free = |bytes: Option<u64>| bytes.map_or(String::new(), |b| format!(" of {} free", size_text(b)));
        let time = self.seconds.map_or(String::new(), |s| {
            format!(
                ", about {} without calibration stacks and truth over depth",
                duration_text(s, self.threads)
            )
        });
        format!(
            "{} frames with {:.1} particles each{time}; memory {}{}; disk {}{}",
            self.frames,
            self.particles_per_frame,
            size_text(self.memory_bytes),
            free(self.memory_free_bytes),
            size_text(self.disk_bytes),
            free(self.disk_free_bytes)
        )
    }
}

/// If the first frame takes longer, it is sufficient for an estimate, s.
const SLOW_S: f64 = 2.0;

/// Durations from this one on are announced, s.
const LONG_S: f64 = 60.0;

fn duration_text(s: f64, threads: usize) -> String {
    let (value, unit) = match s {
        s if s < 90.0 => (s, "s"),
        s if s < 5400.0 => (s / 60.0, "min"),
        s if s < 72.0 * 3600.0 => (s / 3600.0, "h"),
        s => (s / 86400.0, "days"),
    };
    format!("{value:.1} {unit} on {threads} threads")
}

/// The first frame of a dataset, and the time that it takes to place and move the particles of a frame, s.
pub(super) struct FirstFrames {
    frame: Option<Frame>,
    seconds: f64,
}

impl FirstFrames {
    /// Places the particles and, unless that alone takes long, follows them to the second frame.
    pub(super) fn new(scenario: &Scenario) -> Result<Self> {
        let start = Instant::now();
        let mut frames = Frames::new(scenario)?;
        let frame = frames.next().transpose()?;
        let is_slow = start.elapsed().as_secs_f64() > SLOW_S;
        let second = if is_slow { None } else { frames.next().transpose()? };
        let taken = 1 + second.iter().count();
        Ok(FirstFrames { frame, seconds: start.elapsed().as_secs_f64() / taken as f64 })
    }
}

/// Maximum number of rays of a particle in an image rendered for an estimate: about 0.1 s.
const SAMPLED_RAYS: f64 = 5e7;

/// Number of source points of the largest particle whose rays are counted; 0 for other renderers.
fn points(scenario: &Scenario) -> u64 {
    if !scenario.renderer.has_ray_noise() {
        return 0;
    }
    let largest = Particle::sphere(1.0, 1.0, 0.0, scenario.seeding.diameters().max());
    emission::surface_points(&scenario.settings, &largest) as u64
}

/// The fraction of the rays of a particle that is rendered for an estimate; `None`: all, because they are
/// few.
fn share_of_rays(scenario: &Scenario) -> Option<f64> {
    let rays = points(scenario) as f64 * f64::from(scenario.settings.n_rays);
    (rays > 2.0 * SAMPLED_RAYS).then(|| SAMPLED_RAYS / rays)
}

/// The scenario's camera with a fraction of the source points of each particle or, for particles with few
/// points, of the rays of each point.
fn with_share_of_rays(scenario: &Scenario, share: f64) -> Result<Camera> {
    /// Fewer would not sample the aperture evenly.
    const LEAST_POINTS: f64 = 500.0;
    let mut settings = scenario.settings.clone();
    let point_share = share.max((LEAST_POINTS / points(scenario) as f64).min(1.0));
    settings.points_per_pixel *= point_share;
    settings.n_rays = ((f64::from(settings.n_rays) * share / point_share) as u32).max(1);
    let renderer = scenario.spec.renderer().build(&settings, &scenario.context)?;
    Camera::of_dataset(scenario, renderer, scenario.detector.as_ref())
}

/// About `n` tracers of a frame, evenly spread over all.
fn some_of(frame: &Frame, n: usize) -> Frame {
    let step = frame.tracers.len().checked_div(n).unwrap_or(0);
    let at = |n: usize| (0..n).map(|k| k * step);
    Frame {
        tracers: at(n).filter_map(|k| frame.tracers.get(k).cloned()).collect(),
        streaks: at(n).filter_map(|k| frame.streaks.get(k).cloned()).collect(),
        ..*frame
    }
}

/// Rendering time on one thread: a part per image, a part per particle, and the tables that all images
/// share.
pub(super) struct ImageTime {
    empty_s: f64,
    particle_s: f64,
    tables_s: f64,
}

/// Number of particles whose images are timed first.
const TIMED: usize = 16;

/// A duration that can be measured, s.
const MEASURABLE_S: f64 = 0.02;

impl ImageTime {
    /// Measures with `draw`, which renders an image of some of `particles` particles: one, or more if that
    /// takes little time. `tables`: the number of tables still to be computed for all of them.
    pub(super) fn measure(
        particles: usize,
        tables: impl Fn() -> usize,
        draw: impl Fn(usize) -> Result<()> + Sync,
    ) -> Result<Self> {
        let failed = |e: rayon::ThreadPoolBuildError| Error::input(format!("threads: {e}"));
        let thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().map_err(failed)?;
        let timed = |n: usize| -> Result<f64> {
            let start = Instant::now();
            thread.install(|| draw(n))?;
            Ok(start.elapsed().as_secs_f64())
        };
        // The first image also computes what all images share, and the tables that it needs itself.
        let before = tables();
        let mut first_s = timed(1.min(particles))?;
        let empty_s = timed(0)?;
        let rest = tables();
        let mut tables_s = 0.0;
        if before > rest {
            let again_s = timed(1.min(particles))?;
            tables_s = (first_s - again_s).max(0.0) / (before - rest) as f64 * rest as f64;
            first_s = again_s;
        }
        if first_s > 1.0 || tables_s > 1.0 || particles <= 1 {
            return Ok(ImageTime { empty_s, particle_s: (first_s - empty_s).max(0.0), tables_s });
        }
        // More and more particles until the time can be measured, because images of many particles overlap.
        let mut n = particles.min(TIMED);
        loop {
            // Again, because the first time may include computing tables.
            let all_s = (timed(n)?.min(timed(n)?) - empty_s).max(0.0);
            if n == particles || all_s > MEASURABLE_S {
                return Ok(ImageTime { empty_s, particle_s: all_s / n as f64, tables_s });
            }
            n = particles.min(4 * n);
        }
    }

    /// Duration of images with this total of particles on all threads, s.
    pub(super) fn seconds(&self, images: f64, particles: f64) -> f64 {
        (self.tables_s + self.empty_s * images + self.particle_s * particles)
            / rayon::current_num_threads() as f64
    }

    /// The duration as a sentence if it is long.
    pub(super) fn warning(&self, images: usize, particles: usize) -> Option<String> {
        let seconds = self.seconds(images as f64, particles as f64);
        let time = || duration_text(seconds, rayon::current_num_threads());
        (seconds > LONG_S).then(|| format!("{images} images with {particles} particles, about {}", time()))
    }
}

/// Free disk space for a folder that may not exist yet, bytes.
fn free_disk(out: &Path) -> Option<u64> {
    let existing = out.ancestors().find(|path| path.exists()).unwrap_or(Path::new("."));
    fs4::available_space(existing).ok()
}
