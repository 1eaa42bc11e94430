//! Kraichnan's random Fourier modes: a field with the statistics of turbulence, in three dimensions or two.
//!
//! u = SUM_n a_n cos(k_n . x + w_n t) + b_n sin(k_n . x + w_n t), N modes, a_n and b_n perpendicular to k_n
//! (Kraichnan, Phys. Fluids 13 (1970) 22). In 3-D a_n = c xi x k_n/|k_n| with xi a vector of three standard
//! normal numbers, c = u' sqrt(3 / 2N), and isotropic directions of k_n; in 2-D a_n = c xi (-k_y, k_x)
//! / |k_n| with c = u' sqrt(2 / N). In both cases the mean square of every component, averaged over seeds, is
//! u'^2. |k| = (k0/2) chi_5, a sample of the spectrum 16 sqrt(2/pi) u'^2 k^4 / k0^5 exp(-2 k^2 / k0^2), whose
//! peak is at k0. w_n is normal with standard deviation `unsteadiness` u' |k_n|; 0 gives a frozen field. With
//! a period along an axis, the wave number along it is rounded to a multiple of 2 pi / period.
//!
//! The field is exactly divergence-free, has no walls, and is not a solution of the Navier-Stokes equations.
//! Mode n is drawn from the stream (`Seeding`, 2^32 - 1, n) of the field's own seed: a field with fewer modes
//! has the first modes of one with more.

use super::prelude::*;
use crate::sincos::sines_and_cosines;
use microsig_core::random::normal;
use microsig_core::stream::{Purpose, Stream, Streams};

/// Number of modes in a block, which are summed in parallel lanes.
const LANES: usize = 16;

params! {
    /// Parameters of [`Kraichnan`].
    KraichnanParams("kraichnan") {
        /// Number of dimensions: 3, or 2 for a field in the xy-plane.
        dimensions: u32 = 3, [2 to 3];
        /// Root mean square u' of each component of the velocity, um/s.
        rms_speed_um_s: f64 = 300.0, [>= 0];
        /// Wavelength 2 pi / k0 of the peak of the spectrum, um.
        wavelength_um: f64 = 100.0, [> 0];
        /// Number of modes.
        modes: u32 = 200, [1 to 100_000];
        /// Standard deviation of the angular frequencies, in units of u' k; 0: a frozen field.
        unsteadiness: f64 = 0.0, [>= 0];
        /// Periods along x, y and z, um; 0: not periodic.
        period_um: [f64; 3] = [0.0, 0.0, 0.0], [>= 0], "0 or several wavelengths";
        /// Seed of the random modes.
        seed: u64 = 1, [>= 0];
    }
}

entry! {
    KraichnanParams => Kraichnan::new, XY;
    "u = SUM a_n cos(k_n.x + w_n t) + b_n sin(k_n.x + w_n t)";
    "Kraichnan, Phys. Fluids 13 (1970) 22";
    [
        ("plane", || Self { dimensions: 2, ..Default::default() }.build()),
        ("unsteady periodic", || {
            Self { unsteadiness: 0.5, period_um: [400.0, 400.0, 200.0], modes: 60, ..Default::default() }
                .build()
        }),
    ];
    {
        fn seed(&mut self) -> Option<&mut u64> {
            Some(&mut self.seed)
        }
    }
}

/// [`LANES`] modes as a structure of arrays: lane i of every array belongs to mode i.
#[derive(Debug, Clone, PartialEq, Default)]
struct Block {
    k: [[f64; LANES]; 3],
    omega: [f64; LANES],
    a: [[f64; LANES]; 3],
    b: [[f64; LANES]; 3],
}

#[derive(Debug, Clone, Copy)]
struct Mode {
    k: DVec3,
    omega: f64,
    a: DVec3,
    b: DVec3,
}

/// A sum of random Fourier modes.
#[derive(Debug, Clone, PartialEq)]
pub struct Kraichnan {
    blocks: Vec<Block>,
    steady: bool,
    /// Upper bound of the speed, um/s.
    bound: f64,
}

impl Kraichnan {
    /// The field of these parameters.
    pub fn new(params: &KraichnanParams) -> Result<Self> {
        let params = &params.checked()?;
        for period in params.period_um {
            // With the shortest allowed period a few per cent of the wave vectors round to zero and are
            // redrawn.
            if period > 0.0 && period < params.wavelength_um {
                return Err(KraichnanParams::CHECK.fault(
                    "period_um",
                    period,
                    "0, or at least wavelength_um",
                ));
            }
        }
        let streams = Streams::new(params.seed);
        let modes: Vec<Mode> = (0..params.modes)
            .map(|number| Mode::draw(params, &mut streams.stream(Purpose::Seeding, u32::MAX, number)))
            .collect();
        // |a cos + b sin| is at most sqrt(|a|^2 + |b|^2).
        let bound =
            modes.iter().map(|mode| libm::sqrt(mode.a.length_squared() + mode.b.length_squared())).sum();
        let blocks = modes.chunks(LANES).map(Block::of).collect();
        Ok(Kraichnan { blocks, steady: params.unsteadiness == 0.0, bound })
    }
}

