//! Particles in scenarios: how many, where, how large, how bright, how they lie, and what moves them besides the flow.

use std::path::Path;

use flows::body::Body;
use flows::brownian::{Brownian as BrownianMotion, Settling as SettlingMotion};
use flows::intensities::Intensities;
use flows::orientation::{Orientations, Spheroids as SpheroidCloud};
use flows::scale::Scale;
use flows::{Diameters, Seeding};
use glam::{DVec2, DVec3};
use microsig_core::Settings;
use microsig_core::formats::data_file;
use serde::{Deserialize, Serialize};

use super::files::Files;
use super::problems::Problems;
use crate::error::Result;
use crate::light::Stack;

/// Particles in view: a source density N_S of about 0.1 under setting 1 in the default channel.
const DEFAULT_COUNT: u32 = 46;
const DEFAULT_DIAMETER_UM: f64 = 2.0;

/// What the particles are.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Particles {
    /// How many.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub number: Option<Number>,
    /// How they are placed at first.
    pub seeding: Placement,
    /// Their diameters; of spheroids the equatorial ones.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diameter_um: Option<Diameter>,
    /// Factors on their brightness.
    pub c_int: Brightness,
    /// Spheroids instead of spheres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spheroids: Option<Spheroids>,
    /// Thermal motion.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub brownian: Option<Brownian>,
    /// Sinking or rising.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub settling: Option<Settling>,
}

/// Number of particles.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Number {
    /// Exactly so many in view in the first frame of each recording; the rest of the domain at the same density.
    Count(u32),
    /// So many per pixel of the image on average, a Poisson process.
    Ppp(f64),
    /// So many per um^3 on average, a Poisson process.
    PerUm3(f64),
    /// So many that their images cover this share of the sensor on average, overlaps counted twice (the source density
    /// N_S), a Poisson process.
    NS(f64),
    /// One at each place of a MicroSIG data file (x, y in px, z in um; diameters are those of `diameter_um`).
    File(String),
}

/// How particles are placed at first.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Placement {
    /// Independent of each other, uniform.
    #[default]
    Uniform,
    /// One in each cell of a grid, moved by up to this many half edges of a cell.
    JitteredGrid(f64),
    /// Surfaces at least this far apart, um.
    Apart(f64),
    /// The same in the image plane, whatever the depths, um.
    ApartInImage(f64),
}

/// Diameters of the particles, um. Distributions that are cut are drawn again, never clipped.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs, reason = "the usual parameters")]
pub enum Diameter {
    /// All the same.
    Constant(f64),
    Uniform {
        min: f64,
        max: f64,
    },
    Normal {
        mean: f64,
        sd: f64,
        min: f64,
        max: f64,
    },
    /// Mean and standard deviation are those of the diameter, not of its logarithm.
    Lognormal {
        mean: f64,
        sd: f64,
        min: f64,
        max: f64,
    },
    /// Diameters and their weights.
    List(Vec<(f64, f64)>),
}

/// Factors on the brightness that the optics give a particle of its size.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs, reason = "the usual parameters")]
pub enum Brightness {
    /// All the same.
    Constant(f64),
    Uniform {
        min: f64,
        max: f64,
    },
    /// Restricted to positive factors.
    Normal {
        mean: f64,
        sd: f64,
    },
    /// (d / reference)^exponent.
    PowerOfDiameter {
        reference_um: f64,
        exponent: f64,
    },
}

impl Default for Brightness {
    fn default() -> Self {
        Brightness::Constant(1.0)
    }
}

/// Spheroids.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Spheroids {
    /// Polar over equatorial diameter.
    pub e_p: f64,
    /// How they lie at first; the flow turns them by Jeffery's equation.
    #[serde(default)]
    pub orientation: Orientation,
}

/// How the axes of spheroids lie at first.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Orientation {
    /// Every direction is equally likely.
    #[default]
    Random,
    /// All along one direction.
    Aligned((f64, f64, f64)),
    /// About a mean direction, with density exp(kappa cos).
    VonMisesFisher {
        /// The mean direction.
        mean: (f64, f64, f64),
        /// The concentration.
        kappa: f64,
    },
}

