//! Predictions for a scenario's optics before any dataset is generated: one particle over depth, the position
//! of best focus, the growth of images, their brightness relative to the range of the camera.

mod depth_of_field;
mod text;
mod ticks;

use microsig_core::Particle;
use microsig_core::render::expected::TOLERANCES;
use microsig_core::render::waves::{Lens, WaveOptics, WavesRenderer};
use serde::Serialize;

pub use depth_of_field::depth_of_field_um;
use depth_of_field::span;
use microsig_core::sensor::ImageFormat;
use microsig_core::visibility::{DepthScan, ScanImage};
use scenario::{CylinderFacts, MotionSource, Scenario, spec::Diameter};
use storage::error::Result;
pub use text::lines;
pub use ticks::tick_label;

/// Depths whose weight in a correlation is below this fraction of the maximum do not contribute (Olsen and
/// Adrian 2000).
const CORRELATED: f64 = 0.01;
/// Depths over which the growth of an image far from focus is measured.
const OUTER: usize = 10;
/// Phase difference over the pupil, waves, above which a lens no longer resembles a commercially available
/// objective.
const ABERRATED_WAVES: f64 = 1.0;
/// Wavelength for what rays neglect, um: green.
const GREEN_UM: f64 = 0.55;
/// Options that model a corrected objective.
const WAVES_OF_APLANAT: &str = "render: (mode: waves, wavelength_um: ...) with optics: (lens: aplanatic)";
/// Minimum fraction of the accepted light that should land near the particle's position.
const LEAST_NEAR: f64 = 0.5;

/// Difference of the growth along both directions above which an objective with MicroSIG's virtual lens does
/// not represent one with a cylindrical lens in front of the camera.
const UNLIKE_A_CYLINDER: f64 = 0.05;

/// Fraction of dark pixels whose noise may be clipped.
const MOST_CLIPPED: f64 = 0.01;

/// Signal-to-noise ratio of a pixel that a size should exceed at some depth.
const LEAST_SNR: f64 = 2.0;

/// Predicted particle images of a scenario's optics.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Preview {
    /// Name of the scenario.
    pub name: String,
    /// Description of renderer and lens.
    pub optics: String,
    /// Object-space length of a pixel, um.
    pub um_per_px: f64,
    /// Range of physical depths, um.
    pub depth_range_um: (f64, f64),
    /// MicroSIG's cylindrical lens, um; 0: no cylindrical lens.
    pub cyl_focal_length_um: f64,
    /// Effect of a cylindrical lens, either MicroSIG's or one in front of the camera.
    pub cylinder: Option<CylinderFacts>,
    /// Whether images are diffracted.
    pub is_diffracted: bool,
    /// Wavelength of the images, um, or 0.55 um if they are not diffracted.
    pub wavelength_um: f64,
    /// Radius of the Airy disc, px.
    pub airy_radius_px: f64,
    /// Optical path difference over the pupil at best focus, waves; `None` for spots.
    pub path_difference_waves: Option<f64>,
    /// Depth of field, um: where the peak is at least 80 % of the highest; for the mean size.
    pub depth_of_field_um: Option<f64>,
    /// Depth of correlation, um: where the weight of images in a correlation is at least 1 % of the maximum;
    /// for the mean size.
    pub depth_of_correlation_um: f64,
    /// Whether that range ends at an end of the depth range, beyond which it may continue.
    #[serde(skip)]
    pub is_correlation_cut: bool,
    /// Mean number of particles in view.
    pub particles_in_view: f64,
    /// The same per pixel.
    pub particles_per_px: f64,
    /// Source density N_S of these particles, in the area that walls and bodies leave free. The area of an image is the number of
    /// its pixels above a tenth of its peak, averaged over depth.
    pub source_density: f64,
    /// Background, counts.
    pub background_counts: f64,
    /// Its standard deviation, counts.
    pub background_noise_counts: f64,
    /// Counts at which a pixel is saturated.
    pub saturation_counts: f64,
    /// One entry for each size: each diameter of a list, or the smallest, mean and largest of a distribution.
    pub sizes: Vec<SizeCurves>,
    /// Warnings that the model is used outside its range of validity.
    pub warnings: Vec<String>,
    /// Index of the size that is the mean or nearest to it.
    #[serde(skip)]
    pub middle: usize,
    /// The images of each size.
    #[serde(skip)]
    pub scans: Vec<DepthScan>,
}

