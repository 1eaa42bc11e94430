//! OpenPIV's text file: `# x y u v flags mask`, tab-separated, or pivpy's CSV `x,y,u,v`, without units; flag 0 valid, 1 invalid, 2
//! interpolated (openpiv.tools.save). `transform_coordinates`, which `windef` always applies, reverses y
//! within the grid of vectors, not within the image, and v: such files need --y up.

use super::fields::{self, FieldColumns, FieldLayout};
use super::sheet::TextTable;
use super::table::Reversal;
use super::{Conventions, Field, FormatDefaults, Origin};
use storage::InputFile;
use storage::error::Result;

// OpenPIV's coordinates are centers of interrogation windows, counted in whole pixels from the corner of the
// image.
const DEFAULTS: FormatDefaults = FormatDefaults::px("OpenPIV", Origin::Center1);

pub(super) fn read(path: &InputFile, given: &Conventions) -> Result<Field> {
    let sheet = TextTable::open(path, 1)?.at_most(given.limits.rows);
    let [at, moved] = [[sheet.need("x")?, sheet.need("y")?], [sheet.need("u")?, sheet.need("v")?]];
    let (flag, mask) = (sheet.column("flags"), sheet.column("mask"));
    let layout = FieldLayout { reversal: Reversal::Grid, ..FieldLayout::new(DEFAULTS) };
    let columns = FieldColumns { at, moved, flags: [flag, mask, None], ..FieldColumns::default() };
    fields::read(sheet, columns, layout, given, |cells| {
        if cells.number_or_nan(mask)? == 1.0 {
            return Ok(1);
        }
        fields::flag(cells, flag, "flags")
    })
}
