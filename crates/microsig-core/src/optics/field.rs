//! Optics that vary over the field of view of a real objective.
//!
//! All lengths are in the particles' space: a place of the field is the offset of a particle's image from the
//! center of the sensor divided by the magnification, X to the right and Y down, in mm. The terms are the
//! lowest orders of the expansion in the place: field curvature and tilt, telecentricity, distortion,
//! vignetting, and the linear and quadratic parts of coma and astigmatism of a misaligned system (nodal
//! aberration theory: Thompson 2005, JOSA A 22, 1389).

use crate::error::Error;
use crate::particle::Particle;
use crate::problem::Problems;
use crate::settings::Settings;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How the optics vary over the field of view; by default they do not.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct FieldOptics {
    /// Depth of the surface in focus.
    pub focus: FocusSurface,
    /// Direction of the chief ray, along which images move with depth.
    pub chief_ray: ChiefRay,
    /// Relative displacement of images away from the center of the field, per squared distance from it;
    /// negative for barrel distortion.
    #[schemars(range(min = -100.0, max = 100.0), extend("x-unit" = "1/mm^2"))]
    pub distortion_per_mm2: f64,
    /// Relative change of the light of images, per squared distance from the center of the field.
    #[schemars(range(min = -1e4, max = 1e4), extend("x-unit" = "1/mm^2"))]
    pub light_per_mm2: f64,
    /// Coma, for `mode: waves`.
    pub coma: FieldComa,
    /// Astigmatism, for `mode: waves`.
    pub astigmatism: FieldAstigmatism,
    /// Vignetting, for `mode: waves`.
    pub vignetting: Vignetting,
}

/// Depth of the surface in focus: a tilted paraboloid that contains the center of the field at z = 0.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct FocusSurface {
    /// Field curvature: depth per squared distance from the center.
    #[schemars(range(min = -1e5, max = 1e5), extend("x-unit" = "um/mm^2"))]
    pub curvature_um_per_mm2: f64,
    /// Tilt: depth per distance along x and y.
    #[schemars(extend("x-unit" = "um/mm"))]
    pub tilt_um_per_mm: (f64, f64),
    /// Standard deviation of the depths in focus of particles about the surface (Gaussian, the same in all frames of a
    /// track), as `microsig fit --field` measures it for dried particles; 0 for tracers in a fluid unless it is known.
    #[schemars(range(min = 0.0, max = 1e3), extend("x-unit" = "um"))]
    #[serde(skip_serializing_if = "is_zero")]
    pub scatter_um: f64,
}

/// Whether a value is the default of [`FocusSurface::scatter_um`].
#[expect(clippy::trivially_copy_pass_by_ref, reason = "as serde calls it")]
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// Slope of the chief ray: displacement of an image along x and y per distance of its particle from the
/// surface in focus, in the particles' medium. 0 everywhere: a telecentric system.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct ChiefRay {
    /// At the center of the field.
    pub slope: (f64, f64),
    /// Change of the slope per distance from the center, along the direction from it.
    #[schemars(range(min = -10.0, max = 10.0), extend("x-unit" = "1/mm"))]
    pub per_mm: f64,
}

/// Coma: coefficients of Noll's terms 8 (along x) and 7 (along y), waves rms.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct FieldComa {
    /// At the center of the field.
    #[schemars(extend("x-unit" = "waves"))]
    pub constant: (f64, f64),
    /// Change per distance from the center, along the direction from it.
    #[schemars(range(min = -100.0, max = 100.0), extend("x-unit" = "waves/mm"))]
    pub per_mm: f64,
}

/// Astigmatism: coefficients of Noll's terms 6 (along x and y) and 5 (along the diagonals), waves rms.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct FieldAstigmatism {
    /// At the center of the field.
    #[schemars(extend("x-unit" = "waves"))]
    pub constant: (f64, f64),
    /// Term of misaligned lenses: the coefficients change by this times (X, Y).
    #[schemars(range(min = -100.0, max = 100.0), extend("x-unit" = "waves/mm"))]
    pub per_mm: f64,
    /// Term of aligned lenses: the coefficients change by this times (X^2 - Y^2, 2 X Y).
    #[schemars(range(min = -1e3, max = 1e3), extend("x-unit" = "waves/mm^2"))]
    pub per_mm2: f64,
}