/// Images of one size over depth.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SizeCurves {
    /// Diameter, um.
    pub d_um: f64,
    /// Depth of the highest peak, um; `None` if all are equally high.
    pub focus_um: Option<f64>,
    /// The image there.
    #[serde(skip)]
    pub focus: Option<DepthFacts>,
    /// Depths of minimum width along x and along y (root mean square of all light), um: the two focal planes
    /// of a cylindrical lens.
    pub focal_planes_um: [f64; 2],
    /// Depths of minimum width and of minimum height of the part above 10 % of the peak, um.
    pub least_sizes_um: [f64; 2],
    /// Growth of the diameter far below and far above focus, px/um.
    pub ring_slopes_px_um: [f64; 2],
    /// One entry for each depth.
    pub depths: Vec<DepthFacts>,
}

/// The image of one size at one depth, centered on a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct DepthFacts {
    /// Physical depth, um.
    pub z_um: f64,
    /// Peak above the background, counts.
    pub peak_counts: f64,
    /// Peak divided by the noise of the background; `None` without noise.
    pub snr: Option<f64>,
    /// Peak divided by the noise at the peak, including shot noise; `None` without noise.
    pub snr_with_shot_noise: Option<f64>,
    /// Width of the part above 10 % of the peak, px.
    pub width_px: f64,
    /// Its height, px.
    pub height_px: f64,
    /// Light on the sensor, up to 400 px from a particle at its center, as a fraction of the light that the
    /// aperture accepts; `None` for spots.
    pub share: Option<f64>,
    /// The same on a sensor of any size.
    pub share_near: Option<f64>,
}

impl Preview {
    /// Renders one particle of each size over depth and measures its images.
    pub fn of(scenario: &Scenario) -> Result<Self> {
        let mean_um = scenario.diameters_um()[1];
        let mut sizes_um = scenario.mixed_um();
        if sizes_um.is_empty() {
            sizes_um = scenario.diameters_um().to_vec();
            sizes_um.sort_by(f64::total_cmp);
            sizes_um.dedup_by(|next, known| (*next - *known).abs() <= 1e-9);
        }
        let (middle, scans) = scans(scenario, &sizes_um, mean_um, None)?;
        let depth_of_field_um = depth_of_field_um(scenario, sizes_um[middle], &scans[middle])?;
        Preview::measured(scenario, sizes_um, middle, scans, depth_of_field_um)
    }

    /// The same for representative sizes, reusing existing images of the mean size through the depth
    /// range.
    pub fn from_scan(scenario: &Scenario, scan: &DepthScan) -> Result<Self> {
        let mean_um = scenario.diameters_um()[1];
        let mut sizes_um = scenario.representative_um();
        if sizes_um.len() < 2 {
            sizes_um = vec![mean_um];
        }
        let (middle, scans) = scans(scenario, &sizes_um, mean_um, Some(scan))?;
        Preview::measured(scenario, sizes_um, middle, scans, None)
    }

