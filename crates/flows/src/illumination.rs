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
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const CHECK: ParameterCheck = ParameterCheck("illumination");

/// Largest relative standard deviation of the pulse energy; above it, redrawing negative energies shifts the
/// mean noticeably.
const MAX_JITTER: f64 = 0.3;

/// Illumination that varies in space and from pulse to pulse; `flows::illumination` documents the formulas.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Illumination {
    /// Spatial distribution of the light.
    pub shape: LightShape,
    /// Relative gradient of the light along x, y and z; the ramp is 1 at the center of the image.
    pub ramp_per_um: (f64, f64, f64),
    /// Relative pulse energies of the frames of a recording, repeated cyclically.
    #[schemars(length(min = 1, max = 10_000_000), inner(range(min = 0.0, max = 1e6)))]
    pub pulse_energies: Vec<f64>,
    /// Relative standard deviation of the pulse energies.
    #[schemars(range(min = 0.0, max = MAX_JITTER))]
    pub energy_jitter: f64,
    /// Photobleaching: time in which the brightness of the particles decays to 1/e.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("exclusiveMinimum" = 0), example = 2.0)]
    pub bleaching_s: Option<f64>,
}

/// Spatial distribution of the light.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
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
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Sheet {
    /// Intensity profile across the sheet.
    pub profile: SheetProfile,
    /// Thickness T: distance between the two e^-2 points, or between the edges of a top hat.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub thickness_um: f64,
    /// A point in its middle plane (x, y, z).
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-default" = "the middle of the depth range", "x-formerly" = ["centre_um"]))]
    pub center_um: Option<(f64, f64, f64)>,
    /// Normal of the sheet (x, y, z).
    pub normal: (f64, f64, f64),
}

/// Profile of a light sheet.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SheetProfile {
    /// exp(-8 s^2 / T^2) at the distance s from the middle plane.
    Gaussian,
    /// 1 within the thickness, 0 outside.
    TopHat,
    /// exp(-2 |2 s / T|^N), of order N.
    SuperGaussian(#[schemars(range(min = 1.0, max = 100.0), example = 8.0)] f64),
}

impl Default for Sheet {
    fn default() -> Self {
        let (profile, normal) = (SheetProfile::Gaussian, (0.0, 0.0, 1.0));
        Sheet { profile, thickness_um: 20.0, center_um: None, normal }
    }
}

/// A Gaussian beam.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Beam {
    /// Center of the beam waist (x, y, z).
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend(
        "x-default" = "on the optical axis in the middle of the depth range",
        "x-formerly" = ["centre_um"]
    ))]
    pub center_um: Option<(f64, f64, f64)>,
    /// Direction of the beam (x, y, z).
    pub axis: (f64, f64, f64),
    /// e^-2 radius of the beam waist.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub waist_um: f64,
    /// Rayleigh length: distance from the waist at which the cross-section has doubled.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("exclusiveMinimum" = 0, "x-default" = "a collimated beam"), example = 5000.0)]
    pub rayleigh_um: Option<f64>,
}

impl Default for Beam {
    fn default() -> Self {
        Beam { center_um: None, axis: (0.0, 0.0, 1.0), waist_um: 200.0, rayleigh_um: None }
    }
}

impl Default for Illumination {
    /// Uniform and constant, factor 1.
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

impl LightShape {
    fn check(&self) -> Result<()> {
        match *self {
            LightShape::Uniform => {}
            LightShape::Sheet(Sheet { profile, thickness_um, center_um, normal }) => {
                if let SheetProfile::SuperGaussian(order) = profile
                    && !(1.0..=100.0).contains(&order)
                {
                    return Err(CHECK.fault("sheet.profile.super_gaussian", order, "an order from 1 to 100"));
                }
                CHECK.finite_vector("sheet.center_um", center_um.unwrap_or_default().into())?;
                CHECK.direction("sheet.normal", normal.into())?;
                CHECK.positive("sheet.thickness_um", thickness_um)?;
            }
            LightShape::Beam(Beam { center_um, axis, waist_um, rayleigh_um }) => {
                check_positive("beam.rayleigh_um", rayleigh_um, "a length > 0")?;
                CHECK.finite_vector("beam.center_um", center_um.unwrap_or_default().into())?;
                CHECK.direction("beam.axis", axis.into())?;
                CHECK.positive("beam.waist_um", waist_um)?;
            }
        }
        Ok(())
    }

