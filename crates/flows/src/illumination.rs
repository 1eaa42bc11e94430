//! Illumination: a brightness factor of each particle that depends on its position and on the light pulse.
//!
//! A light sheet of thickness T at the distance s from its middle plane: Gaussian, exp(-8 s^2 / T^2), where T
//! is the full width at e^-2 of the peak; super-Gaussian of order n, exp(-2 |2 s / T|^n), which is Gaussian
//! for n = 2; top hat, 1 for |s| <= T/2 and 0 outside. A Gaussian beam along an axis, I = (w0 / w)^2 exp(-2
//! r^2 / w^2), w = w0 sqrt(1 + (s / sR)^2) at the distance s from its waist (Saleh & Teich, Fundamentals of
//! Photonics, 3.1), r from its axis. Each can be multiplied by a linear ramp max(0, 1 + g . x), with x
//! measured from the center of the image. Each pulse has its own energy, and photobleaching dims all
//! particles by exp(-t / tau), t being the time since the start of the recording.

use crate::error::{ParameterCheck, Result};
use glam::DVec3;
use microsig_core::random::normal;
use microsig_core::stream::{Purpose, Streams};

const CHECK: ParameterCheck = ParameterCheck("illumination");

/// Largest relative standard deviation of the pulse energy; above it, redrawing negative energies shifts the
/// mean noticeably.
const MAX_JITTER: f64 = 0.3;

/// The illumination of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Illumination {
    shape: Shape,
    ramp_per_um: DVec3,
    pulse_energies: Vec<f64>,
    energy_jitter: f64,
    bleaching_s: f64,
}

/// Spatial distribution of the light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// Uniform light.
    Uniform,
    /// A light sheet.
    Sheet {
        /// Profile across the sheet.
        profile: Profile,
        /// A point on its middle plane, um.
        center: DVec3,
        /// Unit normal of the sheet.
        normal: DVec3,
        /// Thickness, um: full width at e^-2 of the peak, or between the edges of a top hat.
        thickness: f64,
    },
    /// A Gaussian beam.
    Beam {
        /// Center of the waist, um.
        center: DVec3,
        /// Unit vector along the beam.
        axis: DVec3,
        /// Waist radius w0, at e^-2 of the intensity on the axis, um.
        waist: f64,
        /// Rayleigh length sR, at which the cross-section has doubled, um; infinite for a parallel beam.
        rayleigh: f64,
    },
}

/// Profile of a light sheet.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(rename = "SheetProfile"))]
pub enum Profile {
    /// exp(-8 s^2 / T^2) at the distance s from the middle plane.
    Gaussian,
    /// 1 within the thickness, 0 outside.
    TopHat,
    /// exp(-2 |2 s / T|^N), of order N.
    SuperGaussian(
        #[cfg_attr(feature = "schema", schemars(range(min = 1.0, max = 100.0), example = 8.0))] f64,
    ),
}

impl Default for Illumination {
    /// Uniform and constant, factor 1.
    fn default() -> Self {
        Illumination {
            shape: Shape::Uniform,
            ramp_per_um: DVec3::ZERO,
            pulse_energies: vec![1.0],
            energy_jitter: 0.0,
            bleaching_s: f64::INFINITY,
        }
    }
}

impl Shape {
    /// A light sheet; `center` and `thickness` (> 0) in um, `normal` of any length but zero.
    pub fn sheet(profile: Profile, center: DVec3, normal: DVec3, thickness: f64) -> Result<Self> {
        if let Profile::SuperGaussian(order) = profile
            && !(1.0..=100.0).contains(&order)
        {
            return Err(CHECK.fault("sheet.profile.super_gaussian", order, "an order from 1 to 100"));
        }
        Ok(Shape::Sheet {
            profile,
            center: CHECK.finite_vector("sheet.center_um", center)?,
            normal: CHECK.direction("sheet.normal", normal)?,
            thickness: CHECK.positive("sheet.thickness_um", thickness)?,
        })
    }

    /// A Gaussian beam; `center`, `waist` (> 0) and `rayleigh` (> 0, infinite allowed) in um, `axis` of any
    /// length but zero.
    pub fn beam(center: DVec3, axis: DVec3, waist: f64, rayleigh: f64) -> Result<Self> {
        if rayleigh.is_nan() || rayleigh <= 0.0 {
            return Err(CHECK.fault("beam.rayleigh_um", rayleigh, "a length > 0"));
        }
        Ok(Shape::Beam {
            center: CHECK.finite_vector("beam.center_um", center)?,
            axis: CHECK.direction("beam.axis", axis)?,
            waist: CHECK.positive("beam.waist_um", waist)?,
            rayleigh,
        })
    }

