//! What a scenario's optics show, before any dataset is made: one particle over depth, where focus is, how
//! images grow, how bright they are against the camera.

mod accepted;
mod cylinder;
mod depth_of_field;
mod picture;
mod text;
mod ticks;

use microsig_core::Particle;
use microsig_core::render::RendererSpec;
use microsig_core::render::waves::{Lens, WaveOptics};
use serde::Serialize;

use accepted::{Accepted, GREEN_UM};
pub use depth_of_field::depth_of_field_um;
use depth_of_field::span;
pub use picture::svg;
use scenario::{CylinderFacts, MotionSource, Scenario};
use storage::error::Result;
pub use text::{lines, text};
pub use ticks::tick_label;
use visibility::DepthScan;

/// Depths whose images weigh less than this share of the most in a correlation do not contribute (Olsen and
/// Adrian 2000).
const CORRELATED: f64 = 0.01;
/// Depths over which the growth of an image far from focus is measured.
const OUTER: usize = 10;
/// Phase differences over the pupil, waves, from which a lens is no longer like an objective that one can
/// buy.
const ABERRATED_WAVES: f64 = 1.0;
/// What rays lack of a corrected objective.
const WAVES_OF_APLANAT: &str = "render: (mode: waves, wavelength_um: ...) with optics: (lens: aplanatic)";
/// The least share of the accepted light that should land near the particle's place.
const LEAST_NEAR: f64 = 0.5;

/// What the optics of a scenario show.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Preview {
    /// Name of the scenario.
    pub name: String,
    /// Renderer and lens in words.
    pub optics: String,
    /// Object-space length of a pixel, um.
    pub um_per_px: f64,
    /// Range of physical depths, um.
    pub depth_range_um: (f64, f64),
    /// MicroSIG's cylindrical lens, um; 0: none.
    pub cyl_focal_length_um: f64,
    /// What a cylindrical lens does, MicroSIG's or one before the camera.
    pub cylinder: Option<CylinderFacts>,
    /// Whether images are diffracted.
    pub is_diffracted: bool,
    /// Wavelength, um: that of the images, or 0.55 um if they are not diffracted.
    pub wavelength_um: f64,
    /// Radius of the Airy disc, px.
    pub airy_radius_px: f64,
    /// Difference of the optical path over the pupil in best focus, waves; `None` for spots.
    pub path_difference_waves: Option<f64>,
    /// Depth of field, um: where the peak is at least 80 % of the highest; of the mean size.
    pub depth_of_field_um: Option<f64>,
    /// Depth of correlation, um: where images weigh at least 1 % of the most in a correlation; of the mean
    /// size.
    pub depth_of_correlation_um: f64,
    /// Particles in view on average.
    pub particles_in_view: f64,
    /// Source density of so many, where walls and bodies leave room for them.
    pub source_density: f64,
    /// Background, counts.
    pub background_counts: f64,
    /// Its standard deviation, counts.
    pub background_noise_counts: f64,
    /// Counts at which a pixel is saturated.
    pub saturation_counts: f64,
    /// One for each size: each diameter of a list; the smallest, the mean and the largest of a distribution.
    pub sizes: Vec<SizeCurves>,
    /// Where the model leaves what it is good for.
    pub warnings: Vec<String>,
    /// Which of the sizes is the mean, or nearest to it.
    #[serde(skip)]
    middle: usize,
    /// The images of each size.
    #[serde(skip)]
    scans: Vec<DepthScan>,
}

/// Images of one size over depth.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SizeCurves {
    /// Diameter, um.
    pub d_um: f64,
    /// Depth of the highest peak, um; `None` where all are as high.
    pub focus_um: Option<f64>,
    /// Depths of the least widths along x and along y (root mean square of all light), um: the two focal
    /// planes of a cylindrical lens.
    pub focal_planes_um: [f64; 2],
    /// Depths of the least width and of the least height of the part above 10 % of the peak, um.
    pub least_sizes_um: [f64; 2],
    /// Growth of the diameter far below and far above focus, px/um.
    pub ring_slopes_px_um: [f64; 2],
    /// One for each depth.
    pub depths: Vec<DepthFacts>,
}

/// The image of one size at one depth, centred on a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct DepthFacts {
    /// Physical depth, um.
    pub z_um: f64,
    /// Highest count above the background.
    pub peak_counts: f64,
    /// The peak over the background's noise; `None` without noise.
    pub snr: Option<f64>,
    /// The peak over the noise there, shot noise of its light included; `None` without noise.
    pub snr_with_shot_noise: Option<f64>,
    /// Width of the part above 10 % of the peak, px.
    pub width_px: f64,
    /// Its height, px.
    pub height_px: f64,
    /// Light on the sensor, up to 400 px from a particle in its center, as a share of what the aperture
    /// accepts; `None` for spots.
    pub share: Option<f64>,
    /// The same on any sensor.
    pub share_near: Option<f64>,
}

impl Preview {
    /// Draws one particle of each size over depth, and measures it.
    ///
    /// # Errors
    /// Settings that cannot be drawn.
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

