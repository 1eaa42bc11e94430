//! PIVlab's exports: text with up to three header lines, the last `x [px],y [px],u [px/frame],v
//! [px/frame],Vector type [-]`, separated by commas, tabs or spaces, or Tecplot's text (`tecplot.rs`). Pixels
//! from 1, y downward; type 1 valid, 2 interpolated, 0 masked. Calibrated exports are in m and m/s or m/frame;
//! the calibration factors in the second line are divided out, because the stated units of u are not always
//! right. The factor of u is negative if x grows to the left; that y grows upward is not in the file. Both are
//! reversed as `size - x` (PIVlab's `file_save.m` and `xy.m`).

use super::fields::{FieldLayout, Unit};
use super::sheet::TextTable;
use super::table::Reversal;
use super::tecplot::{self, Table};
use super::text::Text;
use super::{Conventions, Field, FormatDefaults, Origin};
use storage::InputFile;
use storage::error::{Error, Result};

const DEFAULTS: FormatDefaults =
    FormatDefaults { frame_base: 1, ..FormatDefaults::px("PIVlab", Origin::Center1) };

pub(super) fn read(path: &InputFile, given: &Conventions) -> Result<Field> {
    let head = Text::head(path)?;
    let head = String::from_utf8_lossy(&head);
    let found = head.lines().take(3).enumerate().find(|(_, l)| l.trim_start().starts_with("x ["));
    let Some((index, header)) = found else {
        if head.starts_with("# PIVlab") {
            return tecplot::field(path, given);
        }
        return Err(Error::input(format!(
            "{}: expected a line that begins with x [px] among the first three",
            path.display()
        )));
    };
    // Column names contain blanks and end with their unit.
    let columns = header.split_inclusive(']').map(|c| c.trim_matches([',', ';', '\t', ' ', '\r']));
    let columns = columns.filter(|column| !column.is_empty()).map(|column| {
        let (name, unit) = column.split_once('[').unwrap_or((column, ""));
        (name.trim().to_lowercase(), unit.trim_end_matches(']').to_owned())
    });
    let (names, units) = columns.unzip();
    let sheet = TextTable::open(path, index as u64 + 1)?.at_most(given.limits.rows).named(names);
    let mut field = tecplot::read(Table { sheet, header: head.to_string(), units }, true, given)?;
    let frame = number_after(&head, "FRAME:").filter(|frame| frame.fract() == 0.0 && *frame >= 1.0);
    let base = given.frame_base.unwrap_or(DEFAULTS.frame_base) as f64;
    if let Some(frame) = frame.filter(|frame| *frame >= base) {
        field.vectors.iter_mut().for_each(|v| v.pair = Some((frame - base) as u32));
        field.notes.push(format!("FRAME: {frame} is the image pair, from {base}"));
    }
    Ok(field)
}

/// The layout of an export whose header is in `head`, with the units of positions and displacements.
pub(super) fn layout(
    head: &str,
    [length, speed]: [&str; 2],
    place: &str,
    given: &Conventions,
) -> Result<FieldLayout> {
    let mut layout = FieldLayout { reversal: Reversal::Size, ..FieldLayout::new(DEFAULTS) };
    let factors = number_after(head, "(px -> m):").zip(number_after(head, "(px/frame -> m/s):"));
    let factors = factors.filter(|(xy, uv)| *xy > 0.0 && *uv != 0.0);
    layout.scale = Some(match factors {
        Some((xy, uv)) if xy == 1.0 && uv.abs() == 1.0 => ([1.0, uv], "px".to_owned()),
        Some((xy, uv)) => {
            layout.notes.push(format!(
                "calibrated: divided by {xy:e} m per px and {uv:e} m/s per px/frame, as given in the file"
            ));
            ([1.0 / xy, 1.0 / uv], "m".to_owned())
        }
        None => {
            let px = |text: &str| {
                let unit = Unit::parse(text).ok_or_else(|| {
                    Error::input(format!("{place}: unit {text:?}: expected px and px/frame, or m and m/s"))
                })?;
                unit.px(given, place)
            };
            ([px(length)?, px(speed)?], length.to_owned())
        }
    });
    Ok(layout)
}

fn number_after(text: &str, word: &str) -> Option<f64> {
    let text = text.split_once(word)?.1.split([',', '\n', '\r']).next()?;
    text.trim().parse().ok().filter(|number: &f64| number.is_finite())
}