    fn measured(
        scenario: &Scenario,
        sizes_um: Vec<f64>,
        middle: usize,
        scans: Vec<DepthScan>,
        depth_of_field_um: Option<f64>,
    ) -> Result<Self> {
        let sizes = sizes_um.iter().zip(&scans).map(|(d_um, scan)| curves(scenario, *d_um, scan));
        let sizes = sizes.collect::<Result<Vec<_>>>()?;
        let settings = &scenario.settings;
        let (waves, mean) = (waves_of_lens(scenario), &scans[middle]);
        let wavelength_um = waves.as_ref().map_or(GREEN_UM, |waves| waves.optics().wavelength_um);
        let factor = scenario.depth_factor();
        let response = scenario.response()?;
        let in_view = in_view(scenario)?;
        let pixels = f64::from(settings.pixel_dim_x) * f64::from(settings.pixel_dim_y);
        let (depth_of_correlation_um, is_correlation_cut) = span(mean, |spot| spot.curvature, CORRELATED);
        let mut preview = Preview {
            name: scenario.spec.name.clone(),
            optics: scenario.renderer.description().optics,
            um_per_px: settings.um_per_px(),
            depth_range_um: scenario.depth_range_um,
            cyl_focal_length_um: settings.cyl_focal_length,
            cylinder: scenario.cylinder(),
            is_diffracted: scenario.renderer.is_diffracted(),
            wavelength_um,
            airy_radius_px: WaveOptics::new(wavelength_um).airy_radius_px(settings),
            path_difference_waves: waves
                .zip(mean.focus_um())
                .map(|(waves, focus_um)| waves.path_difference_waves(focus_um / factor)),
            depth_of_field_um,
            depth_of_correlation_um,
            is_correlation_cut,
            particles_in_view: in_view,
            particles_per_px: in_view / pixels,
            source_density: in_view * mean_area_px(scenario, &sizes_um, &scans, middle)
                / (pixels * scenario.image_share()),
            background_counts: response.background,
            background_noise_counts: response.background_noise,
            saturation_counts: scenario.sensor()?.saturation_counts(),
            middle,
            sizes,
            warnings: Vec::new(),
            scans,
        };
        preview.warnings = preview.warnings(scenario);
        Ok(preview)
    }

    /// The curves of the mean size.
    pub fn mean(&self) -> &SizeCurves {
        &self.sizes[self.middle]
    }

    /// Warnings that the model is used outside its range of validity; the renderer's own warnings belong to
    /// the scenario.
    fn warnings(&self, scenario: &Scenario) -> Vec<String> {
        let mut warnings = Vec::new();
        let (mean, airy_px) = (self.mean(), self.airy_radius_px);
        let sharpest =
            mean.depths.iter().map(|depth| depth.width_px.min(depth.height_px)).fold(f64::INFINITY, f64::min);
        let is_rays = scenario.renderer.depends_on_depth() && !scenario.renderer.is_diffracted();
        if is_rays && 2.0 * airy_px > 0.5 * sharpest {
            warnings.push(format!(
                "rays neglect diffraction: at a wavelength of {GREEN_UM} um the Airy disc is {:.1} px wide, the sharpest image here {sharpest:.1} px; \
                 render: (mode: waves, wavelength_um: {GREEN_UM}) includes it",
                2.0 * airy_px
            ));
        }
        let lens = scenario.spec.optics.lens.unwrap_or_default();
        if let Some(waves) =
            self.path_difference_waves.filter(|waves| *waves > ABERRATED_WAVES && lens == Lens::Microsig)
        {
            let option = if self.is_diffracted { "optics: (lens: aplanatic)" } else { WAVES_OF_APLANAT };
            warnings.push(format!(
                "at a wavelength of {:.2} um, MicroSIG's lens has a wavefront aberration of {waves:.1} waves at best focus, a commercial objective less than \
                 one: {option}",
                self.wavelength_um
            ));
        }
        let near = mean.depths.iter().filter_map(|depth| depth.share_near).fold(f64::INFINITY, f64::min);
        if near < LEAST_NEAR {
            let option = if self.is_diffracted { "optics: (lens: aplanatic)" } else { WAVES_OF_APLANAT };
            warnings.push(format!(
                "at some depths only {:.0} % of the light that the aperture accepts lands within 400 px of a particle; {option} gives more",
                100.0 * near
            ));
        }
        for size in &self.sizes {
            let peak = size.range(|depth| Some(depth.peak_counts)).map_or(0.0, |[_, highest]| highest);
            if self.background_counts + peak > self.saturation_counts {
                warnings.push(format!(
                    "images of {:.3} um particles reach {:.0} counts, above the saturation level of {:.0}",
                    size.d_um,
                    self.background_counts + peak,
                    self.saturation_counts
                ));
            }
        }
        for size in &self.sizes {
            let snr = size.range(|depth| depth.snr).map(|[_, highest]| highest);
            if let Some(snr) = snr.filter(|snr| *snr < LEAST_SNR) {
                warnings.push(format!(
                    "images of {:.3} um particles have a peak of at most {snr:.1} times the noise of a pixel: most trackers do not \
                     see them, and their calibration stack shows little but noise",
                    size.d_um
                ));
            }
        }
        warnings.extend(self.cylinder.and_then(|facts| cylinder_warning(facts, lens)));
        warnings.extend(infeasible(
            scenario,
            [self.particles_per_px, self.source_density],
            self.mean().median_snr(),
            [self.background_counts, self.background_noise_counts],
        ));
        let (low, high) = self.depth_range_um;
        if mean.focus_um.is_some_and(|focus| focus <= low || focus >= high) {
            warnings.push(format!(
                "best focus lies at an end of the depth range of {low} to {high} um, or beyond it"
            ));
        }
        warnings
    }
}

