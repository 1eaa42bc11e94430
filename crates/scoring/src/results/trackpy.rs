//! trackpy's data frame as `DataFrame.to_csv` writes it: `y, x [, z], ..., frame [, particle]` in any order,
//! pixel centers from 0, frames from 0 (github.com/soft-matter/trackpy).

use super::sheet::{OptionalColumns, TextTable};
use super::{Conventions, Converter, FormatDefaults, LengthUnit, Origin, Points};
use storage::error::Result;

const DEFAULTS: FormatDefaults =
    FormatDefaults { name: "trackpy", origin: Origin::Center0, frame_base: 0, unit: LengthUnit::Px };

pub(super) fn read(sheet: TextTable, given: &Conventions) -> Result<Points> {
    let mut converter = Converter::new(DEFAULTS, given)?;
    let (frame, x, y) = (sheet.need("frame")?, sheet.need("x")?, sheet.need("y")?);
    let (track, z) = (sheet.column("particle"), sheet.column("z"));
    if track.is_none() {
        converter.notes.push("no column `particle`: points are not linked".to_owned());
    }
    // trackpy's estimated position error, one value for all axes (column ep of `locate`).
    let ep = sheet.column("ep");
    if ep.is_some() {
        converter
            .notes
            .push("ep is taken as the uncertainty of x and y; negative values are unknown".to_owned());
    }
    converter.ignores(&sheet.others(&["frame", "x", "y", "z", "particle", "ep"]));
    sheet.points(
        converter,
        z.is_some(),
        OptionalColumns { sigma: [ep, ep, None], negative_is_unknown: true, ..OptionalColumns::default() },
        |cells| {
            let z_um = z.map_or(Ok(0.0), |z| cells.number(z))?;
            Ok((cells.number(frame)?, cells.track(track)?, [cells.number(x)?, cells.number(y)?, z_um]))
        },
    )
}
