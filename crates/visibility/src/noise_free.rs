//! The noise-free image of any particle of a dataset, from precomputed depth scans.

use std::sync::Arc;

use microsig_core::emission::{SpheroidLaw, surface_points};
use microsig_core::render::Renderer;
use microsig_core::{Particle, Settings};

use super::depth_scan::DepthScan;
use storage::error::Result;

/// Number of diameters scanned, from the smallest to the largest.
const DIAMETERS: u32 = 5;

/// Renders single particles without noise, accurately enough for peak, SNR and overlap.
///
/// The image is that of the depth scan nearest in depth and diameter, shifted by whole pixels and scaled to
/// the peak at the particle's depth (interpolated linearly) and to its number of source points. The peak is
/// therefore that of a particle centered on a pixel. A spheroid is rendered as a sphere with its number of
/// emitting points.
#[derive(Debug, Clone)]
pub struct NoiseFree {
    settings: Settings,
    /// Which surface points of spheroids emit light; `None` for renderers without source points.
    law: Option<SpheroidLaw>,
    depth_factor: f64,
    range_um: (f64, f64),
    /// Sorted by diameter, um.
    stacks: Vec<(f64, Arc<DepthScan>)>,
}

/// The light of a particle on a rectangle of pixels, in the unit of [`microsig_core::sensor::Light`].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Patch {
    /// Left column and top row, from 0.
    pub corner: (usize, usize),
    /// Width, px.
    pub width: usize,
    /// Light, row by row.
    pub values: Vec<f64>,
}

impl NoiseFree {
    /// Scans spheres with diameters in a range (um) through a range of physical depths (um).
    ///
    /// # Errors
    /// Settings that cannot be rendered.
    pub fn new(
        draw: impl Fn(&Settings) -> Result<Renderer>,
        settings: &Settings,
        law: Option<SpheroidLaw>,
        (least_um, greatest_um): (f64, f64),
        range_um: (f64, f64),
        depth_factor: f64,
    ) -> Result<Self> {
        let n = if least_um < greatest_um { DIAMETERS } else { 1 };
        let diameter =
            |k: u32| least_um + (greatest_um - least_um) * f64::from(k) / f64::from((n - 1).max(1));
        let stacks = (0..n)
            .map(|k| {
                let stack = DepthScan::measure(&draw, settings, diameter(k), range_um, depth_factor)?;
                Ok((diameter(k), Arc::new(stack)))
            })
            .collect::<Result<_>>()?;
        Ok(NoiseFree { settings: settings.clone(), law, depth_factor, range_um, stacks })
    }

    /// The depth scan of a diameter (um) through a range of physical depths (um), if it is available.
    pub fn stack(&self, d_um: f64, range_um: (f64, f64)) -> Option<Arc<DepthScan>> {
        let found = self.stacks.iter().find(|(of_um, _)| *of_um == d_um && self.range_um == range_um);
        found.map(|(_, stack)| Arc::clone(stack))
    }

    /// Renders one particle into a patch, which is resized to fit; empty if no light reaches the sensor.
    pub fn draw(&self, particle: &Particle, patch: &mut Patch) {
        patch.values.clear();
        let distance = |d_um: &f64| (d_um - particle.d_um).abs();
        let nearest = self.stacks.iter().min_by(|a, b| distance(&a.0).total_cmp(&distance(&b.0)));
        let Some((d_um, stack)) = nearest else { return };
        let (spot, peak) = stack.at(particle.z_um * self.depth_factor);
        if spot.peak == 0.0 {
            return;
        }
        let factor = particle.c_int * peak / spot.peak * self.points(particle, *d_um);
        let side = 2 * spot.half_px + 1;
        // Pixels are counted from 0 here, from 1 in MicroSIG.
        let visible = |center: f64, size: u32| {
            let first = libm::rint(center) as i64 - 1 - spot.half_px as i64;
            let (low, high) = (first.max(0), (first + side as i64).min(i64::from(size)));
            (low < high).then(|| (low as usize, (low - first) as usize..(high - first) as usize))
        };
        let (Some((x, columns)), Some((y, rows))) = (
            visible(particle.x_px, self.settings.pixel_dim_x),
            visible(particle.y_px, self.settings.pixel_dim_y),
        ) else {
            return;
        };
        (patch.corner, patch.width) = ((x, y), columns.len());
        for row in rows {
            patch.values.extend(spot.light[row * side..][columns.clone()].iter().map(|light| factor * light));
        }
    }

    /// Ratio of the number of emitting points of a particle to that of a sphere of diameter `d_um`.
    fn points(&self, particle: &Particle, d_um: f64) -> f64 {
        // The brightness of Gaussian images depends on c_int only, not on size.
        let Some(law) = self.law else { return 1.0 };
        let sphere = Particle { spheroid: None, d_um, ..*particle };
        // In the original law about half of a spheroid's points emit light, and all of a sphere's.
        let shining = if particle.spheroid.is_some() && law == SpheroidLaw::Original { 0.5 } else { 1.0 };
        shining * surface_points(&self.settings, particle) as f64
            / surface_points(&self.settings, &sphere) as f64
    }
}
