//! How a small particle is seen through one point of the lens.
//!
//! For a fixed point of the lens, the place where a ray lands is a smooth function of the source point's offset from
//! the particle's centre, and the offset is small beside the distance to the lens (1 in 400 um). First order is enough:
//! what is left out is the square of that ratio, about a thousandth of a pixel. Everything of higher order in the
//! aperture (spherical aberration, coma) is in the numbers of the lens point itself, which come from exact rays.

use crate::optics::{OpticalSystem, Ray};

/// A particle seen through one point of the lens: places on the sensor in px (columns, rows), relative to the
/// particle's image, and their derivatives by the source's offset along the axes of `optics`, px/um.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct View {
    /// Where the ray from the particle's centre lands.
    pub(super) landing: [f64; 2],
    /// By the offset away from the lens.
    pub(super) by_e1: [f64; 2],
    /// By the offset along columns, before the lens inverts.
    pub(super) by_e2: [f64; 2],
    /// By the offset along rows, before the lens inverts.
    pub(super) by_e3: [f64; 2],
}

/// Optics and the scale of the sensor.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pupil {
    pub(super) system: OpticalSystem,
    pub(super) pixel_size: f64,
}

impl Pupil {
    /// The view through the point `q` of the lens (um) at depth `z_um`, for source points within `radius_um` of the
    /// centre. `None`: the ray is lost.
    pub(super) fn view(&self, z_um: f64, radius_um: f64, q: [f64; 2]) -> Option<View> {
        // Differences over the extent of the particle carry the mean of higher orders.
        let step = (0.6 * radius_um).max(0.05);
        let land = |e: [f64; 3]| self.landing(z_um, e, q);
        let derivative = |axis: usize| {
            let mut offset = [0.0; 3];
            offset[axis] = step;
            let high = land(offset)?;
            offset[axis] = -step;
            let low = land(offset)?;
            Some([0, 1].map(|i| (high[i] - low[i]) / (2.0 * step)))
        };
        Some(View {
            landing: land([0.0; 3])?,
            by_e1: derivative(0)?,
            by_e2: derivative(1)?,
            by_e3: derivative(2)?,
        })
    }

    /// Where the ray from a source point through the point `q` of the lens lands, px.
    fn landing(&self, z_um: f64, [e1, e2, e3]: [f64; 3], q: [f64; 2]) -> Option<[f64; 2]> {
        let distance = self.distance(z_um) + e1;
        if distance <= 0.0 {
            return None;
        }
        let start = Ray { q_x: e2, q_y: e3, p_x: (q[0] - e2) / distance, p_y: (q[1] - e3) / distance };
        let (x, y) = self.system.trace(start, distance)?;
        Some([x / self.pixel_size, y / self.pixel_size])
    }

    /// Distance from the plane at this depth to the lens, um.
    pub(super) fn distance(&self, z_um: f64) -> f64 {
        self.system.objective.object_distance(z_um)
    }

    /// The largest radius in the lens plane that is used, um: just inside the aperture, where rounding loses no ray.
    pub(super) fn aperture(&self) -> f64 {
        self.system.objective.aperture_radius * (1.0 - 1e-9)
    }
}

/// The share of isotropic light over the half space that a point at `distance` in front of a plane sends through each
/// unit of its area at the in-plane offset squared `offset2`: cos / (2 pi r^2), 1/um^2.
pub(super) fn density(distance: f64, offset2: f64) -> f64 {
    let r2 = distance * distance + offset2;
    distance / (r2 * r2.sqrt() * (2.0 * std::f64::consts::PI))
}
