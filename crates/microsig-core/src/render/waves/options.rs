//! Options of wave optics in addition to MicroSIG's settings, and their validation.

use super::cylinder::Cylinder;
use crate::error::Error;
use crate::optics::FieldOptics;
use crate::problem::Problems;
use crate::settings::Settings;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// There is a warning if the peak in focus in vectorial theory is less than this fraction of the scalar one.
const MIN_VECTORIAL_PEAK: f64 = 0.88;

/// Light and optics of [`super::WavesRenderer`].
#[derive(Debug, Clone, PartialEq)]
pub struct WaveOptics {
    /// Wavelength in vacuum, um, 0.1 to 2: the center of the band.
    pub wavelength_um: f64,
    /// Full width at half maximum of the (Gaussian) band, um, 0 to 0.3 wavelengths; 0 is monochromatic light.
    pub bandwidth_um: f64,
    /// The part of a particle that emits light.
    pub emission: Emission,
    /// The model of the objective.
    pub lens: Lens,
    /// Mask and aberrations of the pupil.
    pub pupil: PupilFunction,
    /// Azimuth of the direction in which the cylindrical lens has power, degrees from image x toward image y;
    /// 0 without a cylindrical lens.
    pub cyl_angle_deg: f64,
    /// Medium, cover slip and immersion; `None`: those that the objective was designed for.
    pub layers: Option<Layers>,
    /// A cylindrical lens before the camera, for the aplanatic lens.
    pub cylinder: Option<Cylinder>,
    /// Standard deviation, in the particles' space, of the Gaussian blur by detector and relay optics, um.
    pub blur_um: f64,
    /// How coma, astigmatism and vignetting vary over the field.
    pub field: FieldOptics,
}

impl WaveOptics {
    /// Monochromatic light of the given wavelength (um) from the surface of particles, through MicroSIG's own
    /// lens.
    pub fn new(wavelength_um: f64) -> Self {
        WaveOptics {
            wavelength_um,
            bandwidth_um: 0.0,
            emission: Emission::Surface,
            lens: Lens::Microsig,
            pupil: PupilFunction::default(),
            cyl_angle_deg: 0.0,
            layers: None,
            cylinder: None,
            blur_um: 0.0,
            field: FieldOptics::default(),
        }
    }

    /// The peak of the image of a freely rotating dipole in focus in vectorial theory, as a fraction of that
    /// in scalar theory, which all images here follow; an aplanatic lens of this numerical aperture.
    ///
    /// Richards and Wolf 1959 (Proc. R. Soc. A 253, 358): with c the cosine of the half angle in the
    /// immersion, the fields on the axis are the integrals from c to 1 of cos^1/2 and of cos^1/2 (1 + cos)/2.
    pub fn vectorial_peak(&self, numerical_aperture: f64) -> f64 {
        let sine = numerical_aperture / self.layers.map_or(1.0, |layers| layers.n_i_design);
        let c = libm::sqrt((1.0 - sine * sine).max(0.0));
        let root = libm::sqrt(c);
        let share = 0.6 * (1.0 - c * c * root) / (1.0 - c * root);
        0.25 * (1.0 + share) * (1.0 + share)
    }

    /// A warning if scalar theory is far from vectorial theory.
    pub(super) fn scalar_warning(&self, numerical_aperture: f64) -> Option<String> {
        let peak = self.vectorial_peak(numerical_aperture);
        (peak < MIN_VECTORIAL_PEAK).then(|| {
            format!(
                "numerical_aperture = {numerical_aperture}: wave optics is scalar; with polarization the peak of a point in focus is \
                 {:.0} % lower, its image wider by about half as much",
                100.0 * (1.0 - peak)
            )
        })
    }

    /// Radius of the first dark ring of the aberration-free image of a point in focus, px: 0.61 lambda M /
    /// (NA pixel_size).
    pub fn airy_radius_px(&self, settings: &Settings) -> f64 {
        let Settings { magnification, numerical_aperture, pixel_size, .. } = settings;
        0.61 * self.wavelength_um * magnification / (numerical_aperture * pixel_size)
    }
}

/// The part of a particle that emits light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Emission {
    /// The half of its surface that faces the lens, as in MicroSIG.
    #[default]
    Surface,
    /// Its entire volume: a transparent particle, dyed throughout, which emits as much light.
    Volume,
}

impl Emission {
    /// Its name in scenarios and manifests.
    pub fn name(self) -> &'static str {
        match self {
            Emission::Surface => "surface",
            Emission::Volume => "volume",
        }
    }
}

/// The model of the objective, for wave optics.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Lens {
    /// MicroSIG's thin lens with its spherical aberration; dry.
    #[default]
    Microsig,
    /// An objective corrected for the plane in focus (Abbe's sine condition), as microscope objectives are;
    /// dry or immersed.
    Aplanatic,
}