    /// The same of the sizes that stand for all, from images of the mean size through the depth range that
    /// are there already.
    ///
    /// # Errors
    /// Settings that cannot be drawn.
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
        let accepted = Accepted::new(scenario)?;
        let sizes = sizes_um.iter().zip(&scans).map(|(d_um, scan)| curves(scenario, *d_um, scan, &accepted));
        let sizes = sizes.collect::<Result<Vec<_>>>()?;
        let settings = &scenario.settings;
        let (waves, mean) = (accepted.waves(), &scans[middle]);
        let wavelength_um = waves.as_ref().map_or(GREEN_UM, |waves| waves.optics().wavelength_um);
        let factor = scenario.spec.optics.depth_factor.unwrap_or(1.0);
        let response = scenario.response()?;
        let in_view = in_view(scenario)?;
        let pixels = f64::from(settings.pixel_dim_x) * f64::from(settings.pixel_dim_y);
        let mut preview = Preview {
            name: scenario.spec.name.clone(),
            optics: scenario.renderer.description().optics,
            um_per_px: settings.um_per_px(),
            depth_range_um: scenario.depth_range_um,
            cyl_focal_length_um: settings.cyl_focal_length,
            cylinder: scenario.cylinder(),
            is_diffracted: matches!(accepted, Accepted::Waves(_)),
            wavelength_um,
            airy_radius_px: WaveOptics::new(wavelength_um).airy_radius_px(settings),
            path_difference_waves: waves
                .zip(mean.focus_um())
                .map(|(waves, focus_um)| waves.path_difference_waves(focus_um / factor)),
            depth_of_field_um,
            depth_of_correlation_um: span(mean, |spot| spot.curvature, CORRELATED),
            particles_in_view: in_view,
            source_density: in_view * mean.area_px() / (pixels * scenario.image_share()),
            background_counts: response.background,
            background_noise_counts: response.background_noise,
            saturation_counts: scenario.sensor()?.saturation_counts(),
            middle,
            sizes,
            warnings: Vec::new(),
            scans,
        };
        preview.warnings = preview.doubts(scenario);
        Ok(preview)
    }

    /// The curves of the mean size.
    pub fn mean(&self) -> &SizeCurves {
        &self.sizes[self.middle]
    }

    /// Where the model leaves what it is good for; the renderer's own warnings are the scenario's.
    fn doubts(&self, scenario: &Scenario) -> Vec<String> {
        let mut doubts = Vec::new();
        let (mean, airy_px) = (self.mean(), self.airy_radius_px);
        let sharpest =
            mean.depths.iter().map(|depth| depth.width_px.min(depth.height_px)).fold(f64::INFINITY, f64::min);
        let is_rays =
            matches!(scenario.spec.renderer(), RendererSpec::Rays { .. } | RendererSpec::Expected { .. });
        if is_rays && 2.0 * airy_px > 0.5 * sharpest {
            doubts.push(format!(
                "rays do not diffract: the Airy disc of light of {GREEN_UM} um is {:.1} px wide, the sharpest image here {sharpest:.1} px; \
                 render: (mode: waves, wavelength_um: {GREEN_UM}) has it",
                2.0 * airy_px
            ));
        }
        let lens = scenario.spec.optics.lens.unwrap_or_default();
        if let Some(waves) =
            self.path_difference_waves.filter(|waves| *waves > ABERRATED_WAVES && lens == Lens::Microsig)
        {
            let cure = if self.is_diffracted { "optics: (lens: aplanatic)" } else { WAVES_OF_APLANAT };
            doubts.push(format!(
                "MicroSIG's lens bends light of {:.2} um by {waves:.1} waves in best focus, an objective that one can buy by less than \
                 one: {cure}",
                self.wavelength_um
            ));
        }
        let near = mean.depths.iter().filter_map(|depth| depth.share_near).fold(f64::INFINITY, f64::min);
        if near < LEAST_NEAR {
            let cure = if self.is_diffracted { "optics: (lens: aplanatic)" } else { WAVES_OF_APLANAT };
            doubts.push(format!(
                "at some depth only {:.0} % of the light that the aperture accepts lands within 400 px of a particle; {cure} brings more",
                100.0 * near
            ));
        }
        for size in &self.sizes {
            let peak = size.depths.iter().map(|depth| depth.peak_counts).fold(0.0, f64::max);
            if self.background_counts + peak > self.saturation_counts {
                doubts.push(format!(
                    "images of {:.3} um reach {:.0} counts, more than the {:.0} of a saturated pixel",
                    size.d_um,
                    self.background_counts + peak,
                    self.saturation_counts
                ));
            }
        }
        doubts.extend(self.cylinder.and_then(|facts| cylinder::warning(facts, lens)));
        let (low, high) = self.depth_range_um;
        if mean.focus_um.is_some_and(|focus| focus <= low || focus >= high) {
            doubts.push(format!(
                "best focus lies at an end of the depth range of {low} to {high} um, or beyond it"
            ));
        }
        doubts
    }
}

