//! Acoustofluidics: Rayleigh streaming in a channel with a standing wave, and acoustophoresis, the motion of
//! particles by the acoustic radiation force.
//!
//! A standing pressure wave with n half wavelengths across a channel of width W (y) and depth 2 h (z from the
//! mid-plane), k = n pi / W, K = 2 k, drives the following flow outside the thin viscous boundary layers
//! (Rayleigh, Phil. Trans. 175 (1884) 1; Muller et al., Phys. Rev. E 88 (2013) 023006): u_y = F'(z) S(y), u_z
//! = -F(z) S'(y), S = -sin(K (y + W/2)), F = b [z cosh Kz - h coth(Kh) sinh Kz], where b = u0 sinh Kh / (sinh
//! Kh cosh Kh - Kh). This is a creeping flow with the slip velocity u0 S at the plates, u0 = (3/8) va^2 / c0,
//! and 4 n rolls. For n = 1, S = sin Ky: the flow is toward the side walls at the plates and away from them
//! in the mid-plane. F S is invariant. At the side walls the flux is zero but not the slip; the viscous
//! boundary layers (0.4 um at 2 MHz in water) are not modeled.
//!
//! Acoustophoresis: the radiation force drives particles of diameter d at u_y = v sin(2 k (y + W/2)), v = (2
//! Phi / 3) k (d/2)^2 E / mu (Barnkob et al., Lab Chip 10 (2010) 563), toward the pressure nodes for a
//! contrast factor Phi > 0 (0.165 for polystyrene in water); E is the acoustic energy density. With y' = y +
//! W/2, tan(k y') grows exponentially. This is a velocity of particles relative to the fluid: add it to a
//! flow.

use super::plates::{Plates, inside};
use super::prelude::*;
use super::sinusoid::sine_displacement;
use std::sync::Arc;

/// Largest K h; above it the squares of the hyperbolic functions overflow.
const MAX_KH: f64 = 300.0;

params! {
    /// Parameters of [`RayleighStreaming`].
    RayleighStreamingParams("rayleigh_streaming") {
        /// Maximum slip velocity u0 at the plates, um/s.
        slip_speed_um_s: f64 = 50.0, [finite];
        /// Distance between the side walls, um.
        width_um: f64 = 236.0, [> 0];
        /// Number of half wavelengths across the channel.
        half_waves: u32 = 1, [>= 1], "2 pi half_waves depth / width at most 600";
        /// y of the center between the side walls, um.
        #[alias = "centre_y_um"]
        center_y_um: f64 = 0.0, [finite];
        /// z of floor and ceiling, um.
        #[otherwise = "the depth range"]
        walls_z_um: Option<[f64; 2]> = None, [finite], "floor below ceiling";
    }
}

entry! {
    RayleighStreamingParams => RayleighStreaming::new, YZ;
    "u_y = F' S, u_z = -F S', F = b (z cosh Kz - h coth(Kh) sinh Kz), S = -sin(K (y + W/2))";
    "Rayleigh, Phil. Trans. 175 (1884) 1; Muller et al., Phys. Rev. E 88 (2013) 023006";
    [("three half waves", || Self { half_waves: 3, ..Default::default() }.build())];
    walls_z_um: walls;
}

params! {
    /// Parameters of [`Acoustophoresis`].
    AcoustophoresisParams("acoustophoresis") {
        /// Acoustic energy density, J/m^3.
        energy_density_j_m3: f64 = 10.0, [>= 0];
        /// Acoustic contrast factor; 0.165 for polystyrene in water.
        contrast_factor: f64 = 0.165, [finite];
        /// Diameter for the truth on a grid, um; each particle moves according to its own diameter.
        diameter_um: f64 = 2.0, [> 0];
        /// Dynamic viscosity, Pa s.
        viscosity_pa_s: f64 = 0.89e-3, [> 0];
        /// Distance between the side walls, um.
        width_um: f64 = 236.0, [> 0];
        /// Number of half wavelengths across the channel.
        half_waves: u32 = 1, [>= 1];
        /// y of the center between the side walls, um.
        #[alias = "centre_y_um"]
        center_y_um: f64 = 0.0, [finite];
    }
}

entry! {
    AcoustophoresisParams => Acoustophoresis::new, YZ;
    "u_y = v sin(2 k (y + W/2)), v = (2 Phi/3) k (d/2)^2 E / mu";
    "Barnkob et al., Lab Chip 10 (2010) 563";
}