/// Thermal motion in a liquid.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Brownian {
    /// Temperature, K.
    pub temperature_k: f64,
    /// Dynamic viscosity, Pa s.
    pub viscosity_pa_s: f64,
    /// Steps from frame to frame.
    pub substeps: u32,
}

impl Default for Brownian {
    /// Water at 25 degrees.
    fn default() -> Self {
        Brownian { temperature_k: 298.15, viscosity_pa_s: 0.89e-3, substeps: 2 }
    }
}

/// Sinking of particles in a liquid.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Settling {
    /// Density of the particles less that of the liquid, kg/m^3.
    pub density_difference_kg_m3: f64,
    /// Dynamic viscosity, Pa s.
    pub viscosity_pa_s: f64,
    /// Where gravity points, in x, y, z.
    pub direction: (f64, f64, f64),
}

impl Default for Settling {
    /// Polystyrene in water, seen from below (the lens is on the side of negative z).
    fn default() -> Self {
        Settling { density_difference_kg_m3: 50.0, viscosity_pa_s: 0.89e-3, direction: (0.0, 0.0, -1.0) }
    }
}

/// A body that particles cannot enter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs, reason = "centres and radii, um")]
pub enum Obstacle {
    Sphere {
        centre_um: (f64, f64, f64),
        radius_um: f64,
    },
    /// Along z.
    Cylinder {
        centre_um: (f64, f64),
        radius_um: f64,
    },
    /// All but a sessile drop, a parabolic cap.
    OutsideDrop {
        centre_um: (f64, f64, f64),
        radius_um: f64,
        height_um: f64,
    },
    /// Particles whose centre comes into this sphere end.
    Drain {
        centre_um: (f64, f64, f64),
        radius_um: f64,
    },
}

/// The particles of a scenario, checked.
#[derive(Debug, Clone)]
pub struct Cloud {
    /// Spheroids, if they are.
    pub spheroids: Option<SpheroidCloud>,
    /// Factors on brightness.
    pub intensities: Intensities,
    /// Whether `intensities` is anything but 1.
    pub has_intensities: bool,
    /// Thermal motion.
    pub brownian: Option<BrownianMotion>,
    /// Sinking.
    pub settling: Option<SettlingMotion>,
    /// Bodies that keep particles out.
    pub bodies: Vec<Body>,
}

