//! The section of a scenario that turns particles into images: settings, camera, renderer, and the conversion
//! between px and um.

use flows::scale::Scale;
use flows::{Diameters, Shutter};
use microsig_core::render::{Context, Renderer};
use microsig_core::sensor::{Detector, ImageFormat};
use microsig_core::{Particle, Settings, Spheroid};

use super::drawing;
use super::field_of_view::corners;
use super::findings::{Collect, Findings};
use super::optics::{clipped, response};
use super::spec::{Calibration, Spec};
use microsig_core::visibility::DepthScan;
use storage::error::Result;

/// What images the particles.
pub(super) struct Imaging {
    pub(super) settings: Settings,
    pub(super) detector: Option<Detector>,
    pub(super) renderer: Renderer,
    pub(super) scale: Scale,
    pub(super) shutter: Option<Shutter>,
}

impl Imaging {
    /// Builds it from settings and camera, which are valid on their own.
    pub(super) fn resolve(
        spec: &Spec,
        (settings, detector): (Settings, Option<Detector>),
        found: &mut Findings<'_>,
    ) -> Option<Self> {
        drawing::check(spec, &settings, &mut found.problems)?;
        let scale = found.problems.of("optics", scale(spec, &settings))?;
        let shutter = spec.timing.shutter(scale.um_per_px(), &mut found.problems);
        let renderer = found.problems.of("optics", spec.renderer().build(&settings, found.context))?;
        found.warnings.extend(renderer.warning());
        if spec.image_format() == ImageFormat::Integer {
            let response = found.problems.of("sensor", response(&settings, detector.as_ref()))?;
            found.warnings.extend(clipped(&response, detector.as_ref()));
        }
        Some(Imaging { settings, detector, renderer, scale, shutter })
    }

    /// A depth range (um) as in the data files.
    pub(super) fn in_data_files(&self, z_um: (f64, f64)) -> (f64, f64) {
        let depth_factor = self.scale.depth_factor();
        (z_um.0 / depth_factor, z_um.1 / depth_factor)
    }

    /// Checks that the particles nearest to the lens and farthest from it can be rendered.
    pub(super) fn check_depths(
        &self,
        spec: &Spec,
        z_um: (f64, f64),
        diameters: &Diameters,
        found: &mut Findings<'_>,
    ) {
        let depths = self.in_data_files(z_um);
        let e_p = spec.particles.spheroids.map_or(1.0, |s| s.e_p);
        // A spheroid aligned with the optical axis extends farthest toward the lens.
        let spheroid = (e_p != 1.0).then(|| Spheroid::from_axis(e_p, [0.0, 0.0, 1.0]));
        let calibrated =
            spec.calibration.as_ref().and_then(Calibration::given_diameters_um).unwrap_or_default();
        let is_field = matches!(spec.calibration, Some(Calibration::Field { .. }));
        let key = if is_field { "calibration.field.diameters_um" } else { "calibration.sizes.diameters_um" };
        let calibrated = calibrated.iter().map(|d_um| (key, depths.0, *d_um, None));
        let extremes = [
            ("particles", depths.0, diameters.max(), spheroid),
            ("particles", depths.1, diameters.min(), spheroid),
        ];
        let corners = corners(spec.optics.field.as_ref(), &self.settings);
        for (path, z, d_um, spheroid) in extremes.into_iter().chain(calibrated) {
            for [x, y] in &corners {
                let extreme = Particle { spheroid, ..Particle::sphere(*x, *y, z, d_um) };
                found.warnings.extend(found.problems.of(path, self.renderer.check(&extreme)).flatten());
            }
        }
    }

    /// Half the side of the largest particle image at a place of the sensor (px) within `z_um`, a depth range in
    /// MicroSIG's data files; px, rounded up.
    pub(super) fn largest_image(&self, [x, y]: [f64; 2], z_um: (f64, f64), d_um: f64) -> f64 {
        /// The image grows smoothly away from focus, so the ends of the range and a few planes between them are
        /// enough.
        const PLANES: i32 = 20;
        (0..=PLANES)
            .map(|i| z_um.0 + (z_um.1 - z_um.0) * f64::from(i) / f64::from(PLANES))
            .map(|z| self.renderer.image_extent(&Particle::sphere(x, y, z, d_um)))
            .fold(0.0f64, |largest, (x, y)| largest.max(x).max(y))
            .ceil()
    }
}

/// The conversion between px and um of the sensor, stretched by a cylindrical lens before the camera.
fn scale(spec: &Spec, settings: &Settings) -> flows::Result<Scale> {
    let (width, height) = (settings.pixel_dim_x, settings.pixel_dim_y);
    let scale = Scale::new(settings.um_per_px(), width, height, spec.optics.depth_factor())?;
    Ok(match spec.stretch() {
        Some((growth, angle_deg)) => scale.stretched(growth, angle_deg),
        None => scale,
    })
}

/// Noise-free images of a sphere of diameter `d_um` (um) through a range of physical depths (um).
pub(super) fn scan(
    spec: &Spec,
    (settings, depth_factor): (&Settings, f64),
    d_um: f64,
    range_um: (f64, f64),
    context: &Context,
) -> Result<DepthScan> {
    let renderer = spec.renderer().for_depth_scans();
    let draw = |settings: &Settings| renderer.clone().build(settings, context);
    Ok(DepthScan::measure(draw, settings, d_um, range_um, depth_factor)?)
}