/// Warnings that hardly any particle can be found, or that the noise is clipped: of the particles per pixel and N_S, the
/// median SNR, and mean and standard deviation of the background (counts).
pub fn infeasible(
    scenario: &Scenario,
    [n_ppp, n_s]: [f64; 2],
    snr: Option<f64>,
    [background, noise]: [f64; 2],
) -> Vec<String> {
    let mut warnings = storage::dataset::hopeless(n_ppp, n_s, snr);
    // Counts below -0.5 become 0.
    let clipped = 0.5 * libm::erfc((background + 0.5) / (std::f64::consts::SQRT_2 * noise));
    if scenario.spec.image_format() == ImageFormat::Integer && noise > 0.0 && clipped > MOST_CLIPPED {
        let key = if scenario.detector.is_some() {
            "sensor: (offset_counts: ...)"
        } else {
            "optics: (background_mean: ...)"
        };
        warnings.push(format!(
            "the noise of {:.1} % of the dark pixels is clipped at 0 counts, which biases the background: it has {background:.1} counts with \
             a noise of {noise:.1}; {:.0} counts more, by {key}, avoid that",
            100.0 * clipped,
            (3.0 * noise - background).ceil()
        ));
    }
    warnings
}

impl SizeCurves {
    /// Median over depth of the peak divided by the noise of the background; `None` without noise.
    pub fn median_snr(&self) -> Option<f64> {
        let mut all: Vec<f64> = self.depths.iter().filter_map(|depth| depth.snr).collect();
        all.sort_unstable_by(f64::total_cmp);
        all.get(all.len() / 2).copied()
    }

    /// Minimum and maximum over depth, best focus included, if there are values.
    pub fn range(&self, of: impl Fn(&DepthFacts) -> Option<f64>) -> Option<[f64; 2]> {
        self.depths.iter().chain(&self.focus).filter_map(of).fold(None, |range: Option<[f64; 2]>, value| {
            Some(range.map_or([value; 2], |[low, high]| [low.min(value), high.max(value)]))
        })
    }
}

