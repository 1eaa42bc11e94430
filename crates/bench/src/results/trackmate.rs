//! TrackMate's table of spots: four header lines (key, name, short name, unit), then one spot a line, lengths in um, the
//! first pixel's centre at 0, frames from 0 (TrackMate's `CSVExporter` and `ExportAllSpotsStatsAction`). Tables with only
//! the first header line are read too. Its XML is in `xml.rs`.

use std::path::Path;

use super::sheet::{Separator, Sheet};
use super::{Conventions, Converter, Origin, Points, Unit, Usual};
use crate::error::Result;

pub(super) const USUAL: Usual =
    Usual { name: "TrackMate spots", origin: Origin::Center0, frame_base: 0, unit: Unit::Um };

pub(super) fn spots(path: &Path, given: &Conventions) -> Result<Points> {
    let sheet = Sheet::open(path, Separator::Comma, 1)?;
    let (track, frame) = (sheet.column("TRACK_ID"), sheet.need("FRAME")?);
    let (x, y, z) = (sheet.need("POSITION_X")?, sheet.need("POSITION_Y")?, sheet.column("POSITION_Z"));
    let mut converter = Converter::new(USUAL, given)?;
    let mut header_lines = 3;
    let mut pixels = false;
    let mut points = {
        let converter = &mut converter;
        let taken = std::mem::take(&mut converter.notes);
        let inner = Converter::new(USUAL, given)?;
        let points = sheet.points(inner, z.is_some(), |cells| {
            // The names and units below the keys; a number ends them.
            if header_lines > 0 && cells.number(x).is_err() {
                header_lines -= 1;
                pixels |= cells.text(x).contains("pixel");
                return Ok((f64::NAN, -1, [f64::NAN; 3]));
            }
            header_lines = 0;
            let z_um = z.map_or(Ok(0.0), |z| cells.number(z))?;
            Ok((cells.number(frame)?, cells.track(track)?, [cells.number(x)?, cells.number(y)?, z_um]))
        })?;
        converter.notes = taken;
        points
    };
    points.notes = converter.notes;
    Ok(points)
}
