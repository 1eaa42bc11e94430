//! The pupil function of an objective for an emitter at a given depth.
//!
//! MicroSIG's lens is not a system of surfaces whose optical paths could be summed: the deflection depends on
//! a ray's own slope. For a point on the axis, however, the slopes behind the lens are radial, so their
//! integral exists and reproduces every ray; it is used as the phase. The pupil coordinate is the sine, sigma
//! = q / sqrt(1 + (q / a0)^2), with q the radius in the lens plane and a0 the distance of the plane in focus
//! (Abbe's sine condition), which gives the textbook Airy radius. The phase of the aplanatic lens is the
//! optical path of Gibson and Lanni.

use super::cylinder::Cylinder;
use super::options::{Layers, Lens};
use super::quadrature;
use crate::optics::{OpticalSystem, Ray};
use crate::quadrature::gauss_legendre_on;
use crate::settings::Settings;

/// Number of rays in a fan.
const STATIONS: usize = 48;

/// Half the distance of the source points for the derivative across the axis, um.
const OFFSET_UM: f64 = 0.02;

/// The pupil is truncated where rays land beyond this multiple of the largest radius that is rendered ...
const BEYOND: f64 = 3.0;
/// ... with a taper over this fraction of its radius.
const TAPER: f64 = 0.1;

/// The aplanatic lens accepts light up to this fraction of the largest sine in the medium.
const GRAZING: f64 = 0.999;

/// Number of radii at which the end of the pupil is searched.
const STOPS: usize = 256;

/// Objective, cylindrical lens and layers.
#[derive(Debug, Clone)]
pub(super) struct Pupil {
    pub(super) system: OpticalSystem,
    lens: Lens,
    layers: Option<Layers>,
    /// A cylindrical lens before the camera.
    cylinder: Option<Behind>,
    /// Radius of the aperture in the lens plane, um; for the aplanatic lens, in the coordinate sigma.
    aperture: f64,
    /// Transmission at the rim less that at the center.
    transmission: f64,
}

/// What a cylindrical lens before the camera does in the direction of its power.
#[derive(Debug, Clone, Copy)]
struct Behind {
    /// Magnification there over that across it.
    growth: f64,
    /// Depth of the plane in focus, in air, um.
    focus_um: f64,
}

/// Radii at which the pupil function is evaluated.
#[derive(Debug, Clone)]
pub(super) struct Radii {
    /// Radii in the lens plane, um; for the aplanatic lens equal to sigma.
    pub(super) q: Vec<f64>,
    pub(super) sigma: Vec<f64>,
    /// d sigma / dq.
    pub(super) stretch: Vec<f64>,
    /// K, the integral of q over sigma, um^2.
    pub(super) curvature: Vec<f64>,
    /// Radius of the outermost ray of the fan, um.
    end: f64,
    /// Matrix from the rays of a fan to running integrals at the radii.
    running: Vec<f64>,
}

/// The pupil function at some radii.
#[derive(Debug, Clone)]
pub(super) struct Fan {
    /// Optical path S without a cylindrical lens, um.
    pub(super) phase: Vec<f64>,
    /// Amplitude A, 1/um: A^2 d^2 sigma is a fraction of the light emitted into the half space.
    pub(super) amplitude: Vec<f64>,
    /// H / b: derivative of the phase with respect to the emitter's offset from the axis, along the same
    /// azimuth.
    pub(super) off_axis: Vec<f64>,
}

impl Pupil {
    pub(super) fn new(settings: &Settings, lens: Lens, layers: Option<Layers>) -> Pupil {
        let system = OpticalSystem::new(settings);
        let aperture = match lens {
            // Slightly smaller, so that no ray is lost by rounding.
            Lens::Microsig => system.objective.aperture_radius * (1.0 - 1e-12),
            Lens::Aplanatic => {
                let n_s = layers.map_or(1.0, |layers| layers.n_s);
                settings.numerical_aperture.min(GRAZING * n_s) * system.objective.object_distance_0
            }
        };
        Pupil { system, lens, layers, cylinder: None, aperture, transmission: 0.0 }
    }

    /// The pupil with a cylindrical lens before the camera.
    pub(super) fn behind(self, cylinder: Option<Cylinder>, settings: &Settings) -> Pupil {
        let focus_um = |cylinder: Cylinder| cylinder.focus_um(settings.magnification);
        let cylinder = cylinder.map(|lens| Behind { growth: lens.growth(), focus_um: focus_um(lens) });
        Pupil { cylinder, ..self }
    }

