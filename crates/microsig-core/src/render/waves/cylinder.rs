//! A thin cylindrical lens before the camera, in the units of data sheets.
//!
//! In the direction of its power, a lens of focal length f at the distance d before the sensor changes a ray
//! that would arrive at X with the slope u as the matrices of free paths and of a thin lens say:
//!
//! ```text
//!   (X', u') = (1 d; 0 1) (1 0; -1/f 1) (1 -d; 0 1) (X, u),    X' = X (1 - d/f) + u d^2/f
//! ```
//!
//! Light from a point at depth z and lateral position x through the objective at the sine s arrives at X = M
//! (x + z s / n) with u = -s / M: the sensor side of a microscope is telecentric to good approximation (its
//! exit pupil is many times farther away than the cylinder). So positions and the growth of images out of
//! focus both scale by M_x / M = 1 - d/f, and the plane in focus moves by -d^2 / (f - d) in image space, by n
//! / M^2 of that in object space. Angles behind the objective are NA / M, a few hundredths: paraxial optics
//! is exact enough.

use crate::error::Error;
use crate::render::rays;
use crate::settings::Settings;

/// Lengths of a lens on an optical bench, mm.
const LENGTHS_MM: std::ops::RangeInclusive<f64> = 0.01..=1e7;

/// How many times faster images may grow along one direction than along the other.
const MOST: f64 = 5.0;

/// A thin cylindrical lens between the tube lens and the sensor.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Cylinder {
    /// Focal length, mm; negative for a diverging lens.
    pub focal_length_mm: f64,
    /// Distance to the sensor, mm, > 0.
    pub to_sensor_mm: f64,
}

impl Cylinder {
    /// The lens whose plane in focus in the direction of its power lies at the depth `apart_um` (in air, um)
    /// and behind which images grow `growth` times as fast in this direction. `None`: there is none.
    pub fn of_planes(apart_um: f64, growth: f64, magnification: f64) -> Option<Self> {
        // From apart = -d^2 / (M^2 (f - d)) and growth = 1 - d/f.
        let to_sensor_mm = -1e-3 * apart_um * magnification * magnification * growth / (1.0 - growth);
        let lens = Cylinder { focal_length_mm: to_sensor_mm / (1.0 - growth), to_sensor_mm };
        (to_sensor_mm > 0.0 && to_sensor_mm.is_finite()).then_some(lens)
    }

    /// M_x / M: magnification in the direction of its power over that across it; the same for positions and
    /// for the growth of images out of focus.
    pub fn growth(&self) -> f64 {
        1.0 - self.to_sensor_mm / self.focal_length_mm
    }

    /// Depth (in air, um) of the plane in focus in the direction of its power; that across it is at 0.
    pub fn focus_um(&self, magnification: f64) -> f64 {
        let Cylinder { focal_length_mm: f, to_sensor_mm: d } = self;
        -1e3 * d * d / (magnification * magnification * (f - d))
    }

    /// Checks both lengths. Errors: [`Error::Unsupported`] with the value and what is allowed.
    pub fn validate(&self) -> Result<(), Error> {
        let Cylinder { focal_length_mm: f, to_sensor_mm: d } = self;
        let refuse = |message: String| Err(Error::Unsupported(message));
        if !LENGTHS_MM.contains(&f.abs()) {
            return refuse(format!("focal_length_mm = {f}: expected 0.01 to 1e7 mm, or -0.01 to -1e7"));
        }
        if !LENGTHS_MM.contains(d) {
            return refuse(format!("to_sensor_mm = {d}: expected 0.01 to 1e7 mm"));
        }
        let growth = self.growth();
        if !(1.0 / MOST..=MOST).contains(&growth) {
            return refuse(format!(
                "focal_length_mm = {f} at to_sensor_mm = {d}: images grow {growth:.3} times as fast in the direction of its \
                 power, 1 - to_sensor_mm / focal_length_mm; expected {} to {MOST}",
                1.0 / MOST
            ));
        }
        Ok(())
    }
}

/// Magnification, aperture and cylinder as text.
pub(super) fn lens_phrase(settings: &Settings, cylinder: Option<Cylinder>) -> String {
    let real = cylinder.map(|Cylinder { focal_length_mm, to_sensor_mm }| {
        let [f, d] = [focal_length_mm, to_sensor_mm].map(|mm| libm::rint(100.0 * mm) / 100.0);
        format!("a cylindrical lens of {f} mm, {d} mm before the sensor")
    });
    rays::lens_phrase(settings, real.unwrap_or_else(|| rays::cylinder_phrase(settings)))
}

#[cfg(test)]
mod tests {
    use glam::{DMat2, DVec2};

    use super::*;

    /// Matrices of rays (position, slope).
    fn path(length: f64) -> DMat2 {
        DMat2::from_cols(DVec2::new(1.0, 0.0), DVec2::new(length, 1.0))
    }

    fn lens(focal_length: f64) -> DMat2 {
        DMat2::from_cols(DVec2::new(1.0, -1.0 / focal_length), DVec2::new(0.0, 1.0))
    }

    /// A whole microscope by matrices, mm: an objective of 9 mm, 180 mm of tube lens at the distance that
    /// makes the image space telecentric, and the cylinder. Its x-focus is found where the position on the
    /// sensor does not depend on the slope at the object.
    #[test]
    fn planes_and_magnifications_are_those_of_matrices() {
        let (objective, tube) = (9.0, 180.0);
        let magnification: f64 = tube / objective;
        for (f, d) in [(1000.0, 40.0), (300.0, 60.0), (-500.0, 80.0), (20_000.0, 10.0)] {
            let cylinder = Cylinder { focal_length_mm: f, to_sensor_mm: d };
            let system = |object_mm: f64| {
                let camera = path(d) * lens(f) * path(tube - d) * lens(tube);
                camera * path(objective + tube) * lens(objective) * path(object_mm)
            };
            // B of the matrix is linear in the object's distance.
            let [b0, b1] = [system(objective), system(objective + 1e-3)].map(|m| m.y_axis.x);
            let focus_um = -1e3 * 1e-3 * b0 / (b1 - b0);
            assert!((cylinder.focus_um(magnification) / focus_um - 1.0).abs() < 1e-9, "{f} {d}: {focus_um}");
            let growth = (b1 - b0) / 1e-3 / -magnification;
            assert!((cylinder.growth() / growth - 1.0).abs() < 1e-9, "{f} {d}: {growth}");
            // Positions: of the chief ray, which is parallel to the axis behind the tube lens.
            let position = system(objective).x_axis.x / -magnification;
            assert!((cylinder.growth() / position - 1.0).abs() < 1e-9, "{f} {d}: {position}");
            let back = Cylinder::of_planes(focus_um, growth, magnification).unwrap();
            assert!(
                (back.focal_length_mm / f - 1.0).abs() < 1e-6 && (back.to_sensor_mm / d - 1.0).abs() < 1e-6
            );
            cylinder.validate().unwrap();
        }
        // A converging lens has its plane on the side of the objective and makes images grow more slowly.
        assert!(
            Cylinder::of_planes(-20.0, 1.04, 20.0).is_none()
                && Cylinder::of_planes(20.0, 0.96, 20.0).is_none()
        );
        assert!(Cylinder { focal_length_mm: 30.0, to_sensor_mm: 29.0 }.validate().is_err());
    }
}
