//! The 14 settings of MicroSIG: names, units, ranges, and the three sets of Rossi 2020, Table 1.

use crate::error::{Error, Fault, Finding, shown};
use crate::interval::Interval;

/// MicroSIG's settings; fields have the names used in its settings file.
///
/// Values may be out of range (for example a magnification of -1); [`Settings::validate`] reports all that
/// are.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Magnification M, dimensionless, > 0.
    pub magnification: f64,
    /// Numerical aperture NA, > 0 and < 1 or, of an aplanatic lens, below the refractive index of its
    /// immersion.
    pub numerical_aperture: f64,
    /// Focal length of the virtual thin spherical lens, um, > 0 and at most 1e6 (350 is recommended).
    pub focal_length: f64,
    /// Refractive index of the medium, > 0.
    pub ri_medium: f64,
    /// Refractive index of the lens, > `ri_medium`.
    pub ri_lens: f64,
    /// Edge length of a square pixel on the sensor, um, > 0.
    pub pixel_size: f64,
    /// Width of the sensor, px.
    pub pixel_dim_x: u32,
    /// Height of the sensor, px.
    pub pixel_dim_y: u32,
    /// Constant background, counts.
    pub background_mean: f64,
    /// Standard deviation of the Gaussian background noise, counts, >= 0.
    pub background_noise: f64,
    /// Source points per pixel, 1/px, > 0 (10-20 is usual).
    pub points_per_pixel: f64,
    /// Rays per source point, >= 1 (100-500 is usual).
    pub n_rays: u32,
    /// Counts per ray, >= 0.
    pub gain: f64,
    /// Focal length of the virtual cylindrical lens, um, any sign; 0 means there is none.
    pub cyl_focal_length: f64,
}

/// Name, unit and allowed range of one setting.
#[derive(Debug, Clone, Copy)]
pub struct Key {
    /// The name in the settings file.
    pub name: &'static str,
    /// Unit; empty if dimensionless.
    pub unit: &'static str,
    /// The allowed range.
    pub range: Interval,
    /// Whether only whole numbers are allowed.
    pub is_whole: bool,
    /// Further requirement, or the meaning of a value; empty if there is none.
    pub condition: &'static str,
}

impl Key {
    const fn new(name: &'static str, unit: &'static str, range: Interval) -> Self {
        Key { name, unit, range, is_whole: false, condition: "" }
    }

    const fn whole(self) -> Self {
        Key { is_whole: true, ..self }
    }

    const fn with(self, condition: &'static str) -> Self {
        Key { condition, ..self }
    }

    /// What is allowed, in words.
    pub fn allowed(&self) -> String {
        let number = if self.is_whole { "whole number," } else { "number" };
        let range = self.range;
        let number = if range == Interval::FINITE {
            "a finite number".to_owned()
        } else {
            format!("a {number} {range}")
        };
        if self.condition.is_empty() { number } else { format!("{number}; {}", self.condition) }
    }

    fn allows(&self, value: f64) -> bool {
        self.range.contains(value) && (!self.is_whole || value.fract() == 0.0)
    }
}

/// Index of the numerical aperture in [`KEYS`].
const NUMERICAL_APERTURE: usize = 1;
/// Width or height of a sensor, px; the limit bounds the memory that a settings file can demand.
const SIZE: Interval = Interval::at_least(1.0).up_to(32_768.0);
/// Up to a meter, um.
const FOCAL_LENGTH: Interval = POSITIVE.up_to(1e6);
const RAYS: Interval = Interval::at_least(1.0).up_to(1e6);
const POSITIVE: Interval = Interval::above(0.0);
const NOT_NEGATIVE: Interval = Interval::at_least(0.0);

/// The settings in the order of Table 1 of Rossi 2020, in which they are also written.
pub const KEYS: [Key; 14] = [
    Key::new("magnification", "", POSITIVE),
    Key::new("numerical_aperture", "", POSITIVE)
        .with("< 1, or with lens: aplanatic less than n_i and n_i_design of the layers"),
    Key::new("focal_length", "um", FOCAL_LENGTH),
    Key::new("ri_medium", "", POSITIVE),
    Key::new("ri_lens", "", POSITIVE).with("> ri_medium"),
    Key::new("pixel_size", "um", POSITIVE),
    Key::new("pixel_dim_x", "px", SIZE).whole(),
    Key::new("pixel_dim_y", "px", SIZE).whole(),
    Key::new("background_mean", "counts", Interval::FINITE),
    Key::new("background_noise", "counts", NOT_NEGATIVE),
    Key::new("points_per_pixel", "1/px", POSITIVE),
    Key::new("n_rays", "", RAYS).whole(),
    Key::new("gain", "", NOT_NEGATIVE),
    Key::new("cyl_focal_length", "um", Interval::FINITE).with("0: no cylinder"),
];

impl Settings {
    /// Setting 1 of Table 1: M 10, NA 0.3, 752 x 366 px, no cylinder.
    pub fn setting1() -> Self {
        Self::from_values([
            10.0, 0.3, 350.0, 1.0, 1.5, 6.45, 752.0, 366.0, 350.0, 10.0, 18.0, 500.0, 3.2, 0.0,
        ])
    }

