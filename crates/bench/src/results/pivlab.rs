//! PIVlab's ASCII export: up to three header lines, the last `x [px],y [px],u [px/frame],v [px/frame],Vector type [-]`;
//! commas, tabs or spaces. Pixels from 1, y downward; type 1 valid, 2 interpolated, 0 masked (PIVlab's `file_save.m`).

use std::io::Read;
use std::path::Path;

use super::canonical::vector;
use super::sheet::{Separator, Sheet};
use super::{Conventions, Converter, Field, Origin, Unit, Usual, shown};
use crate::error::{Error, Result};

const USUAL: Usual = Usual { name: "PIVlab", origin: Origin::Center1, frame_base: 0, unit: Unit::Px };

pub(super) fn read(path: &Path, given: &Conventions) -> Result<Field> {
    let mut head = Vec::new();
    let file = std::fs::File::open(path).map_err(|e| Error::read(path, e))?;
    file.take(4096).read_to_end(&mut head).map_err(|e| Error::read(path, e))?;
    let head = String::from_utf8_lossy(&head);
    let found = head.lines().take(3).enumerate().find(|(_, l)| l.starts_with("x ["));
    let Some((index, header)) = found else {
        return Err(Error::input(format!(
            "{}: expected a line that begins with x [px] among the first three",
            path.display()
        )));
    };
    for unit in ["x [px]", "y [px]", "u [px/frame]", "v [px/frame]"] {
        if !header.contains(unit) {
            let message = format!(
                "{}:{}: {:?}: expected {unit}; export without calibration",
                path.display(),
                index + 1,
                shown(header)
            );
            return Err(Error::input(message));
        }
    }
    if !header.contains(',') {
        return Err(Error::input(format!(
            "{}:{}: expected commas between the columns",
            path.display(),
            index + 1
        )));
    }
    let converter = Converter::new(USUAL, given)?;
    let sheet = Sheet::open(path, Separator::Comma, index as u64 + 1)?;
    let need = |name: &str| sheet.need(name);
    let (x, y, u, v) = (need("x [px]")?, need("y [px]")?, need("u [px/frame]")?, need("v [px/frame]")?);
    let kind = sheet.column("Vector type [-]");
    let mut field = Field::default();
    sheet.rows(|cells| {
        let Some(at) = converter.place(cells.number(x)?, cells.number(y)?, 0.0)? else {
            field.n_nan += 1;
            return Ok(());
        };
        let [dx, dy] = converter.moved(cells.number(u)?, cells.number(v)?);
        let flag = match cells.number_or_nan(kind)? {
            0.0 => 1,
            2.0 => 2,
            _ => 0,
        };
        field.vectors.push(vector(None, at, [dx, dy, f64::NAN], flag, [f64::NAN; 2])?);
        Ok(())
    })?;
    field.notes = converter.notes;
    Ok(field)
}