/// Index of the size (um) nearest to the mean, and the images of all sizes through the depth range; those of
/// the mean may already exist.
fn scans(
    scenario: &Scenario,
    sizes_um: &[f64],
    mean_um: f64,
    known: Option<&DepthScan>,
) -> Result<(usize, Vec<DepthScan>)> {
    let off = |i: &usize| (sizes_um[*i] - mean_um).abs();
    let middle = (0..sizes_um.len()).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(0);
    let scan = |d_um: &f64| match known {
        Some(known) if *d_um == mean_um => Ok(known.clone()),
        _ => scenario.scan(*d_um, scenario.depth_range_um),
    };
    Ok((middle, sizes_um.iter().map(scan).collect::<Result<_>>()?))
}

/// Wave optics of the lens, also where images are drawn by rays, if it supports these settings. Nothing is
/// drawn by it.
fn waves_of_lens(scenario: &Scenario) -> Option<WavesRenderer> {
    let renderer = scenario.spec.renderer();
    if renderer.spot().is_some() {
        return None;
    }
    let optics = renderer.wave_optics().cloned().unwrap_or_else(|| WaveOptics::new(GREEN_UM));
    WavesRenderer::new(&scenario.settings, &optics, *TOLERANCES.end()).ok()
}

fn curves(scenario: &Scenario, d_um: f64, scan: &DepthScan) -> Result<SizeCurves> {
    let response = scenario.response()?;
    let noise = response.background_noise;
    let factor = scenario.depth_factor();
    let facts = |z_um: f64, spot: &ScanImage| {
        let peak_counts = scenario.peak_counts(response.slope, d_um, z_um, spot);
        // Counts per electron if electrons fluctuate; without a camera, counts per ray.
        let counts = match &scenario.detector {
            Some(detector) if detector.shot_noise => detector.gain_counts_per_e,
            None if scenario.renderer.has_ray_noise() && spot.peak > 0.0 => peak_counts / spot.peak,
            _ => 0.0,
        };
        let at_peak = (noise * noise + counts * peak_counts).sqrt();
        let [width_px, height_px] = spot.size_px();
        // At the place of the scan: the corners of a field may be darker.
        let [x, y] = scenario.settings.middle_px();
        let sphere = Particle::sphere(x, y, z_um / factor, d_um);
        let all = scenario.renderer.accepted_light(&sphere).filter(|light| *light > 0.0);
        let share = |light: f64| all.map(|all| light / all);
        DepthFacts {
            z_um,
            peak_counts,
            snr: (noise > 0.0).then(|| peak_counts / noise),
            snr_with_shot_noise: (at_peak > 0.0).then(|| peak_counts / at_peak),
            width_px,
            height_px,
            share: share(spot.on_sensor),
            share_near: share(spot.total),
        }
    };
    let depths: Vec<DepthFacts> =
        scan.depths_um.iter().zip(&scan.images).map(|(z_um, spot)| facts(*z_um, spot)).collect();
    let at = |i: usize| &depths[i];
    let last = depths.len() - 1;
    let outer = OUTER.min(last);
    let slope = |a: &DepthFacts, b: &DepthFacts| {
        0.5 * (b.width_px + b.height_px - a.width_px - a.height_px) / (b.z_um - a.z_um)
    };
    Ok(SizeCurves {
        d_um,
        focus_um: scan.focus_um(),
        focus: scan.focus.as_ref().map(|(z_um, spot)| facts(*z_um, spot)),
        focal_planes_um: scan.focal_planes_um(),
        least_sizes_um: scan.least_sizes_um(),
        ring_slopes_px_um: [slope(at(0), at(outer)), slope(at(last - outer), at(last))],
        depths,
    })
}

/// Area of a particle image averaged over depth: of the sizes of a list, weighted by their numbers; otherwise
/// of the mean size, px^2.
fn mean_area_px(scenario: &Scenario, sizes_um: &[f64], scans: &[DepthScan], middle: usize) -> f64 {
    let Some(Diameter::List(listed)) = &scenario.spec.particles.diameter_um else {
        return scans[middle].area_px();
    };
    let areas: Vec<f64> = scans.iter().map(DepthScan::area_px).collect();
    let area = |d_um: f64| {
        let off = |i: &usize| (sizes_um[*i] - d_um).abs();
        areas[(0..areas.len()).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(middle)]
    };
    let total: f64 = listed.iter().map(|(_, weight)| weight).sum();
    listed.iter().map(|(d_um, weight)| weight * area(*d_um)).sum::<f64>() / total
}

