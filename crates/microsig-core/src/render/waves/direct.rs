//! Images of single particles over a range of depths, computed without tables: for fits, which draw most
//! images only once.

use super::model::{Exposure, Frame, Model, Scope};
use super::{WavesRenderer, obstacles};
use crate::optics::LocalOptics;

/// Step of the difference that is a derivative with respect to depth, in units of lambda / NA^2.
pub(super) const STEP_DEPTHS: f64 = 0.05;

/// Images of spheres of one diameter over a range of depths. All have the same transform kernels.
#[derive(Debug)]
pub struct SingleImages {
    model: Model,
    frame: Frame,
    exposure: Exposure,
    radius_um: f64,
}

impl WavesRenderer {
    /// Images of spheres of the diameter `d_um` (0 for a point) at a place of the field with these optics, on pixels up to
    /// `edge_px` from the particle along both axes. Depths (um, from and to) are distances from the surface in focus.
    pub fn single_images_at(
        &self,
        local: &LocalOptics,
        depths_um: [f64; 2],
        d_um: f64,
        edge_px: [usize; 2],
    ) -> SingleImages {
        let waves = &self.model;
        let model = waves.model.with_share(waves.model.share, 1.0);
        let cylinder = model.pupil.has_cylinder();
        let obstacles = obstacles(&waves.optics, cylinder, Some((local, [0.0; 2])));
        self.single_images_of(Model { obstacles, ..model }, depths_um, d_um, edge_px)
    }

    fn single_images_of(
        &self,
        model: Model,
        [from_um, to_um]: [f64; 2],
        d_um: f64,
        edge_px: [usize; 2],
    ) -> SingleImages {
        let radius_um = 0.5 * d_um;
        let frame = model.frame(Scope { from_um, to_um, radius_um, edge_px, fineness: 1.0 });
        let exposure = model.exposure(&frame, libm::ceil(3.0 * model.sharpest()).max(2.0) as usize);
        SingleImages { model, frame, exposure, radius_um }
    }

    /// Light on pixels whose centers are at `places` relative to a particle, px, as a fraction of its light
    /// emitted into the half space; computed directly, without tables. `d_um` may be 0 for a point.
    pub fn share_at(&self, z_um: f64, d_um: f64, places: &[[f64; 2]]) -> Vec<f64> {
        // Uses more modes than tables, as the cost is small here, and modes that are weak in the light of a
        // large bead may be strong in its faint middle.
        let model = self.model.model.with_share(0.01 * self.model.model.share, 1.0);
        let far = |axis: usize| places.iter().map(|place| place[axis].abs()).fold(0.0, f64::max);
        let edge_px = [0, 1].map(|axis| libm::ceil(far(axis)) as usize + 1);
        self.single_images_of(model, [z_um, z_um], d_um, edge_px).shares(z_um, places)
    }
}

impl SingleImages {
    fn plane(&self, z_um: f64) -> Vec<f64> {
        self.model.plane(&self.model.light(&self.frame, z_um, self.radius_um), &self.exposure)
    }

    /// Light on pixels whose centers are at `places` relative to the particle, px, as a fraction of its light
    /// emitted into the half space.
    pub fn shares(&self, z_um: f64, places: &[[f64; 2]]) -> Vec<f64> {
        let plane = self.plane(z_um);
        places.iter().map(|&place| self.exposure.evaluate(&plane, place)[0]).collect()
    }

    /// The same with the derivatives with respect to the position of the pixel: value, d/dx, d/dy (1/px).
    pub fn share_slopes(&self, z_um: f64, places: &[[f64; 2]]) -> Vec<[f64; 3]> {
        let plane = self.plane(z_um);
        places.iter().map(|&place| self.exposure.evaluate(&plane, place)).collect()
    }
}
