//! Particles in scenarios: number, positions, diameters, brightness, orientations, and motion besides the
//! flow.

use flows::scale::Scale;
use flows::{
    Body, Brownian, Diameters, FluidRegion, Intensities, Orientation, Region, Seeding, Settling, Spheroids,
};
use microsig_core::formats::data_file;
use microsig_core::problem::Problems;
use microsig_core::{Particle, Settings};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use super::brightness::{Emitted, Growth, PhotonScale, Photons};
use super::findings::{Collect, Findings};
use microsig_core::visibility::DepthScan;
use storage::error::Result;

/// Default number of particles in view: a source density N_S of about 0.1 with setting 1 and the default
/// channel.
const DEFAULT_COUNT: u32 = 46;
const DEFAULT_DIAMETER_UM: f64 = 2.0;

/// The particles.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Particles {
    /// Number of particles.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub number: Option<Number>,
    /// Initial positions. They apply to the first frame of a recording: the flow then moves the particles,
    /// and those that enter later are independent of the others.
    pub seeding: Placement,
    /// Particle diameters; for spheroids the equatorial diameters. Values outside the cutoffs are redrawn,
    /// not clipped.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diameter_um: Option<Diameter>,
    /// Brightness factor of the particles, relative to the brightness that the optics give for their size.
    pub c_int: Intensities,
    /// Instead of `c_int`: number of photons that a particle emits per exposure.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(
        extend("x-default" = "none: MicroSIG's counts, which grow with (d M / pixel_size)^2, points_per_pixel and n_rays"),
        example = Photons { emitted: Emitted::Constant(1e6), grow_with: Growth::Surface, reference_um: None }
    )]
    pub photons: Option<Photons>,
    /// Spheroids instead of spheres; the flow rotates them according to Jeffery's equation.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(example = Spheroids { e_p: 3.0, orientation: Orientation::Random })]
    pub spheroids: Option<Spheroids>,
    /// Brownian motion.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub brownian: Option<Brownian>,
    /// Sedimentation or buoyancy at the Stokes velocity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub settling: Option<Settling>,
}

