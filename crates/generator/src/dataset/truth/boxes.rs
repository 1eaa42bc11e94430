//! `truth/boxes.csv`: boxes and masks of particle images, for detectors.

use flows::frame::Frame;
use scenario::Scenario;
use scenario::spec::Diameter;
use storage::error::Result;
use storage::tables::Rows;
use visibility::Outline;

use super::Sight;

/// Writes the row of a particle image.
pub(super) fn row(
    rows: &mut Rows,
    scenario: &Scenario,
    frame: &Frame,
    sight: &Sight,
    outline: &Outline,
) -> Result<()> {
    let settings = &scenario.settings;
    let pixels = settings.pixel_dim_x as usize * settings.pixel_dim_y as usize;
    // Pixels are counted from 1; a box of one pixel has its middle in that pixel.
    let middle = |first: usize, size: usize| first as f64 + 0.5 * (size as f64 + 1.0);
    let ((left, top), (width, height)) = (outline.corner, outline.size);
    rows.whole_numbers(&[u64::from(frame.index), sight.tracer.id]);
    rows.numbers(&[middle(left, width), middle(top, height)]);
    rows.whole_numbers(&[width as u64, height as u64, outline.area as u64]);
    rows.numbers(&[sight.tracer.position.z]);
    rows.whole_numbers(&[size_class(scenario, sight.particle.d_um) as u64]);
    rows.numbers(&[outline.hidden]);
    rows.whole_numbers(&[u64::from(sight.visible)]);
    rows.cells(&[&outline.mask.text(pixels)]);
    rows.end_row()
}

/// The number of a diameter in the list of diameters of a scenario, otherwise 0.
pub(crate) fn size_class(scenario: &Scenario, d_um: f64) -> usize {
    match &scenario.spec.particles.diameter_um {
        Some(Diameter::List(list)) => list.iter().position(|(d, _)| *d == d_um).unwrap_or(0),
        _ => 0,
    }
}
