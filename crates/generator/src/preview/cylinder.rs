//! What a cylindrical lens does to images, in words.

use microsig_core::render::waves::Lens;

use scenario::CylinderFacts;

/// Difference of the growth along both directions above which an objective with MicroSIG's virtual lens is
/// not like one with a cylindrical lens before the camera.
const NOTICEABLE: f64 = 0.05;

/// A warning where images grow as behind no real cylinder.
pub(super) fn warning(CylinderFacts { growth, stretch, .. }: CylinderFacts, lens: Lens) -> Option<String> {
    let is_virtual = stretch == 1.0;
    (is_virtual && lens == Lens::Aplanatic && (growth - 1.0).abs() > NOTICEABLE).then(|| {
        format!(
            "images grow {growth:.2} times as fast in the direction of the cylindrical lens's power as across it: MicroSIG's \
             virtual lens stands at a third of the way to the sensor. One before a real camera differs by a few percent: \
             optics: (cylinder: ...) has its place and focal length"
        )
    })
}

/// Focal planes, growth and positions.
pub(super) fn phrase(CylinderFacts { focus_um, growth, stretch }: CylinderFacts) -> String {
    format!(
        "cylindrical lens: paraxial focus at {focus_um:.2} um in the direction of its power, at 0 across it; images grow there \
         {growth:.3} times as fast as across it, positions are magnified {stretch:.3} times as much"
    )
}