/// Number of particles.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Number {
    /// Exactly N particles in view in the first frame of each recording; the rest of the box has the same
    /// number density.
    Count(#[schemars(range(max = 1_000_000), example = 46)] u32),
    /// Mean number of particles per pixel (Poisson process).
    Ppp(#[schemars(range(min = 0.0, max = 1.0), extend("x-unit" = "1/px"), example = 0.0002)] f64),
    /// Mean number of particles per volume (Poisson process).
    PerUm3(#[schemars(range(min = 0.0, max = 1e3), extend("x-unit" = "1/um\u{b3}"), example = 1e-6)] f64),
    /// Source density N_S: total area of the particle images over the area of the sensor, on average (Poisson
    /// process); overlaps count once per image. The area of an image is the number of its pixels above a tenth of its
    /// peak, averaged over depth; in focus, whole pixels make it up to 1.6 times as large as by the formula of the
    /// optics. If walls or bodies exclude particles from part of the image, only the rest counts.
    NS(#[schemars(range(min = 0.0, max = 100.0), example = 0.1)] f64),
    /// One particle at each position in a MicroSIG data file (x and y in px, z in um), relative to the
    /// scenario; diameters are drawn from `diameter_um`.
    File(#[schemars(example = &"places.txt")] String),
}

/// Initial positions of the particles.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Placement {
    /// Independent and uniformly distributed.
    #[default]
    Uniform,
    /// One particle in each cell of a regular grid, displaced from the center by up to this fraction of half
    /// a cell. Not available for an exact number (`count`, `file`).
    JitteredGrid(#[schemars(range(min = 0.0, max = 1.0), example = 0.5)] f64),
    /// Minimum distance between the surfaces of particles.
    Apart(#[schemars(range(min = 0.0, max = 1e6), extend("x-unit" = "um"), example = 1.0)] f64),
    /// Minimum distance between the surfaces of particles in the image plane, regardless of depth.
    ApartInImage(#[schemars(range(min = 0.0, max = 1e6), extend("x-unit" = "um"), example = 1.0)] f64),
}

/// Largest diameter.
const LARGEST_UM: f64 = 1e6;

/// Diameters of the particles, um. Values outside the cutoffs are redrawn, not clipped.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Diameter {
    /// The same for all particles.
    Constant(
        #[schemars(extend("x-unit" = "um", "exclusiveMinimum" = 0, "maximum" = LARGEST_UM), example = 2.0)]
        f64,
    ),
    /// Uniform distribution.
    Uniform {
        /// Smallest diameter.
        #[schemars(extend("x-unit" = "um", "exclusiveMinimum" = 0, "maximum" = LARGEST_UM), example = 1.0)]
        min: f64,
        /// Largest diameter.
        #[schemars(extend("x-unit" = "um", "exclusiveMinimum" = 0, "maximum" = LARGEST_UM), example = 3.0)]
        max: f64,
    },
    /// Truncated normal distribution.
    Normal {
        /// Mean before truncation.
        #[schemars(extend("x-unit" = "um", "exclusiveMinimum" = 0, "maximum" = LARGEST_UM), example = 2.0)]
        mean: f64,
        /// Standard deviation before truncation.
        #[schemars(extend("x-unit" = "um", "exclusiveMinimum" = 0, "maximum" = LARGEST_UM), example = 0.2)]
        sd: f64,
        /// Smallest diameter.
        #[schemars(extend("x-unit" = "um", "exclusiveMinimum" = 0, "maximum" = LARGEST_UM), example = 1.0)]
        min: f64,
        /// Largest diameter.
        #[schemars(extend("x-unit" = "um", "exclusiveMinimum" = 0, "maximum" = LARGEST_UM), example = 3.0)]
        max: f64,
    },
    /// Truncated lognormal distribution.
    Lognormal {
        /// Mean of the diameter (not of its logarithm) before truncation.
        #[schemars(extend("x-unit" = "um", "exclusiveMinimum" = 0, "maximum" = LARGEST_UM), example = 2.0)]
        mean: f64,
        /// Standard deviation of the diameter before truncation.
        #[schemars(extend("x-unit" = "um", "exclusiveMinimum" = 0, "maximum" = LARGEST_UM), example = 0.4)]
        sd: f64,
        /// Smallest diameter.
        #[schemars(extend("x-unit" = "um", "exclusiveMinimum" = 0, "maximum" = LARGEST_UM), example = 0.8)]
        min: f64,
        /// Largest diameter.
        #[schemars(extend("x-unit" = "um", "exclusiveMinimum" = 0, "maximum" = LARGEST_UM), example = 5.0)]
        max: f64,
    },
    /// Diameters and their weights.
    List(
        #[schemars(length(min = 1), extend("x-unit" = "um"), example = vec![(2, 1), (1, 3)])] Vec<(f64, f64)>,
    ),
}

/// Brightness of the particles, checked.
#[derive(Debug, Clone)]
pub struct Cloud {
    /// Brightness factors, or photons.
    pub intensities: Intensities,
    /// Conversion of photons to brightness, if `intensities` are photons.
    pub photons: Option<PhotonScale>,
}

impl Diameter {
    pub(super) fn build(&self) -> flows::Result<Diameters> {
        match *self {
            Diameter::Constant(d) => Diameters::equal(d),
            Diameter::Uniform { min, max } => Diameters::uniform(min, max),
            Diameter::Normal { mean, sd, min, max } => Diameters::normal(mean, sd, min, max),
            Diameter::Lognormal { mean, sd, min, max } => Diameters::lognormal(mean, sd, min, max),
            Diameter::List(ref weighted) => Diameters::list(weighted),
        }
    }
}

impl Cloud {
    /// Brightness `c_int` of a particle, from the value drawn for it: a factor or a number of photons.
    pub fn c_int(&self, drawn: f64, particle: &Particle) -> f64 {
        self.photons.as_ref().map_or(drawn, |photons| photons.c_int(drawn, particle))
    }

    /// Typical brightness `c_int` (the middle of the distribution) of a sphere of diameter `d_um` (um).
    pub fn typical_c_int(&self, d_um: f64) -> f64 {
        self.c_int(self.intensities.typical(d_um), &Particle::sphere(1.0, 1.0, 0.0, d_um))
    }
}

impl Particles {
    /// Builds the distribution of diameters; fills in its default.
    pub(super) fn diameters(&mut self, problems: &mut Problems) -> Option<Diameters> {
        let diameter = self.diameter_um.get_or_insert(Diameter::Constant(DEFAULT_DIAMETER_UM));
        problems.of("particles.diameter_um", diameter.build())
    }

    /// Checks everything except number and positions.
    pub(super) fn cloud(&self, bodies: &[Body], problems: &mut Problems) -> Option<Cloud> {
        let (key, intensities) = match (self.photons, self.c_int) {
            (Some(photons), _) => ("particles.photons.emitted", photons.emitted.into()),
            (None, c_int) => ("particles.c_int", c_int),
        };
        let bodies: flows::Result<Vec<Body>> = bodies.iter().map(|body| body.checked()).collect();
        let checked = [
            problems.of("particles.spheroids", self.spheroids.map(Spheroids::checked).transpose()).is_some(),
            problems.of("particles.brownian", self.brownian.map(Brownian::checked).transpose()).is_some(),
            problems.of("particles.settling", self.settling.map(Settling::checked).transpose()).is_some(),
            problems.of("boundaries.bodies", bodies).is_some(),
            self.check_liquid(problems).is_some(),
        ];
        let intensities = problems.of(key, intensities.checked())?;
        checked.iter().all(|fits| *fits).then_some(Cloud { intensities, photons: None })
    }

    /// Checks that Brownian motion and settling are in the same liquid.
    fn check_liquid(&self, problems: &mut Problems) -> Option<()> {
        let (Some(brownian), Some(settling)) = (self.brownian, self.settling) else { return Some(()) };
        let viscosity = brownian.viscosity_pa_s;
        if settling.viscosity_pa_s == viscosity {
            return Some(());
        }
        let allowed =
            format!("{viscosity}, the viscosity of particles.brownian: both are in the same liquid");
        problems.value("particles.settling.viscosity_pa_s", settling.viscosity_pa_s, &allowed);
        None
    }

    /// Refers a seeding by source density to the part of `view` in which particles can be.
    pub(super) fn within_walls(&self, seeding: Seeding, fluid: &FluidRegion<'_>, view: &Region) -> Seeding {
        match self.number {
            Some(Number::NS(_)) => seeding.with_share_of_mean(fluid.image_share(view, 0.0)),
            _ => seeding,
        }
    }

    /// Builds number and initial positions.
    pub(super) fn seeding(
        &mut self,
        diameters: Diameters,
        (scale, settings): (&Scale, &Settings),
        z_um: (f64, f64),
        stack: impl FnOnce() -> Result<DepthScan>,
        found: &mut Findings<'_>,
    ) -> Option<Seeding> {
        let view = found.problems.of("boundaries", scale.view(z_um.0, z_um.1, 0.0))?;
        let number = self.number.get_or_insert(Number::Count(DEFAULT_COUNT));
        let seeding = match number {
            Number::Count(n) => Ok(Seeding::count_in_view(*n, view, diameters)),
            Number::Ppp(ppp) => {
                let pixels = f64::from(settings.pixel_dim_x) * f64::from(settings.pixel_dim_y);
                Seeding::mean_in_view(*ppp * pixels * scale.excess_of_view(), view, diameters)
            }
            Number::PerUm3(density) => Seeding::poisson(*density, diameters),
            Number::NS(n_s) => {
                // The area of an image can be computed only if everything else is valid.
                if found.problems.any() {
                    return None;
                }
                let area_px = found.problems.of("particles.number.n_s", stack())?.area_px();
                if area_px == 0.0 {
                    found.problems.value(
                        "particles.number.n_s",
                        *n_s,
                        "optics in which particles are visible (gain > 0)",
                    );
                }
                let pixels = f64::from(settings.pixel_dim_x) * f64::from(settings.pixel_dim_y);
                let mean = *n_s * pixels / area_px.max(1.0) * scale.excess_of_view();
                Seeding::mean_in_view(mean, view, diameters)
            }
            Number::File(file) => {
                let (path, bytes) = found.read("particles.number.file", file)?;
                let read: Result<_> =
                    data_file::read(&bytes[..], &path.display().to_string()).map_err(Into::into);
                let listed = found.problems.of("particles.number.file", read)?;
                *file = found.keep("particles.number.file", &path, bytes);
                let object = |p: &microsig_core::Particle| {
                    scale.to_object(flows::scale::ImagePoint { x_px: p.x_px, y_px: p.y_px, z_um: p.z_um })
                };
                Seeding::list(listed.iter().map(object).collect(), diameters)
            }
        };
        let placed = seeding.and_then(|seeding| match self.seeding {
            Placement::Uniform => Ok(seeding),
            Placement::JitteredGrid(jitter) => seeding.on_jittered_grid(jitter),
            Placement::Apart(gap_um) => seeding.apart(gap_um),
            Placement::ApartInImage(gap_um) => seeding.apart_in_image(gap_um),
        });
        found.problems.of("particles", placed)
    }
}
