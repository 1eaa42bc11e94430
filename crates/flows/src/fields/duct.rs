//! Pressure-driven flow in a straight duct of rectangular cross-section.
//!
//! Flow along x, width W along y, depth H along z; with b = n pi / H and z measured from the floor, for unit
//! pressure gradient over viscosity (Boussinesq 1868; Bruus, Theoretical Microfluidics, section 3.4.6)
//!
//!   u = z (H - z) / 2 - (4 H^2 / pi^3) SUM_{n odd} n^-3 R_n(y) sin(n pi z / H),
//!   R_n = cosh(b y) / cosh(b W/2) = e^(-b (W/2 - |y|)) (1 + e^(-2 b |y|)) / (1 + e^(-b W)),
//!   Q = (H^3 W / 12) [1 - (192 H / (pi^5 W)) SUM_{n odd} tanh(n pi W / 2H) / n^5].
//!
//! The sine series is along the shorter side. The exponentials of successive terms are obtained by
//! multiplication and the sines by a recurrence, so that no term needs a transcendental function. The sum
//! ends where e^(-b (W/2 - |y|)) < e^-40, at the latest after 400 terms; the truncation error is then at most
//! 3e-8 of the maximum speed, at the side walls. The flow is steady and fully developed; trajectories are
//! straight lines. Outside the duct the velocity is zero.

use super::prelude::*;
use super::speed::max_speed;

/// Maximum number of (odd) terms of the sum.
const MAX_TERMS: u32 = 400;
/// Terms below e^-40 are neglected.
const NEGLIGIBLE: f64 = 40.0;

params! {
    /// Parameters of [`Duct`].
    DuctParams("duct") {
        /// Speed on the axis, um/s.
        #[otherwise = "1290.0"]
        max_speed_um_s: Option<f64> = None, [finite];
        /// Instead of `max_speed_um_s`: mean speed over the cross-section, um/s.
        #[otherwise = "none"]
        mean_speed_um_s: Option<f64> = None, [finite];
        /// Instead of `max_speed_um_s`: volumetric flow rate, ul/min.
        #[otherwise = "none"]
        flow_rate_ul_min: Option<f64> = None, [finite];
        /// Distance between the side walls, um.
        width_um: f64 = 200.0, [> 0];
        /// y of the center between the side walls, um.
        #[alias = "centre_y_um"]
        center_y_um: f64 = 0.0, [finite];
        /// Floor and ceiling, um.
        #[otherwise = "the depth range"]
        walls_z_um: Option<[f64; 2]> = None, [finite], "floor below ceiling";
    }
}

entry! {
    DuctParams => Duct::new, YZ;
    "u = Boussinesq series of a rectangular duct along x";
    "Bruus, Theoretical Microfluidics, 3.4.6";
    [("deep", || Self { width_um: 60.0, ..Default::default() }.build())];
    {
        fn fill_defaults(&mut self, depths: DepthRange) {
            self.walls_z_um.get_or_insert(depths.walls());
            // `build` reports values that cannot be converted.
            if let Ok(max) = Duct::new(self).map(|duct| duct.max_speed) {
                (self.max_speed_um_s, self.mean_speed_um_s, self.flow_rate_ul_min) = (Some(max), None, None);
            }
        }
    }
}

/// Flow along x in a rectangular duct.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Duct {
    center: DVec2,
    /// Lengths of the sides along y and z, um.
    sides: DVec2,
    /// Floor and ceiling, um.
    walls_z: [f64; 2],
    max_speed: f64,
    /// Speed (um/s) per unit of [`Duct::profile`].
    scale: f64,
}