    /// The pupil with this transmission at its rim, less that at its center.
    pub(super) fn transmitting(self, transmission: f64) -> Pupil {
        Pupil { transmission, ..self }
    }

    /// Whether there is a cylindrical lens, MicroSIG's or one before the camera.
    pub(super) fn has_cylinder(&self) -> bool {
        self.system.cylinder.is_some() || self.cylinder.is_some()
    }

    /// B (um) of Collins's integral across a cylindrical lens before the camera or in the direction of its
    /// power, whichever magnifies more; otherwise b.
    pub(super) fn widest(&self) -> f64 {
        self.b() * self.cylinder.map_or(1.0, |cylinder| cylinder.growth.max(1.0))
    }

    /// Distance from the plane in focus to the lens, um.
    fn a0(&self) -> f64 {
        self.system.objective.object_distance_0
    }

    /// Distance from the lens to the sensor, um.
    pub(super) fn b(&self) -> f64 {
        self.system.objective.image_distance
    }

    /// The pupil coordinate sigma, um, at a radius in the lens plane, um.
    pub(super) fn sigma(&self, q: f64) -> f64 {
        match self.lens {
            Lens::Microsig => q / libm::sqrt(1.0 + (q / self.a0()) * (q / self.a0())),
            Lens::Aplanatic => q,
        }
    }

    /// The radius in the lens plane, um, at a pupil coordinate sigma, um.
    pub(super) fn q(&self, sigma: f64) -> f64 {
        match self.lens {
            Lens::Microsig => sigma / libm::sqrt(1.0 - (sigma / self.a0()) * (sigma / self.a0())),
            Lens::Aplanatic => sigma,
        }
    }

    /// Radius of the full pupil in the coordinate sigma, um.
    pub(super) fn radius(&self) -> f64 {
        self.sigma(self.aperture)
    }

    /// Radius of the full pupil in the lens plane, um.
    pub(super) fn aperture(&self) -> f64 {
        self.aperture
    }

    /// Prepares the evaluation at radii `q` in the lens plane (um), none of which exceeds `end`.
    pub(super) fn radii(&self, q: Vec<f64>, end: f64) -> Radii {
        let a0 = self.a0();
        let sigma: Vec<f64> = q.iter().map(|&q| self.sigma(q)).collect();
        let stretch = |&q: &f64| {
            let tangent2 = (q / a0) * (q / a0);
            1.0 / ((1.0 + tangent2) * libm::sqrt(1.0 + tangent2))
        };
        let (stretch, curvature) = match self.lens {
            Lens::Microsig => (
                q.iter().map(stretch).collect(),
                // a0^2 (1 - sqrt(1 - s^2)), without cancellation.
                sigma.iter().map(|s| s * s / (1.0 + libm::sqrt(1.0 - (s / a0) * (s / a0)))).collect(),
            ),
            Lens::Aplanatic => (vec![1.0; q.len()], sigma.iter().map(|s| 0.5 * s * s).collect()),
        };
        let running = match self.lens {
            Lens::Microsig => quadrature::running_integral(end, STATIONS, &q),
            Lens::Aplanatic => Vec::new(),
        };
        Radii { q, sigma, stretch, curvature, end, running }
    }

    /// Depth in the space of MicroSIG's lens, um: with layers, of the paraxial image of the emitter.
    fn optical_depth(&self, z_um: f64) -> f64 {
        self.layers.map_or(z_um, |layers| z_um / layers.n_s)
    }

    /// Distance from an emitter at this depth to the lens, um.
    fn distance(&self, z_um: f64) -> f64 {
        self.system.objective.object_distance(self.optical_depth(z_um))
    }

    /// Whether an emitter at this depth is in front of the lens, if that is MicroSIG's.
    pub(super) fn sees(&self, z_um: f64) -> bool {
        self.lens == Lens::Aplanatic || self.distance(z_um) > 0.0
    }

    /// Slope behind the lens of the ray through the radius `q` from an emitter at `offset` from the axis;
    /// `None` if the ray is lost.
    fn slope(&self, distance: f64, offset: f64, q: f64) -> Option<f64> {
        let ray = Ray { q_x: q, q_y: 0.0, p_x: (q - offset) / distance, p_y: 0.0 };
        self.system.objective.refract(ray).map(|behind| behind.p_x)
    }

