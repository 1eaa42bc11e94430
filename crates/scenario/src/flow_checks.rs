//! Checks of a flow against the box, the particles and the recordings of a scenario.

use flows::{FluidRegion, Region, Seeding, VelocityField};
use microsig_core::problem::Problems;

use super::findings::Collect;
use super::recordings::Recordings;

/// Checks that particles fit into the fluid and that their paths can be integrated; returns warnings.
pub(super) fn check(
    (field, fluid): (&dyn VelocityField, &FluidRegion<'_>),
    (seeding, view): (&Seeding, &Region),
    recordings: &Recordings,
    problems: &mut Problems,
) -> Vec<String> {
    problems.of("particles and boundaries", seeding.density(fluid, 0.0));
    let (longest_s, whole_s) = recordings.spans_s();
    problems.of("motion.flow.field", flows::step_estimate::check(field, fluid, 0.0, longest_s));
    let compressed = compression_warning(field, fluid, view, whole_s);
    compressed.into_iter().chain(coverage_warning(field, fluid.domain().region())).collect()
}

/// A warning if the divergence of a field changes the number density of particles during a recording.
fn compression_warning(
    field: &dyn VelocityField,
    fluid: &FluidRegion<'_>,
    view: &Region,
    recording_s: f64,
) -> Option<String> {
    let (low, high) = flows::divergence::range(field, fluid, view, 0.0)?;
    let strongest = low.abs().max(high.abs()) * recording_s;
    (strongest > NOTICEABLE_COMPRESSION).then(|| {
        format!(
            "the field is not divergence-free ({low:.3} to {high:.3} 1/s in view): within a recording of {recording_s} s the \
             number density of particles changes by factors of {:.3} to {:.3} along their paths, while entering particles \
             have the density of the seeding; timing: pairs(...) avoids this, because it seeds each pair independently",
            (-high * recording_s).exp(),
            (-low * recording_s).exp()
        )
    })
}

/// A warning if the grid of the field does not cover the box of the particles.
fn coverage_warning(field: &dyn VelocityField, region: &Region) -> Option<String> {
    let outside = field.share_without_data(region);
    (outside > NOTICEABLE_OUTSIDE).then(|| {
        let (min, max) = (region.min(), region.max());
        format!(
            "the grid of the velocity field does not cover the box of the particles, ({:.1}, {:.1}, {:.1}) to ({:.1}, {:.1}, \
             {:.1}) um: {:.1} % of its volume, and of the particles, lie outside the grid and have the velocity \
             of its nearest point; see boundaries.margin_px and boundaries.z_um",
            min.x,
            min.y,
            min.z,
            max.x,
            max.y,
            max.z,
            100.0 * outside
        )
    })
}

/// Fraction of the volume without data above which there is a warning.
const NOTICEABLE_OUTSIDE: f64 = 0.01;

/// Relative change of density during a recording above which there is a warning.
const NOTICEABLE_COMPRESSION: f64 = 0.05;