impl Lens {
    /// The depth, um, at which MicroSIG's lens, at this distance (um) from the plane in focus, defocuses
    /// light near the axis as much as this lens does at the physical depth `z_um`. `None`: at no depth.
    pub fn depth_of_equal_defocus(self, layers: Option<&Layers>, distance_um: f64, z_um: f64) -> Option<f64> {
        let optical_um = layers.map_or(z_um, |layers| z_um / layers.n_s);
        match self {
            Lens::Microsig => Some(optical_um),
            // Paths across the pupil differ by -z s^2 / 2 here and by -z s^2 a0 / 2 (a0 + z) there.
            Lens::Aplanatic => {
                (optical_um < distance_um).then(|| optical_um * distance_um / (distance_um - optical_um))
            }
        }
    }

    /// What its numerical aperture must stay below: the refractive index of the immersion, which only
    /// aplanatic lenses have.
    pub fn largest_aperture(self, layers: Option<&Layers>) -> f64 {
        match (self, layers) {
            (Lens::Aplanatic, Some(layers)) => layers.n_i.min(layers.n_i_design),
            _ => 1.0,
        }
    }

    /// Its name in scenarios and manifests.
    pub fn name(self) -> &'static str {
        match self {
            Lens::Microsig => "microsig",
            Lens::Aplanatic => "aplanatic",
        }
    }
}

/// The pupil of the objective, in units of its radius; x to the right and y down as in the image.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
#[schemars(rename = "Pupil")]
pub struct PupilFunction {
    /// The open part of the pupil; the rest blocks light.
    pub mask: Mask,
    /// Aberrations: Noll's index (2 to 66) and the coefficient, waves rms at `wavelength_um`; 6 is
    /// astigmatism along x and y, 11 spherical aberration.
    #[schemars(extend("x-unit" = "waves"), example = vec![(6, 0.1), (11, -0.05)])]
    pub zernike: Vec<(u32, f64)>,
    /// Transmission at the rim of the pupil less that at its center, which is 1; it changes with the squared
    /// radius.
    #[schemars(range(min = -1.0, max = 10.0))]
    pub transmission: f64,
}

/// The open part of the pupil.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Mask {
    /// All of it.
    #[default]
    Open,
    /// A ring.
    Annulus {
        /// Inner radius, in units of the pupil's radius.
        #[schemars(extend("minimum" = 0, "exclusiveMaximum" = 1), example = 0.5)]
        inner: f64,
    },
    /// Discs inside the pupil that do not overlap, as in a plate with pinholes.
    Pinholes(#[schemars(length(min = 1), example = vec![Pinhole { x: 0.0, y: 0.6, r: 0.2 }])] Vec<Pinhole>),
}

/// An open disc, in units of the pupil's radius.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Pinhole {
    /// Center, to the right.
    #[schemars(range(min = -1.0, max = 1.0))]
    pub x: f64,
    /// Center, down.
    #[schemars(range(min = -1.0, max = 1.0))]
    pub y: f64,
    /// Radius.
    #[schemars(extend("exclusiveMinimum" = 0, "maximum" = 1))]
    pub r: f64,
}

impl Default for Pinhole {
    /// A pinhole in the middle of the pupil.
    fn default() -> Self {
        Pinhole { x: 0.0, y: 0.0, r: 0.2 }
    }
}

/// The layers between a particle and the objective, and those that the objective was designed for (Gibson and
/// Lanni 1991). Depths are physical: `depth_factor` is 1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Layers {
    /// Refractive index of the medium around the particles.
    #[schemars(range(min = 1.0, max = 4.0))]
    pub n_s: f64,
    /// Refractive index of the cover slip.
    #[schemars(range(min = 1.0, max = 4.0))]
    pub n_g: f64,
    /// Thickness of the cover slip.
    #[schemars(range(min = 0.0, max = 1e6))]
    pub t_g_um: f64,
    /// Refractive index of the cover slip that the objective was designed for.
    #[schemars(range(min = 1.0, max = 4.0))]
    pub n_g_design: f64,
    /// Thickness of the cover slip that the objective was designed for; 0: none.
    #[schemars(range(min = 0.0, max = 1e6))]
    pub t_g_design_um: f64,
    /// Refractive index of the immersion; 1: a dry objective.
    #[schemars(range(min = 1.0, max = 4.0))]
    pub n_i: f64,
    /// Refractive index of the immersion that the objective was designed for.
    #[schemars(range(min = 1.0, max = 4.0))]
    pub n_i_design: f64,
    /// Working distance of the objective.
    #[schemars(range(min = 0.0, max = 1e6))]
    pub t_i_design_um: f64,
    /// Depth of the plane z = 0, which is in paraxial focus, below the inner face of the cover slip.
    #[schemars(range(min = 0.0, max = 1e6))]
    pub focus_depth_um: f64,
}