    /// Landing position (um from the axis) of light through the radius `q`: without a cylindrical lens, and
    /// in the direction in which it has power.
    pub(super) fn landing(&self, z_um: f64, q: f64) -> Option<[f64; 2]> {
        let b = self.b();
        match self.lens {
            Lens::Microsig => {
                let slope = self.slope(self.distance(z_um), 0.0, q)? + self.layer_slope(z_um, q);
                let [ax, bx] = self.across();
                Some([q + b * slope, ax * q + bx * slope])
            }
            Lens::Aplanatic => {
                let slope = self.aplanatic_slope(z_um, q);
                let [ax, bx] = self.across();
                Some([b * slope, bx * (slope + q * (ax / bx - 1.0 / b))])
            }
        }
    }

    /// A and B (um) of Collins's integral in the direction in which the cylindrical lens has power; without
    /// it, 1 and b.
    pub(super) fn across(&self) -> [f64; 2] {
        let (a0, b) = (self.a0(), self.b());
        if let Some(Behind { growth, focus_um }) = self.cylinder {
            // Images scale as b, and the path K (A/B - 1/b) moves the focus as a depth does.
            let bx = growth * b;
            return [bx * (focus_um / (a0 * a0) + 1.0 / b), bx];
        }
        self.system.cylinder.map_or([1.0, b], |cylinder| {
            let f = cylinder.focal_length;
            [1.0 - 2.0 * b / (3.0 * f), b - 2.0 * b * b / (9.0 * f)]
        })
    }

    /// Displacement on the sensor of the light of an emitter over its distance from the axis: in the
    /// direction in which a cylindrical lens has power, and across it.
    pub(super) fn magnifications(&self) -> [f64; 2] {
        let [_, bx] = self.across();
        [bx, self.b()].map(|b| -b / self.a0())
    }

    /// Length of the optical axis less its projection on the ray through the radius `q`, both in the
    /// medium, over a distance of 1: n_s (1 - cos).
    pub(super) fn sagitta(&self, q: f64) -> f64 {
        let n_s = self.layers.map_or(1.0, |layers| layers.n_s);
        let s = self.sigma(q) / self.a0();
        n_s - libm::sqrt((n_s * n_s - s * s).max(0.0))
    }

    /// Whether images depend on the distance from the axis.
    pub(super) fn has_coma(&self) -> bool {
        self.lens == Lens::Microsig
    }

    /// Derivative with respect to sigma of the optical path that layers add to MicroSIG's lens, by finite
    /// differences.
    fn layer_slope(&self, z_um: f64, q: f64) -> f64 {
        let Some(layers) = self.layers else { return 0.0 };
        let (a0, step) = (self.a0(), 1e-4 * self.aperture);
        let at = |sigma: f64| self.layer_path(&layers, z_um, sigma / a0);
        let sigma = self.sigma(q);
        (at(sigma + step) - at(sigma - step)) / (2.0 * step)
    }

    /// Optical path that layers add to MicroSIG's lens at the sine `s`, um.
    fn layer_path(&self, layers: &Layers, z_um: f64, s: f64) -> f64 {
        let h = layers.focus_depth_um + z_um;
        layers.path(s, h)
            - layers.path(0.0, h)
            - self.optical_depth(z_um) * (libm::sqrt((1.0 - s * s).max(0.0)) - 1.0)
    }

    /// Optical path of the aplanatic lens at index times sine `s`, um.
    fn aplanatic_phase(&self, z_um: f64, s: f64) -> f64 {
        match self.layers {
            None => z_um * (libm::sqrt((1.0 - s * s).max(0.0)) - 1.0),
            Some(layers) => {
                let h = layers.focus_depth_um + z_um;
                layers.path(s, h) - layers.path(0.0, h)
            }
        }
    }

    fn aplanatic_slope(&self, z_um: f64, sigma: f64) -> f64 {
        let (a0, step) = (self.a0(), 1e-4 * self.aperture);
        let at = |sigma: f64| self.aplanatic_phase(z_um, sigma / a0);
        // One-sided at the rim, beyond which the path may not exist.
        let (low, high) = (sigma - step, (sigma + step).min(self.aperture));
        (at(high) - at(low)) / (high - low)
    }

