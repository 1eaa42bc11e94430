//! Example images with what a tracker found.

use std::path::Path;

use anyhow::Context;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};

use bench::suite::{CaseScores, Picture, SCORES, Status};

/// Largest part of an image that is shown, px.
const PART: u32 = 320;

/// The middle of a case's first image with the points of the best tracker; `None` for fields.
pub(super) fn picture(work: &Path, case: &CaseScores) -> anyhow::Result<Option<Picture>> {
    let Some(best) = case.results.iter().find(|result| result.status == Status::Scored) else {
        return Ok(None);
    };
    let folder = format!("{}/{}", case.track, case.case);
    let matches = work.join("scores").join(SCORES).join(&best.tracker).join(&folder).join("matches.csv");
    if !matches.is_file() {
        return Ok(None);
    }
    let images = work.join("datasets").join(&folder).join("test/images");
    let mut files: Vec<_> =
        std::fs::read_dir(&images)?.filter_map(|entry| Some(entry.ok()?.path())).collect();
    files.sort();
    let file = files.first().with_context(|| images.display().to_string())?;
    let (width, height) = suite::image_size(file)?;
    let counts = suite::counts(file)?;
    let (w, h) = (width.min(PART), height.min(PART * 3 / 4));
    let (left, top) = ((width - w) / 2, (height - h) / 2);
    let part: Vec<f64> = (0..h)
        .flat_map(|row| (0..w).map(move |column| (row, column)))
        .map(|(row, column)| counts[((top + row) * width + left + column) as usize])
        .collect();
    let mut points = Vec::new();
    for row in csv::Reader::from_path(&matches)?.deserialize::<std::collections::BTreeMap<String, String>>() {
        let row = row?;
        let number = |key: &str| row.get(key).and_then(|text| text.parse::<f64>().ok());
        let (Some(frame), Some(x), Some(y)) = (number("frame"), number("x_px"), number("y_px")) else {
            continue;
        };
        // The center of the first pixel is (1, 1), and (0.5, 0.5) in the picture.
        let (x, y) = (x - 0.5 - f64::from(left), y - 0.5 - f64::from(top));
        let is_inside = (0.0..=f64::from(w)).contains(&x) && (0.0..=f64::from(h)).contains(&y);
        if frame == 0.0 && is_inside {
            points.push((row.get("kind").cloned().unwrap_or_default(), x, y));
        }
    }
    let caption = format!("{} on {}, first image.", best.tracker, case.case);
    Ok(Some(Picture { png: png(&part, (w, h))?, size: (w, h), points, caption }))
}

/// A PNG of 8 bits: the square root of counts between the 1 % and 99.7 % quantiles, which shows faint images.
fn png(counts: &[f64], (width, height): (u32, u32)) -> anyhow::Result<Vec<u8>> {
    let mut sorted = counts.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = |share: f64| sorted[((sorted.len() - 1) as f64 * share) as usize];
    let (low, high) = (at(0.01), at(0.997));
    let gray = |v: &f64| (((v - low) / (high - low).max(1.0)).clamp(0.0, 1.0).sqrt() * 255.0) as u8;
    let image = image::GrayImage::from_raw(width, height, counts.iter().map(gray).collect());
    let mut bytes = Vec::new();
    let image = image.context("an image has as many pixels as its size says")?;
    image.write_with_encoder(PngEncoder::new_with_quality(
        &mut bytes,
        CompressionType::Best,
        FilterType::Adaptive,
    ))?;
    Ok(bytes)
}
