//! microsig's own tables: `frame, track, x_px, y_px, z_um [, u_um_s, v_um_s, w_um_s] [, w_px, h_px, score] [,
//! axis_x, axis_y, axis_z] [, d_um]` for particles, `x_px, y_px, dx_px, dy_px [, dz_um], flag [, pair]` for fields.
//! Columns may be in any order; additional columns are ignored.

use super::fields::{self, FieldColumns, FieldLayout};
use super::sheet::{AxisColumns, OptionalColumns, TextTable};
use super::{Conventions, Converter, Field, FormatDefaults, Origin, Points, VelocityUnit};
use storage::InputFile;
use storage::error::Result;

/// The conventions of microsig's own tables of particles.
pub(crate) const PARTICLES: FormatDefaults = FormatDefaults::px("canonical particles", Origin::Center1);
const FIELD: FormatDefaults = FormatDefaults::px("canonical field", Origin::Center1);

/// Known columns of particle tables.
const COLUMNS: [&str; 12] =
    ["frame", "track", "x_px", "y_px", "z_um", "sx_px", "sy_px", "sz_um", "w_px", "h_px", "score", "d_um"];

/// Columns of velocities along x, y, z with their units; the first set present is read.
const VELOCITIES: [(VelocityUnit, [&str; 3], &str); 2] = [
    (VelocityUnit::UmPerS, ["u_um_s", "v_um_s", "w_um_s"], "um/s"),
    (VelocityUnit::PerFrame, ["vx", "vy", "vz"], "px per frame, along z um per frame"),
];

/// Columns of the symmetry axis of a spheroid: its components, or the angles of MicroSIG's data file.
const AXIS: [&str; 3] = ["axis_x", "axis_y", "axis_z"];
const ANGLES: [&str; 2] = ["alpha_rad", "beta_rad"];

/// The columns with symmetry axes, if all of them are there.
fn axis(sheet: &TextTable) -> Option<AxisColumns> {
    let [x, y, z] = AXIS.map(|name| sheet.column(name));
    if let (Some(x), Some(y), Some(z)) = (x, y, z) {
        return Some(AxisColumns::Vector([x, y, z]));
    }
    let [alpha, beta] = ANGLES.map(|name| sheet.column(name));
    Some(AxisColumns::Angles([alpha?, beta?]))
}

/// Reads a table of particles.
/// Errors: all problems of the table, with line numbers.
pub fn points(path: impl Into<InputFile>, given: &Conventions) -> Result<Points> {
    points_of(TextTable::open(path, 1)?.at_most(given.limits.rows), given)
}

pub(super) fn points_of(sheet: TextTable, given: &Conventions) -> Result<Points> {
    let mut converter = Converter::new(PARTICLES, given)?;
    let (frame, x, y) = (sheet.need("frame")?, sheet.need("x_px")?, sheet.need("y_px")?);
    let (track, z) = (sheet.column("track"), sheet.column("z_um"));
    let sigma = ["sx_px", "sy_px", "sz_um"].map(|name| sheet.column(name));
    let velocity =
        VELOCITIES.map(|(unit, names, words)| (unit, names, words, names.map(|n| sheet.column(n))));
    let velocity = velocity.into_iter().find(|(.., columns)| columns[0].and(columns[1]).is_some());
    let mut used = COLUMNS.to_vec();
    if let Some((_, names, words, _)) = velocity {
        converter.notes.push(format!("{} are velocities in {words}", names.join(", ")));
        used.extend(names);
    }
    let axis = axis(&sheet);
    match axis {
        Some(AxisColumns::Vector(_)) => used.extend(AXIS),
        Some(AxisColumns::Angles(_)) => used.extend(ANGLES),
        None => {}
    }
    converter.ignores(&sheet.others(&used));
    let size = ["w_px", "h_px", "score"].map(|name| sheet.column(name));
    let velocity = velocity.map(|(unit, _, _, columns)| (unit, columns));
    let diameter = sheet.column("d_um");
    let more = OptionalColumns { sigma, velocity, axis, size, diameter, negative_is_unknown: false };
    sheet.points(converter, z.is_some(), more, |cells| {
        let z_um = z.map_or(Ok(0.0), |z| cells.number(z))?;
        Ok((cells.number(frame)?, cells.track(track)?, [cells.number(x)?, cells.number(y)?, z_um]))
    })
}

/// Reads a displacement field.
/// Errors: all problems of the table, with line numbers.
pub fn field(path: impl Into<InputFile>, given: &Conventions) -> Result<Field> {
    field_of(TextTable::open(path, 1)?.at_most(given.limits.rows), given)
}

pub(super) fn field_of(sheet: TextTable, given: &Conventions) -> Result<Field> {
    let column = |name| sheet.column(name);
    let columns = FieldColumns {
        at: [sheet.need("x_px")?, sheet.need("y_px")?],
        moved: [sheet.need("dx_px")?, sheet.need("dy_px")?],
        z: column("z_um"),
        dz: column("dz_um"),
        pair: column("pair"),
        sigma: [column("sx_px"), column("sy_px")],
        flags: [column("flag"), None, None],
    };
    fields::read(sheet, columns, FieldLayout::px(FIELD), given, |cells| {
        fields::flag(cells, columns.flags[0], "flag")
    })
}
