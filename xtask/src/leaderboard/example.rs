//! Example images with what a tracker found.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::Context;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};

use arena::suite::{CaseScores, DepthErrors, Picture, SCORES, Status};

/// Maximum size of the part of an image that is shown, px.
const PART: u32 = 320;

/// End-point error from which a displacement is drawn as wrong, px.
const WRONG_PX: f64 = 1.0;

/// A row of a table by column.
type Row = BTreeMap<String, String>;

fn number(row: &Row, key: &str) -> Option<f64> {
    row.get(key)?.parse().ok()
}

fn rows(path: &Path) -> anyhow::Result<Vec<Row>> {
    Ok(csv::Reader::from_path(path)?.deserialize().collect::<Result<_, _>>()?)
}

/// The folder of the complete scores of a result.
fn scores_of(work: &Path, tracker: &str, case: &CaseScores) -> PathBuf {
    work.join("scores").join(SCORES).join(tracker).join(&case.track).join(&case.case)
}

/// The middle of a case's first image with the points or displacements of the best tracker.
pub(super) fn picture(work: &Path, case: &CaseScores) -> anyhow::Result<Option<Picture>> {
    let Some(best) = case.results.iter().find(|result| result.status == Status::Scored) else {
        return Ok(None);
    };
    let scores = scores_of(work, &best.tracker, case);
    let (matches, found) = (scores.join("matches.csv"), scores.join("vectors.csv"));
    let is_field = found.is_file();
    if !is_field && !matches.is_file() {
        return Ok(None);
    }
    let images = work.join("datasets").join(&case.track).join(&case.case).join("test/images");
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
    let (mut points, mut vectors) = (Vec::new(), Vec::new());
    for row in rows(if is_field { &found } else { &matches })? {
        let Some((x, y)) = number(&row, "x_px").zip(number(&row, "y_px")) else { continue };
        // The center of the first pixel is (1, 1), and (0.5, 0.5) in the picture.
        let (x, y) = (x - 0.5 - f64::from(left), y - 0.5 - f64::from(top));
        let is_inside = (0.0..=f64::from(w)).contains(&x) && (0.0..=f64::from(h)).contains(&y);
        // A field for all image pairs has no column for the pair.
        let is_first = number(&row, if is_field { "pair" } else { "frame" }).map_or(is_field, |n| n == 0.0);
        if !is_inside || !is_first {
            continue;
        }
        if is_field {
            let of = |key: &str| number(&row, key).unwrap_or(f64::NAN);
            let (dx, dy) = (of("dx_px"), of("dy_px"));
            let is_right = (dx - of("true_dx_px")).hypot(dy - of("true_dy_px")) < WRONG_PX;
            vectors.push(([x, y, dx, dy], is_right && of("flag") == 0.0));
        } else {
            points.push((row.get("kind").cloned().unwrap_or_default(), x, y));
        }
    }
    let what = if is_field { "first image pair" } else { "first image" };
    let caption = format!("{} on {}, {what}.", best.tracker, case.case);
    Ok(Some(Picture { png: png(&part, (w, h))?, size: (w, h), points, vectors, caption }))
}

/// RMS error of depth over depth in a case; `None` if no result has depth.
pub(super) fn depth_errors(work: &Path, case: &CaseScores) -> anyhow::Result<Option<DepthErrors>> {
    let mut trackers = Vec::new();
    for result in case.results.iter().filter(|result| result.status == Status::Scored) {
        let path = scores_of(work, &result.tracker, case).join("curves.csv");
        if !path.is_file() {
            continue;
        }
        let table = rows(&path)?;
        let of_depth = table.iter().filter(|row| row.get("against").is_some_and(|of| of == "z_um"));
        let points = of_depth.filter_map(|row| {
            let (from, to) = number(row, "from").zip(number(row, "to"))?;
            Some((0.5 * (from + to), number(row, "rms_z_um")?))
        });
        let points: Vec<(f64, f64)> = points.collect();
        if !points.is_empty() {
            trackers.push((result.tracker.clone(), points));
        }
    }
    trackers.sort_by(|a, b| a.0.cmp(&b.0));
    Ok((!trackers.is_empty()).then(|| DepthErrors { case: case.case.clone(), trackers }))
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
    let image = image.context("the number of pixels matches the image size")?;
    image.write_with_encoder(PngEncoder::new_with_quality(
        &mut bytes,
        CompressionType::Best,
        FilterType::Adaptive,
    ))?;
    Ok(bytes)
}