/// Vignetting: the pupil narrows along the direction from the center of the field.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Vignetting {
    /// Relative reduction of the half width of the pupil in that direction, per squared distance.
    #[schemars(range(min = 0.0, max = 1e3), extend("x-unit" = "1/mm^2"))]
    pub meridional_per_mm2: f64,
}

/// Optics at one place of the field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalOptics {
    /// Depth in focus, um.
    pub focus_um: f64,
    /// Slope of the chief ray along x and y.
    pub slope: [f64; 2],
    /// Displacement of images, in the particles' space, um.
    pub distortion_um: [f64; 2],
    /// Factor on the light.
    pub light: f64,
    /// Coefficients of Noll's terms 8 and 7, waves rms.
    pub coma: [f64; 2],
    /// Coefficients of Noll's terms 6 and 5, waves rms.
    pub astigmatism: [f64; 2],
    /// The symmetric matrix that narrows the pupil, along x and y.
    pub squeeze: [[f64; 2]; 2],
}

/// The narrowest half width of a pupil, in units of its radius.
const NARROWEST: f64 = 0.2;

/// Largest aberration of the field, waves rms.
const MAX_WAVES: f64 = 5.0;

impl FieldOptics {
    /// The place in the field of a position in the image (px), mm.
    pub fn place(settings: &Settings, x_px: f64, y_px: f64) -> [f64; 2] {
        let offset = |at: f64, size: u32| at - 0.5 * (f64::from(size) + 1.0);
        let per_px = 1e-3 * settings.pixel_size / settings.magnification;
        [offset(x_px, settings.pixel_dim_x), offset(y_px, settings.pixel_dim_y)].map(|px| px * per_px)
    }

    /// The optics at a place, mm.
    pub fn at(&self, [x, y]: [f64; 2]) -> LocalOptics {
        let r2 = x * x + y * y;
        let FieldOptics { focus, chief_ray, coma, astigmatism, vignetting, .. } = self;
        let along = |(x0, y0): (f64, f64), per_mm: f64| [x0 + per_mm * x, y0 + per_mm * y];
        let [a6, a5] = along(astigmatism.constant, astigmatism.per_mm);
        let narrowing = vignetting.meridional_per_mm2;
        LocalOptics {
            focus_um: focus.curvature_um_per_mm2 * r2
                + focus.tilt_um_per_mm.0 * x
                + focus.tilt_um_per_mm.1 * y,
            slope: along(chief_ray.slope, chief_ray.per_mm),
            distortion_um: [x, y].map(|at| 1e3 * self.distortion_per_mm2 * r2 * at),
            light: 1.0 + self.light_per_mm2 * r2,
            coma: along(coma.constant, coma.per_mm),
            astigmatism: [a6 + astigmatism.per_mm2 * (x * x - y * y), a5 + astigmatism.per_mm2 * 2.0 * x * y],
            // 1 - v r^2 along the radius: 1 - v (X, Y) (X, Y)^T.
            squeeze: [
                [1.0 - narrowing * x * x, -narrowing * x * y],
                [-narrowing * x * y, 1.0 - narrowing * y * y],
            ],
        }
    }

    /// The particle whose image, with the same optics everywhere, this particle has: where the optics put
    /// it, its distance from the surface in focus, and its light.
    pub fn apparent(&self, settings: &Settings, particle: &Particle) -> Particle {
        let [dx_px, dy_px, dz_um] = self.displacement(settings, particle);
        Particle {
            x_px: particle.x_px + dx_px,
            y_px: particle.y_px + dy_px,
            z_um: particle.z_um + dz_um,
            c_int: particle.c_int * self.at(Self::place(settings, particle.x_px, particle.y_px)).light,
            ..*particle
        }
    }

