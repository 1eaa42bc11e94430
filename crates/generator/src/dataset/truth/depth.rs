//! `truth/depth.csv`: properties of the noise-free image of a particle at each depth, and the weight of the
//! depth.

use glam::DVec3;
use microsig_core::Particle;
use microsig_core::visibility::DepthScan;
use scenario::{Scenario, Weighting};
use storage::dataset::DepthRow;
use storage::error::Result;

/// Properties of particle images for the manifest.
#[derive(Debug, Clone, PartialEq)]
pub struct ParticleImage {
    /// Diameter of the particle, um.
    pub d_um: f64,
    /// A_pi: the image's area, averaged over depth, px.
    pub area_px: f64,
    /// Median over depth of the signal-to-noise ratio; `None` without noise.
    pub snr: Option<f64>,
    /// Mean background, counts.
    pub background_counts: f64,
    /// Standard deviation of the background, counts.
    pub background_noise_counts: f64,
    /// Depth of the highest peak, um; `None` if all depths are in focus.
    pub focus_um: Option<f64>,
    /// With wave optics: least and greatest share over depth of the light accepted by the aperture that
    /// images show. The rest lies outside the drawn part of an image or, with a mask, is blocked.
    pub drawn_share: Option<[f64; 2]>,
}

/// The rows of the table, NaN where a cell is empty, and the summary for the manifest.
pub fn measure(scenario: &Scenario, stack: &DepthScan) -> Result<(Vec<DepthRow>, ParticleImage)> {
    let (settings, d_um) = (&scenario.settings, scenario.diameters_um()[1]);
    let middle = (settings.pixel_dim_y / 2) as usize * settings.pixel_dim_x as usize
        + (settings.pixel_dim_x / 2) as usize;
    let response = scenario.sensor()?.response(middle);
    let noise = response.background_noise;
    // A weight is proportional to the square of the illumination.
    let weights = scenario.truth_grid().filter(|nodes| nodes.weighting != Weighting::None).map(|nodes| {
        let light = |z_um: &f64| scenario.illumination.at(DVec3::Z * *z_um);
        let weights = nodes.weighting.weights(stack).into_iter().zip(stack.depths_um.iter().map(light));
        let lit: Vec<f64> = weights.map(|(weight, light)| weight * light * light).collect();
        let sum: f64 = lit.iter().sum();
        lit.into_iter().map(|weight| weight / sum).collect::<Vec<f64>>()
    });
    let depths = stack.depths_um.iter().zip(&stack.images).enumerate();
    let rows: Vec<DepthRow> = depths
        .map(|(k, (z_um, spot))| {
            let peak = scenario.peak_counts(response.slope, d_um, *z_um, spot);
            let weight = weights.as_ref().map_or(f64::NAN, |weights| weights[k]);
            // Without noise the ratio is infinite, which is written as an empty cell.
            let snr = peak / noise;
            DepthRow { z_um: *z_um, peak_counts: peak, snr, area_px: spot.area_px, weight }
        })
        .collect();
    let mut peaks: Vec<f64> = rows.iter().map(|row| row.peak_counts).collect();
    peaks.sort_unstable_by(f64::total_cmp);
    let image = ParticleImage {
        d_um,
        area_px: stack.area_px(),
        snr: (noise > 0.0).then(|| peaks[peaks.len() / 2] / noise),
        background_counts: response.background,
        background_noise_counts: noise,
        focus_um: stack.focus_um(),
        drawn_share: drawn_share(scenario, d_um, stack),
    };
    Ok((rows, image))
}

/// With wave optics: least and greatest share of the accepted light that images of this size have.
fn drawn_share(scenario: &Scenario, d_um: f64, stack: &DepthScan) -> Option<[f64; 2]> {
    if !scenario.renderer.is_diffracted() {
        return None;
    }
    let depth_factor = scenario.depth_factor();
    let shares = stack.depths_um.iter().zip(&stack.images).filter_map(|(z_um, spot)| {
        let [x, y] = scenario.settings.middle_px();
        let sphere = Particle::sphere(x, y, z_um / depth_factor, d_um);
        Some(spot.total / scenario.renderer.accepted_light(&sphere)?).filter(|share| share.is_finite())
    });
    shares.fold(None, |range: Option<[f64; 2]>, share| {
        Some(range.map_or([share; 2], |[least, greatest]| [least.min(share), greatest.max(share)]))
    })
}