impl SizeCurves {
    /// Least and greatest value over depth, where there are any.
    pub fn range(&self, of: impl Fn(&DepthFacts) -> Option<f64>) -> Option<[f64; 2]> {
        self.depths.iter().filter_map(of).fold(None, |range: Option<[f64; 2]>, value| {
            Some(range.map_or([value; 2], |[low, high]| [low.min(value), high.max(value)]))
        })
    }
}

/// Which of the sizes (um) is nearest to the mean, and their images through the depth range; those of the
/// mean may be there already.
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

fn curves(scenario: &Scenario, d_um: f64, scan: &DepthScan, accepted: &Accepted) -> Result<SizeCurves> {
    let response = scenario.response()?;
    let noise = response.background_noise;
    let factor = scenario.spec.optics.depth_factor.unwrap_or(1.0);
    let peaks = scenario.peak_counts(response.slope, d_um, scan);
    let depths: Vec<DepthFacts> = (scan.depths_um.iter().zip(&scan.images).zip(peaks))
        .map(|((&z_um, spot), peak_counts)| {
            // Counts per electron, if electrons fluctuate; without a camera per ray.
            let counts = match &scenario.detector {
                Some(detector) if detector.shot_noise => detector.gain_counts_per_e,
                None if scenario.renderer.has_ray_noise() && spot.peak > 0.0 => peak_counts / spot.peak,
                _ => 0.0,
            };
            let at_peak = (noise * noise + counts * peak_counts).sqrt();
            let [width_px, height_px] = spot.size_px();
            let sphere = Particle::sphere(1.0, 1.0, z_um / factor, d_um);
            let all = accepted.of(&sphere).filter(|light| *light > 0.0);
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
        })
        .collect();
    let at = |i: usize| &depths[i];
    let last = depths.len() - 1;
    let outer = OUTER.min(last);
    let slope = |a: &DepthFacts, b: &DepthFacts| {
        0.5 * (b.width_px + b.height_px - a.width_px - a.height_px) / (b.z_um - a.z_um)
    };
    Ok(SizeCurves {
        d_um,
        focus_um: scan.focus_um(),
        focal_planes_um: scan.focal_planes_um(),
        least_sizes_um: scan.least_sizes_um(),
        ring_slopes_px_um: [slope(at(0), at(outer)), slope(at(last - outer), at(last))],
        depths,
    })
}

/// Particles in view on average.
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

#[cfg(test)]
mod tests {
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
        Preview::of(&resolve(parse(&text, "p.ron").unwrap(), Path::new(".")).unwrap()).unwrap()
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
        assert!(
            shown.warnings.iter().any(|warning| warning.contains("rays do not diffract")),
            "{:?}",
            shown.warnings
        );
    }

    #[test]
    fn a_cylinder_has_two_focal_planes_and_a_bright_particle_saturates() {
        let shown = preview("cyl_focal_length: 4000, gain: 500", "");
        // As far apart as the key says, which is converted into the lens.
        for apart_um in [-10.0, -20.0, -40.0] {
            let [x, y] = preview(&format!("focal_planes_um: {apart_um}"), "").sizes[0].focal_planes_um;
            assert!((x - y - apart_um).abs() < 0.03 * -apart_um, "{x} {y}");
        }
        assert!(shown.warnings.iter().any(|warning| warning.contains("saturated")), "{:?}", shown.warnings);
    }

    /// Also of images that are not diffracted: best focus of 20x / 0.45 is bent by 5.6 waves, that of setting
    /// 1 by less than one.
    #[test]
    fn the_lens_of_microsig_is_doubted_at_large_apertures() {
        let doubts = |shown: &Preview| shown.warnings.iter().any(|warning| warning.contains("bends light"));
        for mode in ["rays", "expected", "waves, wavelength_um: 0.55"] {
            let large =
                preview("magnification: 20, numerical_aperture: 0.45", &format!("render: (mode: {mode})"));
            let waves = large.path_difference_waves.unwrap();
            assert!(waves > 4.5 && waves < 7.0 && doubts(&large), "{mode}: {waves} {:?}", large.warnings);
        }
        assert!(!doubts(&preview("", "")));
    }

    /// Behind MicroSIG's lens a halo moves the least widths of all light.
    #[test]
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

    /// A small sensor catches less of a defocused image.
    #[test]
    fn shares_are_of_the_own_sensor() {
        let shown = on_sensor((40, 30), "", "");
        let far = shown.mean().depths[0];
        assert!(far.share.unwrap() < 0.7 && far.share_near.unwrap() > 0.98, "{far:?}");
    }

    #[test]
    fn peaks_are_those_of_the_datasets_table_light_sheet_included() {
        let text = "(name: \"p\", optics: (pixel_dim_x: 64, pixel_dim_y: 48), motion: flow(field: poiseuille()), \
                    timing: pairs(count: 1), illumination: (shape: sheet(thickness_um: 20, center_um: (0, 0, -30))))";
        let scenario = resolve(parse(text, "p.ron").unwrap(), Path::new(".")).unwrap();
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
