//! A resolved scenario: all defaults filled in, all rules checked.

use std::path::Path;

use flows::scale::Scale;
use flows::tracks::ParticleDefaults;
use flows::{
    Domain, FluidFractionCache, FluidRegion, Illumination, RecordedTracks, Scene, Seeding, Shutter,
    VelocityField,
};
use glam::DVec3;
use microsig_core::Settings;
use microsig_core::formats::data_file::Layout;
use microsig_core::render::{Context, Renderer};
use microsig_core::sensor::{Detector, Response, Sensor};
use microsig_core::stream::Streams;

use super::findings::{Findings, Input};
use super::focal_planes::CylinderFacts;
use super::imaging::scan;
use super::license::License;
use super::motion::MotionSource;
use super::optics::{response, sensor};
use super::particles::Cloud;
use super::recordings::Recordings;
use super::spec::{Calibration, Number, Spec};
use super::truth_grid::Nodes;
use microsig_core::visibility::{DepthScan, NoiseFree, ScanImage};
use storage::error::{Error, Result};

/// A valid scenario with all defaults filled in.
#[derive(Debug)]
pub struct Scenario {
    /// The scenario with every default written out.
    pub spec: Spec,
    /// The license of the dataset.
    pub license: License,
    /// Random number streams, of `spec.seed` or secret ones.
    pub streams: Streams,
    /// MicroSIG's settings.
    pub settings: Settings,
    /// Renders particle images.
    pub renderer: Renderer,
    /// Where it and other renderers of the scenario keep their tables.
    pub context: Context,
    /// The camera; `None` is MicroSIG's own sensor.
    pub detector: Option<Detector>,
    /// Files that the scenario refers to, copied to `inputs/` of the dataset; `spec` refers to the copies.
    pub inputs: Vec<Input>,
    /// Warnings to be shown before the scenario runs.
    pub warnings: Vec<String>,
    /// The source of particle motion.
    pub motion: MotionSource,
    /// Conversion between px and um.
    pub scale: Scale,
    /// The box that contains the particles.
    pub domain: Domain,
    /// The depth range of the measurement, um.
    pub depth_range_um: (f64, f64),
    /// Volume fractions of fluid in parts of the box that have been measured.
    pub fluid_shares: FluidFractionCache,
    /// Number, diameters and initial positions of the particles.
    pub seeding: Seeding,
    /// Brightness of the particles.
    pub cloud: Cloud,
    /// Frames and their times.
    pub recordings: Recordings,
    /// The shutter; `None` if exposures are instantaneous.
    pub shutter: Option<Shutter>,
    /// Illumination of the particles.
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

    /// The effect of a cylindrical lens; `None` without one.
    pub fn cylinder(&self) -> Option<CylinderFacts> {
        CylinderFacts::of(&self.settings, &self.spec.optics)
    }

    /// The flow with particles, bodies and shutter, as the recordings of a field need it.
    pub fn scene<'a>(&'a self, field: &'a dyn VelocityField) -> Result<Scene<'a>> {
        let particles = &self.spec.particles;
        let scene = Scene::in_fluid(self.fluid(field), &self.seeding)?;
        let scene = scene.with_intensities(self.cloud.intensities);
        let scene = particles.spheroids.into_iter().fold(scene, Scene::with_spheroids);
        let scene = particles.brownian.into_iter().fold(scene, Scene::with_brownian);
        let scene = particles.settling.into_iter().fold(scene, Scene::with_settling);
        let scene = self.shutter.into_iter().fold(scene, Scene::with_shutter);
        let scene = if self.spec.walls_slow() { scene.with_slowing_walls() } else { scene };
        Ok(if self.spec.boundaries.keep_ids { scene.keeping_ids() } else { scene })
    }

    /// The region with fluid: the box without the walls of the field and the bodies.
    pub fn fluid<'a>(&'a self, field: &'a dyn VelocityField) -> FluidRegion<'a> {
        FluidRegion::new(field, &self.domain, &self.spec.boundaries.bodies).keeping(&self.fluid_shares)
    }

    /// The fraction of the sensor in which particles can be, see [`FluidRegion::image_share`]; 1 without
    /// walls across the image.
    pub fn image_share(&self) -> f64 {
        let region = self.domain.region();
        let view = self.scale.view(region.min().z, region.max().z, 0.0);
        // A scenario that could be resolved has a view with a volume.
        self.field().zip(view.ok()).map_or(1.0, |(field, view)| self.fluid(field).image_share(&view, 0.0))
    }

