//! Light on the particles, as scenarios write it.

use flows::Illumination as Light;
use flows::illumination::{Profile, Shape};
use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::problems::Problems;

/// Light that differs from place to place and from pulse to pulse; `flows::illumination` has the formulas.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Illumination {
    /// How it is spread over space.
    pub shape: LightShape,
    /// Change of the light per um along x, y and z, relative to that in the middle of the image.
    pub ramp_per_um: (f64, f64, f64),
    /// Energies of the frames of a recording, and again from the first after the last.
    pub pulse_energies: Vec<f64>,
    /// Relative standard deviation of the energy of a pulse.
    pub energy_jitter: f64,
    /// Time in which the particles dim to 1/e, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bleaching_s: Option<f64>,
}

/// How light is spread over space.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LightShape {
    /// The same everywhere.
    #[default]
    Uniform,
    /// A light sheet.
    Sheet(Sheet),
    /// A Gaussian beam.
    Beam(Beam),
}

/// A light sheet.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Sheet {
    /// How it falls off.
    pub profile: SheetProfile,
    /// Between the places where light is e^-2 of that in the middle, or between the edges of a top hat, um.
    pub thickness_um: f64,
    /// A point of its middle plane, um; unless given, the middle of the depth range.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub centre_um: Option<(f64, f64, f64)>,
    /// Across it.
    pub normal: (f64, f64, f64),
}

impl Default for Sheet {
    fn default() -> Self {
        Sheet {
            profile: SheetProfile::Gaussian,
            thickness_um: 20.0,
            centre_um: None,
            normal: (0.0, 0.0, 1.0),
        }
    }
}

/// Profile of a light sheet.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SheetProfile {
    /// exp(-8 s^2 / T^2).
    Gaussian,
    /// 1 within the thickness, 0 beyond.
    TopHat,
    /// exp(-2 |2 s / T|^order).
    SuperGaussian(f64),
}

/// A Gaussian beam.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Beam {
    /// The middle of its waist, um; unless given, on the optical axis in the middle of the depth range.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub centre_um: Option<(f64, f64, f64)>,
    /// Its direction.
    pub axis: (f64, f64, f64),
    /// Radius of the waist, where light is e^-2 of that in the middle, um.
    pub waist_um: f64,
    /// Distance from the waist at which its section has doubled, um; unless given, the beam is parallel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rayleigh_um: Option<f64>,
}

impl Default for Beam {
    fn default() -> Self {
        Beam { centre_um: None, axis: (0.0, 0.0, 1.0), waist_um: 200.0, rayleigh_um: None }
    }
}

impl Default for Illumination {
    fn default() -> Self {
        Illumination {
            shape: LightShape::Uniform,
            ramp_per_um: (0.0, 0.0, 0.0),
            pulse_energies: vec![1.0],
            energy_jitter: 0.0,
            bleaching_s: None,
        }
    }
}

impl Illumination {
    /// Fills defaults and checks.
    pub(super) fn build(&mut self, z_um: (f64, f64), problems: &mut Problems) -> Option<Light> {
        let middle = (0.0, 0.0, 0.5 * (z_um.0 + z_um.1));
        let shape = match &mut self.shape {
            LightShape::Uniform => Ok(Shape::Uniform),
            LightShape::Sheet(s) => {
                let profile = match s.profile {
                    SheetProfile::Gaussian => Profile::Gaussian,
                    SheetProfile::TopHat => Profile::TopHat,
                    SheetProfile::SuperGaussian(order) => Profile::SuperGaussian(order),
                };
                let centre = DVec3::from(*s.centre_um.get_or_insert(middle));
                Shape::sheet(profile, centre, DVec3::from(s.normal), s.thickness_um)
            }
            LightShape::Beam(b) => {
                let centre = DVec3::from(*b.centre_um.get_or_insert(middle));
                let rayleigh = b.rayleigh_um.unwrap_or(f64::INFINITY);
                Shape::beam(centre, DVec3::from(b.axis), b.waist_um, rayleigh)
            }
        };
        let light = shape.and_then(|shape| {
            Light::new(shape)
                .with_ramp(DVec3::from(self.ramp_per_um))?
                .with_pulses(self.pulse_energies.clone(), self.energy_jitter)?
                .with_bleaching(self.bleaching_s.unwrap_or(f64::INFINITY))
        });
        problems.of("illumination", light)
    }
}
