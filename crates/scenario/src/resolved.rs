//! A scenario that can be run: every default filled in, every rule checked.

use std::sync::Arc;

use flows::scale::Scale;
use flows::tracks::ParticleDefaults;
use flows::{Domain, FluidRegion, Illumination, RecordedTracks, Scene, Seeding, Shutter, VelocityField};
use glam::DVec3;
use microsig_core::Settings;
use microsig_core::formats::data_file::Layout;
use microsig_core::render::Renderer;
use microsig_core::sensor::{Detector, Response, Sensor};
use microsig_core::stream::Streams;

use super::files::Input;
use super::license::License;
use super::motion::MotionSource;
use super::optics::{response, sensor};
use super::particles::Cloud;
use super::recordings::Recordings;
use super::spec::Spec;
use super::truth_grid::Nodes;
use storage::error::Result;
use visibility::{DepthScan, NoiseFree};

/// A scenario that can be run.
#[derive(Debug)]
pub struct Scenario {
    /// The scenario with every default written out.
    pub spec: Spec,
    /// The licence of the dataset.
    pub license: License,
    /// All random numbers: the public streams of `spec.seed`, or secret ones.
    pub streams: Streams,
    /// MicroSIG's settings.
    pub settings: Settings,
    /// What draws the particles.
    pub renderer: Renderer,
    /// The camera; `None` is MicroSIG's own sensor.
    pub detector: Option<Detector>,
    /// Files that the scenario names, copied to `inputs/` of the dataset; `spec` names the copies.
    pub inputs: Vec<Input>,
    /// What should be known before running it.
    pub warnings: Vec<String>,
    /// What moves the particles.
    pub motion: MotionSource,
    /// From px to um and back.
    pub scale: Scale,
    /// The box that holds the particles.
    pub domain: Domain,
    /// The depth range of the measurement, um.
    pub depth_range_um: (f64, f64),
    /// How the box is filled.
    pub seeding: Seeding,
    /// What particles are besides places and sizes, and what moves them besides the flow.
    pub cloud: Cloud,
    /// When frames are taken.
    pub recordings: Recordings,
    /// The shutter, unless frames are instantaneous.
    pub shutter: Option<Shutter>,
    /// Light on the particles.
    pub illumination: Illumination,
    /// The columns of the data files.
    pub layout: Layout,
}

impl Scenario {
    /// The velocity field; `None` if tracks are given.
    pub fn field(&self) -> Option<&dyn VelocityField> {
        match &self.motion {
            MotionSource::Field(field) => Some(field.as_ref()),
            MotionSource::Tracks(_) => None,
        }
    }

    /// The tracks; `None` if a field moves the particles.
    pub fn tracks(&self) -> Option<&RecordedTracks> {
        match &self.motion {
            MotionSource::Field(_) => None,
            MotionSource::Tracks(tracks) => Some(tracks),
        }
    }

    /// What the recordings of a field are taken of.
    pub fn scene<'a>(&'a self, field: &'a dyn VelocityField) -> Result<Scene<'a>> {
        let scene = Scene::new(field, &self.domain, &self.seeding)?;
        let cloud = &self.cloud;
        let scene = scene.with_bodies(&cloud.bodies)?.with_intensities(cloud.intensities);
        let scene = cloud.spheroids.into_iter().fold(scene, Scene::with_spheroids);
        let scene = cloud.brownian.into_iter().fold(scene, Scene::with_brownian);
        let scene = cloud.settling.into_iter().fold(scene, Scene::with_settling);
        let scene = self.shutter.into_iter().fold(scene, Scene::with_shutter);
        Ok(if self.spec.boundaries.keep_ids { scene.keeping_ids() } else { scene })
    }

    /// Where there is fluid: the box beside the walls of the field and the bodies.
    pub fn fluid<'a>(&'a self, field: &'a dyn VelocityField) -> FluidRegion<'a> {
        FluidRegion::new(field, &self.domain, &self.cloud.bodies)
    }