    /// Properties of the particles of recorded tracks that the file does not give.
    pub fn particle_defaults(&self) -> ParticleDefaults<'_> {
        ParticleDefaults {
            diameters: self.seeding.diameters(),
            intensities: self.cloud.intensities,
            spheroids: self.spec.particles.spheroids,
        }
    }

    /// Smallest, mean and largest diameter of the particles, um: recorded tracks may give the diameter in
    /// each row.
    pub fn diameters_um(&self) -> [f64; 3] {
        self.motion.diameters_um(self.seeding.diameters())
    }

    /// Diameters that represent all particles, um, increasing: each listed diameter, or quantiles of
    /// their distribution, see [`flows::Diameters::representative`]; the mean of Gaussian spots.
    pub fn representative_um(&self) -> Vec<f64> {
        if !self.renderer.depends_on_depth() {
            return vec![self.diameters_um()[1]];
        }
        let drawn = self.seeding.diameters();
        let rows = self.tracks().map(RecordedTracks::rows).unwrap_or_default();
        let mut own: Vec<f64> = rows.iter().filter_map(|row| row.d_um).collect();
        if own.is_empty() {
            return drawn.representative();
        }
        if own.len() < rows.len() {
            own.extend(drawn.representative());
        }
        let weighted: Vec<(f64, f64)> = own.iter().map(|d_um| (*d_um, 1.0)).collect();
        flows::Diameters::list(&weighted).map_or_else(|_| own, |all| all.representative())
    }

    /// The diameters of [`Self::representative_um`] if they come from a list of several; otherwise empty.
    pub fn mixed_um(&self) -> Vec<f64> {
        let [smallest, _, largest] = self.diameters_um();
        let all = self.representative_um();
        let listed = all.len() > 1 && all.first() == Some(&smallest) && all.last() == Some(&largest);
        if listed { all } else { Vec::new() }
    }

    /// Diameters of the particles of the calibration stacks, um, increasing, one for each stack; empty
    /// without calibration.
    pub fn calibrated_um(&self) -> Vec<f64> {
        match &self.spec.calibration {
            None | Some(Calibration::None) => Vec::new(),
            Some(calibration) => match calibration.given_diameters_um() {
                Some(diameters_um) => {
                    let mut sizes = diameters_um.to_vec();
                    sizes.sort_by(f64::total_cmp);
                    sizes
                }
                None => self.representative_um(),
            },
        }
    }

    /// Places of the calibration stacks in the image, px, row by row; empty if there is one for the whole field
    /// of view. Each is the center of a pixel.
    pub fn calibrated_px(&self) -> Vec<[f64; 2]> {
        let n = self.spec.calibration.as_ref().map_or(1, Calibration::places);
        if n < 2 {
            return Vec::new();
        }
        let along = |k: u32, pixels: u32| {
            (f64::from(pixels) * (f64::from(k) + 0.5) / f64::from(n) + 0.5)
                .round()
                .clamp(1.0, f64::from(pixels))
        };
        let (width, height) = (self.settings.pixel_dim_x, self.settings.pixel_dim_y);
        (0..n * n).map(|k| [along(k % n, width), along(k / n, height)]).collect()
    }

    /// A warning if the images of a single calibration stack represent particles of several sizes.
    pub(super) fn single_stack_warning(&self) -> Option<String> {
        let (stacks, sizes) = (self.calibrated_um(), self.representative_um());
        let ([d_um], [smallest, .., largest]) = (stacks.as_slice(), sizes.as_slice()) else { return None };
        Some(format!(
            "calibration: a single stack of a particle of {d_um} um represents particles of {smallest} to {largest} um, whose images \
             differ in size and brightness; `calibration: stack` generates one for each size"
        ))
    }

    /// Physical depth over depth in MicroSIG's data files.
    pub fn depth_factor(&self) -> f64 {
        self.scale.depth_factor()
    }

    /// Noise-free images of a sphere of diameter `d_um` (um) through a range of physical depths (um).
    pub fn scan(&self, d_um: f64, range_um: (f64, f64)) -> Result<DepthScan> {
        scan(&self.spec, (&self.settings, self.depth_factor()), d_um, range_um, &self.context)
    }

    /// [`Self::scan`] of the mean diameter through the depth range.
    pub fn scan_of_mean(&self) -> Result<DepthScan> {
        self.scan(self.diameters_um()[1], self.depth_range_um)
    }

    /// Counts above the background of the peak of a sphere of diameter `d_um` (um) at depth `z_um`, whose
    /// noise-free image is `image`, with typical brightness and illumination on the optical axis; `slope` is
    /// counts per unit of light.
    pub fn peak_counts(&self, slope: f64, d_um: f64, z_um: f64, image: &ScanImage) -> f64 {
        slope * self.cloud.typical_c_int(d_um) * image.peak * self.illumination.at(DVec3::Z * z_um)
    }

    /// Typical brightness factor of a particle of diameter `d_um` (um) on the optical axis at depth `z_um` (um), with its
    /// illumination.
    pub fn brightness(&self, d_um: f64, z_um: f64) -> f64 {
        self.cloud.typical_c_int(d_um) * self.illumination.at(DVec3::Z * z_um)
    }

    /// The renderer of the light without ray noise. Errors: ray images whose limit of infinitely many rays
    /// would take too long.
    pub fn without_ray_noise(&self, tolerance: f64) -> Result<Renderer> {
        if !self.renderer.has_ray_noise() {
            return Ok(self.renderer.clone());
        }
        Ok(self.spec.renderer().without_ray_noise(tolerance).build(&self.settings, &self.context)?)
    }

    /// Noise-free images of single particles.
    pub fn noise_free(&self) -> NoiseFree {
        let has_ray_noise = self.renderer.has_ray_noise();
        let limit = || self.without_ray_noise(microsig_core::visibility::TOLERANCE).ok();
        NoiseFree::new(self.renderer.clone(), has_ray_noise.then(limit).flatten())
    }

    /// The sensor with its fixed-pattern noise.
    pub fn sensor(&self) -> Result<Sensor> {
        sensor(&self.settings, self.detector.as_ref(), self.spec.image_format(), &self.streams)
    }

    /// Response of the camera to light at the image center, without fixed-pattern noise.
    pub fn response(&self) -> Result<Response> {
        response(&self.settings, self.detector.as_ref())
    }

    /// The nodes of the displacement field, if it is written.
    pub fn truth_grid(&self) -> Option<Nodes> {
        let size_px = (self.settings.pixel_dim_x, self.settings.pixel_dim_y);
        self.spec.truth_grid.as_ref()?.nodes(size_px, self.depth_range_um)
    }

    /// Replaces the seed of all random numbers.
    pub fn reseed(&mut self, seed: u64) {
        (self.spec.seed, self.streams) = (seed, Streams::new(seed));
    }

    /// Whether [`Self::replace`] can replace the value at a path: no section but its own depends on it.
    pub fn can_replace(&self, path: &str) -> bool {
        match path {
            "optics.background_mean" | "optics.background_noise" => true,
            // The extent of Gaussian spots depends on the gain.
            "optics.gain" => self.spec.optics.gaussian.is_none(),
            "particles.number.count" | "particles.number.ppp" => self.field().is_some(),
            _ => false,
        }
    }

    /// Replaces the value at a path for which [`Self::can_replace`] is true, and resolves its section again;
    /// the value must be within its range. The result is the scenario that would be resolved with this value,
    /// except for its warnings. Errors: [`Error::Problems`] if the particles do not fit into the box.
    pub fn replace(&mut self, path: &str, value: f64) -> Result<()> {
        let (optics, particles) = (&mut self.spec.optics, &mut self.spec.particles);
        match path {
            "optics.background_mean" => optics.background_mean = Some(value),
            "optics.background_noise" => optics.background_noise = Some(value),
            "optics.gain" => optics.gain = Some(value),
            "particles.number.count" => particles.number = Some(Number::Count(value as u32)),
            "particles.number.ppp" => particles.number = Some(Number::Ppp(value)),
            _ => return Err(Error::input(format!("{path}: cannot be replaced in a resolved scenario"))),
        }
        optics.apply(&mut self.settings);
        if path.starts_with("particles") {
            let (mut found, region) = (Findings::new(Path::new("."), &self.context), self.domain.region());
            let scan = || Err(Error::input("particles.number: a source density cannot be replaced"));
            let (diameters, optics) = (self.seeding.diameters().clone(), (&self.scale, &self.settings));
            let z_um = (region.min().z, region.max().z);
            let seeding = particles.seeding(diameters, optics, z_um, scan, &mut found);
            found.problems.finish(Error::Problems)?;
            self.seeding = seeding.ok_or_else(|| Error::input("particles: cannot be placed"))?;
        }
        Ok(())
    }
}
