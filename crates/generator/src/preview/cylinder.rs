//! Describes the effect of a cylindrical lens on images.

use microsig_core::render::waves::Lens;

use scenario::CylinderFacts;

/// Difference of the growth along both directions above which an objective with MicroSIG's virtual lens does
/// not represent one with a cylindrical lens in front of the camera.
const NOTICEABLE: f64 = 0.05;

/// A warning if images grow as with no real cylindrical lens.
pub(super) fn warning(CylinderFacts { growth, stretch, .. }: CylinderFacts, lens: Lens) -> Option<String> {
    let is_virtual = stretch == 1.0;
    (is_virtual && lens == Lens::Aplanatic && (growth - 1.0).abs() > NOTICEABLE).then(|| {
        format!(
            "images grow {growth:.2} times as fast along the direction in which the cylindrical lens has power as across it: MicroSIG's \
            virtual lens is located at a third of the distance to the sensor. With a lens in front of a real camera the ratio differs from 1 by a few \
            percent: optics: (cylinder: ...) sets its position and focal length"
        )
    })
}
