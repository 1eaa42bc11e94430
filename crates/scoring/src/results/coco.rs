//! COCO's list of results of a detector: `[{"image_id": 0, "bbox": [x, y, width, height], "score": 0.9},
//! ...]`. `image_id` is the frame, from 0; the corner of the first pixel is at (0, 0). A key `z_um` is also
//! read; others are ignored.

use serde::Deserialize;

use super::text::Text;
use super::{Conventions, Converter, DroppedRows, FormatDefaults, Origin, Points, TrackRow};
use storage::InputFile;
use storage::error::{Error, Result};

/// COCO counts from the corner of the first pixel.
const DEFAULTS: FormatDefaults = FormatDefaults::px("COCO results", Origin::Corner0);

#[derive(Deserialize)]
struct Found {
    image_id: f64,
    bbox: [f64; 4],
    #[serde(default = "one")]
    score: f64,
    z_um: Option<f64>,
}

fn one() -> f64 {
    1.0
}

pub(super) fn read(path: &InputFile, given: &Conventions) -> Result<Points> {
    let mut converter = Converter::new(DEFAULTS, given)?;
    converter.notes.push("image_id is taken as the frame".to_owned());
    let file = std::io::BufReader::new(Text::open(path)?);
    // The size of the file limits the list.
    let all: Vec<Found> = serde_json::from_reader(file)
        .map_err(|e| Error::input(format!("{}:{}: {e}", path.display(), e.line())))?;
    if all.len() > given.limits.rows {
        return Err(Error::input(format!("{}: more than {} results", path.display(), given.limits.rows)));
    }
    let (mut points, mut dropped) = (
        Points { has_z: all.iter().any(|found| found.z_um.is_some()), ..Points::default() },
        DroppedRows::default(),
    );
    for (k, found) in all.iter().enumerate() {
        let at = |e: String| Error::input(format!("{}: result {k}: {e}", path.display()));
        let [x, y, w, h] = found.bbox;
        let frame = converter.frame(found.image_id).map_err(at)?;
        let z_um = found.z_um.unwrap_or(if points.has_z { f64::NAN } else { 0.0 });
        match converter.position(x + 0.5 * w, y + 0.5 * h, z_um).map_err(at)? {
            Some(at_px) => {
                points.rows.push(TrackRow { frame, track: -1, at: at_px });
                points.boxes.push(converter.size([w, h], found.score).map_err(at)?);
            }
            None => dropped.at(k as u64),
        }
    }
    (points.read_as, points.notes) = (Box::new(converter.conventions), converter.notes);
    points.n_nan = dropped.finish(&mut points.notes);
    Ok(points)
}
