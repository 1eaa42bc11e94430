//! napari's tracks as CSV: `track_id, t [, z], y, x`, pixel centres from 0, frames from 0 (napari.org, tracks layer).

use std::path::Path;

use super::sheet::{More, Separator, Sheet};
use super::{Conventions, Converter, Origin, Points, Unit, Usual};
use crate::error::Result;

const USUAL: Usual = Usual { name: "napari tracks", origin: Origin::Center0, frame_base: 0, unit: Unit::Px };

pub(super) fn read(path: &Path, given: &Conventions) -> Result<Points> {
    let mut converter = Converter::new(USUAL, given)?;
    let sheet = Sheet::open(path, Separator::Comma, 1)?;
    let (track, frame) = (sheet.need("track_id")?, sheet.need("t")?);
    let (x, y, z) = (sheet.need("x")?, sheet.need("y")?, sheet.column("z"));
    converter.ignores(&sheet, &["track_id", "t", "z", "y", "x"]);
    sheet.points(converter, z.is_some(), More::default(), |cells| {
        let z_um = z.map_or(Ok(0.0), |z| cells.number(z))?;
        Ok((cells.number(frame)?, cells.track(Some(track))?, [cells.number(x)?, cells.number(y)?, z_um]))
    })
}