/// Mean number of particles in view.
fn in_view(scenario: &Scenario) -> Result<f64> {
    match &scenario.motion {
        MotionSource::Field(field) => {
            let fluid = scenario.fluid(field.as_ref());
            let (low, high) = (scenario.domain.region().min().z, scenario.domain.region().max().z);
            let view = scenario.scale.view(low, high, 0.0)?;
            Ok(scenario.seeding.density(&fluid, 0.0)? * view.volume() * fluid.share(&view, 0.0, 0.0))
        }
        MotionSource::Tracks(tracks) => {
            Ok(tracks.rows().len() as f64 / f64::from(scenario.recordings.frames().max(1)))
        }
    }
}

/// A warning if images grow as with no real cylindrical lens.
fn cylinder_warning(CylinderFacts { growth, stretch, .. }: CylinderFacts, lens: Lens) -> Option<String> {
    let is_virtual = stretch == 1.0;
    (is_virtual && lens == Lens::Aplanatic && (growth - 1.0).abs() > UNLIKE_A_CYLINDER).then(|| {
        format!(
            "images grow {growth:.2} times as fast along the direction in which the cylindrical lens has power as across it: MicroSIG's \
            virtual lens is located at a third of the distance to the sensor. With a lens in front of a real camera the ratio differs from 1 by a few \
            percent: optics: (cylinder: ...) sets its position and focal length"
        )
    })
}

#[cfg(test)]
mod tests {
    use microsig_core::render::Context;
    use std::path::Path;

    use super::*;
    use scenario::{parse, resolve};

    fn preview(optics: &str, rest: &str) -> Preview {
        on_sensor((200, 150), optics, rest)
    }

    fn on_sensor((columns, rows): (u32, u32), optics: &str, rest: &str) -> Preview {
        let text = format!(
            "(name: \"p\", optics: (preset: setting1, pixel_dim_x: {columns}, pixel_dim_y: {rows}, {optics}), \
             motion: flow(field: poiseuille()), timing: pairs(count: 1), {rest})"
        );
        Preview::of(&resolve(parse(&text, "p.ron").unwrap(), Path::new("."), &Context::default()).unwrap())
            .unwrap()
    }

    fn warns(shown: &Preview, text: &str) -> bool {
        shown.warnings.iter().any(|warning| warning.contains(text))
    }

    /// Numbers of the reference data (setting 1, 2 um; see `visibility`): the highest peak at -12 um, areas
    /// of images.
    #[test]
    fn setting_1_is_as_it_is_known() {
        let shown = preview("", "particles: (number: count(7), diameter_um: uniform(min: 1.5, max: 2.5))");
        assert_eq!(shown.sizes.iter().map(|size| size.d_um).collect::<Vec<_>>(), [1.5, 2.0, 2.5]);
        let mean = &shown.sizes[1];
        assert!((mean.focus_um.unwrap() + 12.0).abs() <= 2.0, "{:?}", mean.focus_um);
        let depth = |z_um: f64| mean.depths.iter().find(|depth| (depth.z_um - z_um).abs() < 1e-9).unwrap();
        // A disc of 2335 px.
        assert!((depth(-80.0).width_px / 54.5 - 1.0).abs() < 0.06, "{:?}", depth(-80.0));
        assert!((depth(-80.0).width_px / depth(-80.0).height_px - 1.0).abs() < 0.05);
        assert!(
            depth(-12.0).share.unwrap() > 0.95 && depth(-12.0).share.unwrap() < 1.01,
            "{:?}",
            depth(-12.0)
        );
        assert!(mean.ring_slopes_px_um[0] < -0.3 && mean.ring_slopes_px_um[1] > 0.3);
        assert!((shown.particles_in_view - 7.0).abs() < 0.01);
        let field_um = shown.depth_of_field_um.unwrap();
        assert!(field_um > 5.0 && field_um < 30.0, "{field_um}");
        assert!(shown.depth_of_correlation_um > field_um);
        // The Airy disc is as wide as the sharpest image.
        assert!(warns(&shown, "rays neglect diffraction"), "{:?}", shown.warnings);
    }