    fn at(&self, x: DVec3) -> f64 {
        let way = |center_um: Option<(f64, f64, f64)>| x - DVec3::from(center_um.unwrap_or_default());
        match *self {
            LightShape::Uniform => 1.0,
            LightShape::Sheet(Sheet { profile, thickness_um, center_um, normal }) => {
                let normal = DVec3::from(normal).normalize();
                let s = 2.0 * way(center_um).dot(normal).abs() / thickness_um;
                match profile {
                    SheetProfile::Gaussian => libm::exp(-2.0 * s * s),
                    SheetProfile::TopHat => f64::from(u8::from(s <= 1.0)),
                    SheetProfile::SuperGaussian(order) => libm::exp(-2.0 * libm::pow(s, order)),
                }
            }
            LightShape::Beam(Beam { center_um, axis, waist_um, rayleigh_um }) => {
                let (way, axis) = (way(center_um), DVec3::from(axis).normalize());
                let along = way.dot(axis);
                let across = (way - axis * along).length_squared();
                let rayleigh = rayleigh_um.unwrap_or(f64::INFINITY);
                let spread = 1.0 + (along / rayleigh) * (along / rayleigh);
                libm::exp(-2.0 * across / (waist_um * waist_um * spread)) / spread
            }
        }
    }
}

/// Checks a length or time that may be infinite.
fn check_positive(parameter: &'static str, value: Option<f64>, allowed: &str) -> Result<()> {
    match value {
        Some(value) if value.is_nan() || value <= 0.0 => Err(CHECK.fault(parameter, value, allowed)),
        _ => Ok(()),
    }
}

impl Illumination {
    /// The same illumination, or `Err` if a value is out of range; directions may have any length but zero.
    pub fn checked(self) -> Result<Self> {
        self.shape.check()?;
        CHECK.finite_vector("ramp_per_um", self.ramp_per_um.into())?;
        if self.pulse_energies.is_empty() {
            return Err(CHECK.fault("pulse_energies", "[]", "at least one energy"));
        }
        for energy in &self.pulse_energies {
            CHECK.not_negative("pulse_energies", *energy)?;
        }
        if !(0.0..=MAX_JITTER).contains(&self.energy_jitter) {
            return Err(CHECK.fault("energy_jitter", self.energy_jitter, "0 to 0.3"));
        }
        check_positive("bleaching_s", self.bleaching_s, "a time > 0")?;
        Ok(self)
    }

    /// Puts the middle of a light sheet and the waist of a beam at `middle_um` unless they are given.
    pub fn fill_center(&mut self, middle_um: (f64, f64, f64)) {
        if let LightShape::Sheet(Sheet { center_um, .. }) | LightShape::Beam(Beam { center_um, .. }) =
            &mut self.shape
        {
            center_um.get_or_insert(middle_um);
        }
    }

    /// The factor at the position `x` (um).
    pub fn at(&self, x: DVec3) -> f64 {
        self.shape.at(x) * (1.0 + DVec3::from(self.ramp_per_um).dot(x)).max(0.0)
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
        nominal * fluctuating * libm::exp(-t_s / self.bleaching_s.unwrap_or(f64::INFINITY))
    }