impl Default for Layers {
    /// Water below a 0.17 mm cover slip, for which the dry objective was designed; the focus is 100 um deep.
    fn default() -> Self {
        Layers {
            n_s: 1.33,
            n_g: 1.515,
            t_g_um: 170.0,
            n_g_design: 1.515,
            t_g_design_um: 170.0,
            n_i: 1.0,
            n_i_design: 1.0,
            t_i_design_um: 1000.0,
            focus_depth_um: 100.0,
        }
    }
}

impl Layers {
    /// Thickness of the immersion, um, that brings the plane z = 0 into paraxial focus.
    pub fn immersion_um(&self) -> f64 {
        self.n_i
            * (self.t_i_design_um / self.n_i_design + self.t_g_design_um / self.n_g_design
                - self.t_g_um / self.n_g
                - self.focus_depth_um / self.n_s)
    }

    /// Optical path difference, um, of a ray with index times sine `s` between the layers and the objective's
    /// design, for an emitter at depth `h_um` below the cover slip.
    pub(super) fn path(&self, s: f64, h_um: f64) -> f64 {
        let along = |t: f64, n: f64| t * libm::sqrt((n * n - s * s).max(0.0));
        along(h_um, self.n_s) + along(self.t_g_um, self.n_g) - along(self.t_g_design_um, self.n_g_design)
            + along(self.immersion_um(), self.n_i)
            - along(self.t_i_design_um, self.n_i_design)
    }
}

/// Largest index of a Zernike term, and largest sum of the absolute coefficients, waves.
const LAST_ZERNIKE: u32 = 66;
const MAX_WAVES: f64 = 5.0;

impl WaveOptics {
    /// Checks all values; messages have the keys of a scenario. Errors: [`Error::Malformed`] with all values
    /// out of range.
    pub fn validate(&self, settings: &Settings) -> Result<(), Error> {
        let mut problems = Problems::default();
        self.light(&mut problems);
        self.mask(&mut problems);
        self.zernike(&mut problems);
        let transmission = self.pupil.transmission;
        let passes = (-1.0..=10.0).contains(&transmission);
        problems.unless(passes, "optics.pupil.transmission", transmission, "-1 to 10");
        let blurs = (0.0..=1e3).contains(&self.blur_um);
        problems.unless(blurs, "optics.blur_um", self.blur_um, "0 to 1000 um");
        let angle = self.cyl_angle_deg;
        let turned = angle != 0.0 && settings.cyl_focal_length == 0.0 && self.cylinder.is_none();
        problems.unless(angle.is_finite(), "optics.cyl_angle_deg", angle, "a finite number");
        let straight = "0: there is no cylindrical lens (cyl_focal_length = 0)";
        problems.unless(!turned, "optics.cyl_angle_deg", angle, straight);
        self.cylinder(settings, &mut problems);
        if let Some(layers) = &self.layers {
            self.layers(layers, &mut problems);
        }
        if let Err(Error::Malformed(found)) = self.field.validate(settings) {
            problems.0.extend(found);
        }
        problems.finish(Error::Malformed)
    }

    fn cylinder(&self, settings: &Settings, problems: &mut Problems) {
        let Some(cylinder) = &self.cylinder else { return };
        let mut refuse = |message: String| problems.other("optics.cylinder", message);
        if self.lens != Lens::Aplanatic {
            refuse(
                "expected nothing, or `lens: aplanatic`: MicroSIG's lens has `cyl_focal_length`".to_owned(),
            );
        }
        if settings.cyl_focal_length != 0.0 {
            refuse(format!(
                "expected nothing with cyl_focal_length = {}: one lens or the other",
                settings.cyl_focal_length
            ));
        }
        if let Err(error) = cylinder.validate() {
            refuse(error.to_string());
        }
    }

    fn light(&self, problems: &mut Problems) {
        let (wavelength, width) = (self.wavelength_um, self.bandwidth_um);
        let fits = (0.1..=2.0).contains(&wavelength);
        problems.unless(fits, "render.wavelength_um", wavelength, "0.1 to 2 um, the wavelength in vacuum");
        let widest = 0.3 * wavelength;
        let (fits, allowed) =
            (width >= 0.0 && width <= widest, format!("0 to {widest:.4} um, 0.3 wavelengths"));
        problems.unless(fits || !wavelength.is_finite(), "render.bandwidth_um", width, &allowed);
    }

