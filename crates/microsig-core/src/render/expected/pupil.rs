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

impl View {
    /// Places move by at most so much along columns when the source moves by one, px/um.
    pub(super) fn slope(&self) -> f64 {
        self.by_e1[0].abs() + self.by_e2[0].abs() + self.by_e3[1].abs()
    }
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
    pub(super) fn landing(&self, z_um: f64, [e1, e2, e3]: [f64; 3], q: [f64; 2]) -> Option<[f64; 2]> {
        let distance = self.distance(z_um) + e1;
        if distance <= 0.0 {
            return None;
        }
        let start = Ray { q_x: e2, q_y: e3, p_x: (q[0] - e2) / distance, p_y: (q[1] - e3) / distance };
        let (x, y) = self.system.trace(start, distance)?;
        Some([x / self.pixel_size, y / self.pixel_size])
    }

    /// Radius in the lens plane beyond which no light of a particle of this radius lands within `farthest_px` of it, um; at
    /// most the aperture's. With a cylinder it is the aperture's.
    pub(super) fn useful_radius(&self, z_um: f64, radius_um: f64, farthest_px: f64) -> f64 {
        const STEPS: u32 = 256;
        let aperture = self.aperture();
        if self.system.cylinder.is_some() {
            return aperture;
        }
        let misses = |q: f64| {
            self.view(z_um, radius_um, [q, 0.0])
                .is_none_or(|view| view.landing[0].abs() - radius_um * view.slope() > farthest_px)
        };
        let step = aperture / f64::from(STEPS);
        let missing = (0..STEPS).take_while(|&i| misses(aperture - f64::from(i) * step)).count();
        (aperture - step * (missing as f64 - 1.0)).min(aperture)
    }

    /// The farthest that light of a particle lands from its image's centre, px, on the two axes.
    pub(super) fn reach(&self, z_um: f64, radius_um: f64) -> [f64; 2] {
        const STEPS: u32 = 64;
        let mut reach = [0.0f64; 2];
        for i in 0..=STEPS {
            let q = self.aperture() * f64::from(i) / f64::from(STEPS);
            for point in [[q, 0.0], [0.0, q]] {
                let Some(view) = self.view(z_um, radius_um, point) else { continue };
                for axis in 0..2 {
                    let slope2 =
                        [view.by_e1, view.by_e2, view.by_e3].iter().map(|d| d[axis] * d[axis]).sum::<f64>();
                    reach[axis] = reach[axis].max(view.landing[axis].abs() + radius_um * libm::sqrt(slope2));
                }
            }
        }
        if self.system.cylinder.is_none() { [reach[0].max(reach[1]); 2] } else { reach }
    }

    /// Diameter of a particle's own image at this depth, px, apart from all blur.
    pub(super) fn image_px(&self, z_um: f64, radius_um: f64) -> f64 {
        2.0 * radius_um * self.system.objective.image_distance / self.distance(z_um) / self.pixel_size
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
#[inline(always)]
pub(super) fn density(distance: f64, offset2: f64) -> f64 {
    let r2 = distance * distance + offset2;
    distance / (r2 * r2.sqrt() * (2.0 * std::f64::consts::PI))
}
