//! TrackMate's spot table: four header lines (key, name, short name, unit), then one spot per line, lengths
//! in um, first pixel's center at 0, frames from 0 (TrackMate's `CSVExporter` and
//! `ExportAllSpotsStatsAction`). Tables with only the first header line are read too. `xml.rs` reads
//! TrackMate's XML.

use super::sheet::{OptionalColumns, TextTable};
use super::{Conventions, Converter, FormatDefaults, LengthUnit, Origin, Points};
use storage::error::Result;

const DEFAULTS: FormatDefaults =
    FormatDefaults { name: "TrackMate spots", origin: Origin::Center0, frame_base: 0, unit: LengthUnit::Um };

pub(super) fn spots(mut sheet: TextTable, given: &Conventions) -> Result<Points> {
    let (track, frame) = (sheet.column("TRACK_ID"), sheet.need("FRAME")?);
    let (x, y, z) = (sheet.need("POSITION_X")?, sheet.need("POSITION_Y")?, sheet.column("POSITION_Z"));
    // Rows of names and units below the keys, up to the first number.
    let units = sheet.skip_words(x)?;
    let unit = if units.iter().any(|u| u.contains("pixel")) { LengthUnit::Px } else { LengthUnit::Um };
    let mut converter = Converter::new(FormatDefaults { unit, ..DEFAULTS }, given)?;
    converter.ignores(&sheet.others(&["TRACK_ID", "FRAME", "POSITION_X", "POSITION_Y", "POSITION_Z"]));
    sheet.points(converter, z.is_some(), OptionalColumns::default(), |cells| {
        let z_um = z.map_or(Ok(0.0), |z| cells.number(z))?;
        Ok((cells.number(frame)?, cells.track(track)?, [cells.number(x)?, cells.number(y)?, z_um]))
    })
}