impl Mode {
    fn draw(params: &KraichnanParams, stream: &mut Stream) -> Mode {
        let flat = params.dimensions == 2;
        let mut vector = || DVec3::new(normal(stream), normal(stream), normal(stream));
        let k0 = 2.0 * PI / params.wavelength_um;
        let k = loop {
            // chi_5 is the length of a vector of five normal numbers; the sixth is not used.
            let (first, second) = (vector(), vector());
            let length =
                0.5 * k0 * libm::sqrt(first.length_squared() + second.x * second.x + second.y * second.y);
            let direction = if flat { vector().with_z(0.0) } else { vector() };
            let k = direction.try_normalize().map_or(DVec3::ZERO, |unit| unit * length);
            let k = DVec3::from_array(std::array::from_fn(|i| {
                let unit = 2.0 * PI / params.period_um[i];
                // Without a period the unit is infinite. libm::round rounds halves away from zero.
                if unit.is_finite() { libm::round(k[i] / unit) * unit } else { k[i] }
            }));
            if k != DVec3::ZERO {
                break k;
            }
        };
        let direction = k.normalize();
        let scale = if flat { 2.0 } else { 1.5 };
        let c = params.rms_speed_um_s * libm::sqrt(scale / f64::from(params.modes));
        // In 2-D only the z component of xi is used.
        let mut amplitude = || {
            let xi = vector();
            (if flat { DVec3::Z * xi.z } else { xi }).cross(direction) * c
        };
        let (a, b) = (amplitude(), amplitude());
        let omega = params.unsteadiness * params.rms_speed_um_s * k.length() * vector().x;
        Mode { k, omega, a, b }
    }
}

impl Block {
    /// A block of up to [`LANES`] modes; unused lanes have zero amplitude.
    fn of(modes: &[Mode]) -> Block {
        let mut block = Block::default();
        for (lane, mode) in modes.iter().enumerate() {
            for i in 0..3 {
                block.k[i][lane] = mode.k[i];
                block.a[i][lane] = mode.a[i];
                block.b[i][lane] = mode.b[i];
            }
            block.omega[lane] = mode.omega;
        }
        block
    }

    /// Sines and cosines of the phases at `x` (um) and `t` (s).
    #[inline(always)]
    fn waves(&self, x: DVec3, t: f64) -> ([f64; LANES], [f64; LANES]) {
        let mut phases = [0.0; LANES];
        for (i, phase) in phases.iter_mut().enumerate() {
            *phase = self.k[0][i] * x.x + self.k[1][i] * x.y + self.k[2][i] * x.z + self.omega[i] * t;
        }
        sines_and_cosines(&phases)
    }
}

/// The sum over the lanes, in a fixed order.
#[inline(always)]
fn total(lanes: [[f64; LANES]; 3]) -> DVec3 {
    DVec3::from_array(lanes.map(|mut lane| {
        let mut half = LANES / 2;
        while half > 0 {
            for i in 0..half {
                lane[i] += lane[i + half];
            }
            half /= 2;
        }
        lane[0]
    }))
}

impl VelocityField for Kraichnan {
    facts!(divergence_free);

    fn velocity(&self, x: DVec3, t: f64) -> DVec3 {
        // The widest vector instructions of this machine; the sums are the same bit for bit.
        pulp::Arch::new().dispatch(VelocitySum(self, x, t))
    }

    fn gradient(&self, x: DVec3, t: f64) -> DMat3 {
        pulp::Arch::new().dispatch(GradientSum(self, x, t))
    }

    fn is_steady(&self) -> bool {
        self.steady
    }

    fn max_speed(&self, _region: &Region, _t0: f64, _t1: f64) -> f64 {
        self.bound * ROUNDING_MARGIN
    }
}

/// The velocity at a position (um) and time (s), compiled for every vector instruction set.
struct VelocitySum<'a>(&'a Kraichnan, DVec3, f64);

impl pulp::WithSimd for VelocitySum<'_> {
    type Output = DVec3;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> DVec3 {
        self.0.sum(self.1, self.2)
    }
}

/// The gradient at a position (um) and time (s), compiled for every vector instruction set.
struct GradientSum<'a>(&'a Kraichnan, DVec3, f64);

impl pulp::WithSimd for GradientSum<'_> {
    type Output = DMat3;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> DMat3 {
        self.0.gradient_sum(self.1, self.2)
    }
}

impl Kraichnan {
    #[inline(always)]
    fn sum(&self, x: DVec3, t: f64) -> DVec3 {
        let mut sums = [[0.0; LANES]; 3];
        for block in &self.blocks {
            let (sin, cos) = block.waves(x, t);
            for ((sum, a), b) in sums.iter_mut().zip(&block.a).zip(&block.b) {
                for i in 0..LANES {
                    sum[i] += a[i] * cos[i] + b[i] * sin[i];
                }
            }
        }
        total(sums)
    }