    /// What the optics add to x and y (px) and to the depth (um) of a particle.
    pub fn displacement(&self, settings: &Settings, particle: &Particle) -> [f64; 3] {
        let local = self.at(Self::place(settings, particle.x_px, particle.y_px));
        let z_um = particle.z_um - local.focus_um;
        let px_per_um = settings.magnification / settings.pixel_size;
        let along = |axis: usize| (local.distortion_um[axis] + local.slope[axis] * z_um) * px_per_um;
        // Not -focus_um, which is -0 where there is none.
        [along(0), along(1), 0.0 - local.focus_um]
    }

    /// Whether positions, depths and light are the same everywhere.
    pub fn is_uniform(&self) -> bool {
        let FieldOptics { focus, chief_ray, distortion_per_mm2, light_per_mm2, .. } = *self;
        let rest = FieldOptics { focus, chief_ray, distortion_per_mm2, light_per_mm2, ..Self::default() };
        rest == Self::default()
    }

    /// Whether the shapes of images depend on the place; only wave optics can draw them.
    pub fn has_aberrations(&self) -> bool {
        let FieldOptics { coma, astigmatism, vignetting, .. } = *self;
        FieldOptics { coma, astigmatism, vignetting, ..Self::default() } != Self::default()
    }

    /// Checks all values for a sensor with these settings; messages have the keys of a scenario. Errors:
    /// [`Error::Malformed`] with all values out of range.
    pub fn validate(&self, settings: &Settings) -> Result<(), Error> {
        let mut problems = Problems::default();
        let mut unless = |fine: bool, key: &str, value: f64, expected: &str| {
            problems.unless(fine, &format!("optics.field.{key}"), value, expected);
        };
        let numbers = [
            ("focus.curvature_um_per_mm2", self.focus.curvature_um_per_mm2),
            ("focus.tilt_um_per_mm.0", self.focus.tilt_um_per_mm.0),
            ("focus.tilt_um_per_mm.1", self.focus.tilt_um_per_mm.1),
            ("distortion_per_mm2", self.distortion_per_mm2),
            ("light_per_mm2", self.light_per_mm2),
            ("coma.constant.0", self.coma.constant.0),
            ("coma.constant.1", self.coma.constant.1),
            ("coma.per_mm", self.coma.per_mm),
            ("astigmatism.constant.0", self.astigmatism.constant.0),
            ("astigmatism.constant.1", self.astigmatism.constant.1),
            ("astigmatism.per_mm", self.astigmatism.per_mm),
            ("astigmatism.per_mm2", self.astigmatism.per_mm2),
        ];
        for (key, value) in numbers {
            unless(value.is_finite(), key, value, "a finite number");
        }
        for (key, slope) in [
            ("chief_ray.slope.0", self.chief_ray.slope.0),
            ("chief_ray.slope.1", self.chief_ray.slope.1),
            ("chief_ray.per_mm", self.chief_ray.per_mm),
        ] {
            unless(slope.abs() <= 10.0, key, slope, "-10 to 10");
        }
        let scatter_um = self.focus.scatter_um;
        unless((0.0..=1e3).contains(&scatter_um), "focus.scatter_um", scatter_um, "0 to 1000");
        let narrowing = self.vignetting.meridional_per_mm2;
        unless(narrowing >= 0.0, "vignetting.meridional_per_mm2", narrowing, "a number >= 0");
        // At the corners and at the middles of the edges.
        let (right, below) = (f64::from(settings.pixel_dim_x) + 0.5, f64::from(settings.pixel_dim_y) + 0.5);
        let middle = [0.5 * (right + 0.5), 0.5 * (below + 0.5)];
        let mut ends = Vec::new();
        for x in [0.5, middle[0], right] {
            ends.extend([0.5, middle[1], below].map(|y| Self::place(settings, x, y)));
        }
        let r2 = |[x, y]: &[f64; 2]| x * x + y * y;
        let farthest2 = ends.iter().map(r2).fold(0.0, f64::max);
        // What is not a number has been reported.
        let at_most = |value: f64, most: f64| value <= most || value.is_nan();
        let at_corner = |value: f64| value * farthest2;
        unless(
            at_most(-at_corner(self.light_per_mm2), 0.999_999),
            "light_per_mm2",
            self.light_per_mm2,
            &format!("more than {:.4}, as light would be negative in a corner", -1.0 / farthest2),
        );
        unless(
            at_most(at_corner(narrowing), 1.0 - NARROWEST),
            "vignetting.meridional_per_mm2",
            narrowing,
            &format!(
                "at most {:.4}, which leaves a fifth of the pupil in a corner",
                (1.0 - NARROWEST) / farthest2
            ),
        );
        unless(
            at_most(at_corner(self.distortion_per_mm2).abs(), 0.5),
            "distortion_per_mm2",
            self.distortion_per_mm2,
            &format!("an absolute value of at most {:.4}, half the distance of a corner", 0.5 / farthest2),
        );
        let waves = |end: &[f64; 2]| {
            let local = self.at(*end);
            libm::hypot(local.coma[0], local.coma[1])
                + libm::hypot(local.astigmatism[0], local.astigmatism[1])
        };
        let most = ends.iter().map(waves).fold(0.0, f64::max);
        unless(
            at_most(most, MAX_WAVES),
            "coma",
            most,
            "coma and astigmatism that sum to at most 5 waves rms anywhere in the field",
        );
        problems.finish(Error::Malformed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_and_laws_are_those_of_a_hand_calculation() {
        // 1 px is 1 um; 1001 px.
        let settings = Settings {
            magnification: 10.0,
            pixel_size: 10.0,
            pixel_dim_x: 1001,
            pixel_dim_y: 1001,
            ..Settings::setting1()
        };
        assert_eq!(FieldOptics::place(&settings, 501.0, 501.0), [0.0, 0.0]);
        let field = FieldOptics {
            focus: FocusSurface { curvature_um_per_mm2: 5.0, tilt_um_per_mm: (1.0, -2.0), scatter_um: 0.0 },
            chief_ray: ChiefRay { slope: (0.01, 0.0), per_mm: -0.02 },
            distortion_per_mm2: 0.1,
            light_per_mm2: -1.0,
            coma: FieldComa { constant: (0.04, 0.0), per_mm: -0.1 },
            astigmatism: FieldAstigmatism { constant: (0.0, 0.01), per_mm: 0.1, per_mm2: 1.0 },
            vignetting: Vignetting { meridional_per_mm2: 0.5 },
        };
        field.validate(&settings).unwrap();
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a}, not {b}");
        let at = field.at([0.3, -0.4]);
        near(at.focus_um, 5.0 * 0.25 + 0.3 + 0.8);
        near(at.coma[0], 0.01);
        near(at.coma[1], 0.04);
        near(at.astigmatism[0], 0.03 + 0.09 - 0.16);
        near(at.astigmatism[1], 0.01 - 0.04 - 0.24);
        // Narrowed by 0.5 * 0.25 along (3, -4)/5, and not across.
        let times = |[x, y]: [f64; 2]| at.squeeze.map(|row| row[0] * x + row[1] * y);
        near(times([0.6, -0.8])[0], 0.875 * 0.6);
        near(times([0.8, 0.6])[1], 0.6);
        let seen = field.apparent(&settings, &Particle::sphere(801.0, 101.0, 12.35, 2.0));
        near(seen.z_um, 10.0);
        near(seen.c_int, 0.75);
        near(seen.x_px, 801.0 + 0.1 * 0.25 * 300.0 + (0.01 - 0.006) * 10.0);
        near(seen.y_px, 101.0 - 0.1 * 0.25 * 400.0 + 0.008 * 10.0);
    }

    #[test]
    fn values_that_leave_no_light_or_no_pupil_are_refused() {
        let settings = Settings::setting1();
        let bad = FieldOptics {
            light_per_mm2: -1e4,
            vignetting: Vignetting { meridional_per_mm2: 1e3 },
            coma: FieldComa { constant: (f64::NAN, 0.0), per_mm: 0.0 },
            ..FieldOptics::default()
        };
        let message = bad.validate(&settings).unwrap_err().to_string();
        for key in ["light_per_mm2 = -10000", "meridional_per_mm2 = 1000", "coma.constant.0 = NaN"] {
            assert!(message.contains(key), "{message}");
        }
    }
}