    fn mask(&self, problems: &mut Problems) {
        match &self.pupil.mask {
            Mask::Open => {}
            Mask::Annulus { inner } => {
                let allowed = "0 or more and less than 1, in units of the pupil's radius";
                let fits = (0.0..1.0).contains(inner);
                problems.unless(fits, "optics.pupil.mask.annulus.inner", inner, allowed);
            }
            Mask::Pinholes(holes) => {
                let key = "optics.pupil.mask.pinholes";
                problems.unless(!holes.is_empty(), key, "[]", "at least one pinhole");
                for (i, hole) in holes.iter().enumerate() {
                    let key = format!("optics.pupil.mask.pinholes.{i}");
                    let shown = format!("(x: {}, y: {}, r: {})", hole.x, hole.y, hole.r);
                    let inside = libm::hypot(hole.x, hole.y) + hole.r <= 1.0;
                    let allowed = "a disc of radius > 0 within the pupil, whose radius is 1";
                    problems.unless(hole.r > 0.0 && inside, &key, &shown, allowed);
                    let over =
                        |other: &Pinhole| libm::hypot(hole.x - other.x, hole.y - other.y) < hole.r + other.r;
                    if let Some(other) = holes[..i].iter().position(over) {
                        let allowed = format!("a disc that does not overlap pinhole {other}");
                        problems.unless(false, &key, &shown, &allowed);
                    }
                }
            }
        }
    }

    fn zernike(&self, problems: &mut Problems) {
        for (i, &(j, waves)) in self.pupil.zernike.iter().enumerate() {
            let key = format!("optics.pupil.zernike.{i}.0");
            let allowed = format!("a Noll index from 2 to {LAST_ZERNIKE}");
            problems.unless((2..=LAST_ZERNIKE).contains(&j), &key, j, &allowed);
            let is_new = self.pupil.zernike[..i].iter().all(|(other, _)| *other != j);
            problems.unless(is_new, &key, j, "each Noll index once");
            let key = format!("optics.pupil.zernike.{i}.1");
            problems.unless(waves.is_finite(), &key, waves, "a finite number of waves rms");
        }
        let sum: f64 = self.pupil.zernike.iter().map(|(_, waves)| waves.abs()).sum();
        let allowed = "coefficients whose absolute values sum to at most 5 waves rms";
        problems.unless(sum <= MAX_WAVES || !sum.is_finite(), "optics.pupil.zernike", sum, allowed);
    }

    fn layers(&self, layers: &Layers, problems: &mut Problems) {
        let Layers { n_s, n_g, t_g_um, n_g_design, t_g_design_um, n_i, n_i_design, t_i_design_um, .. } =
            *layers;
        let indices = [
            ("optics.layers.n_s", n_s),
            ("optics.layers.n_g", n_g),
            ("optics.layers.n_g_design", n_g_design),
            ("optics.layers.n_i", n_i),
            ("optics.layers.n_i_design", n_i_design),
        ];
        for (key, index) in indices {
            problems.unless((1.0..=4.0).contains(&index), key, index, "a refractive index, 1 to 4");
        }
        let lengths = [
            ("optics.layers.t_g_um", t_g_um),
            ("optics.layers.t_g_design_um", t_g_design_um),
            ("optics.layers.t_i_design_um", t_i_design_um),
            ("optics.layers.focus_depth_um", layers.focus_depth_um),
        ];
        for (key, length) in lengths {
            problems.unless((0.0..=1e6).contains(&length), key, length, "a length, 0 to 1000000 um");
        }
        if self.lens == Lens::Microsig {
            let dry = "1: MicroSIG's lens is dry (lens: aplanatic may be immersed)";
            problems.unless(n_i == 1.0, "optics.layers.n_i", n_i, dry);
            problems.unless(n_i_design == 1.0, "optics.layers.n_i_design", n_i_design, dry);
        }
        let immersion = layers.immersion_um();
        problems.unless(
            immersion >= 0.0 || immersion.is_nan(),
            "optics.layers.t_i_design_um",
            t_i_design_um,
            &format!("a longer working distance: focusing so deep would leave {immersion:.1} um before the cover slip"),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ratios of peaks by independent integrals of both theories.
    #[test]
    fn scalar_peaks_exceed_vectorial_ones() {
        let water = Layers { n_i: 1.33, n_i_design: 1.33, ..Layers::default() };
        let oil = Layers { n_i: 1.515, n_i_design: 1.515, ..Layers::default() };
        for (na, layers, expected) in [
            (0.45, None, 0.948),
            (0.6, None, 0.904),
            (0.75, None, 0.843),
            (0.95, None, 0.712),
            (1.2, Some(water), 0.752),
            (1.4, Some(oil), 0.735),
        ] {
            let found = WaveOptics { layers, ..WaveOptics::new(0.52) }.vectorial_peak(na);
            assert!((found - expected).abs() < 6e-4, "{na}: {found}");
        }
    }
}
