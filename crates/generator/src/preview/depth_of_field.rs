//! Depths between which a curve over depth is high: depth of field and depth of correlation.

use scenario::Scenario;
use storage::error::Result;
use visibility::{DepthScan, ScanImage};

/// In focus, the peak is at least this fraction of the highest peak.
const IN_FOCUS: f64 = 0.8;

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

/// The depth of field of a scan of particles of this diameter (um), measured more finely around its highest
/// peak, um; `None` where all depths are in focus.
///
/// # Errors
/// None for a scenario that could be resolved.
pub fn depth_of_field_um(scenario: &Scenario, d_um: f64, scan: &DepthScan) -> Result<Option<f64>> {
    let Some(focus_um) = scan.focus_um() else { return Ok(None) };
    let (coarse, _) = span(scan, |spot| spot.peak, IN_FOCUS);
    let step = scan.depths_um[1] - scan.depths_um[0];
    if coarse > 12.0 * step {
        return Ok(Some(coarse));
    }
    let reach = coarse + step;
    let (low, high) = scenario.depth_range_um;
    let range_um = ((focus_um - reach).max(low), (focus_um + reach).min(high));
    let fine = scenario.scan(d_um, range_um)?;
    Ok(Some(span(&fine, |spot| spot.peak, IN_FOCUS).0))
}
