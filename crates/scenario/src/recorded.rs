//! Checks of recorded tracks against the rest of a scenario.

use flows::scale::Scale;
use flows::{Diameters, RecordedTracks};
use glam::DVec3;
use microsig_core::render::Renderer;
use microsig_core::{Particle, Spheroid};

use super::findings::Findings;
use super::particles::Cloud;
use super::recordings::Recordings;

/// Maximum number of problems, and of warnings, listed for single particles.
const MAX_LISTED: usize = 20;

/// Checks that the particles of recorded tracks can be rendered, and warns of rows outside the depth range or
/// after the last frame.
pub(super) fn check_tracks(
    tracks: &RecordedTracks,
    cloud: &Cloud,
    (diameters, renderer, scale): (&Diameters, &Renderer, &Scale),
    (recordings, z_um): (&Recordings, (f64, f64)),
    found: &mut Findings<'_>,
) {
    if cloud.photons.is_some() && tracks.rows().iter().any(|row| row.c_int.is_some()) {
        let what = "expected nothing: the column `c_int` of the tracks gives the brightness of particles";
        found.problems.other("particles.photons", what);
    }
    const KEY: &str = "motion.tracks.file";
    let (mut wrong, mut drawn_badly, mut beyond, mut late) = (0, 0, 0, 0);
    for row in tracks.rows() {
        let at = scale.to_image(row.position);
        let axis = row.axis.unwrap_or(DVec3::Z).to_array();
        let spheroid = row.aspect.filter(|e_p| *e_p != 1.0).map(|e_p| Spheroid::from_axis(e_p, axis));
        for d_um in [row.d_um.unwrap_or(diameters.min()), row.d_um.unwrap_or(diameters.max())] {
            let particle = Particle { spheroid, ..Particle::sphere(at.x_px, at.y_px, at.z_um, d_um) };
            let in_line = |what: String| format!("line {} of the tracks: {what}", row.line);
            match renderer.check(&particle) {
                Err(e) if wrong < MAX_LISTED => {
                    wrong += 1;
                    found.problems.other(KEY, in_line(e.to_string()));
                }
                Ok(Some(warning)) if drawn_badly < MAX_LISTED => {
                    drawn_badly += 1;
                    found.warn(in_line(warning));
                }
                _ => {}
            }
        }
        beyond += usize::from(row.position.z < z_um.0 || row.position.z > z_um.1);
        late += usize::from(row.frame >= recordings.frames());
    }
    found.problems.0.dedup();
    if beyond > 0 {
        found.warn(format!(
            "{beyond} rows of the tracks are outside boundaries.z_um = ({}, {}): they are rendered, but not scored",
            z_um.0, z_um.1
        ));
    }
    if late > 0 {
        found.warn(format!(
            "{late} rows of the tracks are in frames after the last one, {}, and are omitted",
            recordings.frames() - 1
        ));
    }
}