    /// What particles of recorded tracks are where the file does not say.
    pub fn particle_defaults(&self) -> ParticleDefaults<'_> {
        ParticleDefaults {
            diameters: self.seeding.diameters(),
            intensities: self.cloud.intensities,
            spheroids: self.cloud.spheroids,
        }
    }

    /// Noise-free images of a sphere of the mean diameter through the depth range; they may be among those of
    /// all particles.
    ///
    /// # Errors
    /// None for a scenario that could be resolved.
    pub fn stack(&self, noise_free: &NoiseFree) -> Result<Arc<DepthScan>> {
        let (d_um, range_um) = (self.seeding.diameters().mean(), self.depth_range_um);
        if let Some(stack) = noise_free.stack(d_um, range_um) {
            return Ok(stack);
        }
        Ok(Arc::new(self.scan(d_um, range_um)?))
    }

    /// Noise-free images of a sphere of a diameter (um) through a range of physical depths (um).
    ///
    /// # Errors
    /// Depths that cannot be drawn.
    pub fn scan(&self, d_um: f64, range_um: (f64, f64)) -> Result<DepthScan> {
        let depth_factor = self.spec.optics.depth_factor.unwrap_or(1.0);
        let draw = |settings: &Settings| Ok(self.spec.renderer().for_depth_scans().build(settings)?);
        DepthScan::measure(draw, &self.settings, d_um, range_um, depth_factor)
    }

    /// [`Self::scan`] of the mean diameter through the depth range.
    ///
    /// # Errors
    /// Depths that cannot be drawn.
    pub fn scan_of_mean(&self) -> Result<DepthScan> {
        self.scan(self.seeding.diameters().mean(), self.depth_range_um)
    }

    /// The highest count above the background at each depth of a scan of spheres of a diameter (um), as
    /// bright and lit as they usually are, where a unit of light is `slope` counts.
    pub fn peak_counts<'a>(
        &'a self,
        slope: f64,
        d_um: f64,
        scan: &'a DepthScan,
    ) -> impl Iterator<Item = f64> + 'a {
        let counts = slope * self.cloud.typical_c_int(d_um);
        let depths = scan.images.iter().zip(&scan.depths_um);
        depths.map(move |(image, z_um)| counts * image.peak * self.illumination.at(DVec3::Z * *z_um))
    }

    /// Noise-free images of all particles.
    ///
    /// # Errors
    /// None for a scenario that could be resolved.
    pub fn noise_free(&self) -> Result<NoiseFree> {
        let (depth_factor, sizes) = (self.spec.optics.depth_factor.unwrap_or(1.0), self.seeding.diameters());
        let box_um = (self.domain.region().min().z, self.domain.region().max().z);
        let draw = |settings: &Settings| Ok(self.spec.renderer().for_depth_scans().build(settings)?);
        let law = self.renderer.spheroid_law();
        NoiseFree::new(draw, &self.settings, law, (sizes.min(), sizes.max()), box_um, depth_factor)
    }

    /// The sensor with its fixed pattern.
    ///
    /// # Errors
    /// None for a scenario that could be resolved.
    pub fn sensor(&self) -> Result<Sensor> {
        sensor(&self.settings, self.detector.as_ref(), &self.streams)
    }

    /// How the camera shows light in the middle of the image, without its fixed pattern.
    ///
    /// # Errors
    /// None for a scenario that could be resolved.
    pub fn response(&self) -> Result<Response> {
        response(&self.settings, self.detector.as_ref())
    }

    /// The nodes of the displacement field, if it is written.
    pub fn truth_grid(&self) -> Option<Nodes> {
        let size_px = (self.settings.pixel_dim_x, self.settings.pixel_dim_y);
        self.spec.truth_grid.as_ref()?.nodes(size_px, self.depth_range_um)
    }
}