    /// Setting 1a: setting 1 with a cylindrical lens of 4000 um.
    pub fn setting1a() -> Self {
        Settings { cyl_focal_length: 4000.0, ..Self::setting1() }
    }

    /// Setting 2 of Table 1: M 63, NA 0.75, 141 x 141 px, no cylinder.
    pub fn setting2() -> Self {
        Self::from_values([63.0, 0.75, 350.0, 1.0, 1.5, 6.45, 141.0, 141.0, 52.0, 5.0, 12.0, 250.0, 1.1, 0.0])
    }

    /// Settings from their values in the order of [`KEYS`]. Integer settings are truncated.
    pub fn from_values(v: [f64; 14]) -> Self {
        Settings {
            magnification: v[0],
            numerical_aperture: v[1],
            focal_length: v[2],
            ri_medium: v[3],
            ri_lens: v[4],
            pixel_size: v[5],
            pixel_dim_x: v[6] as u32,
            pixel_dim_y: v[7] as u32,
            background_mean: v[8],
            background_noise: v[9],
            points_per_pixel: v[10],
            n_rays: v[11] as u32,
            gain: v[12],
            cyl_focal_length: v[13],
        }
    }

    /// The values in the order of [`KEYS`].
    pub fn values(&self) -> [f64; 14] {
        [
            self.magnification,
            self.numerical_aperture,
            self.focal_length,
            self.ri_medium,
            self.ri_lens,
            self.pixel_size,
            f64::from(self.pixel_dim_x),
            f64::from(self.pixel_dim_y),
            self.background_mean,
            self.background_noise,
            self.points_per_pixel,
            f64::from(self.n_rays),
            self.gain,
            self.cyl_focal_length,
        ]
    }

    /// Whether a position (px) is on a pixel of the sensor: pixel k covers [k - 0.5, k + 0.5).
    pub fn is_on_sensor(&self, x_px: f64, y_px: f64) -> bool {
        let on = |at: f64, size: u32| (0.5..f64::from(size) + 0.5).contains(&at);
        on(x_px, self.pixel_dim_x) && on(y_px, self.pixel_dim_y)
    }

    /// Checks all values.
    ///
    /// # Errors
    /// [`Error::Malformed`] with every value out of range.
    pub fn validate(&self) -> Result<(), Error> {
        self.validate_immersed(1.0)
    }

    /// Checks all values; the numerical aperture must be less than the refractive index `n_i` of the
    /// immersion.
    ///
    /// # Errors
    /// [`Error::Malformed`] with every value out of range.
    pub fn validate_immersed(&self, n_i: f64) -> Result<(), Error> {
        let faults = check(self.values(), n_i, |_| ("settings".to_owned(), None));
        if faults.is_empty() { Ok(()) } else { Err(Error::Malformed(faults)) }
    }

    /// Pixel size in object space, um.
    pub fn um_per_px(&self) -> f64 {
        self.pixel_size / self.magnification
    }
}

/// The errors in a set of values in the order of [`KEYS`], for an immersion of refractive index `n_i`;
/// `place` returns source and line of the key with an index.
pub(crate) fn check(
    mut values: [f64; 14],
    n_i: f64,
    place: impl Fn(usize) -> (String, Option<usize>),
) -> Vec<Fault> {
    let na = &mut values[NUMERICAL_APERTURE];
    // MicroSIG's range is for air.
    if *na >= 1.0 && *na < n_i {
        *na /= n_i;
    }
    let mut faults = Vec::new();
    let mut fault = |index: usize, allowed: &str| {
        let (source_name, line) = place(index);
        let (key, found) = (KEYS[index].name.to_owned(), shown(values[index]));
        let finding = Finding::Value { key, found, allowed: allowed.to_owned() };
        faults.push(Fault { source_name, line, column: None, finding });
    };
    for (index, key) in KEYS.iter().enumerate() {
        let is_above = index == NUMERICAL_APERTURE && values[index] >= 1.0;
        if is_above || !key.allows(values[index]) {
            fault(index, &key.allowed());
        }
    }
    let (ri_medium, ri_lens) = (values[3], values[4]);
    if ri_medium > 0.0 && ri_lens > 0.0 && ri_lens <= ri_medium {
        fault(4, &format!("a number > ri_medium = {ri_medium}"));
    }
    faults
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_1_is_valid_and_survives_the_round_trip() {
        for settings in [Settings::setting1(), Settings::setting1a(), Settings::setting2()] {
            settings.validate().unwrap();
            assert_eq!(Settings::from_values(settings.values()), settings);
        }
    }

    #[test]
    fn every_fault_is_named_with_its_range() {
        let broken = Settings {
            magnification: -1.0,
            numerical_aperture: 1.2,
            ri_lens: 1.0,
            gain: f64::NAN,
            ..Settings::setting1()
        };
        let message = broken.validate().unwrap_err().to_string();
        assert_eq!(message.lines().count(), 4, "{message}");
        assert!(message.contains("numerical_aperture = 1.2: expected a number > 0; < 1"), "{message}");
        assert!(message.contains("ri_lens = 1: expected a number > ri_medium = 1"), "{message}");
    }
}
