//! microsig's own tables: `frame, track, x_px, y_px, z_um [, u_um_s, v_um_s, w_um_s] [, w_px, h_px, score] [,
//! axis_x, axis_y, axis_z]` for particles, `x_px, y_px, dx_px, dy_px [, dz_um], flag [, pair]` for fields.
//! Columns may be in any order; additional columns are ignored.

use super::sheet::{AxisColumns, OptionalColumns, Separator, TextTable};
use super::{
    Conventions, Converter, DroppedRows, Field, FlowVector, FormatDefaults, LengthUnit, Origin, Points,
    Position, VelocityUnit,
};
use storage::InputFile;
use storage::error::Result;

/// The conventions of microsig's own tables of particles.
pub(crate) const PARTICLES: FormatDefaults = FormatDefaults {
    name: "canonical particles",
    origin: Origin::Center1,
    frame_base: 0,
    unit: LengthUnit::Px,
};
const FIELD: FormatDefaults =
    FormatDefaults { name: "canonical field", origin: Origin::Center1, frame_base: 0, unit: LengthUnit::Px };

/// Known columns of particle tables.
const COLUMNS: [&str; 11] =
    ["frame", "track", "x_px", "y_px", "z_um", "sx_px", "sy_px", "sz_um", "w_px", "h_px", "score"];

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
///
/// # Errors
/// All problems of the table, with line numbers.
pub fn points(path: impl Into<InputFile>, given: &Conventions) -> Result<Points> {
    points_of(TextTable::open(path, Separator::Comma, 1)?.at_most(given.limits.rows), given)
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
    let more = OptionalColumns { sigma, velocity, axis, size, negative_is_unknown: false };
    sheet.points(converter, z.is_some(), more, |cells| {
        let z_um = z.map_or(Ok(0.0), |z| cells.number(z))?;
        Ok((cells.number(frame)?, cells.track(track)?, [cells.number(x)?, cells.number(y)?, z_um]))
    })
}

/// Reads a displacement field.
///
/// # Errors
/// All problems of the table, with line numbers.
pub fn field(path: impl Into<InputFile>, given: &Conventions) -> Result<Field> {
    field_of(TextTable::open(path, Separator::Comma, 1)?.at_most(given.limits.rows), given)
}

pub(super) fn field_of(sheet: TextTable, given: &Conventions) -> Result<Field> {
    let converter = Converter::new(FIELD, given)?;
    let need = |name| sheet.need(name);
    let (x, y, dx, dy) = (need("x_px")?, need("y_px")?, need("dx_px")?, need("dy_px")?);
    let column = |name| sheet.column(name);
    let (z, dz, flag, pair) = (column("z_um"), column("dz_um"), column("flag"), column("pair"));
    let (sx, sy) = (column("sx_px"), column("sy_px"));
    let (mut field, mut dropped) = (Field::default(), DroppedRows::default());
    let style = sheet.rows(|cells| {
        let pair = match cells.number_or_nan(pair)? {
            p if p.is_nan() => None,
            p => Some(converter.pair(p)?),
        };
        let z_um = z.map_or(Ok(0.0), |z| cells.number(z))?;
        let Some(at) = converter.position(cells.number(x)?, cells.number(y)?, z_um)? else {
            dropped.at(cells.line);
            return Ok(());
        };
        let [dx, dy] = converter.displacement(cells.number(dx)?, cells.number(dy)?);
        let flag = match flag.map_or(Ok(0.0), |f| cells.number(f))? {
            f if f == 0.0 || f == 1.0 || f == 2.0 => f as u8,
            f => return Err(format!("flag = {f}: expected 0 (valid), 1 (invalid) or 2 (interpolated)")),
        };
        let moved = [dx, dy, cells.number_or_nan(dz)?];
        let sigma = [cells.number_or_nan(sx)?, cells.number_or_nan(sy)?];
        field.vectors.push(vector(pair, at, moved, flag, sigma)?);
        field.lines.push(u32::try_from(cells.line).unwrap_or(u32::MAX));
        Ok(())
    })?;
    field.notes = converter.notes;
    field.notes.extend(style);
    field.n_nan = dropped.finish(&mut field.notes);
    Ok(field)
}

/// A vector with bounded components; one with NaN components is flagged invalid.
pub(super) fn vector(
    pair: Option<u32>,
    at: Position,
    moved: [f64; 3],
    flag: u8,
    sigma: [f64; 2],
) -> std::result::Result<FlowVector, String> {
    if let Some(large) = moved.iter().chain(&sigma).find(|v| v.abs() > 1e7) {
        return Err(format!("{large:?}: expected a displacement of at most 1e7 px"));
    }
    let flag = if moved[0].is_nan() || moved[1].is_nan() { 1 } else { flag };
    Ok(FlowVector { pair, at, moved, flag, sigma })
}
