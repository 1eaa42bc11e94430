//! The model of one particle's images: optics at its place in the field.

use microsig_core::optics::LocalOptics;
use microsig_core::render::waves::{PupilFunction, SingleImages, WaveOptics, WavesRenderer};
use microsig_core::{Error, Settings};

/// Quantities of a particle's images, in the order of [`Local`].
pub(super) const COUNT: usize = 15;

/// Indices of the quantities.
pub(super) const FOCUS: usize = 0;
pub(super) const X: usize = 1;
pub(super) const Y: usize = 2;
pub(super) const SLOPE: usize = 3;
pub(super) const NA: usize = 5;
pub(super) const MERIDIONAL: usize = 6;
pub(super) const COMA: usize = 7;
pub(super) const ASTIGMATISM: usize = 9;
pub(super) const SPHERICAL: usize = 11;
pub(super) const BLUR: usize = 12;
pub(super) const TRANSMISSION: usize = 13;
pub(super) const DIAMETER: usize = 14;

/// Names of the quantities, with units, and the steps of differences.
pub(super) const QUANTITIES: [(&str, f64); COUNT] = [
    ("focus_um", 0.1),
    ("x_px", 0.0),
    ("y_px", 0.0),
    ("chief_ray_slope_x", 0.0),
    ("chief_ray_slope_y", 0.0),
    ("numerical_aperture", 0.003),
    ("pupil_meridional", 0.01),
    ("coma_x_waves", 0.005),
    ("coma_y_waves", 0.005),
    ("astigmatism_waves", 0.005),
    ("astigmatism_45_waves", 0.005),
    ("spherical_waves", 0.005),
    ("blur_um", 0.02),
    ("pupil_transmission", 0.05),
    ("particle_diameter_um", 0.02),
];

/// Values of the quantities: stage position in focus (um, toward the lens if stage positions are), position
/// relative to the middle of the window in focus (px), slope of the chief ray, numerical aperture, half width
/// of the pupil along the direction from the center of the field over that across it, coma (Noll 8 and 7),
/// astigmatism (6 and 5), spherical aberration (11), blur (um), transmission, diameter of the
/// particle (um).
pub(super) type Local = [f64; COUNT];

/// What is given.
#[derive(Debug, Clone)]
pub(super) struct Instrument {
    /// Magnification and pixel size.
    pub(super) settings: Settings,
    /// Wavelength, emission and layers.
    pub(super) light: WaveOptics,
    /// +1: stage positions increase away from the lens.
    pub(super) direction: f64,
    /// Particle diameter, um; fitted if `None`.
    pub(super) diameter_um: Option<f64>,
    /// The quantities that are fitted.
    pub(super) free: Vec<usize>,
}

impl Instrument {
    pub(super) fn px_per_um(&self) -> f64 {
        self.settings.magnification / self.settings.pixel_size
    }

    /// A particle that is hardly resolved, um. All smaller ones look alike, so a diameter is best approached from below.
    pub(super) fn resolved_um(&self, na: f64) -> f64 {
        0.5 * self.light.wavelength_um / na
    }

    /// Images of a particle with these optics in a direction of the field, at these distances from the focus
    /// (um, from and to) on windows of this half width.
    pub(super) fn images(
        &self,
        local: &Local,
        toward: [f64; 2],
        depths_um: [f64; 2],
        half: usize,
        tolerance: f64,
    ) -> Result<SingleImages, Error> {
        // The wider of the two half widths belongs to the numerical aperture.
        let (along, across) = match local[MERIDIONAL] {
            m if m > 1.0 => (1.0, 1.0 / m),
            m => (m, 1.0),
        };
        let [c, s] = toward;
        let squeeze = [
            [across + (along - across) * c * c, (along - across) * c * s],
            [(along - across) * c * s, across + (along - across) * s * s],
        ];
        let settings = Settings {
            numerical_aperture: local[NA] * local[MERIDIONAL].max(1.0),
            pixel_dim_x: 2 * half as u32 + 1,
            pixel_dim_y: 2 * half as u32 + 1,
            ..self.settings.clone()
        };
        let optics = WaveOptics {
            pupil: PupilFunction {
                zernike: vec![(11, local[SPHERICAL])],
                transmission: local[TRANSMISSION],
                ..PupilFunction::default()
            },
            blur_um: local[BLUR],
            ..self.light.clone()
        };
        let at_place = LocalOptics {
            focus_um: 0.0,
            slope: [0.0; 2],
            distortion_um: [0.0; 2],
            light: 1.0,
            coma: [local[COMA], local[COMA + 1]],
            astigmatism: [local[ASTIGMATISM], local[ASTIGMATISM + 1]],
            squeeze,
        };
        let renderer = WavesRenderer::new(&settings, &optics, tolerance)?;
        Ok(renderer.single_images_at(&at_place, depths_um, local[DIAMETER], [half + MARGIN_PX; 2]))
    }

    /// Distance of a particle from the surface in focus at a stage position, um, positive away from the lens.
    pub(super) fn depth_um(&self, local: &Local, stage_um: f64) -> f64 {
        self.direction * (stage_um - local[FOCUS])
    }
}

/// Margin of images beyond the window, px, for displaced particles.
const MARGIN_PX: usize = 3;

/// Largest aperture that is tried.
pub(super) const LARGEST_NA: f64 = 0.95;

/// Values clamped to those that can be rendered.
pub(super) fn bounded(mut local: Local) -> Local {
    local[NA] = local[NA].clamp(0.02, LARGEST_NA);
    local[MERIDIONAL] = local[MERIDIONAL].clamp(0.5, 1.5);
    if local[MERIDIONAL] > 1.0 {
        local[NA] = local[NA].min(LARGEST_NA / local[MERIDIONAL]);
    }
    // A blur of 0 is not fitted.
    if local[BLUR] != 0.0 {
        local[BLUR] = local[BLUR].max(0.02);
    }
    local[DIAMETER] = local[DIAMETER].clamp(0.02, 60.0);
    local[TRANSMISSION] = local[TRANSMISSION].clamp(-0.9, 3.0);
    for waves in &mut local[COMA..=SPHERICAL] {
        *waves = waves.clamp(-0.5, 0.5);
    }
    for slope in &mut local[SLOPE..SLOPE + 2] {
        *slope = slope.clamp(-0.3, 0.3);
    }
    local
}