    #[test]
    fn the_depth_of_field_is_that_of_the_microscope_wherever_the_depth_range_ends() {
        let field_um = |z_um: &str| {
            let rest = format!(
                "particles: (number: count(7)), boundaries: (z_um: {z_um}), render: (mode: waves, wavelength_um: 0.5)"
            );
            preview("lens: aplanatic", &rest).depth_of_field_um.unwrap()
        };
        let whole = field_um("(-20, 20)");
        for part in ["(0, 20)", "(-20, -1)", "(4, 24)"] {
            assert!((field_um(part) / whole - 1.0).abs() < 0.1, "{part}: {} not {whole}", field_um(part));
        }
    }

    #[test]
    fn a_cylinder_has_two_focal_planes_and_a_bright_particle_saturates() {
        let shown = preview("cyl_focal_length: 4000, gain: 500", "");
        // The planes are as far apart as the key states, which is converted to a focal length.
        for apart_um in [-10.0, -20.0, -40.0] {
            let [x, y] = preview(&format!("focal_planes_um: {apart_um}"), "").sizes[0].focal_planes_um;
            assert!((x - y - apart_um).abs() < 0.03 * -apart_um, "{x} {y}");
        }
        assert!(warns(&shown, "saturation level"), "{:?}", shown.warnings);
    }

    /// Also for images without diffraction: the wavefront aberration at best focus is 5.6 waves for 20x /
    /// 0.45, and below one wave for setting 1.
    #[test]
    fn the_lens_of_microsig_is_doubted_at_large_apertures() {
        let aberrates = |shown: &Preview| warns(shown, "wavefront aberration");
        for mode in ["rays", "expected", "waves, wavelength_um: 0.55"] {
            let large = preview(
                "magnification: 20, numerical_aperture: 0.45",
                &format!("boundaries: (z_um: (-10, 5)), render: (mode: {mode})"),
            );
            let waves = large.path_difference_waves.unwrap();
            assert!(waves > 4.5 && waves < 7.0 && aberrates(&large), "{mode}: {waves} {:?}", large.warnings);
        }
        assert!(!aberrates(&preview("", "")));
    }

    /// Sizes of a list: a size that is fainter than the noise is named; the source density holds for the
    /// mixture, with less than the mean size would have if small particles prevail.
    #[test]
    fn each_listed_size_counts() {
        let of = |sizes: &str| {
            preview(
                "",
                &format!(
                    "particles: (number: count(7), diameter_um: {sizes}, \
                     c_int: power_of_diameter(reference_um: 4, exponent: 5))"
                ),
            )
        };
        let (small, large) = (of("constant(0.8)"), of("constant(4)"));
        let mixed = of("list([(0.8, 3), (4, 1)])");
        let expected = 0.75 * small.source_density + 0.25 * large.source_density;
        assert!((mixed.source_density / expected - 1.0).abs() < 0.02, "{} {expected}", mixed.source_density);
        assert!(warns(&mixed, "0.800 um particles have a peak of at most"), "{:?}", mixed.warnings);
        assert!(!warns(&large, "particles have a peak of at most"), "{:?}", large.warnings);
    }