impl Duct {
    /// The flow of these parameters.
    pub fn new(params: &DuctParams) -> Result<Self> {
        let (params, check) = (params.checked()?, DuctParams::CHECK);
        let [floor, ceiling] = check.increasing("walls_z_um", params.walls_z_um.unwrap_or(CHANNEL))?;
        let width = params.width_um;
        let mut duct = Duct {
            center: DVec2::new(params.center_y_um, 0.5 * (floor + ceiling)),
            sides: DVec2::new(width, ceiling - floor),
            walls_z: [floor, ceiling],
            max_speed: 1.0,
            scale: 1.0,
        };
        let on_axis = duct.profile(DVec2::ZERO).0;
        let speeds = [params.max_speed_um_s, params.mean_speed_um_s, params.flow_rate_ul_min];
        let mean_share = duct.mean_speed() / on_axis;
        duct.max_speed = max_speed(speeds, check, mean_share, || Ok(width * (ceiling - floor)))?;
        duct.scale = duct.max_speed / on_axis;
        check.finite("width_um over depth", duct.scale)?;
        Ok(duct)
    }

    /// Mean velocity over the cross-section, um/s.
    pub fn mean_speed(&self) -> f64 {
        let (long, short) = (self.sides.max_element(), self.sides.min_element());
        let sum: f64 = (0..200)
            .map(|i| f64::from(2 * i + 1))
            .map(|n| libm::tanh(0.5 * n * PI * long / short) / (n * n * n * n * n))
            .sum();
        let pi5 = PI * PI * PI * PI * PI;
        // The profile uses the shorter side as the unit of length.
        self.scale / 12.0 * (1.0 - 192.0 / pi5 * short / long * sum)
    }

    /// u and its derivatives with respect to y and z at a point inside the duct relative to the axis, in
    /// units in which the shorter side and the pressure gradient over viscosity are 1.
    fn profile(&self, place: DVec2) -> (f64, DVec2) {
        let swapped = self.sides.y > self.sides.x;
        let short = self.sides.min_element();
        let half = 0.5 * self.sides.max_element() / short;
        let place = if swapped { DVec2::new(place.y, place.x) } else { place } / short;
        let (y, z) = (place.x.abs(), place.y + 0.5);
        let gap = (half - y).max(0.0);
        let terms = if gap * PI * f64::from(2 * MAX_TERMS) > NEGLIGIBLE {
            (0.5 * NEGLIGIBLE / (PI * gap)) as u32 + 1
        } else {
            MAX_TERMS
        };
        let power = |length: f64| libm::exp(-PI * length);
        // e^(-n pi length) for n = 1, 3, 5, ...: the first value times powers of the second.
        let (near, mirror, across) = (power(gap), power(2.0 * y), power(2.0 * half));
        let (mut far, mut image, mut both) = (near, mirror, across);
        let (sin1, cos1) = libm::sincos(PI * z);
        // sin((n + 2) a) = sin(n a) cos 2a + cos(n a) sin 2a.
        let (sin2, cos2) = (2.0 * sin1 * cos1, 1.0 - 2.0 * sin1 * sin1);
        let (mut sin, mut cos) = (sin1, cos1);
        let (mut sum, mut along_y, mut along_z) = (0.0, 0.0, 0.0);
        for i in 0..terms.min(MAX_TERMS) {
            let n = f64::from(2 * i + 1);
            let shape = far / ((1.0 + both) * n * n);
            sum += shape * (1.0 + image) * sin / n;
            along_y += shape * (1.0 - image) * sin;
            along_z += shape * (1.0 + image) * cos;
            (far, image, both) = (far * near * near, image * mirror * mirror, both * across * across);
            (sin, cos) = (sin * cos2 + cos * sin2, cos * cos2 - sin * sin2);
        }
        let u = 0.5 * z * (1.0 - z) - 4.0 / (PI * PI * PI) * sum;
        let slope =
            DVec2::new(-4.0 / (PI * PI) * along_y * place.x.signum(), 0.5 - z - 4.0 / (PI * PI) * along_z)
                / short;
        (u, if swapped { DVec2::new(slope.y, slope.x) } else { slope })
    }

