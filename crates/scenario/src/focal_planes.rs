//! The focal planes of a cylindrical lens, and depth ranges between them.

use microsig_core::Settings;
use microsig_core::problem::Problems;
use microsig_core::render::waves;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::spec::{Boundaries, Optics};

/// A cylindrical lens in paraxial optics.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CylinderFacts {
    /// Physical depth of the plane in focus in the direction of its power, um; the plane in focus
    /// perpendicular to it is at 0.
    pub focus_um: f64,
    /// Ratio of the growth rates of defocused images in this direction and perpendicular to it.
    pub growth: f64,
    /// Ratio of the magnifications of positions in this direction and perpendicular to it: 1 with MicroSIG's
    /// virtual lens.
    pub stretch: f64,
}

impl Optics {
    /// Physical depth over depth in MicroSIG's data files; 1 unless given.
    pub(super) fn depth_factor(&self) -> f64 {
        self.depth_factor.unwrap_or(1.0)
    }

    /// Ratio of a physical depth to the depth in air with the same defocus.
    fn depth_over_air(&self) -> f64 {
        self.layers.map_or(1.0, |layers| layers.n_s) * self.depth_factor()
    }

    /// The cylindrical lens in front of the camera; `None` without one, or if no lens has the given focal
    /// planes.
    pub(super) fn cylinder_lens(&self) -> Option<waves::Cylinder> {
        self.cylinder?.lens(self.depth_over_air(), self.magnification.unwrap_or(1.0))
    }
}

impl CylinderFacts {
    /// Derives them from the settings and the other keys of the optics; `None` without a cylindrical lens.
    pub(super) fn of(settings: &Settings, optics: &Optics) -> Option<Self> {
        let physical = optics.depth_over_air();
        if let Some(lens) = optics.cylinder_lens() {
            let focus_um = physical * lens.focus_um(settings.magnification);
            return Some(CylinderFacts { focus_um, growth: lens.growth(), stretch: lens.growth() });
        }
        // At b/3 behind the lens, 2b/3 in front of the sensor.
        let (f, m, cylinder) = (settings.focal_length, settings.magnification, settings.cyl_focal_length);
        (cylinder != 0.0).then(|| {
            let (a0, b) = (f * (1.0 + 1.0 / m), f * (m + 1.0));
            let (power, bx) = (1.0 - 2.0 * b / (3.0 * cylinder), b - 2.0 * b * b / (9.0 * cylinder));
            // The change of vergence, as a depth behind an aplanatic lens.
            let moved_um = a0 * a0 * (power / bx - 1.0 / b);
            let in_air_um = match optics.lens.unwrap_or_default() {
                waves::Lens::Aplanatic => moved_um,
                waves::Lens::Microsig => moved_um * a0 / (a0 - moved_um),
            };
            CylinderFacts { focus_um: physical * in_air_um, growth: bx / b, stretch: 1.0 }
        })
    }
}

/// Converts `boundaries.depth_um` into a depth range between the focal planes.
pub(super) fn center(
    boundaries: &mut Boundaries,
    settings: Option<&Settings>,
    optics: &Optics,
    problems: &mut Problems,
) {
    let Some(depth_um) = boundaries.depth_um.take() else { return };
    if !(depth_um > 0.0 && depth_um <= 1e6) {
        problems.value("boundaries.depth_um", depth_um, "a number > 0 and <= 1e6");
        return;
    }
    if boundaries.z_um.is_some() {
        problems.other("boundaries", "expected either `z_um` or `depth_um`, not both");
        return;
    }
    let facts = settings.and_then(|settings| CylinderFacts::of(settings, optics));
    let middle_um = facts.map_or(0.0, |facts| 0.5 * facts.focus_um);
    // Rounded to nanometers for readability.
    let round = |z_um: f64| (1e3 * z_um).round() / 1e3;
    boundaries.z_um = Some((round(middle_um - 0.5 * depth_um), round(middle_um + 0.5 * depth_um)));
}

/// A cylindrical lens in front of the camera. In the direction of its power, it scales image positions and
/// the growth of defocused images by 1 - `to_sensor_mm` / `focal_length_mm`; `x_px` and `y_px` of the truth
/// include this factor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Cylinder {
    /// Given by focal length and position, as in its data sheet and the setup.
    Lens {
        /// Focal length; negative for a diverging lens.
        #[schemars(extend("x-condition" = "0.01 to 1e7, or negative", "x-unit" = "mm"), example = 1000.0)]
        focal_length_mm: f64,
        /// Distance from the lens to the sensor.
        #[schemars(range(min = 0.01, max = 1e7), extend("x-unit" = "mm"), example = 40.0)]
        to_sensor_mm: f64,
    },
    /// Given by its effect on the images, as measured with a calibration target.
    Planes {
        /// Distance of the two focal planes: the physical depth at which images are narrowest along x minus
        /// the depth at which they are narrowest along y; negative for a converging lens.
        #[schemars(range(min = -1e5, max = 1e5), extend("x-unit" = "um"), example = -20.0)]
        apart_um: f64,
        /// Ratio of the magnifications along x and y; less than 1 for a converging lens.
        #[schemars(range(min = 0.2, max = 5.0), example = 0.96)]
        growth: f64,
    },
}