    #[inline(always)]
    fn gradient_sum(&self, x: DVec3, t: f64) -> DMat3 {
        let mut columns = [[[0.0; LANES]; 3]; 3];
        for block in &self.blocks {
            let (sin, cos) = block.waves(x, t);
            for (column, k) in columns.iter_mut().zip(&block.k) {
                for ((sum, a), b) in column.iter_mut().zip(&block.a).zip(&block.b) {
                    for i in 0..LANES {
                        sum[i] += (b[i] * cos[i] - a[i] * sin[i]) * k[i];
                    }
                }
            }
        }
        let [x, y, z] = columns.map(total);
        DMat3::from_cols(x, y, z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn params(dimensions: u32, seed: u64) -> KraichnanParams {
        KraichnanParams { dimensions, seed, ..Default::default() }
    }

    #[test]
    fn every_component_has_the_mean_square_asked_for() {
        for dimensions in [2, 3] {
            let mut squares = [0.0; 3];
            let mut energy = Vec::new();
            for seed in 0..200 {
                let field = Kraichnan::new(&params(dimensions, seed)).unwrap();
                let mut own = DVec3::ZERO;
                for i in 0..100 {
                    let i = f64::from(i);
                    let u = field.velocity(DVec3::new(73.0 * i, 41.0 * i, 59.0 * i), 0.0) / 300.0;
                    own += u * u / 100.0;
                }
                for (sum, square) in squares.iter_mut().zip(own.to_array()) {
                    *sum += square / 200.0;
                }
                energy.push(own.element_sum());
            }
            // 200 seeds with 100 positions each; the energy varies by about 10 % from seed to seed.
            for square in &squares[..dimensions as usize] {
                assert!((square - 1.0).abs() < 0.04, "{dimensions}: {squares:?}");
            }
            assert!(dimensions == 3 || squares[2] == 0.0);
        }
    }

    #[test]
    fn wave_numbers_follow_the_spectrum() {
        // (k0/2)^2 chi^2_5 has the mean 5/4 k0^2 and the standard deviation sqrt(10)/4 k0^2.
        let field = Kraichnan::new(&KraichnanParams { modes: 20_000, ..Default::default() }).unwrap();
        let k0 = 2.0 * PI / 100.0;
        let squares = field.blocks.iter().flat_map(|block| {
            (0..LANES).map(move |i| (0..3).map(|axis| block.k[axis][i] * block.k[axis][i]).sum::<f64>())
        });
        let mean = squares.sum::<f64>() / 20_000.0 / (k0 * k0);
        assert!((mean - 1.25).abs() < 4.0 * 0.79 / 141.0, "{mean}");
        // Isotropy: a third along every axis, with a standard deviation of about 0.5.
        for axis in 0..3 {
            let along: f64 = field.blocks.iter().flat_map(|block| block.k[axis]).map(|k| k * k).sum::<f64>();
            assert!((along / 20_000.0 / (k0 * k0) - 1.25 / 3.0).abs() < 4.0 * 0.6 / 141.0);
        }
    }

    #[test]
    fn a_periodic_field_repeats() {
        let periodic = KraichnanParams { period_um: [400.0, 0.0, 200.0], ..params(3, 5) };
        let field = Kraichnan::new(&periodic).unwrap();
        let x = DVec3::new(12.0, 34.0, 56.0);
        let again = field.velocity(x + DVec3::new(800.0, 0.0, -200.0), 0.0);
        // Rounding errors of phases of about 100 rad are 1e-14.
        assert!((again - field.velocity(x, 0.0)).length() < 1e-9);
        let gradient = field.gradient(x, 0.0);
        assert!((0..3).map(|i| gradient.col(i)[i]).sum::<f64>().abs() < 1e-12);
    }

    #[test]
    fn wide_vectors_give_the_same_bits() {
        let field = Kraichnan::new(&params(3, 9)).unwrap();
        for i in 0..100 {
            let (x, t) = (DVec3::new(3.1, -2.7, 1.9) * f64::from(i), 0.01 * f64::from(i));
            assert_eq!(field.velocity(x, t), field.sum(x, t));
            assert_eq!(field.gradient(x, t), field.gradient_sum(x, t));
        }
    }

    #[test]
    fn fewer_modes_are_the_first_and_seeds_differ() {
        let few = Kraichnan::new(&KraichnanParams { modes: 16, ..params(3, 1) }).unwrap();
        let more = Kraichnan::new(&KraichnanParams { modes: 32, ..params(3, 1) }).unwrap();
        assert_eq!(few.blocks[0].k, more.blocks[0].k);
        assert_ne!(few, Kraichnan::new(&KraichnanParams { modes: 16, ..params(3, 2) }).unwrap());
    }

    #[test]
    fn impossible_fields_are_refused() {
        let message = Kraichnan::new(&params(4, 1)).unwrap_err().to_string();
        assert_eq!(message, "kraichnan: dimensions = 4: expected a number from 2 to 3");
        assert!(Kraichnan::new(&KraichnanParams { period_um: [30.0, 0.0, 0.0], ..params(3, 1) }).is_err());
    }
}
