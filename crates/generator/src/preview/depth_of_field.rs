//! Depths between which a curve over depth is high: depth of field and depth of correlation.

use microsig_core::visibility::{DepthScan, ScanImage};
use scenario::Scenario;
use storage::error::Result;

/// In focus, the peak is at least this fraction of the highest peak.
const IN_FOCUS: f64 = 0.8;

/// Windows, each twice as wide as the one before, in which a best focus beyond the depth range is sought.
const MAX_WINDOWS: u32 = 8;

/// The range of depths around the maximum in which values exceed a fraction of it, um, and whether it reaches
/// an end of the scan; the ends are interpolated linearly between depths.
pub(super) fn span(scan: &DepthScan, of: impl Fn(&ScanImage) -> f64, share: f64) -> (f64, bool) {
    let values: Vec<f64> = scan.images.iter().map(of).collect();
    let Some(best) = (0..values.len()).max_by(|a, b| values[*a].total_cmp(&values[*b])) else {
        return (0.0, false);
    };
    let level = share * values[best];
    let z = &scan.depths_um;
    // The depth, and whether values are as high up to the end of the scan.
    let end = |walk: &mut dyn Iterator<Item = usize>| {
        let mut inner = best;
        for i in walk {
            if values[i] < level {
                let z_um =
                    z[inner] + (z[i] - z[inner]) * (values[inner] - level) / (values[inner] - values[i]);
                return (z_um, false);
            }
            inner = i;
        }
        (z[inner], true)
    };
    let (above, below) = (end(&mut (best + 1..values.len())), end(&mut (0..best).rev()));
    (above.0 - below.0, above.1 || below.1)
}

/// The depth of field for particles of this diameter (um), from their scan through the depth range, measured
/// more finely around its highest peak, um; `None` where all depths are in focus. It is a property of the
/// microscope: where the range ends within it, it is measured beyond the end.
pub fn depth_of_field_um(scenario: &Scenario, d_um: f64, scan: &DepthScan) -> Result<Option<f64>> {
    let Some(mut focus_um) = scan.focus_um() else { return Ok(None) };
    let (mut field_um, mut is_cut) = span(scan, |spot| spot.peak, IN_FOCUS);
    let step = scan.depths_um[1] - scan.depths_um[0];
    if field_um > 12.0 * step && !is_cut {
        return Ok(Some(field_um));
    }
    let (low, high) = scenario.depth_range_um;
    let mut reach = field_um + step;
    for _ in 0..MAX_WINDOWS {
        let window_um = (focus_um - reach, focus_um + reach);
        let window_um = if is_cut { window_um } else { (window_um.0.max(low), window_um.1.min(high)) };
        // Beyond the depth range, a microscope may not be rendered.
        let Ok(fine) = scenario.scan(d_um, window_um) else { break };
        (field_um, is_cut) = span(&fine, |spot| spot.peak, IN_FOCUS);
        if !is_cut {
            break;
        }
        focus_um = fine.focus_um().unwrap_or(focus_um);
        reach *= 2.0;
    }
    Ok(Some(field_um))
}