/// K = 2 n pi / W (1/um) and y (um) of the side wall with the smaller coordinate.
fn wave(half_waves: u32, width: f64, center: f64) -> (f64, f64) {
    (2.0 * PI * f64::from(half_waves) / width, center - 0.5 * width)
}

/// Acoustic streaming in a rectangular channel along x.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayleighStreaming {
    plates: Plates,
    side: f64,
    far_side: f64,
    wavenumber: f64,
    /// b and b h coth(Kh).
    scale: f64,
    counter: f64,
    peak: f64,
}

impl RayleighStreaming {
    /// The flow of these parameters.
    pub fn new(params: &RayleighStreamingParams) -> Result<Self> {
        let (params, check) = (params.checked()?, RayleighStreamingParams::CHECK);
        let plates = Plates::new(check, params.walls_z_um)?;
        let (wavenumber, side) = wave(params.half_waves, params.width_um, params.center_y_um);
        let h = 0.5 * plates.depth;
        let kh = wavenumber * h;
        if kh > MAX_KH {
            let allowed = "2 pi half_waves depth / width at most 600";
            return Err(check.fault("half_waves", params.half_waves, allowed));
        }
        let (sinh, cosh) = (libm::sinh(kh), libm::cosh(kh));
        let scale = params.slip_speed_um_s * sinh / (sinh * cosh - kh);
        check.finite("width_um over depth", scale)?;
        let mut field = RayleighStreaming {
            plates,
            side,
            far_side: side + params.width_um,
            wavenumber,
            scale,
            counter: scale * h * cosh / sinh,
            peak: 0.0,
        };
        // The squared speed is F'^2 S^2 + (K F)^2 (1 - S^2); both are smooth over the depth, so that sampling
        // at 1000 nodes underestimates the maximum by less than 0.1 %.
        let nodes = (0..=1000).map(|i| h * (f64::from(i) / 500.0 - 1.0));
        let faster = |peak: f64, z: f64| {
            let (f, slope) = field.shape(z);
            peak.max(slope.abs()).max((f * wavenumber).abs())
        };
        field.peak = 1.001 * nodes.fold(0.0, faster);
        Ok(field)
    }

    /// F and F' at a height z above the mid-plane.
    fn shape<S: Real>(&self, z: S) -> (S, S) {
        let k = self.wavenumber;
        let (sinh, cosh) = ((z * k).sinh(), (z * k).cosh());
        let f = z * cosh * self.scale - sinh * self.counter;
        (f, (cosh + z * sinh * k) * self.scale - cosh * (self.counter * k))
    }
}

impl Formula for RayleighStreaming {
    fn formula<S: Real>(&self, [_, y, z]: [S; 3], _t: f64) -> [S; 3] {
        let rest = S::constant(0.0);
        if !inside(self.plates.height(z).value()) {
            return [rest; 3];
        }
        let (f, slope) = self.shape(z - self.plates.middle());
        let phase = (y - self.side) * self.wavenumber;
        [rest, -(slope * phase.sin()), f * phase.cos() * self.wavenumber]
    }
}

impl VelocityField for RayleighStreaming {
    by_formula!();
    facts!(divergence_free, steady, walls_same_along(true, false, false));

    fn invariant(&self, x: DVec3, _t: f64) -> Option<f64> {
        let z = x.z.clamp(self.plates.floor, self.plates.floor + self.plates.depth) - self.plates.middle();
        Some(self.shape(z).0 * libm::sin((x.y - self.side) * self.wavenumber))
    }

    fn wall(&self, x: DVec3, _t: f64) -> Option<Wall> {
        Some(self.plates.wall(x).or(Wall::between(Axis::Y, self.side, self.far_side, x)))
    }

    fn max_speed(&self, _region: &Region, _t0: f64, _t1: f64) -> f64 {
        self.peak
    }
}

/// The velocity of particles by the radiation force of a standing wave, proportional to the square of their
/// diameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Acoustophoresis {
    side: f64,
    far_side: f64,
    wavenumber: f64,
    /// Diameter of the particles (um); `speed` is their maximum speed, um/s.
    d_um: f64,
    speed: f64,
}