    fn at(&self, x: DVec3) -> f64 {
        match *self {
            Shape::Uniform => 1.0,
            Shape::Sheet { profile, center, normal, thickness } => {
                let s = 2.0 * (x - center).dot(normal).abs() / thickness;
                match profile {
                    Profile::Gaussian => libm::exp(-2.0 * s * s),
                    Profile::TopHat => f64::from(u8::from(s <= 1.0)),
                    Profile::SuperGaussian(order) => libm::exp(-2.0 * libm::pow(s, order)),
                }
            }
            Shape::Beam { center, axis, waist, rayleigh } => {
                let way = x - center;
                let along = way.dot(axis);
                let across = (way - axis * along).length_squared();
                let spread = 1.0 + (along / rayleigh) * (along / rayleigh);
                libm::exp(-2.0 * across / (waist * waist * spread)) / spread
            }
        }
    }
}

impl Illumination {
    /// Constant illumination of this shape.
    pub fn new(shape: Shape) -> Self {
        Illumination { shape, ..Illumination::default() }
    }

    /// With a linear ramp: the factor max(0, 1 + `per_um` . x), `per_um` in 1/um, x measured from the center
    /// of the image.
    pub fn with_ramp(self, per_um: DVec3) -> Result<Self> {
        Ok(Illumination { ramp_per_um: CHECK.finite_vector("ramp_per_um", per_um)?, ..self })
    }

    /// With pulse energies (dimensionless factors >= 0), one per frame and repeated cyclically, that
    /// fluctuate normally with a relative standard deviation `jitter` (0 to 0.3).
    pub fn with_pulses(self, energies: Vec<f64>, jitter: f64) -> Result<Self> {
        if energies.is_empty() {
            return Err(CHECK.fault("pulse_energies", "[]", "at least one energy"));
        }
        for energy in &energies {
            CHECK.not_negative("pulse_energies", *energy)?;
        }
        if !(0.0..=MAX_JITTER).contains(&jitter) {
            return Err(CHECK.fault("energy_jitter", jitter, "0 to 0.3"));
        }
        Ok(Illumination { pulse_energies: energies, energy_jitter: jitter, ..self })
    }

    /// With photobleaching: all particles dim by exp(-t / `tau_s`), `tau_s` > 0, t being the time since the
    /// start of the recording.
    pub fn with_bleaching(self, tau_s: f64) -> Result<Self> {
        if tau_s.is_nan() || tau_s <= 0.0 {
            return Err(CHECK.fault("bleaching_s", tau_s, "a time > 0"));
        }
        Ok(Illumination { bleaching_s: tau_s, ..self })
    }

    /// The factor at the position `x` (um).
    pub fn at(&self, x: DVec3) -> f64 {
        self.shape.at(x) * (1.0 + self.ramp_per_um.dot(x)).max(0.0)
    }

    /// The factor of a frame: pulse energy, its fluctuation and bleaching. `frame` is its number in the
    /// dataset, `number` its number in the recording, `t_s` the time (s) since the start of the recording.
    pub fn energy(&self, frame: u32, number: u32, t_s: f64, streams: Streams) -> f64 {
        let nominal = self.pulse_energies[number as usize % self.pulse_energies.len()];
        let mut stream = streams.stream(Purpose::PulseEnergy, frame, 0);
        let fluctuating = loop {
            if self.energy_jitter == 0.0 {
                break 1.0;
            }
            let factor = 1.0 + self.energy_jitter * normal(&mut stream);
            if factor >= 0.0 {
                break factor;
            }
        };
        nominal * fluctuating * libm::exp(-t_s / self.bleaching_s)
    }

