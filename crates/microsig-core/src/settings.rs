//! The 14 settings of MicroSIG: names, units, ranges, and the three sets of Rossi 2020, Table 1.

use crate::error::Error;
use crate::interval::Interval;
use crate::problem::{Problem, Problems};

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

macro_rules! settings {
    ($($(#[doc = $meaning:literal])* $name:ident: $type:ident, $unit:literal, $range:expr $(, $condition:literal)?;)*) => {
        /// MicroSIG's settings; fields have the names used in its settings file.
        ///
        /// Values may be out of range (for example a magnification of -1); [`Settings::validate`] reports all that
        /// are.
        #[derive(Debug, Clone, PartialEq)]
        pub struct Settings {
            $($(#[doc = $meaning])* pub $name: $type,)*
        }

        /// The settings in the order of Table 1 of Rossi 2020, in which they are also written.
        pub const KEYS: [Key; 14] = [$(Key {
            name: stringify!($name),
            unit: $unit,
            range: $range,
            is_whole: stringify!($type).as_bytes()[0] == b'u',
            condition: concat!($($condition)?),
        }),*];

        impl Settings {
            /// Settings from their values in the order of [`KEYS`]. Integer settings are truncated.
            pub fn from_values([$($name),*]: [f64; 14]) -> Self {
                Settings { $($name: $name as $type),* }
            }

            /// The values in the order of [`KEYS`].
            pub fn values(&self) -> [f64; 14] {
                [$(f64::from(self.$name)),*]
            }
        }
    };
}

settings! {
    /// Magnification M, dimensionless, > 0.
    magnification: f64, "", POSITIVE;
    /// Numerical aperture NA, > 0 and < 1 or, of an aplanatic lens, below the refractive index of its
    /// immersion.
    numerical_aperture: f64, "", POSITIVE, "< 1, or with lens: aplanatic less than n_i and n_i_design of the layers";
    /// Focal length of the virtual thin spherical lens, um, > 0 and at most 1e6 (350 is recommended).
    focal_length: f64, "um", FOCAL_LENGTH;
    /// Refractive index of the medium, > 0.
    ri_medium: f64, "", POSITIVE;
    /// Refractive index of the lens, > `ri_medium`.
    ri_lens: f64, "", POSITIVE, "> ri_medium";
    /// Edge length of a square pixel on the sensor, um, > 0.
    pixel_size: f64, "um", POSITIVE;
    /// Width of the sensor, px.
    pixel_dim_x: u32, "px", SIZE;
    /// Height of the sensor, px.
    pixel_dim_y: u32, "px", SIZE;
    /// Constant background, counts.
    background_mean: f64, "counts", Interval::FINITE;
    /// Standard deviation of the Gaussian background noise, counts, >= 0.
    background_noise: f64, "counts", NOT_NEGATIVE;
    /// Source points per pixel, 1/px, > 0 (10-20 is usual).
    points_per_pixel: f64, "1/px", POSITIVE;
    /// Rays per source point, >= 1 (100-500 is usual).
    n_rays: u32, "", RAYS;
    /// Counts per ray, >= 0.
    gain: f64, "", NOT_NEGATIVE;
    /// Focal length of the virtual cylindrical lens, um, any sign; 0 means there is none.
    cyl_focal_length: f64, "um", Interval::FINITE, "0: no cylinder";
}

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

    /// The position of the middle of the sensor, px.
    pub fn middle_px(&self) -> [f64; 2] {
        [self.pixel_dim_x, self.pixel_dim_y].map(|size| 0.5 * (f64::from(size) + 1.0))
    }

    /// Whether a position (px) is on a pixel of the sensor: pixel k covers [k - 0.5, k + 0.5).
    pub fn is_on_sensor(&self, x_px: f64, y_px: f64) -> bool {
        let on = |at: f64, size: u32| (0.5..f64::from(size) + 0.5).contains(&at);
        on(x_px, self.pixel_dim_x) && on(y_px, self.pixel_dim_y)
    }

    /// Checks all values. Errors: [`Error::Malformed`] with every value out of range.
    pub fn validate(&self) -> Result<(), Error> {
        self.validate_immersed(1.0)
    }

    /// Checks all values; the numerical aperture must be less than the refractive index `n_i` of the
    /// immersion. Errors: [`Error::Malformed`] with every value out of range.
    pub fn validate_immersed(&self, n_i: f64) -> Result<(), Error> {
        check(self.values(), n_i, |_| "settings".to_owned()).finish(Error::Malformed)
    }

    /// Pixel size in object space, um.
    pub fn um_per_px(&self) -> f64 {
        self.pixel_size / self.magnification
    }
}

/// The problems of a set of values in the order of [`KEYS`], for an immersion of refractive index `n_i`;
/// `input` returns the input of the key with an index, with its line.
pub(crate) fn check(mut values: [f64; 14], n_i: f64, input: impl Fn(usize) -> String) -> Problems {
    let na = &mut values[NUMERICAL_APERTURE];
    // MicroSIG's range is for air.
    if *na >= 1.0 && *na < n_i {
        *na /= n_i;
    }
    let mut problems = Problems::default();
    let mut refuse = |index: usize, allowed: &str| {
        problems.push(Problem::value(KEYS[index].name, values[index], allowed).within(input(index)));
    };
    for (index, key) in KEYS.iter().enumerate() {
        let is_above = index == NUMERICAL_APERTURE && values[index] >= 1.0;
        if is_above || !key.allows(values[index]) {
            refuse(index, &key.allowed());
        }
    }
    let (ri_medium, ri_lens) = (values[3], values[4]);
    if ri_medium > 0.0 && ri_lens > 0.0 && ri_lens <= ri_medium {
        refuse(4, &format!("a number > ri_medium = {ri_medium}"));
    }
    problems
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
