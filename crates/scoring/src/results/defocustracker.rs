//! DefocusTracker's dataset: `fr, X, Y, Z, DX, DY, DZ, id, cm` as CSV, or its text file
//! (`dataset_exportascii`): a title, `scaling = [sx, sy, sz, dt]`, column names, rows with six digits. Frames
//! from 1, pixels from 1 as in MATLAB, Z in [0, 1] over the depth of the calibration, id 0 for points that
//! are not tracked. DefocusTrackerAI adds `W, H`, the sizes of boxes (px), and may leave out `id`. Scaled
//! tables have columns x, y, z with the lengths X sx, Y sy, Z sz.

use super::sheet::{OptionalColumns, TextTable};
use super::text::Text;
use super::{Conventions, Converter, FormatDefaults, Origin, Points, shown};
use storage::InputFile;
use storage::advice;
use storage::advice::option;
use storage::error::{Error, Result};

const DEFAULTS: FormatDefaults =
    FormatDefaults { frame_base: 1, ..FormatDefaults::px("DefocusTracker", Origin::Center1) };

pub(super) fn csv(sheet: TextTable, given: &Conventions) -> Result<Points> {
    read(sheet, given, [1.0; 3])
}

pub(super) fn ascii(path: &InputFile, given: &Conventions) -> Result<Points> {
    let head = Text::head(path)?;
    let head = String::from_utf8_lossy(&head);
    let line = head.lines().nth(1).unwrap_or_default();
    let scaling: Option<Vec<f64>> = line
        .split_once('[')
        .and_then(|(_, rest)| rest.split_once(']'))
        .and_then(|(numbers, _)| numbers.split(',').map(|n| n.trim().parse().ok()).collect());
    match scaling.as_deref() {
        Some(&[sx, sy, sz, _]) if sx > 0.0 && sy > 0.0 && sz > 0.0 => {
            read(TextTable::open(path, 3)?, given, [sx, sy, sz])
        }
        _ => Err(Error::input(format!(
            "{}:2: {:?}: expected scaling = [sx,sy,sz,dt] with positive numbers",
            path.display(),
            shown(line)
        ))),
    }
}

fn read(sheet: TextTable, given: &Conventions, scaling: [f64; 3]) -> Result<Points> {
    let (low, high) = given.depth_um.ok_or_else(|| {
        let what = "DefocusTracker: Z is a fraction of the depth range; give ";
        Error::option(advice!(what, option("depth_um")))
    })?;
    let sheet = sheet.at_most(given.limits.rows);
    let frame = sheet.need("fr")?;
    let scaled = sheet.column("X").is_none();
    if scaled && scaling == [1.0; 3] {
        return Err(Error::input(
            "DefocusTracker: columns X, Y, Z are missing (scaled tables are read as text only)",
        ));
    }
    let names = if scaled { ["x", "y", "z"] } else { ["X", "Y", "Z"] };
    let (x, y, z) = (sheet.need(names[0])?, sheet.need(names[1])?, sheet.need(names[2])?);
    let track = sheet.column("id");
    let [sx, sy, sz] = if scaled { scaling } else { [1.0; 3] };
    let mut converter = Converter::new(DEFAULTS, given)?;
    converter.notes.push(format!("Z = 0 is taken as {low} um, Z = 1 as {high} um; id 0 as not tracked"));
    converter.ignores(&sheet.others(&["fr", names[0], names[1], names[2], "id", "W", "H", "score"]));
    let size = ["W", "H", "score"].map(|name| sheet.column(name));
    let more = OptionalColumns { size, ..OptionalColumns::default() };
    sheet.points(converter, true, more, |cells| {
        let id = cells.track(track)?;
        let z_um = low + cells.number(z)? / sz * (high - low);
        let at = [cells.number(x)? / sx, cells.number(y)? / sy, z_um];
        Ok((cells.number(frame)?, if id == 0 { -1 } else { id }, at))
    })
}
