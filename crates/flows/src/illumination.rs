//! Light on the particles: a factor on the brightness of each, by where it is and by the pulse.
//!
//! A light sheet of thickness T about a plane at distance s (Gaussian: exp(-8 s^2 / T^2), T being the width at e^-2 of the
//! middle; super-Gaussian of order n: exp(-2 |2 s / T|^n), Gaussian for n = 2; top hat: 1 within T, 0 beyond). A Gaussian
//! beam along an axis, I = (w0 / w)^2 exp(-2 r^2 / w^2), w = w0 sqrt(1 + (s / sR)^2) at the distance s from its waist (Saleh &
//! Teich, Fundamentals of Photonics, 3.1), r from its axis. Any of them times a ramp 1 + g . (x - c), nowhere below zero. A
//! pulse has an energy of its own, and bleaching dims all particles by exp(-t / tau) since the recording began.

use crate::error::{Check, Result};
use glam::DVec3;
use microsig_core::random::normal;
use microsig_core::stream::{Purpose, Streams};

const CHECK: Check = Check("illumination");

/// The largest relative standard deviation of the energy of a pulse: beyond it redrawing those below zero shifts the mean.
const MAX_JITTER: f64 = 0.3;

/// The light of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Illumination {
    shape: Shape,
    ramp_per_um: DVec3,
    pulse_energies: Vec<f64>,
    energy_jitter: f64,
    bleaching_s: f64,
}

/// How light is spread over space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// The same everywhere.
    Uniform,
    /// A light sheet.
    Sheet {
        /// How it falls off.
        profile: Profile,
        /// A point of its middle plane, um.
        centre: DVec3,
        /// Across it, of length 1.
        normal: DVec3,
        /// Its thickness, um: between the places of e^-2 of the middle, or between the edges of a top hat.
        thickness: f64,
    },
    /// A Gaussian beam.
    Beam {
        /// The middle of its waist, um.
        centre: DVec3,
        /// Its direction, of length 1.
        axis: DVec3,
        /// Radius of the waist, where light is e^-2 of the middle, um.
        waist: f64,
        /// Distance from the waist at which its section has doubled, um; infinite for a parallel beam.
        rayleigh: f64,
    },
}

/// Profile of a light sheet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Profile {
    /// exp(-8 s^2 / T^2).
    Gaussian,
    /// 1 within the thickness.
    TopHat,
    /// exp(-2 |2 s / T|^n).
    SuperGaussian(f64),
}

impl Default for Illumination {
    /// The same everywhere and always.
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

fn direction(parameter: &'static str, v: DVec3) -> Result<DVec3> {
    let unit = CHECK.finite_vector(parameter, v)?.try_normalize();
    unit.ok_or_else(|| CHECK.fault(parameter, v, "a vector other than zero"))
}

impl Shape {
    /// A light sheet; `centre` and `thickness` (> 0) in um, `normal` of any length but zero.
    pub fn sheet(profile: Profile, centre: DVec3, normal: DVec3, thickness: f64) -> Result<Self> {
        if let Profile::SuperGaussian(order) = profile
            && !(1.0..=100.0).contains(&order)
        {
            return Err(CHECK.fault("sheet.profile.super_gaussian", order, "an order from 1 to 100"));
        }
        Ok(Shape::Sheet {
            profile,
            centre: CHECK.finite_vector("sheet.centre_um", centre)?,
            normal: direction("sheet.normal", normal)?,
            thickness: CHECK.positive("sheet.thickness_um", thickness)?,
        })
    }

    /// A Gaussian beam; `centre`, `waist` (> 0) and `rayleigh` (> 0, infinite allowed) in um, `axis` of any length but zero.
    pub fn beam(centre: DVec3, axis: DVec3, waist: f64, rayleigh: f64) -> Result<Self> {
        if rayleigh.is_nan() || rayleigh <= 0.0 {
            return Err(CHECK.fault("beam.rayleigh_um", rayleigh, "a length > 0"));
        }
        Ok(Shape::Beam {
            centre: CHECK.finite_vector("beam.centre_um", centre)?,
            axis: direction("beam.axis", axis)?,
            waist: CHECK.positive("beam.waist_um", waist)?,
            rayleigh,
        })
    }

    fn at(&self, x: DVec3) -> f64 {
        match *self {
            Shape::Uniform => 1.0,
            Shape::Sheet { profile, centre, normal, thickness } => {
                let s = 2.0 * (x - centre).dot(normal).abs() / thickness;
                match profile {
                    Profile::Gaussian => libm::exp(-2.0 * s * s),
                    Profile::TopHat => f64::from(u8::from(s <= 1.0)),
                    Profile::SuperGaussian(order) => libm::exp(-2.0 * libm::pow(s, order)),
                }
            }
            Shape::Beam { centre, axis, waist, rayleigh } => {
                let way = x - centre;
                let along = way.dot(axis);
                let across = (way - axis * along).length_squared();
                let spread = 1.0 + (along / rayleigh) * (along / rayleigh);
                libm::exp(-2.0 * across / (waist * waist * spread)) / spread
            }
        }
    }
}

impl Illumination {
    /// Light of a shape.
    pub fn new(shape: Shape) -> Self {
        Illumination { shape, ..Illumination::default() }
    }

    /// With a ramp: the factor 1 + `per_um` . (x - middle of the image), at least 0.
    pub fn with_ramp(self, per_um: DVec3) -> Result<Self> {
        Ok(Illumination { ramp_per_um: CHECK.finite_vector("ramp_per_um", per_um)?, ..self })
    }

    /// With energies (>= 0) of the frames of a recording, in their order and again from the first after the last, that fluctuate normally with
    /// a relative standard deviation `jitter` (0 to 0.3).
    pub fn with_pulses(self, energies: Vec<f64>, jitter: f64) -> Result<Self> {
        if energies.is_empty() {
            return Err(CHECK.fault("pulse_energies", "[]", "one energy or more"));
        }
        for energy in &energies {
            CHECK.not_negative("pulse_energies", *energy)?;
        }
        if !(0.0..=MAX_JITTER).contains(&jitter) {
            return Err(CHECK.fault("energy_jitter", jitter, "0 to 0.3"));
        }
        Ok(Illumination { pulse_energies: energies, energy_jitter: jitter, ..self })
    }

    /// With bleaching: all particles dim by exp(-t / `tau_s`), `tau_s` > 0, t being the time since the recording began.
    pub fn with_bleaching(self, tau_s: f64) -> Result<Self> {
        if tau_s.is_nan() || tau_s <= 0.0 {
            return Err(CHECK.fault("bleaching_s", tau_s, "a time > 0"));
        }
        Ok(Illumination { bleaching_s: tau_s, ..self })
    }

    /// The factor of the place `x` (um).
    pub fn at(&self, x: DVec3) -> f64 {
        self.shape.at(x) * (1.0 + self.ramp_per_um.dot(x)).max(0.0)
    }

    /// The factor of a frame: of number `frame` in the dataset, `number` in its recording, `t_s` after that began.
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

    /// The depths between which there is light, if it is a sheet across the optical axis, um.
    pub fn depths(&self) -> Option<(f64, f64)> {
        match self.shape {
            Shape::Sheet { centre, normal, thickness, .. } if normal.z.abs() == 1.0 => {
                Some((centre.z - 0.5 * thickness, centre.z + 0.5 * thickness))
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
            // Rings of 0.1 um out to where exp(-2 r^2 / w^2) is below 1e-10.
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
        assert!(text(none().with_pulses(vec![], 0.0)).contains("one energy or more"));
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
