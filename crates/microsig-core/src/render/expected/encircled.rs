//! Light within a radius: the image of a sphere behind a spherical lens.
//!
//! Rays are not counted one by one. For a source point and an azimuth, the landing radius is followed along a spoke of
//! the lens from the axis to the rim, and the light between two stops on the spoke is spread evenly over the radii
//! between their landing places. So a caustic, where the landing radius turns back and the density is infinite, is
//! integrated as it should be. The far hemisphere's points are turned to the near one (`emission`), so source points are
//! uniform in area over the hemisphere toward the lens: by Archimedes, uniform in depth.

use super::exposure::Fineness;
use super::pupil::{Pupil, View, density};

/// Annuli per px.
pub(super) const RINGS: usize = 32;

/// Spokes, which are pairs of a source point and an azimuth, for a particle whose own image is so wide, px.
fn spokes(Fineness(fine): Fineness, image_px: f64) -> usize {
    (fine * 512.0 * (image_px / 3.0).clamp(1.0, 16.0)) as usize
}

/// Stops on a spoke for an image that reaches so far, px.
fn stops(Fineness(fine): Fineness, reach_px: f64) -> usize {
    (fine * (32.0 + reach_px.min(500.0))) as usize
}

/// Light within the radius k / RINGS px, k = 0..=rings, as a share of all light that the particle sends toward the lens
/// side.
pub(super) fn encircled(
    pupil: &Pupil,
    z_um: f64,
    radius_um: f64,
    rings: usize,
    fineness: Fineness,
) -> Vec<f64> {
    let reach_px = rings as f64 / RINGS as f64;
    let q_max = pupil.useful_radius(z_um, radius_um, reach_px);
    let stops = stops(fineness, reach_px);
    let step = q_max / stops as f64;
    let views: Vec<Option<View>> =
        (0..=stops).map(|i| pupil.view(z_um, radius_um, [i as f64 * step, 0.0])).collect();
    let distance = pupil.distance(z_um);

    let mut ramps = Ramps::new(rings);
    // Stops along a spoke, in arrays: where they land, in rings, and the light up to the next.
    let (mut x, mut y) = (vec![f64::NAN; stops + 1], vec![f64::NAN; stops + 1]);
    let (mut r, mut light) = (vec![0.0; stops + 1], vec![0.0; stops]);
    // A point has no size: every spoke is the same.
    let spokes = if radius_um == 0.0 { 1 } else { spokes(fineness, pupil.image_px(z_um, radius_um)) };
    for spoke in 0..spokes {
        let depth = (spoke as f64 + 0.5) / spokes as f64;
        let azimuth = std::f64::consts::PI * (spoke as f64 * GOLDEN).fract();
        let (sine, cosine) = libm::sincos(azimuth);
        let e1 = -radius_um * depth;
        let offset = radius_um * libm::sqrt(1.0 - depth * depth);
        let (e2, e3) = (offset * cosine, offset * sine);
        for (i, view) in views.iter().enumerate() {
            if let Some(view) = view {
                x[i] = (view.landing[0] + view.by_e1[0] * e1 + view.by_e2[0] * e2) * RINGS as f64;
                y[i] = view.by_e3[1] * e3 * RINGS as f64;
            }
        }
        for i in 0..=stops {
            r[i] = (x[i] * x[i] + y[i] * y[i]).sqrt();
        }
        let area = 2.0 * std::f64::consts::PI * step / spokes as f64;
        for (i, light) in light.iter_mut().enumerate() {
            let q = (i as f64 + 0.5) * step;
            *light = density(distance + e1, q * q - 2.0 * q * e2 + offset * offset) * q * area;
        }
        for i in 0..stops {
            let (dx, dy) = (x[i + 1] - x[i], y[i + 1] - y[i]);
            let least = r[i].min(r[i + 1]);
            // Far from the axis the radius runs evenly along the line to the next stop; near it, it turns.
            if least * least > 4.0 * (dx * dx + dy * dy) {
                ramps.spread(r[i], r[i + 1], light[i]);
            } else {
                ramps.spread_line([x[i], y[i]], [dx, dy], light[i]);
            }
        }
    }
    ramps.cumulative()
}

/// The golden ratio less one: its multiples modulo 1 fill the unit interval evenly however many are taken.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// Pieces of a line on each side of its point nearest to the axis.
const PIECES: usize = 4;

/// A distribution over radii made of uniform pieces, kept as the second differences of its integral: a piece costs four
/// additions however wide it is, and the integral at whole rings is exact.
struct Ramps {
    second: Vec<f64>,
    rings: usize,
}

impl Ramps {
    fn new(rings: usize) -> Self {
        Ramps { second: vec![0.0; rings + 2], rings }
    }

    /// Spreads `light` over the radii of a straight line near the axis, in rings: in pieces on both sides of its nearest
    /// point. NaN (a ray that is lost) loses the line.
    fn spread_line(&mut self, [x, y]: [f64; 2], [dx, dy]: [f64; 2], light: f64) {
        let nearest = (-(x * dx + y * dy) / (dx * dx + dy * dy).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        let at = |t: f64| {
            let (x, y) = (x + t * dx, y + t * dy);
            (x * x + y * y).sqrt()
        };
        for (start, part) in [(0.0, nearest), (nearest, 1.0 - nearest)] {
            let part = part / PIECES as f64;
            let mut before = at(start);
            for piece in 1..=PIECES {
                let after = at(start + piece as f64 * part);
                self.spread(before, after, light * part);
                before = after;
            }
        }
    }

    /// Spreads `light` evenly between two radii, in rings.
    fn spread(&mut self, a: f64, b: f64, light: f64) {
        let (low, high) = (a.min(b), a.max(b));
        // What lands beyond the rings, or nowhere, is not counted.
        if low.is_nan() || low >= self.rings as f64 || light == 0.0 {
            return;
        }
        // At a turning point of the landing radius a piece has no width; a thousandth of a ring is as good.
        let width = (high - low).max(1e-3);
        let slope = light / width;
        self.bend(low, slope);
        self.bend(low + width, -slope);
    }

    fn bend(&mut self, at: f64, slope: f64) {
        let ring = at as usize;
        if ring < self.rings {
            let part = at - ring as f64;
            self.second[ring] += slope * (1.0 - part);
            self.second[ring + 1] += slope * part;
        }
    }

    fn cumulative(mut self) -> Vec<f64> {
        self.second.truncate(self.rings + 1);
        let (mut slope, mut sum) = (0.0, 0.0);
        // At ring k the integral holds all bends before it.
        for value in &mut self.second {
            let bend = *value;
            *value = sum + slope;
            sum = *value;
            slope += bend;
        }
        self.second
    }
}
