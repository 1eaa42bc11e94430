//! The short way to images in memory: a microscope, a flow, a cloud of particles, and a recording of them.
//!
//! ```ignore
//! use flows::fields::LambOseenParams;
//! use generator::setup::{Cloud, Microscope, Recording};
//!
//! let scope = Microscope::setting1().sensor(512, 512).expected();
//! let flow = LambOseenParams { max_speed_um_s: 800.0, ..Default::default() };
//! let cloud = Cloud::count(500).diameter_um(2.0);
//! let recording = Recording::pair(flow, &cloud, &scope, 0.005)?.seed(1)?;
//! for frame in recording.frames()? {
//!     let frame = frame?;
//!     frame.save(format!("{}.tif", frame.index()))?;
//!     for particle in frame.particles() { /* x_px, y_px, z_um, d_um */ }
//! }
//! ```
//!
//! [`Microscope`] and [`Cloud`] hold sections of a scenario, whose keys docs/scenario.md describes: their
//! methods set the most common keys, their fields give access to all others. The images equal the images of a dataset
//! of this scenario, byte for byte. The flow is a built-in field, any [`Motion`], or, by [`Motion::own`], every
//! other [`flows::VelocityField`]. `examples/` of the repository has programs.

use std::path::Path;
use std::sync::Arc;

use flows::Tracer;
use microsig_core::Particle;
use microsig_core::render::Context;
use microsig_core::sensor::Image;
use rayon::prelude::*;
use scenario::spec::{
    Boundaries, Calibration, Diameter, Motion, Number, Optics, Pairs, Particles, Preset, Render, RenderMode,
    Sensor, Sequence, Spec, Timing,
};
use scenario::{Scenario, build};
use storage::dataset::CalibrationRow;
use storage::{Progress, Result, save};

use crate::dataset::Camera;
use crate::dataset::calibration::CalibrationStack;
use crate::dataset::truth::{FrameTruth, Truth, rendered};
use crate::runner::{self, MemoryDataset, camera};

/// Optics, camera and measured volume.
#[derive(Debug, Clone, Default)]
pub struct Microscope {
    /// Objective, cylindrical lens, sensor size and background: section `optics` of a scenario.
    pub optics: Optics,
    /// How particle images are rendered: section `render`.
    pub render: Render,
    /// The camera model: section `sensor`. `None` is MicroSIG's constant background with Gaussian noise.
    pub camera: Option<Sensor>,
    /// The box that holds the particles: section `boundaries`.
    pub boundaries: Boundaries,
    /// Calibration stacks: section `calibration`.
    pub calibration: Option<Calibration>,
}

impl Microscope {
    /// Magnification 10, numerical aperture 0.3 (Rossi 2020, Table 1).
    pub fn setting1() -> Self {
        Self::of(Preset::Setting1)
    }

    /// [`Self::setting1`] with a cylindrical lens: astigmatic images.
    pub fn setting1a() -> Self {
        Self::of(Preset::Setting1a)
    }

    /// Magnification 63, numerical aperture 0.75 (Rossi 2020, Table 1).
    pub fn setting2() -> Self {
        Self::of(Preset::Setting2)
    }

    fn of(preset: Preset) -> Self {
        Microscope { optics: Optics { preset: Some(preset), ..Optics::default() }, ..Microscope::default() }
    }

    /// Width and height of the images, px.
    pub fn sensor(mut self, width: u32, height: u32) -> Self {
        (self.optics.pixel_dim_x, self.optics.pixel_dim_y) = (Some(width), Some(height));
        self
    }

    /// Mean and standard deviation of the background, counts.
    pub fn background(mut self, mean: f64, noise: f64) -> Self {
        (self.optics.background_mean, self.optics.background_noise) = (Some(mean), Some(noise));
        self
    }

    /// The depth range of the particles, um.
    pub fn depths_um(mut self, lowest: f64, highest: f64) -> Self {
        self.boundaries.z_um = Some((lowest, highest));
        self
    }

    /// A cylindrical lens that separates the two focal planes by this distance, um; negative for a converging
    /// lens.
    pub fn focal_planes_um(mut self, distance: f64) -> Self {
        self.optics.focal_planes_um = Some(distance);
        self
    }

    /// Images without ray noise: the limit of infinitely many rays. By default, rays are counted.
    pub fn expected(mut self) -> Self {
        self.render.mode = RenderMode::Expected;
        self
    }

    /// Images by wave optics at this vacuum wavelength, um.
    pub fn waves(mut self, wavelength_um: f64) -> Self {
        self.render = Render { mode: RenderMode::Waves, wavelength_um: Some(wavelength_um), ..self.render };
        self
    }
}

