//! Particle images of a scenario's optics for the page: curves and images over depth, and the noise-free
//! image of a particle.

use microsig_core::Particle;
use serde_json::{Value, json};

use super::columns::list;
use generator::dataset::truth::depth::ParticleImage;
use microsig_core::visibility::{DepthScan, ScanImage};
use scenario::Scenario;
use storage::dataset::DepthRow;
use storage::error::Result;

/// Maximum half side of a crop, px.
const MAX_HALF_PX: i64 = 100;

/// Number of images in the strip over depth.
const STRIP: usize = 11;

/// Maximum half side of an image in the strip, px.
const STRIP_HALF_PX: usize = 60;

/// Peak, widths and area over depth, from the rows of [`generator::dataset::truth::depth::measure`].
pub(super) fn curves(scan: &DepthScan, rows: &[DepthRow], image: &ParticleImage) -> Value {
    let sizes: Vec<[f64; 2]> = scan.images.iter().map(ScanImage::size_px).collect();
    let column = |of: fn(&DepthRow) -> f64| list(rows.iter().map(of));
    json!({
        "z_um": column(|row| row.z_um), "peak_counts": column(|row| row.peak_counts), "snr": column(|row| row.snr),
        "area_px": column(|row| row.area_px),
        "width_x_px": list(sizes.iter().map(|size| size[0])), "width_y_px": list(sizes.iter().map(|size| size[1])),
        "focus_um": image.focus_um, "d_um": image.d_um,
    })
}

/// Images of one particle at equispaced depths, one after the other: their side and depths, and mean counts
/// above the background as 32-bit little-endian floating-point numbers.
pub(super) fn strip(scan: &DepthScan, rows: &[DepthRow]) -> (Value, Vec<u8>) {
    let last = scan.images.len() - 1;
    let chosen: Vec<usize> = (0..STRIP).map(|k| k * last / (STRIP - 1)).collect();
    let half = chosen.iter().map(|k| scan.images[*k].half_px).max().unwrap_or(0).clamp(4, STRIP_HALF_PX);
    let side = 2 * half + 1;
    let mut bytes = Vec::with_capacity(4 * side * side * STRIP);
    for k in &chosen {
        let image = &scan.images[*k];
        let factor = if image.peak > 0.0 { rows[*k].peak_counts / image.peak } else { 0.0 };
        let own = 2 * image.half_px as i64 + 1;
        let shift = image.half_px as i64 - half as i64;
        for y in 0..side as i64 {
            for x in 0..side as i64 {
                let (u, v) = (x + shift, y + shift);
                let is_inside = (0..own).contains(&u) && (0..own).contains(&v);
                let light = if is_inside { image.light[(v * own + u) as usize] } else { 0.0 };
                bytes.extend(((light * factor) as f32).to_le_bytes());
            }
        }
    }
    let depths = chosen.iter().map(|k| scan.depths_um[*k]);
    (json!({ "side": side, "z_um": list(depths) }), bytes)
}

/// The noise-free image of one particle around its center: corner (px, from 1) and mean counts, including the
/// background.
pub(super) fn crop(scenario: &Scenario, particle: &Particle) -> Result<Value> {
    let (width, height) = (scenario.settings.pixel_dim_x as i64, scenario.settings.pixel_dim_y as i64);
    let (reach_x, reach_y) = scenario.renderer.image_extent(particle);
    let half = |reach: f64| (reach.ceil() as i64 + 2).clamp(6, MAX_HALF_PX);
    let half = half(reach_x).max(half(reach_y));
    let (x, y) = (particle.x_px.round() as i64, particle.y_px.round() as i64);
    let (left, right) = ((x - half).max(1), (x + half).min(width));
    let (top, bottom) = ((y - half).max(1), (y + half).min(height));
    if left > right || top > bottom {
        return Ok(Value::Null);
    }
    let light = scenario.renderer.mean_light(particle);
    let sensor = scenario.sensor()?;
    let mut counts = Vec::new();
    for row in top..=bottom {
        for column in left..=right {
            let index = ((row - 1) * width + column - 1) as usize;
            let response = sensor.response(index);
            let mean = response.background + response.slope * light.values[index];
            counts.push((mean.min(response.saturation_counts) * 100.0).round() / 100.0);
        }
    }
    let size = (right - left + 1, bottom - top + 1);
    Ok(json!({ "x": left, "y": top, "width": size.0, "height": size.1, "counts": list(counts) }))
}