    /// Largest distance (um) at which rays up to the radius `end` of the lens plane land: across and along
    /// the direction in which a cylindrical lens has power.
    pub(super) fn farthest(&self, z_um: f64, end: f64) -> [f64; 2] {
        let mut far = [0.0f64; 2];
        for i in 0..=STOPS {
            if let Some(landing) = self.landing(z_um, end * i as f64 / STOPS as f64) {
                (0..2).for_each(|axis| far[axis] = far[axis].max(landing[axis].abs()));
            }
        }
        far
    }

    /// The radius in the lens plane, um, up to which light matters if only positions within `radius_um` on
    /// the sensor are rendered; `None`: the full aperture.
    pub(super) fn useful(&self, z_um: f64, radius_um: f64) -> Option<f64> {
        let stop = |i: usize| self.aperture * i as f64 / STOPS as f64;
        let refracted = (0..=STOPS).take_while(|&i| self.landing(z_um, stop(i)).is_some()).count() - 1;
        let is_near = |i: usize| {
            let landing = self.landing(z_um, stop(i)).unwrap_or([f64::INFINITY; 2]);
            landing[0].abs().min(landing[1].abs()) <= BEYOND * radius_um
        };
        let last = (0..=refracted).rev().find(|&i| is_near(i)).unwrap_or(0);
        if last == STOPS {
            return None;
        }
        // The taper must end within the part in which rays are refracted.
        let inside = stop(refracted.saturating_sub(1)) / (1.0 + TAPER);
        let within = if refracted == STOPS { f64::INFINITY } else { inside };
        Some(stop(last + 1).min(within))
    }

    /// Radius at which the taper outside a useful radius ends, um.
    pub(super) fn taper_end(&self, useful: Option<f64>) -> f64 {
        useful.map_or(self.aperture, |useful| ((1.0 + TAPER) * useful).min(self.aperture))
    }

    /// The fraction of the accepted light whose rays land within `radius_um` on the sensor.
    pub(super) fn share_within(&self, z_um: f64, radius_um: f64) -> f64 {
        let (q, weights) = gauss_legendre_on(0.0, self.aperture, STOPS);
        let radii = self.radii(q, self.aperture);
        let fan = self.fan(z_um, &radii, None);
        let (mut near, mut all) = (0.0, 0.0);
        for (i, weight) in weights.iter().enumerate() {
            let light = fan.amplitude[i] * fan.amplitude[i] * radii.sigma[i] * radii.stretch[i] * weight;
            all += light;
            if self.landing(z_um, radii.q[i]).is_some_and(|[x, _]| x.abs() < radius_um) {
                near += light;
            }
        }
        near / all
    }

    /// The pupil function for an emitter on the axis.
    pub(super) fn fan(&self, z_um: f64, radii: &Radii, useful: Option<f64>) -> Fan {
        let mut fan = match self.lens {
            Lens::Microsig => self.traced(z_um, radii),
            Lens::Aplanatic => self.corrected(z_um, radii),
        };
        if self.transmission != 0.0 {
            for (amplitude, sigma) in fan.amplitude.iter_mut().zip(&radii.sigma) {
                let rho = sigma / self.radius();
                *amplitude *= libm::sqrt((1.0 + self.transmission * rho * rho).max(0.0));
            }
        }
        if let Some(useful) = useful {
            for (amplitude, &q) in fan.amplitude.iter_mut().zip(&radii.q) {
                let beyond = ((q - useful) / (TAPER * useful)).clamp(0.0, 1.0);
                let cosine = libm::cos(0.5 * std::f64::consts::PI * beyond);
                *amplitude *= cosine * cosine;
            }
        }
        fan
    }

