//! trackpy's data frame as `DataFrame.to_csv` writes it: `y, x [, z], ..., frame [, particle]` in any order, pixel centres
//! from 0, frames from 0 (github.com/soft-matter/trackpy).

use std::path::Path;

use super::sheet::{More, Separator, Sheet};
use super::{Conventions, Converter, Origin, Points, Unit, Usual};
use crate::error::Result;

const USUAL: Usual = Usual { name: "trackpy", origin: Origin::Center0, frame_base: 0, unit: Unit::Px };

pub(super) fn read(path: &Path, given: &Conventions) -> Result<Points> {
    let mut converter = Converter::new(USUAL, given)?;
    let sheet = Sheet::open(path, Separator::Comma, 1)?;
    let (frame, x, y) = (sheet.need("frame")?, sheet.need("x")?, sheet.need("y")?);
    let (track, z) = (sheet.column("particle"), sheet.column("z"));
    if track.is_none() {
        converter.notes.push("no column `particle`: nothing is linked".to_owned());
    }
    // trackpy's estimate of the error of a position, one number for all axes (`locate`, column ep).
    let ep = sheet.column("ep");
    if ep.is_some() {
        converter.notes.push("ep is taken as the uncertainty of x and y".to_owned());
    }
    converter.ignores(&sheet, &["frame", "x", "y", "z", "particle", "ep"]);
    sheet.points(converter, z.is_some(), More { sigma: [ep, ep, None], ..More::default() }, |cells| {
        let z_um = z.map_or(Ok(0.0), |z| cells.number(z))?;
        Ok((cells.number(frame)?, cells.track(track)?, [cells.number(x)?, cells.number(y)?, z_um]))
    })
}