/// The particles.
#[derive(Debug, Clone, Default)]
pub struct Cloud {
    /// Number, positions, sizes, brightness, random motion: section `particles` of a scenario.
    pub particles: Particles,
}

impl Cloud {
    /// This number of particles in view.
    pub fn count(count: u32) -> Self {
        Self::of(Number::Count(count))
    }

    /// A mean number of particles per pixel.
    pub fn ppp(ppp: f64) -> Self {
        Self::of(Number::Ppp(ppp))
    }

    fn of(number: Number) -> Self {
        Cloud { particles: Particles { number: Some(number), ..Particles::default() } }
    }

    /// Particles of one diameter, um.
    pub fn diameter_um(mut self, d_um: f64) -> Self {
        self.particles.diameter_um = Some(Diameter::Constant(d_um));
        self
    }
}

/// A flow with particles under a microscope, at the times of its frames.
#[derive(Debug)]
pub struct Recording {
    scenario: Scenario,
    camera: Camera,
}

impl Recording {
    /// An image pair, `dt_s` (s) apart.
    pub fn pair(flow: impl Into<Motion>, cloud: &Cloud, scope: &Microscope, dt_s: f64) -> Result<Self> {
        Self::timed(flow, cloud, scope, Timing::Pairs(Pairs::new(1, dt_s)))
    }

    /// A time-resolved sequence of `frames` frames, `dt_s` (s) apart.
    pub fn sequence(
        flow: impl Into<Motion>,
        cloud: &Cloud,
        scope: &Microscope,
        frames: u32,
        dt_s: f64,
    ) -> Result<Self> {
        Self::timed(flow, cloud, scope, Timing::Sequence(Sequence::new(frames, dt_s)))
    }

    /// A recording at any times. Files that the keys name are relative to the working directory.
    pub fn timed(flow: impl Into<Motion>, cloud: &Cloud, scope: &Microscope, timing: Timing) -> Result<Self> {
        let Microscope { optics, render, camera, boundaries, calibration } = scope.clone();
        let spec = Spec {
            optics,
            render,
            sensor: camera,
            boundaries,
            calibration,
            particles: cloud.particles.clone(),
            ..Spec::new("recording", flow.into(), timing)
        };
        Self::of(build(spec, Path::new("."), &Context::default())?)
    }

    /// The recording of a scenario.
    pub fn of(scenario: Scenario) -> Result<Self> {
        Ok(Recording { camera: camera(&scenario)?, scenario })
    }

    /// The same with another seed of all random numbers; the default is 0.
    pub fn seed(mut self, seed: u64) -> Result<Self> {
        self.scenario.reseed(seed);
        Self::of(self.scenario)
    }

    /// The scenario, with all defaults.
    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// The camera that takes the images.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The frames, one after the other. Errors: particles that do not fit into the box.
    pub fn frames(&self) -> Result<Frames<'_>> {
        let truth = Arc::new(Truth::new(&self.scenario, self.camera.renderer())?);
        Ok(Frames { recording: self, truth, frames: runner::Frames::new(&self.scenario)?, before: None })
    }

    /// The calibration stack: images of a particle through the depth range, each with its row of the table of
    /// the stack. Empty if the optics have none.
    pub fn calibration(&self) -> Result<Vec<(CalibrationRow, Image)>> {
        let scan = self.scenario.scan_of_mean()?;
        let Some(stack) = CalibrationStack::of(&self.scenario, &self.camera, &scan)? else {
            return Ok(Vec::new());
        };
        let rows = stack.rows().into_par_iter().enumerate();
        Ok(rows.map(|(number, row)| (row, stack.image(number))).collect())
    }

    /// All images with their truth in memory, as scores need them ([`MemoryDataset`]). Errors: a trajectory
    /// that cannot be integrated; more than fits into memory.
    pub fn dataset(self, progress: &Progress) -> Result<MemoryDataset> {
        MemoryDataset::take(self.scenario, progress)
    }
}

/// The frames of a [`Recording`].
pub struct Frames<'a> {
    recording: &'a Recording,
    truth: Arc<Truth<'a>>,
    frames: runner::Frames<'a>,
    before: Option<Arc<flows::Frame>>,
}

impl<'a> Iterator for Frames<'a> {
    type Item = Result<Frame<'a>>;

    fn next(&mut self) -> Option<Self::Item> {
        let frame = match self.frames.next()? {
            Ok(frame) => Arc::new(frame),
            Err(error) => return Some(Err(error)),
        };
        let (recording, truth) = (self.recording, Arc::clone(&self.truth));
        let particles = rendered(&recording.scenario, recording.camera.renderer(), &frame);
        let before = self.before.replace(Arc::clone(&frame));
        Some(Ok(Frame { recording, truth, frame, before, particles }))
    }
}

