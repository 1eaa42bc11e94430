//! Brightness of particles in scenarios: a factor on MicroSIG's counts, or photons.
//!
//! With `photons`, a particle emits isotropically; the aperture collects the fraction 0.5 (1 - cos(asin NA))
//! in focus, which reaches the camera. The ideal image is then in photons, independent of `points_per_pixel`,
//! `n_rays`, magnification and pixel size: `c_int` in the data files is in photons per ray, so the same
//! images can be rendered from these files alone.

use flows::Intensities;
use microsig_core::emission::{SpheroidLaw, area_ratio, emitted_rays};
use microsig_core::render::RendererSpec;
use microsig_core::{Particle, Settings};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Photons that a particle emits per exposure; `optics.gain` is then in counts per photon and defaults to 1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Photons {
    /// Photons that a particle of diameter `reference_um` emits per exposure in all directions; the aperture
    /// collects a fraction of them.
    #[schemars(example = Emitted::Constant(1e6))]
    pub emitted: Emitted,
    /// How the number of photons depends on the diameter.
    #[serde(default)]
    pub grow_with: Growth,
    /// Diameter of a particle that emits `emitted` photons.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(
        extend("exclusiveMinimum" = 0, "maximum" = 1e6, "x-default" = "the mean diameter"),
        example = 2.0
    )]
    pub reference_um: Option<f64>,
}

/// Number of emitted photons.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Emitted {
    /// The same for all particles.
    Constant(#[schemars(range(min = 0.0, max = 1e15), extend("x-unit" = "photons"), example = 1e6)] f64),
    /// Uniform distribution.
    Uniform {
        /// Smallest number of photons.
        #[schemars(range(min = 0.0, max = 1e15), extend("x-unit" = "photons"), example = 5e5)]
        min: f64,
        /// Largest number of photons.
        #[schemars(range(min = 0.0, max = 1e15), extend("x-unit" = "photons"), example = 1.5e6)]
        max: f64,
    },
    /// Normal distribution, truncated to positive numbers.
    Normal {
        /// Mean before truncation.
        #[schemars(extend("exclusiveMinimum" = 0, "maximum" = 1e15, "x-unit" = "photons"), example = 1e6)]
        mean: f64,
        /// Standard deviation before truncation.
        #[schemars(range(min = 0.0, max = 1e15), extend("x-unit" = "photons"), example = 2e5)]
        sd: f64,
    },
}

/// How the number of photons depends on the particle diameter.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Growth {
    /// Proportional to d^2: particles dyed on their surface.
    #[default]
    Surface,
    /// Proportional to d^3: particles dyed throughout their volume.
    Volume,
    /// The same number for all diameters.
    Equal,
}

impl From<Emitted> for Intensities {
    fn from(emitted: Emitted) -> Self {
        match emitted {
            Emitted::Constant(photons) => Intensities::Constant(photons),
            Emitted::Uniform { min, max } => Intensities::Uniform { min, max },
            Emitted::Normal { mean, sd } => Intensities::Normal { mean, sd },
        }
    }
}

/// Conversion of photons to `c_int` of the data files.
#[derive(Debug, Clone, PartialEq)]
pub struct PhotonScale {
    grow_with: Growth,
    reference_um: f64,
    settings: Settings,
    unit: Unit,
}

/// The quantity that `c_int` multiplies.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Unit {
    /// Rays emitted into the half space toward the lens.
    Rays(SpheroidLaw),
    /// Gaussian spots. `counts`: integral of a spot's light; `reference_um`: particle diameter (um) at which
    /// it holds, if spots scale with the particles.
    Spots { counts: f64, reference_um: Option<f64> },
}

impl PhotonScale {
    /// The conversion for a renderer and its settings; `reference_um`: diameter (um) of a particle that emits the
    /// given number of photons.
    pub(super) fn new(
        grow_with: Growth,
        reference_um: f64,
        renderer: &RendererSpec,
        settings: &Settings,
    ) -> Self {
        let unit = match renderer.spot() {
            None => Unit::Rays(renderer.spheroid_law()),
            Some(spot) => Unit::Spots {
                // The integral of exp(-8 r^2 / d^2).
                counts: spot.peak_counts * std::f64::consts::PI / 8.0 * spot.diameter_px * spot.diameter_px,
                reference_um: spot.reference_um,
            },
        };
        PhotonScale { grow_with, reference_um, settings: settings.clone(), unit }
    }

    /// `c_int` of a particle; `photons` is the number that a sphere of the reference diameter emits.
    pub fn c_int(&self, photons: f64, particle: &Particle) -> f64 {
        let d = particle.d_um / self.reference_um;
        let e_p = particle.spheroid.map_or(1.0, |spheroid| spheroid.e_p);
        let emitted = photons
            * match self.grow_with {
                Growth::Surface => d * d * area_ratio(e_p),
                Growth::Volume => d * d * d * e_p,
                Growth::Equal => 1.0,
            };
        match self.unit {
            Unit::Rays(law) => {
                // About half of the surface points emit.
                let share = match (particle.spheroid, law) {
                    (Some(_), SpheroidLaw::Original) => 0.5,
                    (None, _) | (Some(_), SpheroidLaw::Uniform) => 1.0,
                };
                0.5 * emitted / (share * emitted_rays(&self.settings, particle)).max(1.0)
            }
            Unit::Spots { counts, reference_um } => {
                let na = self.settings.numerical_aperture;
                let collected = 0.5 * (1.0 - (1.0 - na * na).sqrt());
                let width = reference_um.map_or(1.0, |reference| particle.d_um / reference);
                collected * emitted / (counts * width * width)
            }
        }
    }
}
