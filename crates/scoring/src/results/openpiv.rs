//! OpenPIV's text file: `# x y u v flags mask`, tab-separated, px unless scaled; flag 0 valid, 1 invalid, 2
//! interpolated (openpiv.tools.save). Its tutorials reverse y to point upward with `transform_coordinates`;
//! such files need --y up.

use super::canonical::vector;
use super::sheet::{Separator, TextTable};
use super::{Conventions, Converter, DroppedRows, Field, FormatDefaults, LengthUnit, Origin};
use storage::InputFile;
use storage::error::Result;

// OpenPIV's coordinates are centers of interrogation windows, counted in whole pixels from the corner of the
// image.
const DEFAULTS: FormatDefaults =
    FormatDefaults { name: "OpenPIV", origin: Origin::Center1, frame_base: 0, unit: LengthUnit::Px };

pub(super) fn read(path: &InputFile, given: &Conventions) -> Result<Field> {
    let converter = Converter::new(DEFAULTS, given)?;
    let sheet = TextTable::open(path, Separator::Space, 1)?.at_most(given.limits.rows);
    let (x, y, u, v) = (sheet.need("x")?, sheet.need("y")?, sheet.need("u")?, sheet.need("v")?);
    let (flag, mask) = (sheet.column("flags"), sheet.column("mask"));
    let (mut field, mut dropped) = (Field::default(), DroppedRows::default());
    let style = sheet.rows(|cells| {
        let Some(at) = converter.position(cells.number(x)?, cells.number(y)?, 0.0)? else {
            dropped.at(cells.line);
            return Ok(());
        };
        let [dx, dy] = converter.displacement(cells.number(u)?, cells.number(v)?);
        let masked = cells.number_or_nan(mask)? == 1.0;
        let flag = match cells.number_or_nan(flag)? {
            _ if masked => 1,
            2.0 => 2,
            1.0 => 1,
            f if f == 0.0 || f.is_nan() => 0,
            f => return Err(format!("flags = {f}: expected 0 (valid), 1 (invalid) or 2 (interpolated)")),
        };
        field.vectors.push(vector(None, at, [dx, dy, f64::NAN], flag, [f64::NAN; 2])?);
        Ok(())
    })?;
    field.notes = converter.notes;
    field.notes.extend(style);
    field.n_nan = dropped.finish(&mut field.notes);
    Ok(field)
}