    /// Speed (um/s) and its derivatives with respect to y and z (1/s).
    fn speed(&self, x: DVec3) -> (f64, DVec2) {
        let place = DVec2::new(x.y, x.z) - self.center;
        if place.abs().cmpgt(0.5 * self.sides).any() {
            return (0.0, DVec2::ZERO);
        }
        let (u, slope) = self.profile(place);
        (u * self.scale, slope * self.scale)
    }
}

impl VelocityField for Duct {
    facts!(divergence_free, steady, straight, walls_same_along(true, false, false));

    fn velocity(&self, x: DVec3, _t: f64) -> DVec3 {
        DVec3::X * self.speed(x).0
    }

    fn gradient(&self, x: DVec3, _t: f64) -> DMat3 {
        let slope = self.speed(x).1;
        DMat3::from_cols(DVec3::ZERO, DVec3::X * slope.x, DVec3::X * slope.y)
    }

    fn invariant(&self, x: DVec3, _t: f64) -> Option<f64> {
        Some(self.speed(x).0)
    }

    fn wall(&self, x: DVec3, _t: f64) -> Option<Wall> {
        let [y0, y1] = [-0.5, 0.5].map(|half| self.center.x + half * self.sides.x);
        let [z0, z1] = self.walls_z;
        Some(Wall::between(Axis::Y, y0, y1, x).or(Wall::between(Axis::Z, z0, z1, x)))
    }

    fn max_speed(&self, region: &Region, _t0: f64, _t1: f64) -> f64 {
        // The speed decreases from the axis to all sides: it is highest at the point of the box nearest to
        // the axis.
        let nearest = DVec3::new(0.0, self.center.x, self.center.y).clamp(region.min(), region.max());
        // Near the side walls, the truncated sum may exceed the exact one by the truncation error.
        (self.speed(nearest).0.abs() + 1e-6 * self.max_speed.abs()) * ROUNDING_MARGIN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn duct(width: f64) -> Duct {
        Duct::new(&DuctParams { width_um: width, ..Default::default() }).unwrap()
    }

    #[test]
    fn greatest_over_mean_speed_is_the_known_ratio() {
        // Square 2.0963, 3:1 1.8636 (rounded), slot 3/2; a deep duct is a wide one rotated by 90 degrees.
        for (width, ratio, digits) in [(100.0, 2.0963, 5e-5), (300.0, 1.8636, 5e-5), (1e6, 1.5, 2e-4)] {
            let found = 1290.0 / duct(width).mean_speed();
            assert!((found - ratio).abs() < digits, "{width}: {found}");
        }
        let turned = Duct::new(&DuctParams { width_um: 100.0 / 3.0, ..Default::default() }).unwrap();
        assert!((1290.0 / turned.mean_speed() - 1.8636).abs() < 5e-5);
    }

    #[test]
    fn the_laplacian_is_the_same_everywhere() {
        let field = duct(300.0);
        let u = |y: f64, z: f64| field.velocity(DVec3::new(0.0, y, z), 0.0).x;
        let laplacian = |y: f64, z: f64| {
            let h = 0.5;
            let second = |f: &dyn Fn(f64) -> f64| {
                (-f(2.0 * h) + 16.0 * f(h) - 30.0 * f(0.0) + 16.0 * f(-h) - f(-2.0 * h)) / (12.0 * h * h)
            };
            second(&|d| u(y + d, z)) + second(&|d| u(y, z + d))
        };
        let first = laplacian(0.0, -30.0);
        for (y, z) in [(60.0, -30.0), (-100.0, 10.0), (130.0, -60.0)] {
            // Truncation error h^4 pi^6 u / (90 H^6) = 1e-8; rounding error 1e-13 of 1290 over h^2, 1e-9
            // relative.
            assert!((laplacian(y, z) / first - 1.0).abs() < 1e-6, "{y} {z}");
        }
    }
}
