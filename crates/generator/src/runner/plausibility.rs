//! Warnings about datasets that are probably not as intended; each states the number that indicates it.

use crate::dataset::truth::Totals;
use crate::dataset::truth::depth::ParticleImage;
use crate::preview::infeasible;
use scenario::Scenario;
use storage::error::Result;

/// Below this seeding density (particles per pixel), particles are tracked individually, so their spacing
/// matters; above it, interrogation windows are correlated.
const TRACKED_PPP: f64 = 0.005;

/// The warnings about a dataset; `saturated` is the largest fraction of saturated pixels in a frame of the
/// preview.
pub(super) fn warnings(
    scenario: &Scenario,
    totals: &Totals,
    image: &ParticleImage,
    saturated: f64,
) -> Result<Vec<String>> {
    let settings = &scenario.settings;
    let (width, height) = (f64::from(settings.pixel_dim_x), f64::from(settings.pixel_dim_y));
    let moved_px = totals.max_displacement_px;
    let n_p = totals.visible as f64 / f64::from(totals.frames.max(1));
    let spacing_px = (width * height / n_p.max(1e-9)).sqrt();
    let mut warnings = Vec::new();
    if totals.displacements > 0 && moved_px < 0.01 {
        warnings.push(format!(
            "no particle moves in the image plane: the largest displacement is {} px",
            (1e4 * moved_px).round() / 1e4
        ));
    }
    let is_linked =
        (0..scenario.recordings.frames()).any(|frame| scenario.recordings.link_to(frame).is_some());
    if is_linked && totals.displacements == 0 && totals.visible > 0 {
        warnings.push("no particle is in both frames of a pair: all leave within one time step".to_owned());
    }
    if moved_px > 0.25 * width.min(height) {
        warnings.push(format!(
            "displacements of up to {moved_px:.1} px are more than a quarter of the image of {width} x {height} px"
        ));
    } else if moved_px > 0.25 * spacing_px && n_p / (width * height) < TRACKED_PPP && n_p > 1.0 {
        warnings.push(format!(
            "displacements of up to {moved_px:.1} px are more than a quarter of the mean spacing of particles, \
             {spacing_px:.1} px: links are ambiguous"
        ));
    }
    let (background, end) = (image.background_counts, scenario.sensor()?.saturation_counts());
    if background >= end {
        warnings.push(format!(
            "the background of {background:.1} counts reaches the saturation level of the camera, {end:.1} counts"
        ));
    } else if saturated > 0.5 {
        warnings.push(format!(
            "{:.0} % of the pixels in a frame are saturated at {end:.0} counts",
            100.0 * saturated
        ));
    } else if totals.saturated > 0 {
        warnings.push(format!(
            "{} of {} particle images have pixels saturated at {end:.0} counts",
            totals.saturated, totals.visible
        ));
    }
    if totals.visible == 0 {
        warnings.push("no particle is in view".to_owned());
    } else if totals.light <= 0.0 || scenario.response()?.slope == 0.0 {
        warnings.push("the particles emit no light".to_owned());
    }
    let ppp = n_p / (width * height);
    let density = [ppp, ppp * image.area_px / scenario.image_share()];
    let dark = [image.background_counts, image.background_noise_counts];
    warnings.extend(infeasible(scenario, density, image.snr, dark));
    let (low, high) = scenario.depth_range_um;
    if let Some(focus) = image.focus_um.filter(|focus| (*focus <= low || *focus >= high) && low < high) {
        warnings.push(format!(
            "best focus is at the edge of the depth range of {low} to {high} um, at z = {focus} um, or beyond it"
        ));
    }
    Ok(warnings)
}