/// A frame of a [`Recording`]: its particles, its image, and its truth.
pub struct Frame<'a> {
    recording: &'a Recording,
    truth: Arc<Truth<'a>>,
    frame: Arc<flows::Frame>,
    before: Option<Arc<flows::Frame>>,
    particles: Vec<Particle>,
}

impl Frame<'_> {
    /// Number of the frame, from 0.
    pub fn index(&self) -> u32 {
        self.frame.index
    }

    /// Time, s.
    pub fn t_s(&self) -> f64 {
        self.frame.t_s
    }

    /// The particles whose light may reach the sensor: place in the image (px, the first pixel's center is at
    /// 1), depth as in MicroSIG's data files, diameter, brightness.
    pub fn particles(&self) -> &[Particle] {
        &self.particles
    }

    /// All particles in the box, in um, with their velocities.
    pub fn tracers(&self) -> &[Tracer] {
        &self.frame.tracers
    }

    /// The image.
    pub fn image(&self) -> Image {
        self.recording.camera.image(&self.particles, self.index())
    }

    /// Writes the image as TIFF.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        save(path, |writer| self.recording.camera.write_tiff(writer, &self.image(), None, path))
    }

    /// The truth: the rows of the tables of a dataset, with signal-to-noise ratio and overlap of each particle
    /// image, and the displacements since the previous frame.
    pub fn truth(&self) -> Result<FrameTruth> {
        self.truth.frame(&self.frame, self.before.as_deref())
    }
}

#[cfg(test)]
mod tests {
    use flows::fields::{LambOseen, LambOseenParams};
    use storage::dataset::DatasetInMemory;

    use super::*;

    fn scope() -> Microscope {
        Microscope::setting1().sensor(64, 48).expected()
    }

    fn vortex() -> LambOseenParams {
        LambOseenParams { max_speed_um_s: 800.0, ..LambOseenParams::default() }
    }

    fn images(recording: &Recording) -> Vec<Image> {
        recording.frames().unwrap().map(|frame| frame.unwrap().image()).collect()
    }

    #[test]
    fn a_field_of_ones_own_moves_particles_as_a_built_in_one() {
        let cloud = Cloud::count(10).diameter_um(2.0);
        let built_in = Recording::sequence(vortex(), &cloud, &scope(), 3, 0.005).unwrap();
        let own = Motion::own(LambOseen::from_params(&vortex()).unwrap());
        let own = Recording::sequence(own, &cloud, &scope(), 3, 0.005).unwrap();
        assert_eq!(images(&own), images(&built_in));
        // It has no place in a scenario file, which a dataset contains.
        assert!(scenario::write(&own.scenario().spec).is_err());
        let other = images(&built_in.seed(1).unwrap());
        assert_ne!(other, images(&own));
    }

    #[test]
    fn frames_have_their_particles_and_the_displacements_since_the_last_one() {
        let recording = Recording::pair(vortex(), &Cloud::count(10), &scope(), 0.005).unwrap();
        let frames: Vec<_> = recording.frames().unwrap().collect::<Result<_>>().unwrap();
        let [first, second] = &frames[..] else { panic!("{}", frames.len()) };
        assert_eq!((first.index(), first.t_s(), second.index(), second.t_s()), (0, 0.0, 1, 0.005));
        let [before, after] = [first, second].map(|frame| frame.truth().unwrap());
        assert_eq!(first.particles(), before.particles);
        assert_eq!(before.tracks.iter().filter(|row| row.visible).count(), 10);
        assert!(before.displacements.is_empty() && after.displacements.len() >= 8);
        let made = recording.dataset(&Progress::default()).unwrap();
        assert_eq!(made.tracks().count(), before.tracks.len() + after.tracks.len());
    }

    #[test]
    fn values_out_of_range_are_named_by_their_keys() {
        let said = |scope: &Microscope, cloud: &Cloud, dt_s| {
            Recording::pair(vortex(), cloud, scope, dt_s).unwrap_err().to_string()
        };
        let cloud = Cloud::count(10);
        for (message, expected) in [
            (said(&scope().sensor(0, 48), &cloud, 0.005), "optics.pixel_dim_x = 0: expected"),
            (said(&scope(), &cloud, -1.0), "timing.pairs.dt_s = -1.0: expected"),
            (said(&scope(), &cloud, f64::NAN), "timing.pairs.dt_s"),
            (said(&scope(), &Cloud::ppp(2.0), 0.005), "particles.number.ppp = 2.0: expected"),
            (said(&scope().depths_um(20.0, -80.0), &cloud, 0.005), "boundaries.z_um"),
        ] {
            assert!(message.contains(expected), "{message}");
        }
    }
}