impl Cylinder {
    /// The lens behind an objective of this magnification; `index`: physical depth over depth in air. `None`
    /// if no lens has these focal planes and this growth.
    fn lens(self, index: f64, magnification: f64) -> Option<waves::Cylinder> {
        match self {
            Cylinder::Lens { focal_length_mm, to_sensor_mm } => {
                Some(waves::Cylinder { focal_length_mm, to_sensor_mm })
            }
            Cylinder::Planes { apart_um, growth } => {
                waves::Cylinder::of_planes(apart_um / index, growth, magnification)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use microsig_core::render::Context;
    use std::path::Path;

    use crate::{parse, resolve};

    fn resolved(optics: &str, boundaries: &str) -> Result<crate::Scenario, String> {
        let text = format!(
            "(name: \"c\", motion: flow(field: poiseuille()), timing: pairs(count: 1), calibration: none, \
             optics: (magnification: 20, numerical_aperture: 0.4, {optics}), boundaries: ({boundaries}), \
             render: (mode: waves, wavelength_um: 0.52))"
        );
        let spec = parse(&text, "c.ron").map_err(|e| e.to_string())?;
        resolve(spec, Path::new("."), &Context::default()).map_err(|e| e.to_string())
    }

    const WATER: &str = "lens: aplanatic, layers: (n_s: 1.33, focus_depth_um: 60)";

    #[test]
    fn the_depth_range_is_between_the_focal_planes_of_either_lens() {
        let scenario = resolved(&format!("{WATER}, focal_planes_um: -20"), "depth_um: 30").unwrap();
        assert_eq!(scenario.spec.boundaries.z_um, Some((-25.0, 5.0)));
        assert_eq!(scenario.spec.boundaries.depth_um, None);
        let cylinder = "cylinder: planes(apart_um: -20, growth: 0.96)";
        let scenario = resolved(&format!("{WATER}, {cylinder}"), "depth_um: 30").unwrap();
        assert_eq!(scenario.spec.boundaries.z_um, Some((-25.0, 5.0)));
        let facts = scenario.cylinder().unwrap();
        assert!((facts.focus_um + 20.0).abs() < 1e-9 && (facts.growth - 0.96).abs() < 1e-12, "{facts:?}");
        // 20 um along x are 20 / 0.6 * 0.96 px of the sensor's 6.45 um, 20 times magnified.
        let moved = scenario.scale.displacement_to_image(glam::DVec3::new(20.0, 20.0, 0.0));
        let along_y = 20.0 * 20.0 / 6.45;
        assert!((moved.dx_px - 0.96 * along_y).abs() < 1e-9 && (moved.dy_px - along_y).abs() < 1e-9);
        let plain = resolved(WATER, "depth_um: 30").unwrap();
        assert_eq!(plain.spec.boundaries.z_um, Some((-15.0, 15.0)));
        // The same by data sheet: d^2 / (f - d) = 20 um / 1.33 * 20^2 = 6.015 mm, d / f = 0.04.
        let sheet = "cylinder: lens(focal_length_mm: 3609.02, to_sensor_mm: 144.361)";
        let facts = resolved(&format!("{WATER}, {sheet}"), "depth_um: 30").unwrap().cylinder().unwrap();
        assert!((facts.focus_um + 20.0).abs() < 1e-3 && (facts.growth - 0.96).abs() < 1e-6, "{facts:?}");
        // A diverging lens moves the focus the other way.
        let diverging = "cylinder: lens(focal_length_mm: -1000, to_sensor_mm: 40)";
        let facts = resolved(&format!("{WATER}, {diverging}"), "depth_um: 30").unwrap().cylinder().unwrap();
        assert!(facts.focus_um > 0.0 && (facts.growth - 1.04).abs() < 1e-9, "{facts:?}");
    }

    #[test]
    fn contradictions_are_named() {
        for (optics, boundaries, expected) in [
            (WATER, "z_um: (-5, 5), depth_um: 30", "either `z_um` or `depth_um`"),
            (WATER, "depth_um: -3", "boundaries.depth_um = -3"),
            ("lens: aplanatic, cylinder: planes(apart_um: 20, growth: 0.9)", "", "a growth below 1"),
            ("lens: aplanatic, cylinder: lens(focal_length_mm: 10, to_sensor_mm: 20)", "", "0.2 to 5"),
            ("lens: aplanatic, cylinder: lens(focal_length_mm: 0, to_sensor_mm: 20)", "", "0.01 to 1e7"),
            ("cylinder: lens(focal_length_mm: 1000, to_sensor_mm: 20)", "", "`lens: aplanatic`"),
            (
                "lens: aplanatic, focal_planes_um: -10, cylinder: lens(focal_length_mm: 1000, to_sensor_mm: 20)",
                "",
                "either `cylinder` or",
            ),
        ] {
            let said = resolved(optics, boundaries).unwrap_err();
            assert!(said.contains(expected), "{optics} {boundaries}: {said}");
        }
    }
}
