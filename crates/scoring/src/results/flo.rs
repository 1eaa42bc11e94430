//! Middlebury's dense flow: "PIEH", width and height (int32), then (u, v) of every pixel, row by row
//! (float32, little endian); magnitudes above 1e9 mean unknown (Baker et al., IJCV 92, 2011).

use std::io::{BufReader, Read};

use super::fields::{FieldLayout, FieldRows};
use super::{Conventions, Field, FlowVector, FormatDefaults, Origin, Position};
use storage::InputFile;
use storage::error::{Error, Result};

const DEFAULTS: FormatDefaults = FormatDefaults::px("Middlebury .flo", Origin::Center1);

pub(super) fn read(path: &InputFile, given: &Conventions) -> Result<Field> {
    let failed = |e| Error::read(path, e);
    let wrong = |what: String| Error::input(format!("{}: {what}", path.display()));
    let file = path.open()?;
    let bytes = file.metadata().map_err(failed)?.len();
    let mut reader = BufReader::new(file);
    let mut word = [0u8; 4];
    let mut next = || reader.read_exact(&mut word).map(|()| word);
    let mut header =
        || next().map_err(|_| wrong(format!("{bytes} bytes, shorter than the header of 12 bytes")));
    if &header()? != b"PIEH" {
        return Err(wrong("expected it to begin with PIEH".to_owned()));
    }
    let (width, height) = (i32::from_le_bytes(header()?), i32::from_le_bytes(header()?));
    let pixels = u64::try_from(width).ok().zip(u64::try_from(height).ok()).map(|(w, h)| w * h);
    let pixels = pixels
        .filter(|&n| n > 0 && n <= given.limits.rows as u64)
        .ok_or_else(|| wrong(format!("{width} x {height} px: expected 1 to {} pixels", given.limits.rows)))?;
    let expected = 12 + 8 * pixels;
    if bytes != expected {
        return Err(wrong(format!("{width} x {height} px need {expected} bytes; the file has {bytes}")));
    }
    let mut rows = FieldRows::default();
    for row in 1..=height {
        for column in 1..=width {
            let mut component = || next().map(|b| f64::from(f32::from_le_bytes(b))).map_err(failed);
            let (u, v) = (component()?, component()?);
            let is_known = u.abs() <= 1e9 && v.abs() <= 1e9;
            let moved = if is_known { [u, v, f64::NAN] } else { [f64::NAN; 3] };
            let at = Position { x_px: f64::from(column), y_px: f64::from(row), z_um: 0.0 };
            let flag = u8::from(!is_known);
            rows.vectors.push(FlowVector { pair: None, at, moved, flag, sigma: [f64::NAN; 2] });
        }
    }
    // Pixel indices are implicit, so that no origin applies; y upward has no meaning but for v.
    let given = Conventions { origin: None, ..*given };
    rows.field(FieldLayout::px(DEFAULTS), &given, &path.display().to_string())
}