    fn traced(&self, z_um: f64, radii: &Radii) -> Fan {
        let (a0, b, a) = (self.a0(), self.b(), self.distance(z_um));
        let (stations, _) = gauss_legendre_on(0.0, radii.end, STATIONS);
        let (mut slopes, mut changes) = ([0.0; STATIONS], [0.0; STATIONS]);
        for (i, &q) in stations.iter().enumerate() {
            let tangent2 = (q / a0) * (q / a0);
            let stretch = 1.0 / ((1.0 + tangent2) * libm::sqrt(1.0 + tangent2));
            let at = |offset: f64| self.slope(a, offset, q).unwrap_or(0.0);
            slopes[i] = at(0.0) * stretch;
            changes[i] = (at(OFFSET_UM) - at(-OFFSET_UM)) / (2.0 * OFFSET_UM) * stretch;
        }
        let n = radii.q.len();
        let (mut phase, mut off_axis) = (Vec::with_capacity(n), Vec::with_capacity(n));
        for (row, curvature) in radii.running.chunks_exact(STATIONS).zip(&radii.curvature) {
            let (mut slope_integral, mut change_integral) = (0.0, 0.0);
            for ((weight, slope), change) in row.iter().zip(&slopes).zip(&changes) {
                slope_integral += weight * slope;
                change_integral += weight * change;
            }
            phase.push(slope_integral + curvature / b);
            off_axis.push(change_integral);
        }
        let light = |(&q, &stretch): (&f64, &f64)| {
            let r2 = a * a + q * q;
            let density = a / (2.0 * std::f64::consts::PI * r2 * libm::sqrt(r2));
            libm::sqrt(density * libm::sqrt(1.0 + (q / a0) * (q / a0)) / stretch)
        };
        let mut amplitude: Vec<f64> = radii.q.iter().zip(&radii.stretch).map(light).collect();
        if let Some(layers) = &self.layers {
            for ((phase, amplitude), sigma) in phase.iter_mut().zip(&mut amplitude).zip(&radii.sigma) {
                let s = sigma / a0;
                *phase += self.layer_path(layers, z_um, s);
                // Less light is collected from a medium of higher index.
                let n_s = layers.n_s;
                let collected = libm::sqrt(1.0 - s * s) / (n_s * libm::sqrt(n_s * n_s - s * s));
                *amplitude *= libm::sqrt(collected);
            }
        }
        Fan { phase, amplitude, off_axis }
    }

    fn corrected(&self, z_um: f64, radii: &Radii) -> Fan {
        let a0 = self.a0();
        let n_s = self.layers.map_or(1.0, |layers| layers.n_s);
        let phase = radii.sigma.iter().map(|sigma| self.aplanatic_phase(z_um, sigma / a0)).collect();
        let amplitude = |sigma: &f64| {
            let s = sigma / a0;
            let cosine = n_s * libm::sqrt(n_s * n_s - s * s);
            1.0 / (a0 * libm::sqrt(2.0 * std::f64::consts::PI * cosine))
        };
        Fan {
            phase,
            amplitude: radii.sigma.iter().map(amplitude).collect(),
            off_axis: radii.sigma.iter().map(|sigma| -sigma / a0).collect(),
        }
    }

    /// Range of optical paths over the pupil, um, including a cylindrical lens.
    pub(super) fn spread(&self, z_um: f64, end: f64) -> f64 {
        let [ax, bx] = self.across();
        self.spread_behind(z_um, end, ax / bx - 1.0 / self.b())
    }

    /// Range of optical paths over the full pupil, um, without a cylindrical lens.
    pub(super) fn own_spread(&self, z_um: f64) -> f64 {
        self.spread_behind(z_um, self.aperture, 0.0)
    }

    /// Range of optical paths, um, with the power (1/um) that a cylindrical lens adds along x.
    fn spread_behind(&self, z_um: f64, end: f64, power: f64) -> f64 {
        const PARTS: usize = 32;
        let radii = self.radii((0..=PARTS).map(|i| end * i as f64 / PARTS as f64).collect(), end);
        let fan = self.fan(z_um, &radii, None);
        let (mut low, mut high) = (0.0f64, 0.0f64);
        for (phase, curvature) in fan.phase.iter().zip(&radii.curvature) {
            for phase in [*phase, phase + power * curvature] {
                low = low.min(phase);
                high = high.max(phase);
            }
        }
        high - low
    }

    /// The fraction of the light emitted into the half space at depth `z_um` that the aperture accepts.
    pub(super) fn accepted(&self, z_um: f64) -> f64 {
        let (q, weights) = gauss_legendre_on(0.0, self.aperture, STATIONS);
        let radii = self.radii(q, self.aperture);
        let fan = self.fan(z_um, &radii, None);
        let ring = |i: usize| {
            let amplitude = fan.amplitude[i];
            amplitude * amplitude * radii.sigma[i] * radii.stretch[i] * weights[i]
        };
        2.0 * std::f64::consts::PI * (0..STATIONS).map(ring).sum::<f64>()
    }
}
