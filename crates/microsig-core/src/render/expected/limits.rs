//! Limits on settings and particles whose expected images would take unbounded computation.

use std::collections::BTreeMap;
use std::sync::{PoisonError, RwLock};

use super::model::Model;
use super::pupil::Pupil;
use crate::error::Error;
use crate::particle::Particle;
use crate::render::tables::{Key, TableRanges};
use crate::settings::Settings;

/// Largest deflection by a cylindrical lens, px; a stronger lens is rejected.
const FARTHEST_PX: f64 = 20_000.0;

/// Maximum number of aperture cells (`aperture_integral`) per image at one node per px.
const MAX_CELLS: f64 = 1e6;

/// Rejects a cylindrical lens that deflects rays by more than [`FARTHEST_PX`].
pub(super) fn check_cylinder(settings: &Settings, pupil: &Pupil) -> Result<(), Error> {
    let Some(cylinder) = pupil.system.cylinder else { return Ok(()) };
    // A marginal ray is deflected by at most q / f_cyl over the last two thirds of the image distance.
    let lever = 2.0 / 3.0 * pupil.system.objective.image_distance * pupil.aperture() / settings.pixel_size;
    let least_um = lever / FARTHEST_PX;
    if cylinder.focal_length.abs() >= least_um {
        return Ok(());
    }
    let message = format!(
        "cyl_focal_length = {:e}: expected images take |cyl_focal_length| >= {least_um:.3} um, or 0 for no cylinder (a shorter \
         focal length spreads a point over more than {FARTHEST_PX} px)",
        cylinder.focal_length
    );
    Err(Error::malformed("settings", message))
}

/// Rejects a particle whose image takes more than [`MAX_CELLS`] aperture cells.
pub(super) fn check_cells(settings: &Settings, particle: &Particle, cells: f64) -> Result<(), Error> {
    if cells <= MAX_CELLS {
        return Ok(());
    }
    let Settings { numerical_aperture, cyl_focal_length, .. } = settings;
    Err(Error::Unsupported(format!(
        "numerical_aperture = {numerical_aperture} with cyl_focal_length = {cyl_focal_length}: the image of d_p = {} um at \
         z = {} um takes {cells:.1e} parts of the aperture, and expected images at most {MAX_CELLS:.0e}; use a smaller \
         sensor, a greater tolerance, or rays",
        particle.d_um, particle.z_um
    )))
}

/// Number of aperture cells per image, by table.
#[derive(Debug, Default)]
pub(super) struct KnownCells(RwLock<BTreeMap<Key, f64>>);

impl KnownCells {
    /// Number of aperture cells needed for the image of this sphere at the middle of the depth range of its
    /// table.
    pub(super) fn of(&self, model: &Model, ranges: &TableRanges, sphere: &Particle) -> f64 {
        let key = ranges.key(sphere);
        let known = self.0.read().unwrap_or_else(PoisonError::into_inner).get(&key).copied();
        known.unwrap_or_else(|| {
            let span = ranges.span(key);
            let cells = model.cells(span.middle_um(), span.radii[1]);
            self.0.write().unwrap_or_else(PoisonError::into_inner).insert(key, cells);
            cells
        })
    }
}