    /// The depths (z, um) of the two faces of a light sheet normal to the optical axis; `None` for any other
    /// illumination.
    pub fn depths(&self) -> Option<(f64, f64)> {
        match self.shape {
            Shape::Sheet { center, normal, thickness, .. } if normal.z.abs() == 1.0 => {
                Some((center.z - 0.5 * thickness, center.z + 0.5 * thickness))
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sheet(profile: Profile) -> Illumination {
        let shape = Shape::sheet(profile, DVec3::new(0.0, 0.0, -30.0), DVec3::Z * 4.0, 20.0);
        Illumination::new(shape.unwrap())
    }

    #[test]
    fn a_sheet_has_its_thickness_at_e_to_the_minus_two() {
        let at = |profile, z: f64| sheet(profile).at(DVec3::new(70.0, -9.0, z));
        for profile in [Profile::Gaussian, Profile::SuperGaussian(2.0), Profile::SuperGaussian(8.0)] {
            assert_eq!(at(profile, -30.0), 1.0);
            assert!((at(profile, -40.0) - libm::exp(-2.0)).abs() < 1e-15);
            assert!((at(profile, -20.0) - libm::exp(-2.0)).abs() < 1e-15);
        }
        assert!((at(Profile::Gaussian, -25.0) - libm::exp(-0.5)).abs() < 1e-15);
        assert!(at(Profile::SuperGaussian(8.0), -25.0) > 0.99);
        assert_eq!([-40.0, -20.0, -41.0, -19.9].map(|z| at(Profile::TopHat, z)), [1.0, 1.0, 0.0, 0.0]);
        assert_eq!(sheet(Profile::TopHat).depths(), Some((-40.0, -20.0)));
        let oblique = Shape::sheet(Profile::Gaussian, DVec3::ZERO, DVec3::new(1.0, 0.0, 1.0), 20.0).unwrap();
        assert_eq!(Illumination::new(oblique).depths(), None);
    }

    #[test]
    fn a_beam_keeps_its_power_in_every_section() {
        let beam = Shape::beam(DVec3::new(5.0, 0.0, 0.0), DVec3::Z, 30.0, 80.0).unwrap();
        let power = |z: f64| {
            // Rings 0.1 um wide out to where exp(-2 r^2 / w^2) is below 1e-10.
            let rings = (0..2000).map(|i| 0.1 * (f64::from(i) + 0.5));
            rings.map(|r| r * beam.at(DVec3::new(5.0, r, z))).sum::<f64>()
        };
        assert_eq!(beam.at(DVec3::new(5.0, 0.0, 0.0)), 1.0);
        assert!((beam.at(DVec3::new(35.0, 0.0, 0.0)) - libm::exp(-2.0)).abs() < 1e-15);
        // At the Rayleigh length the section has doubled.
        assert!((beam.at(DVec3::new(5.0, 0.0, 80.0)) - 0.5).abs() < 1e-15);
        assert!((power(0.0) / power(80.0) - 1.0).abs() < 1e-6, "{} {}", power(0.0), power(80.0));
        let parallel = Shape::beam(DVec3::ZERO, DVec3::Z, 30.0, f64::INFINITY).unwrap();
        assert_eq!(parallel.at(DVec3::Z * 1e6), 1.0);
    }

    #[test]
    fn a_ramp_ends_at_zero() {
        let light = Illumination::default().with_ramp(DVec3::new(0.01, 0.0, 0.0)).unwrap();
        let x = |x: f64| light.at(DVec3::X * x);
        assert_eq!([x(0.0), x(50.0), x(-50.0), x(-200.0)], [1.0, 1.5, 0.5, 0.0]);
    }

    #[test]
    fn pulses_alternate_fluctuate_and_bleach() {
        let streams = Streams::new(3);
        let light = Illumination::default().with_pulses(vec![1.0, 0.8], 0.0).unwrap();
        assert_eq!([0, 1, 2, 3].map(|k| light.energy(k, k, 0.0, streams)), [1.0, 0.8, 1.0, 0.8]);
        let bleached = light.clone().with_bleaching(0.5).unwrap();
        assert!((bleached.energy(9, 1, 1.0, streams) - 0.8 * libm::exp(-2.0)).abs() < 1e-16);
        let unsteady = light.with_pulses(vec![1.0], 0.1).unwrap();
        let energies: Vec<f64> = (0..4000).map(|k| unsteady.energy(k, k, 0.0, streams)).collect();
        let mean = energies.iter().sum::<f64>() / 4000.0;
        let variance = energies.iter().map(|e| (e - mean) * (e - mean)).sum::<f64>() / 4000.0;
        // Standard errors 0.1 / 63 and 0.1 / 89.
        assert!((mean - 1.0).abs() < 4.0 * 0.0016, "{mean}");
        assert!((libm::sqrt(variance) - 0.1).abs() < 4.0 * 0.0011, "{variance}");
        assert_eq!(energies[7], unsteady.energy(7, 3, 0.0, streams), "the dataset's frame is the address");
    }

    #[test]
    fn impossible_light_is_refused() {
        let text = |result: Result<Illumination>| result.unwrap_err().to_string();
        let none = Illumination::default;
        assert!(text(none().with_pulses(vec![], 0.0)).contains("at least one energy"));
        assert!(text(none().with_pulses(vec![1.0, -1.0], 0.0)).contains("pulse_energies = -1"));
        assert!(text(none().with_pulses(vec![1.0], 0.5)).contains("energy_jitter = 0.5"));
        assert!(text(none().with_bleaching(f64::NAN)).contains("bleaching_s = NaN"));
        assert!(text(none().with_ramp(DVec3::NAN)).contains("ramp_per_um"));
        assert!(Shape::sheet(Profile::Gaussian, DVec3::ZERO, DVec3::ZERO, 5.0).is_err());
        assert!(Shape::sheet(Profile::SuperGaussian(0.0), DVec3::ZERO, DVec3::Z, 5.0).is_err());
        assert!(Shape::sheet(Profile::TopHat, DVec3::ZERO, DVec3::Z, 0.0).is_err());
        assert!(Shape::beam(DVec3::ZERO, DVec3::Z, 0.0, 1.0).is_err());
    }
}
