//! PIVlab's ASCII export: up to three header lines, the last `x [px],y [px],u [px/frame],v [px/frame],Vector
//! type [-]`; separated by commas, tabs or spaces. Pixels from 1, y downward; type 1 valid, 2 interpolated, 0
//! masked (PIVlab's `file_save.m`). Calibrated exports are in m and m/s; the calibration factors in the
//! second line are divided out.

use super::canonical::vector;
use super::sheet::{Separator, TextTable};
use super::text::Text;
use super::{Conventions, Converter, DroppedRows, Field, FormatDefaults, LengthUnit, Origin, shown};
use storage::InputFile;
use storage::error::{Error, Result};

const DEFAULTS: FormatDefaults =
    FormatDefaults { name: "PIVlab", origin: Origin::Center1, frame_base: 0, unit: LengthUnit::Px };

pub(super) fn read(path: &InputFile, given: &Conventions) -> Result<Field> {
    let head = Text::head(path)?;
    let head = String::from_utf8_lossy(&head);
    let wrong = |line: usize, what: String| Error::input(format!("{}:{line}: {what}", path.display()));
    let found = head.lines().take(3).enumerate().find(|(_, l)| l.trim_start().starts_with("x ["));
    let Some((index, header)) = found else {
        return Err(Error::input(format!(
            "{}: expected a line that begins with x [px] among the first three",
            path.display()
        )));
    };
    // Column names contain blanks and end with their unit.
    let separator = if header.contains([',', ';']) { Separator::Comma } else { Separator::Space };
    let names: Vec<String> = header
        .split_inclusive(']')
        .map(|n| n.trim_matches([',', ';', '\t', ' ', '\r']).to_owned())
        .filter(|n| !n.is_empty())
        .collect();
    let mut converter = Converter::new(DEFAULTS, given)?;
    let unit = |name: &str| {
        let column = names.iter().find(|n| n.starts_with(&format!("{name} [")));
        column.and_then(|n| n.split_once('[')).map_or("", |(_, unit)| unit.trim_end_matches(']'))
    };
    let (length, speed) = (unit("x"), unit("u"));
    let (per_px, per_frame) = match (length, speed) {
        ("px", "px/frame") => (1.0, 1.0),
        ("m", "m/s") => {
            let second = head.lines().nth(index.saturating_sub(1)).unwrap_or_default();
            let factor = |name: &str| {
                let text = second.split_once(name)?.1.split(',').next()?.trim();
                text.parse::<f64>().ok().filter(|f| *f > 0.0 && f.is_finite())
            };
            let factors = factor("(px -> m):").zip(factor("(px/frame -> m/s):"));
            let (per_px, per_frame) = factors.ok_or_else(|| {
                wrong(
                    index.max(1),
                    format!(
                        "{:?}: lengths are m; expected \"conversion factor xy (px -> m): F, conversion factor uv \
                         (px/frame -> m/s): F\" with numbers > 0",
                        shown(second)
                    ),
                )
            })?;
            converter.notes.push(format!(
                "calibrated: divided by {per_px:e} m per px and {per_frame:e} m/s per px/frame, as given in the file"
            ));
            (per_px, per_frame)
        }
        _ => {
            let what = format!("{:?}: expected x in px and u in px/frame, or m and m/s", shown(header));
            return Err(wrong(index + 1, what));
        }
    };
    let need = |name: &str, unit: &str| {
        let whole = format!("{name} [{unit}]");
        let column = names.iter().position(|n| *n == whole);
        column.ok_or_else(|| wrong(index + 1, format!("{:?}: expected a column {whole}", shown(header))))
    };
    let (x, y, u, v) = (need("x", length)?, need("y", length)?, need("u", speed)?, need("v", speed)?);
    let kind = names.iter().position(|n| n == "Vector type [-]");
    let sheet = TextTable::open(path, separator, index as u64 + 1)?.at_most(given.limits.rows).named(names);
    let (mut field, mut dropped) = (Field::default(), DroppedRows::default());
    let style = sheet.rows(|cells| {
        let Some(at) = converter.position(cells.number(x)? / per_px, cells.number(y)? / per_px, 0.0)? else {
            dropped.at(cells.line);
            return Ok(());
        };
        let [dx, dy] = converter.displacement(cells.number(u)? / per_frame, cells.number(v)? / per_frame);
        let flag = match cells.number_or_nan(kind)? {
            0.0 => 1,
            2.0 => 2,
            _ => 0,
        };
        field.vectors.push(vector(None, at, [dx, dy, f64::NAN], flag, [f64::NAN; 2])?);
        Ok(())
    })?;
    field.notes = converter.notes;
    field.notes.extend(style);
    field.n_nan = dropped.finish(&mut field.notes);
    Ok(field)
}
