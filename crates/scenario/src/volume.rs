//! The section of a scenario on the box that holds the particles: depths, margin, boundaries.

use flows::{Boundary, Domain, Illumination};
use microsig_core::Settings;
use microsig_core::problem::Problems;

use super::field_of_view::{corners, lost_focus};
use super::findings::{Collect, Findings};
use super::imaging::Imaging;
use super::spec::{Boundaries, Spec};

/// Depth range of the default channel, um: 100 um deep, within the range scanned in Rossi 2020.
const DEFAULT_Z_UM: (f64, f64) = (-80.0, 20.0);

/// The depth range of the box, um; fills in its default.
pub(super) fn depths_um(boundaries: &mut Boundaries, problems: &mut Problems) -> (f64, f64) {
    let z_um = *boundaries.z_um.get_or_insert(DEFAULT_Z_UM);
    if z_um.0 < z_um.1 {
        return z_um;
    }
    let found = format!("({}, {})", z_um.0, z_um.1);
    problems.value("boundaries.z_um", found, "two depths in um, the lower one first");
    // Avoids consequential problems: other depths probably fit the intended range.
    if z_um.0 > z_um.1 { (z_um.1, z_um.0) } else { DEFAULT_Z_UM }
}

/// The margin around the image, px, for particles of a diameter up to `longest_um` at these physical depths;
/// fills in its default. Warns of corners of the field whose focus is not among the depths.
pub(super) fn margin_px(
    spec: &mut Spec,
    imaging: &Imaging,
    (z_um, longest_um): ((f64, f64), f64),
    has_field: bool,
    found: &mut Findings<'_>,
) -> f64 {
    let (depths, field) = (imaging.in_data_files(z_um), spec.optics.field.as_ref());
    let margin_px = *spec.boundaries.margin_px.get_or_insert_with(|| {
        let corners = corners(field, &imaging.settings);
        let images = corners.iter().map(|at| imaging.largest_image(*at, depths, longest_um));
        default_margin_px(images.fold(0.0, f64::max), &imaging.settings, has_field, found)
    });
    if let Some(field) = field.filter(|_| imaging.renderer.depends_on_depth()) {
        found.warnings.extend(lost_focus(field, &imaging.settings, depths));
    }
    margin_px
}

/// Default margin around the image, px: the largest distance from which the light of a particle reaches the
/// image, up to a limit.
fn default_margin_px(largest: f64, settings: &Settings, has_field: bool, found: &mut Findings<'_>) -> f64 {
    // At high NA, a small part of a particle's light lands thousands of px away. Including it would require
    // many times more particles than are in view, so this needs an explicit `margin_px`.
    let most = f64::from(settings.pixel_dim_x.max(settings.pixel_dim_y)).max(100.0) / 2.0;
    if largest > most && has_field {
        found.warn(format!(
            "particles more than {most} px away from the image are omitted, although some of their light would reach it; \
             boundaries: (margin_px: {largest}) includes them all"
        ));
    }
    largest.min(most)
}

/// The measured depth range, um: the one of the boundaries, restricted to a light sheet that is perpendicular to
/// the optical axis.
pub(super) fn illuminated_depths(
    z_um: (f64, f64),
    light: &Illumination,
    problems: &mut Problems,
) -> (f64, f64) {
    let Some(sheet) = light.depths() else { return z_um };
    let lit = (z_um.0.max(sheet.0), z_um.1.min(sheet.1));
    if lit.0 >= lit.1 {
        let allowed = format!("a sheet that crosses the depth range, {} to {} um", z_um.0, z_um.1);
        problems.value("illumination.shape.sheet", format!("{} to {} um", sheet.0, sheet.1), &allowed);
        return z_um;
    }
    lit
}

/// The box: the view with its margin; fills in the boundary along z.
pub(super) fn domain(
    boundaries: &mut Boundaries,
    imaging: &Imaging,
    z_um: (f64, f64),
    margin_px: f64,
    problems: &mut Problems,
) -> Option<Domain> {
    let z = *boundaries.z.get_or_insert(Boundary::Wall);
    let faces = [boundaries.x, boundaries.y, z];
    let region = imaging.scale.view(z_um.0, z_um.1, margin_px);
    problems.of("particles and boundaries", region.map(|region| Domain::new(region, faces)))
}