fn vector((x, y, z): (f64, f64, f64)) -> DVec3 {
    DVec3::new(x, y, z)
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

impl Obstacle {
    fn build(&self) -> flows::Result<Body> {
        match *self {
            Obstacle::Sphere { centre_um, radius_um } => Body::sphere(vector(centre_um), radius_um),
            Obstacle::Cylinder { centre_um: (x, y), radius_um } => {
                Body::cylinder(DVec2::new(x, y), radius_um)
            }
            Obstacle::OutsideDrop { centre_um, radius_um, height_um } => {
                Body::outside_drop(vector(centre_um), radius_um, height_um)
            }
            Obstacle::Drain { centre_um, radius_um } => {
                Ok(Body::sphere(vector(centre_um), radius_um)?.draining())
            }
        }
    }
}

impl Particles {
    /// Diameters, filled in.
    pub(super) fn diameters(&mut self, problems: &mut Problems) -> Option<Diameters> {
        let diameter = self.diameter_um.get_or_insert(Diameter::Constant(DEFAULT_DIAMETER_UM));
        problems.of("particles.diameter_um", diameter.build())
    }

    /// Everything but number and places.
    pub(super) fn cloud(&self, bodies: &[Obstacle], problems: &mut Problems) -> Option<Cloud> {
        let spheroids = self.spheroids.map(|s| {
            let orientations = match s.orientation {
                Orientation::Random => Ok(Orientations::random()),
                Orientation::Aligned(direction) => Orientations::aligned(vector(direction)),
                Orientation::VonMisesFisher { mean, kappa } => {
                    Orientations::von_mises_fisher(vector(mean), kappa)
                }
            };
            orientations.and_then(|orientations| SpheroidCloud::new(s.e_p, orientations))
        });
        let intensities = match self.c_int {
            Brightness::Constant(factor) => Intensities::equal(factor),
            Brightness::Uniform { min, max } => Intensities::uniform(min, max),
            Brightness::Normal { mean, sd } => Intensities::normal(mean, sd),
            Brightness::PowerOfDiameter { reference_um, exponent } => {
                Intensities::power_of_diameter(reference_um, exponent)
            }
        };
        let brownian =
            self.brownian.map(|b| BrownianMotion::new(b.temperature_k, b.viscosity_pa_s, b.substeps));
        let settling = self
            .settling
            .map(|s| SettlingMotion::new(s.density_difference_kg_m3, s.viscosity_pa_s, vector(s.direction)));
        let bodies: flows::Result<Vec<Body>> = bodies.iter().map(Obstacle::build).collect();

        let spheroids = problems.of("particles.spheroids", spheroids.transpose());
        let intensities = problems.of("particles.c_int", intensities);
        let brownian = problems.of("particles.brownian", brownian.transpose());
        let settling = problems.of("particles.settling", settling.transpose());
        let bodies = problems.of("boundaries.bodies", bodies);
        Some(Cloud {
            spheroids: spheroids?,
            intensities: intensities?,
            has_intensities: self.c_int != Brightness::default(),
            brownian: brownian?,
            settling: settling?,
            bodies: bodies?,
        })
    }

    /// Number and places.
    pub(super) fn seeding(
        &mut self,
        diameters: Diameters,
        (scale, settings): (&Scale, &Settings),
        z_um: (f64, f64),
        stack: impl FnOnce() -> Result<Stack>,
        files: &mut Files<'_>,
        problems: &mut Problems,
    ) -> Option<Seeding> {
        let view = problems.of("boundaries", scale.view(z_um.0, z_um.1, 0.0))?;
        let number = self.number.get_or_insert(Number::Count(DEFAULT_COUNT));
        let seeding = match number {
            Number::Count(n) => {
                problems.range("particles.number.count", f64::from(*n), 0.0, 1e6, "0 to 1000000");
                Ok(Seeding::count_in_view(*n, view, diameters))
            }
            Number::Ppp(ppp) => {
                problems.range("particles.number.ppp", *ppp, 0.0, 1.0, "0 to 1 particles per pixel");
                let pixels = f64::from(settings.pixel_dim_x) * f64::from(settings.pixel_dim_y);
                Seeding::poisson(*ppp * pixels / view.volume(), diameters)
            }
            Number::PerUm3(density) => Seeding::poisson(*density, diameters),
            Number::NS(n_s) => {
                problems.range("particles.number.n_s", *n_s, 0.0, 100.0, "0 to 100");
                // An image can be drawn only if all else is right.
                if problems.any() {
                    return None;
                }
                let area_px = problems.of("particles.number.n_s", stack())?.area_px();
                if area_px == 0.0 {
                    problems.add(
                        "particles.number.n_s",
                        *n_s,
                        "optics in which particles are seen (gain > 0)",
                    );
                }
                let pixels = f64::from(settings.pixel_dim_x) * f64::from(settings.pixel_dim_y);
                Seeding::poisson(*n_s * pixels / area_px.max(1.0) / view.volume(), diameters)
            }
            Number::File(file) => {
                let (path, bytes) = files.read("particles.number.file", file, problems)?;
                let read: Result<_> =
                    data_file::read(&bytes[..], &path.display().to_string()).map_err(Into::into);
                let places = problems.of("particles.number.file", read)?;
                *file = files.keep(Path::new(file), bytes);
                let object = |p: &microsig_core::Particle| {
                    scale.to_object(flows::scale::ImagePoint { x_px: p.x_px, y_px: p.y_px, z_um: p.z_um })
                };
                Seeding::list(places.iter().map(object).collect(), diameters)
            }
        };
        let placed = seeding.and_then(|seeding| match self.seeding {
            Placement::Uniform => Ok(seeding),
            Placement::JitteredGrid(jitter) => seeding.on_jittered_grid(jitter),
            Placement::Apart(gap_um) => seeding.apart(gap_um),
            Placement::ApartInImage(gap_um) => seeding.apart_in_image(gap_um),
        });
        problems.of("particles", placed)
    }
}