    /// The depths (z, um) of the two faces of a light sheet normal to the optical axis; `None` for any other
    /// illumination.
    pub fn depths(&self) -> Option<(f64, f64)> {
        let LightShape::Sheet(Sheet { center_um, normal, thickness_um, .. }) = self.shape else {
            return None;
        };
        let (center, normal) = (DVec3::from(center_um.unwrap_or_default()), DVec3::from(normal).normalize());
        let half = 0.5 * thickness_um;
        (normal.z.abs() == 1.0).then_some((center.z - half, center.z + half))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn light(shape: LightShape) -> Illumination {
        Illumination { shape, ..Illumination::default() }.checked().unwrap()
    }

    fn sheet(profile: SheetProfile) -> Illumination {
        let (center_um, normal) = (Some((0.0, 0.0, -30.0)), (0.0, 0.0, 4.0));
        light(LightShape::Sheet(Sheet { profile, center_um, normal, thickness_um: 20.0 }))
    }

    #[test]
    fn a_sheet_has_its_thickness_at_e_to_the_minus_two() {
        let at = |profile, z: f64| sheet(profile).at(DVec3::new(70.0, -9.0, z));
        for profile in
            [SheetProfile::Gaussian, SheetProfile::SuperGaussian(2.0), SheetProfile::SuperGaussian(8.0)]
        {
            assert_eq!(at(profile, -30.0), 1.0);
            assert!((at(profile, -40.0) - libm::exp(-2.0)).abs() < 1e-15);
            assert!((at(profile, -20.0) - libm::exp(-2.0)).abs() < 1e-15);
        }
        assert!((at(SheetProfile::Gaussian, -25.0) - libm::exp(-0.5)).abs() < 1e-15);
        assert!(at(SheetProfile::SuperGaussian(8.0), -25.0) > 0.99);
        assert_eq!([-40.0, -20.0, -41.0, -19.9].map(|z| at(SheetProfile::TopHat, z)), [1.0, 1.0, 0.0, 0.0]);
        assert_eq!(sheet(SheetProfile::TopHat).depths(), Some((-40.0, -20.0)));
        let oblique = Sheet { normal: (1.0, 0.0, 1.0), ..Sheet::default() };
        assert_eq!(light(LightShape::Sheet(oblique)).depths(), None);
    }

    #[test]
    fn a_beam_keeps_its_power_in_every_section() {
        let parallel = Beam { center_um: Some((5.0, 0.0, 0.0)), waist_um: 30.0, ..Beam::default() };
        let beam = light(LightShape::Beam(Beam { rayleigh_um: Some(80.0), ..parallel }));
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
        assert_eq!(light(LightShape::Beam(parallel)).at(DVec3::new(5.0, 0.0, 1e6)), 1.0);
    }

    #[test]
    fn a_ramp_ends_at_zero() {
        let light = Illumination { ramp_per_um: (0.01, 0.0, 0.0), ..Illumination::default() };
        let x = |x: f64| light.at(DVec3::X * x);
        assert_eq!([x(0.0), x(50.0), x(-50.0), x(-200.0)], [1.0, 1.5, 0.5, 0.0]);
    }

    #[test]
    fn pulses_alternate_fluctuate_and_bleach() {
        let streams = Streams::new(3);
        let light = Illumination { pulse_energies: vec![1.0, 0.8], ..Illumination::default() };
        assert_eq!([0, 1, 2, 3].map(|k| light.energy(k, k, 0.0, streams)), [1.0, 0.8, 1.0, 0.8]);
        let bleached = Illumination { bleaching_s: Some(0.5), ..light };
        assert!((bleached.energy(9, 1, 1.0, streams) - 0.8 * libm::exp(-2.0)).abs() < 1e-16);
        let unsteady = Illumination { energy_jitter: 0.1, ..Illumination::default() };
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
        let text = |light: Illumination| light.checked().unwrap_err().to_string();
        let none = Illumination::default;
        assert!(text(Illumination { pulse_energies: vec![], ..none() }).contains("at least one energy"));
        let dark = Illumination { pulse_energies: vec![1.0, -1.0], ..none() };
        assert!(text(dark).contains("pulse_energies = -1"));
        assert!(text(Illumination { energy_jitter: 0.5, ..none() }).contains("energy_jitter = 0.5"));
        assert!(text(Illumination { bleaching_s: Some(f64::NAN), ..none() }).contains("bleaching_s = NaN"));
        assert!(text(Illumination { ramp_per_um: (f64::NAN, 0.0, 0.0), ..none() }).contains("ramp_per_um"));
        let sheet = Sheet::default();
        for (shape, key) in [
            (LightShape::Sheet(Sheet { normal: (0.0, 0.0, 0.0), ..sheet }), "sheet.normal"),
            (
                LightShape::Sheet(Sheet { profile: SheetProfile::SuperGaussian(0.0), ..sheet }),
                "super_gaussian",
            ),
            (LightShape::Sheet(Sheet { thickness_um: 0.0, ..sheet }), "sheet.thickness_um = 0"),
            (LightShape::Beam(Beam { waist_um: 0.0, ..Beam::default() }), "beam.waist_um = 0"),
            (LightShape::Beam(Beam { rayleigh_um: Some(0.0), ..Beam::default() }), "beam.rayleigh_um = 0"),
        ] {
            let said = text(Illumination { shape, ..none() });
            assert!(said.contains(key), "{said}");
        }
    }
}
