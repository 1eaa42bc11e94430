//! The flow of a dataset at any position, not only at the nodes of `truth/field.csv`.

use flows::eulerian::{backward, central, forward};
use flows::scale::{ImagePoint, Scale};
use flows::{FluidRegion, Illumination, VelocityField};
use glam::DVec3;
use microsig_core::quadrature::GAUSS_LEGENDRE_8;

use crate::dataset::FieldRow;

/// A flow whose displacements are known at any position.
pub trait TrueFlow: std::fmt::Debug + Send + Sync {
    /// The displacements at a position (px, px, um) in an image pair, as the table would have them at a node
    /// there: forward, central and, if wanted, weighted ones; masked for a pair that does not exist.
    fn row(&self, pair: Option<u32>, at: [f64; 3], is_weighted: bool) -> FieldRow;
}

/// dx (px), dy (px), dz (um); NaN if undefined.
type Displacement = [f64; 3];

const UNDEFINED: Displacement = [f64::NAN; 3];

/// A flow as images show it.
#[derive(Debug, Clone, Copy)]
pub struct ImageFlow<'a> {
    /// The velocities.
    pub field: &'a dyn VelocityField,
    /// Where there is fluid.
    pub fluid: FluidRegion<'a>,
    /// Conversion between px and um.
    pub scale: &'a Scale,
    /// Illumination of the particles.
    pub illumination: &'a Illumination,
    /// Depths (um) over which central displacements are averaged, and their weights at illumination 1.
    pub depths: &'a [(f64, f64)],
    /// Side of the averaging window, px.
    pub window_px: Option<f64>,
    /// Whether backward displacements are wanted.
    pub backward: bool,
}

impl ImageFlow<'_> {
    /// The row with the displacements at its position over an interval (s) and this weighted one.
    pub fn row(&self, at: FieldRow, weighted: [f64; 3], interval: (f64, f64)) -> FieldRow {
        let x = self.position(at.x_px, at.y_px, at.z_um);
        let [forward, central, backward, window] =
            if self.fluid.contains(x, interval.0) { self.all(x, interval) } else { [UNDEFINED; 4] };
        let mut row = FieldRow { mask: !(forward[0].is_finite() && central[0].is_finite()), ..at };
        [row.forward_dx_px, row.forward_dy_px, row.forward_dz_um] = forward;
        [row.central_dx_px, row.central_dy_px, row.central_dz_um] = central;
        [row.weighted_dx_px, row.weighted_dy_px, row.weighted_dz_um] = weighted;
        [row.window_dx_px, row.window_dy_px, row.window_dz_um] = window;
        [row.backward_dx_px, row.backward_dy_px, row.backward_dz_um] = backward;
        row
    }

    /// The central displacement (px, px, um) averaged over depth at a position (px); NaN without depths.
    pub fn weighted(&self, [x_px, y_px]: [f64; 2], interval: (f64, f64)) -> [f64; 3] {
        mean(self.depths.iter().map(|&(z, weight)| {
            let position = self.position(x_px, y_px, z);
            let light = self.illumination.at(position);
            (weight * light * light, self.central(position, interval))
        }))
    }

    /// Forward, central, backward and window displacement in the fluid.
    fn all(&self, x: DVec3, interval: (f64, f64)) -> [Displacement; 4] {
        let in_image = |moved: flows::Result<DVec3>| moved.map_or(UNDEFINED, |moved| self.in_image(moved));
        [
            in_image(forward(self.field, x, interval)),
            in_image(central(self.field, x, interval)),
            if self.backward { in_image(backward(self.field, x, interval)) } else { UNDEFINED },
            self.window_px.map_or(UNDEFINED, |side| self.over_window(x, side, interval)),
        ]
    }

    /// The central displacement averaged over a square window, by Gauss-Legendre quadrature.
    fn over_window(&self, x: DVec3, side_px: f64, interval: (f64, f64)) -> Displacement {
        let half_um = 0.5 * side_px * self.scale.um_per_px();
        let at = |u: f64, v: f64| {
            let [u, v] = self.scale.unstretched([u, v]);
            x + DVec3::new(u, v, 0.0) * half_um
        };
        let rule = || GAUSS_LEGENDRE_8.into_iter().flat_map(|(at, weight)| [(-at, weight), (at, weight)]);
        mean(
            rule()
                .flat_map(|(v, b)| rule().map(move |(u, a)| (u, v, a * b)))
                .map(|(u, v, weight)| (weight, self.central(at(u, v), interval))),
        )
    }

    fn central(&self, x: DVec3, interval: (f64, f64)) -> Displacement {
        if !self.fluid.contains(x, interval.0) {
            return UNDEFINED;
        }
        central(self.field, x, interval).map_or(UNDEFINED, |moved| self.in_image(moved))
    }

    fn position(&self, x_px: f64, y_px: f64, z_um: f64) -> DVec3 {
        // Depths are physical, unlike in data files.
        self.scale.to_object(ImagePoint { x_px, y_px, z_um: 0.0 }).with_z(z_um)
    }

    fn in_image(&self, moved: DVec3) -> Displacement {
        let image = self.scale.displacement_to_image(moved);
        [image.dx_px, image.dy_px, moved.z]
    }
}

/// The weighted mean of the defined displacements; NaN if there are none.
fn mean(weighted: impl Iterator<Item = (f64, Displacement)>) -> Displacement {
    let (mut sum, mut weights) = ([0.0; 3], 0.0);
    for (weight, moved) in weighted.filter(|(_, moved)| moved[0].is_finite()) {
        sum.iter_mut().zip(moved).for_each(|(s, m)| *s += weight * m);
        weights += weight;
    }
    sum.map(|s| s / weights)
}
