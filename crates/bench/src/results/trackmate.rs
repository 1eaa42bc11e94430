//! TrackMate's table of spots: four header lines (key, name, short name, unit), then one spot a line, lengths in um, the
//! first pixel's centre at 0, frames from 0 (TrackMate's `CSVExporter` and `ExportAllSpotsStatsAction`). Tables with only
//! the first header line are read too. Its XML is in `xml.rs`.

use std::path::Path;

use super::sheet::{More, Separator, Sheet};
use super::{Conventions, Converter, Origin, Points, Unit, Usual};
use crate::error::Result;

const USUAL: Usual =
    Usual { name: "TrackMate spots", origin: Origin::Center0, frame_base: 0, unit: Unit::Um };

pub(super) fn spots(path: &Path, given: &Conventions) -> Result<Points> {
    let mut sheet = Sheet::open(path, Separator::Comma, 1)?;
    let (track, frame) = (sheet.column("TRACK_ID"), sheet.need("FRAME")?);
    let (x, y, z) = (sheet.need("POSITION_X")?, sheet.need("POSITION_Y")?, sheet.column("POSITION_Z"));
    // Names and units below the keys; the first number ends them.
    let units = sheet.skip_words(x)?;
    let unit = if units.iter().any(|u| u.contains("pixel")) { Unit::Px } else { Unit::Um };
    let mut converter = Converter::new(Usual { unit, ..USUAL }, given)?;
    converter.ignores(&sheet, &["TRACK_ID", "FRAME", "POSITION_X", "POSITION_Y", "POSITION_Z"]);
    sheet.points(converter, z.is_some(), More::default(), |cells| {
        let z_um = z.map_or(Ok(0.0), |z| cells.number(z))?;
        Ok((cells.number(frame)?, cells.track(track)?, [cells.number(x)?, cells.number(y)?, z_um]))
    })
}
