//! A preview as text.

use super::{DepthFacts, Preview, SizeCurves};

/// The two most important lines: focus and growth of images, and light.
pub fn lines(preview: &Preview) -> [String; 2] {
    let mean = preview.mean();
    let (Some(first), Some(last)) = (mean.depths.first(), mean.depths.last()) else {
        return Default::default();
    };
    let size = |depth: &DepthFacts| {
        let z_um = 0.01 * libm::round(100.0 * depth.z_um);
        format!("{:.0} x {:.0} px at {} um", depth.width_px, depth.height_px, z_um as f32)
    };
    let best = best(mean);
    let focus = match mean.focus_um {
        None => format!("all depths in focus, images of {:.1} px", best.width_px),
        Some(z_um) => {
            let field = preview
                .depth_of_field_um
                .map_or_else(String::new, |um| format!(", depth of field {um:.1} um"));
            let planes = if preview.cylinder.is_none() {
                String::new()
            } else {
                let ends = [first.z_um, last.z_um];
                // Only images within the depth range are compared.
                let shown = |z_um: f64| {
                    format!("{z_um:.1} um{}", if ends.contains(&z_um) { " or beyond" } else { "" })
                };
                let ([x, y], [halo_x, halo_y]) =
                    (mean.least_sizes_um.map(shown), mean.focal_planes_um.map(shown));
                format!(
                    ", images smallest in x at {x} and in y at {y} (with their halo, root mean square, at {halo_x} and {halo_y})"
                )
            };
            format!(
                "best focus at z = {z_um:.1} um{field}{planes}; images of {:.3} um are {:.1} x {:.1} px there, {}, {}",
                mean.d_um,
                best.width_px,
                best.height_px,
                size(first),
                size(last)
            ) + &others(preview)
        }
    };
    let peaks = range(preview, " counts", |depth| Some(depth.peak_counts), true).unwrap_or_default();
    let snr = range(preview, "", |depth| depth.snr, true)
        .map_or_else(|| "no background noise".to_owned(), |snr| format!("SNR {snr}"));
    let share = range(preview, " %", |depth| depth.share.map(|share| 100.0 * share), false)
        .map_or_else(String::new, |share| format!(", {share} of the accepted light on the sensor"));
    let saturation = match preview.saturation_counts {
        end if end.is_finite() => format!("saturation at {end:.0}"),
        _ => "no saturation".to_owned(),
    };
    let light = format!("peaks of {peaks}, {snr}, {saturation}{share}; N_S = {:.3}", preview.source_density);
    [format!("focus: {focus}"), format!("light: {light}")]
}

/// Minimum and maximum over depth and sizes, and on request over depth for each of several
/// sizes.
fn range(preview: &Preview, unit: &str, of: fn(&DepthFacts) -> Option<f64>, each: bool) -> Option<String> {
    let ranges = preview.sizes.iter().filter_map(|size| Some((size.d_um, size.range(of)?)));
    let ranges: Vec<(f64, [f64; 2])> = ranges.collect();
    let join = |[a, b]: [f64; 2], [low, high]: [f64; 2]| [low.min(a), high.max(b)];
    let all = ranges.iter().map(|(_, range)| *range).reduce(join)?;
    let written = |[low, high]: [f64; 2]| format!("{low:.1} to {high:.1}");
    let size_text = |(d_um, range): &(f64, [f64; 2])| format!("{d_um} um: {}", written(*range));
    let sizes = if each && ranges.len() > 1 {
        format!(" ({})", ranges.iter().map(size_text).collect::<Vec<_>>().join(", "))
    } else {
        String::new()
    };
    Some(format!("{}{unit}{sizes}", written(all)))
}

/// Best focus of the sizes other than the mean.
fn others(preview: &Preview) -> String {
    let all = preview.sizes.iter().filter(|size| size.d_um != preview.mean().d_um);
    let size_text = |size: &SizeCurves| {
        let (best, z_um) = (best(size), size.focus_um?);
        let (d_um, width, height) = (size.d_um, best.width_px, best.height_px);
        Some(format!("; of {d_um:.3} um best at z = {z_um:.1} um, {width:.1} x {height:.1} px there"))
    };
    all.filter_map(size_text).collect()
}

/// The image in best focus.
fn best(size: &SizeCurves) -> DepthFacts {
    size.focus.unwrap_or(size.depths[0])
}
