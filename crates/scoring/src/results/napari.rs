//! napari's tracks as CSV: `track_id, t [, z], y, x`, pixel centers from 0, frames from 0 (napari.org, tracks
//! layer).

use super::sheet::{OptionalColumns, TextTable};
use super::{Conventions, Converter, FormatDefaults, LengthUnit, Origin, Points};
use storage::error::Result;

const DEFAULTS: FormatDefaults =
    FormatDefaults { name: "napari tracks", origin: Origin::Center0, frame_base: 0, unit: LengthUnit::Px };

pub(super) fn read(sheet: TextTable, given: &Conventions) -> Result<Points> {
    let mut converter = Converter::new(DEFAULTS, given)?;
    let (track, frame) = (sheet.need("track_id")?, sheet.need("t")?);
    let (x, y, z) = (sheet.need("x")?, sheet.need("y")?, sheet.column("z"));
    converter.ignores(&sheet.others(&["track_id", "t", "z", "y", "x"]));
    sheet.points(converter, z.is_some(), OptionalColumns::default(), |cells| {
        let z_um = z.map_or(Ok(0.0), |z| cells.number(z))?;
        Ok((cells.number(frame)?, cells.track(Some(track))?, [cells.number(x)?, cells.number(y)?, z_um]))
    })
}