impl Acoustophoresis {
    /// The velocity field of these parameters.
    pub fn new(params: &AcoustophoresisParams) -> Result<Self> {
        let params = params.checked()?;
        let (energy, viscosity) = (params.energy_density_j_m3, params.viscosity_pa_s);
        let (contrast, radius) = (params.contrast_factor, 0.5 * params.diameter_um);
        let (wavenumber, side) = wave(params.half_waves, params.width_um, params.center_y_um);
        // J/m^3 over Pa s is 1/s.
        let speed = 2.0 / 3.0 * contrast * (0.5 * wavenumber) * radius * radius * energy / viscosity;
        Ok(Acoustophoresis {
            side,
            far_side: side + params.width_um,
            wavenumber,
            d_um: params.diameter_um,
            speed: AcoustophoresisParams::CHECK.finite("energy_density_j_m3 over viscosity_pa_s", speed)?,
        })
    }

    /// Maximum speed, um/s; negative if particles move away from the pressure nodes.
    pub fn speed(&self) -> f64 {
        self.speed
    }
}

impl Formula for Acoustophoresis {
    fn formula<S: Real>(&self, [_, y, _]: [S; 3], _t: f64) -> [S; 3] {
        let rest = S::constant(0.0);
        [rest, ((y - self.side) * self.wavenumber).sin() * self.speed, rest]
    }
}

impl VelocityField for Acoustophoresis {
    by_formula!();
    facts!(steady, walls_same_along(true, false, true));

    fn flow_map(&self, x: DVec3, t0: f64, t1: f64) -> Option<DVec3> {
        let way =
            sine_displacement((x.y - self.side) * self.wavenumber, self.wavenumber * self.speed, t1 - t0);
        Some(x + DVec3::Y * (way / self.wavenumber))
    }

    fn invariant(&self, x: DVec3, _t: f64) -> Option<f64> {
        Some(x.x)
    }

    fn wall(&self, x: DVec3, _t: f64) -> Option<Wall> {
        Some(Wall::between(Axis::Y, self.side, self.far_side, x))
    }

    fn for_diameter(&self, d_um: f64) -> Option<Arc<dyn VelocityField>> {
        let ratio = d_um / self.d_um;
        Some(Arc::new(Acoustophoresis { d_um, speed: self.speed * ratio * ratio, ..*self }))
    }

    fn max_speed(&self, _region: &Region, _t0: f64, _t1: f64) -> f64 {
        self.speed.abs() * ROUNDING_MARGIN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streaming_slips_at_the_plates_and_returns_in_the_middle() {
        let field = RayleighStreaming::new(&RayleighStreamingParams::default()).unwrap();
        let at = |y: f64, z: f64| field.velocity(DVec3::new(0.0, y, z), 0.0);
        // At an eighth of the wavelength from the center, sin Ky = 1.
        for z in [-80.0, 20.0] {
            assert!((at(59.0, z) - DVec3::Y * 50.0).length() < 1e-11, "{}", at(59.0, z));
        }
        assert!(at(59.0, -30.0).y < -10.0);
        // No flux through the side walls and the plates.
        assert!(at(118.0, 0.0).y.abs() < 1e-12 && at(30.0, -80.0).z.abs() < 1e-12);
        // In a shallow channel u_y / u0 = (3 z^2 / h^2 - 1) / 2.
        let shallow = RayleighStreamingParams { width_um: 1e5, ..Default::default() };
        let field = RayleighStreaming::new(&shallow).unwrap();
        let middle = field.velocity(DVec3::new(0.0, 25_000.0, -30.0), 0.0).y;
        assert!((middle / 50.0 + 0.5).abs() < 1e-5, "{middle}");
        assert!(
            RayleighStreaming::new(&RayleighStreamingParams { half_waves: 999, ..Default::default() })
                .is_err()
        );
    }

    #[test]
    fn particles_go_to_the_pressure_node() {
        let field = Acoustophoresis::new(&AcoustophoresisParams::default()).unwrap();
        // (2 * 0.165 / 3) (pi / 236 um) 1 um^2 (10 / 0.89e-3) 1/s.
        assert!((field.speed() - 16.453).abs() < 1e-3, "{}", field.speed());
        let end = field.flow_map(DVec3::new(0.0, 100.0, 0.0), 0.0, 100.0).unwrap();
        assert!(end.y.abs() < 1e-12, "{end}");
        let two =
            Acoustophoresis::new(&AcoustophoresisParams { half_waves: 2, ..Default::default() }).unwrap();
        let end = two.flow_map(DVec3::new(0.0, 10.0, 0.0), 0.0, 100.0).unwrap();
        assert!((end.y - 59.0).abs() < 1e-10, "{end}");
    }
}
