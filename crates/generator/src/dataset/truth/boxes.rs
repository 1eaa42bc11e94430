//! `truth/boxes.csv`: boxes and masks of particle images, for detectors.

use flows::frame::Frame;
use microsig_core::visibility::Outline;
use scenario::Scenario;
use scenario::spec::Diameter;
use storage::dataset::BoxRow;

use super::Sight;

/// The row of a particle image.
pub(super) fn row(scenario: &Scenario, frame: &Frame, sight: &Sight, outline: &Outline) -> BoxRow {
    let settings = &scenario.settings;
    let pixels = settings.pixel_dim_x as usize * settings.pixel_dim_y as usize;
    // Pixels are counted from 1; a box of one pixel has its middle in that pixel.
    let middle = |first: usize, size: usize| first as f64 + 0.5 * (size as f64 + 1.0);
    let ((left, top), (width, height)) = (outline.corner, outline.size);
    BoxRow {
        frame: frame.index,
        track: sight.tracer.id,
        x_px: middle(left, width),
        y_px: middle(top, height),
        w_px: width as u32,
        h_px: height as u32,
        area_px: outline.area as u32,
        z_um: sight.tracer.position.z,
        class: size_class(scenario, sight.particle.d_um) as u32,
        hidden: outline.hidden,
        visible: sight.visible,
        mask: outline.mask.text(pixels),
    }
}

/// The number of a diameter in the list of diameters of a scenario, otherwise 0.
pub(crate) fn size_class(scenario: &Scenario, d_um: f64) -> usize {
    match &scenario.spec.particles.diameter_um {
        Some(Diameter::List(list)) => list.iter().position(|(d, _)| *d == d_um).unwrap_or(0),
        _ => 0,
    }
}