    #[test]
    fn hopeless_densities_and_clipped_noise_are_named() {
        let of = |optics: &str, number: &str| preview(optics, &format!("particles: (number: {number})"));
        let crowded = of("", "ppp(0.02)");
        let usual = storage::dataset::usual_ppp(crowded.particles_per_px, crowded.source_density).unwrap();
        assert!((crowded.particles_per_px / 0.02 - 1.0).abs() < 0.01 && crowded.source_density > 1.0);
        assert!(
            warns(&crowded, "images overlap almost everywhere")
                && warns(&crowded, "particles per pixel give N_S = 0.3")
        );
        let advised = of("", &format!("ppp({usual})"));
        assert!(
            (advised.source_density / 0.3 - 1.0).abs() < 0.01 && !warns(&advised, "overlap"),
            "{:?}",
            advised.warnings
        );
        let clipped = of("background_mean: 3, background_noise: 2", "count(7)");
        assert!(warns(&clipped, "4.0 % of the dark pixels is clipped"), "{:?}", clipped.warnings);
        assert!(!warns(&of("background_mean: 6, background_noise: 2", "count(7)"), "clipped"));
        assert!(warns(
            &of("background_mean: 9000, background_noise: 3000", "count(7)"),
            "images vanish in the noise"
        ));
    }

    /// With MicroSIG's lens, a halo shifts the minimum widths of all light.
    #[test]
    #[ignore = "slow: .ci/full"]
    fn images_are_least_where_their_curves_are() {
        let mean = &preview("cyl_focal_length: 4000", "").sizes[0];
        let least = |of: fn(&DepthFacts) -> f64| {
            mean.depths.iter().min_by(|a, b| of(a).total_cmp(&of(b))).unwrap().z_um
        };
        let [x, y] = mean.least_sizes_um;
        let (narrowest, lowest) = (least(|depth| depth.width_px), least(|depth| depth.height_px));
        assert!((x - narrowest).abs() <= 2.0 && (y - lowest).abs() <= 2.0, "{x} {y}, {narrowest} {lowest}");
        assert!(y - mean.focal_planes_um[1] > 5.0, "{:?}", mean.focal_planes_um);
    }

    /// A small sensor records less of a defocused image.
    #[test]
    fn shares_are_of_the_own_sensor() {
        let shown = on_sensor((40, 30), "", "");
        let far = shown.mean().depths[0];
        assert!(far.share.unwrap() < 0.7 && far.share_near.unwrap() > 0.98, "{far:?}");
        // A corner is half as bright, 0.08 mm from the middle.
        let vignetted = on_sensor((200, 150), "field: (light_per_mm2: -75)", "");
        assert!(
            vignetted.mean().depths.iter().all(|depth| depth.share_near.unwrap() < 1.01),
            "{vignetted:?}"
        );
    }

    #[test]
    fn peaks_are_those_of_the_datasets_table_light_sheet_included() {
        let text = "(name: \"p\", optics: (pixel_dim_x: 64, pixel_dim_y: 48), motion: flow(field: poiseuille()), \
                    timing: pairs(count: 1), illumination: (shape: sheet(thickness_um: 20, center_um: (0, 0, -30))))";
        let scenario = resolve(parse(text, "p.ron").unwrap(), Path::new("."), &Context::default()).unwrap();
        let shown = Preview::of(&scenario).unwrap();
        let (rows, _) = crate::dataset::truth::depth::measure(&scenario, &shown.scans[shown.middle]).unwrap();
        let depths = &shown.mean().depths;
        assert_eq!(rows.len(), depths.len());
        for (row, depth) in rows.iter().zip(depths) {
            assert!(
                (row.peak_counts / depth.peak_counts - 1.0).abs() < 1e-12,
                "{}: {}",
                depth.z_um,
                depth.peak_counts
            );
        }
        let [edge, middle] = [0, depths.len() / 2].map(|k| depths[k].peak_counts);
        assert!(edge < 0.5 * middle, "dark at the edge of the sheet: {edge}, {middle}");
    }
}
