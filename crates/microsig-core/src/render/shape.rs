//! Images of spheroids with derivatives with respect to position, axis and aspect ratio: for fits and bounds of
//! precision. Where images of points come from tables, images of spheroids are sums of them.
//!
//! The symmetric matrix A = I + (e - 1) n n^T takes the unit sphere to the spheroid with the axis n and the aspect ratio
//! e. A surface emits where it faces the lens: its normal is A^-1 s, so these are the points s of the hemisphere about
//! A^-1 z. Emitters keep their places on that hemisphere while axis and aspect ratio change, so an image is a smooth
//! function of both.

use glam::{DMat2, DVec3};

use super::patch::Window;
use super::waves::spheroid::kink;
use super::waves::{Emission, bead};
use crate::emission::area_ratio;
use crate::particle::{Particle, Spheroid};

/// Number of values of a pixel: light, and its derivatives.
pub(super) const VALUES: usize = 7;

/// The noise-free image of one spheroid at brightness 1 with its derivatives.
#[derive(Debug, Clone, PartialEq)]
pub struct ShapeGradient {
    /// Where on the sensor.
    pub window: Window,
    /// For each pixel, row by row: counts, and their derivatives with respect to x (1/px), y (1/px), z (1/um), to turns
    /// of the axis toward the two directions of `turns` (1/rad), and to the logarithm of the aspect ratio.
    pub pixels: Vec<[f64; VALUES]>,
    /// Unit vectors perpendicular to the axis and to each other (x right, y down, z away from the lens).
    pub turns: [DVec3; 2],
}

/// What emits the light of a spheroid, and how its points are imaged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpheroidLight {
    /// All light toward the lens, in rays.
    pub light: f64,
    /// Whether the surface (uniformly per area) or the volume emits.
    pub emission: Emission,
    /// Largest wave number across the optical axis times the longest semi-axis.
    pub rim_phase: f64,
    /// Displacement in the image for a displacement in x and y, px/um.
    pub magnification: DMat2,
}

/// A point that emits, with its derivatives with respect to the two turns and the logarithm of the aspect ratio.
#[derive(Debug, Clone, Copy)]
pub(super) struct ShapeEmitter {
    /// Offset from the center of the spheroid, um (x right, y down, z away from the lens).
    pub(super) offset_um: DVec3,
    pub(super) offset_by: [DVec3; 3],
    /// Share of the light.
    pub(super) share: f64,
    pub(super) share_by: [f64; 3],
}

/// Half the difference of angles (rad) and logarithms over which places of emitters are differentiated.
const STEP: f64 = 1e-4;

/// Emitters around a ring in addition to two for each period of the finest detail.
const MORE_AROUND: f64 = 12.0;

/// Depths of emitters in addition to those that images need: derivatives need more.
const MORE_RINGS: usize = 4;

/// The emitters of a spheroid, and the directions of its turns.
pub(super) fn emitters(
    d_um: f64,
    spheroid: &Spheroid,
    of: &SpheroidLight,
) -> (Vec<ShapeEmitter>, [DVec3; 2]) {
    let (axis, e_p) = (DVec3::from_array(spheroid.axis()).normalize(), spheroid.e_p);
    let (u, v) = axis.any_orthonormal_pair();
    let numbers = Numbers { rim_phase: of.rim_phase, rings: MORE_RINGS, around: MORE_AROUND };
    let cloud = Cloud::new(0.5 * d_um, axis, e_p, of.emission, numbers);
    let at = |turn: DVec3, stretch: f64| cloud.points((axis + turn).normalize(), e_p * libm::exp(stretch));
    let pairs = [(u, 0.0), (v, 0.0), (DVec3::ZERO, 1.0)]
        .map(|(turn, stretch)| [-STEP, STEP].map(|by| at(by * turn, by * stretch)));
    let emitters = at(DVec3::ZERO, 0.0).into_iter().enumerate().map(|(k, (offset_um, share))| ShapeEmitter {
        offset_um,
        offset_by: std::array::from_fn(|p| (pairs[p][1][k].0 - pairs[p][0][k].0) / (2.0 * STEP)),
        share,
        share_by: std::array::from_fn(|p| (pairs[p][1][k].1 - pairs[p][0][k].1) / (2.0 * STEP)),
    });
    (emitters.collect(), [u, v])
}

/// Half the distance between the two images of a difference: px, px, um, rad, rad, and of the logarithm.
const STEPS: [f64; VALUES - 1] = [0.25, 0.25, 0.5, 0.05, 0.05, 0.05];

/// The image of a spheroid with derivatives by differences; `draw`: light of a particle on the pixels of the window.
pub(super) fn by_differences(
    window: Window,
    particle: &Particle,
    draw: impl Fn(&Particle) -> Vec<f32>,
) -> Option<ShapeGradient> {
    let spheroid = particle.spheroid?;
    let axis = DVec3::from_array(spheroid.axis());
    let (u, v) = axis.any_orthonormal_pair();
    let mut pixels: Vec<[f64; VALUES]> = vec![[0.0; VALUES]; window.area()];
    pixels.iter_mut().zip(draw(particle)).for_each(|(pixel, light)| pixel[0] = f64::from(light));
    for (p, step) in STEPS.into_iter().enumerate() {
        let at = |by: f64| {
            let (mut moved, mut axis, mut e_p) = (*particle, axis, spheroid.e_p);
            match p {
                0 => moved.x_px += by,
                1 => moved.y_px += by,
                2 => moved.z_um += by,
                3 => axis += by * u,
                4 => axis += by * v,
                _ => e_p *= libm::exp(by),
            }
            draw(&Particle { spheroid: Some(Spheroid::from_axis(e_p, axis.to_array())), ..moved })
        };
        for ((pixel, low), high) in pixels.iter_mut().zip(at(-step)).zip(at(step)) {
            pixel[1 + p] = f64::from(high - low) / (2.0 * step);
        }
    }
    Some(ShapeGradient { window, pixels, turns: [u, v] })
}

/// Relative change of the light of a spheroid of constant emission per area with the logarithm of its aspect ratio.
pub(super) fn light_by_aspect(e_p: f64) -> f64 {
    let [low, high] = [-STEP, STEP].map(|by| libm::log(area_ratio(e_p * libm::exp(by))));
    (high - low) / (2.0 * STEP)
}

/// Density of the emitters: `rings` and `around` are added to the numbers of rings, and of emitters on each, that
/// resolve the phase `rim_phase` (rad) at the rim of the pupil.
#[derive(Debug, Clone, Copy)]
pub(super) struct Numbers {
    pub(super) rim_phase: f64,
    pub(super) rings: usize,
    pub(super) around: f64,
}

/// Emitters on or in the unit sphere.
pub(super) struct Cloud {
    emission: Emission,
    radius_um: f64,
    /// The direction about which they are for the spheroid itself, and two directions across it.
    away: DVec3,
    across: [DVec3; 2],
    /// Place along the direction, distance from it, share of the light, and azimuth.
    places: Vec<[f64; 4]>,
}

impl Cloud {
    /// For spheroids about this one.
    pub(super) fn new(radius_um: f64, axis: DVec3, e_p: f64, emission: Emission, numbers: Numbers) -> Self {
        let mut places = Vec::new();
        let rings = bead::rings(emission, 1.0, numbers.rim_phase, numbers.rings);
        for (k, ring) in rings.into_iter().enumerate() {
            let around = 2.0 * numbers.rim_phase * ring.radius_um + numbers.around;
            let n = libm::ceil(kink(e_p) * around);
            let first = if k % 2 == 0 { 0.0 } else { 0.5 };
            places.extend((0..n as usize).map(|i| {
                let azimuth = (i as f64 + first) * std::f64::consts::TAU / n;
                [ring.depth_um, ring.radius_um, ring.weight / n, azimuth]
            }));
        }
        let away = away(axis, e_p);
        let (right, down) = away.any_orthonormal_pair();
        Cloud { emission, radius_um, away, across: [right, down], places }
    }

    /// Offsets (um) and shares of the emitters of a spheroid with this axis and aspect ratio.
    pub(super) fn points(&self, axis: DVec3, e_p: f64) -> Vec<(DVec3, f64)> {
        let away = away(axis, e_p);
        let [right, down] = self.across.map(|across| turned(across, self.away, away));
        let is_surface = self.emission == Emission::Surface;
        let mut points: Vec<(DVec3, f64)> = (self.places.iter())
            .map(|&[depth, radius, share, azimuth]| {
                let (sine, cosine) = libm::sincos(azimuth);
                let s = depth * away + radius * (cosine * right + sine * down);
                let along = s.dot(axis);
                let area = libm::sqrt(1.0 + (1.0 / (e_p * e_p) - 1.0) * along * along);
                let share = if is_surface { share * area } else { share };
                (self.radius_um * (s + (e_p - 1.0) * along * axis), share)
            })
            .collect();
        let total: f64 = points.iter().map(|(_, share)| share).sum();
        points.iter_mut().for_each(|(_, share)| *share /= total);
        points
    }
}

/// The direction of the hemisphere that does not face the lens once it is stretched: A^-1 z, of length 1.
fn away(axis: DVec3, e_p: f64) -> DVec3 {
    (DVec3::Z + (1.0 / e_p - 1.0) * axis.z * axis).normalize()
}

/// A vector after the smallest rotation that takes the unit vector `from` to `to`.
fn turned(v: DVec3, from: DVec3, to: DVec3) -> DVec3 {
    let about = from.cross(to);
    let first = about.cross(v);
    v + first + about.cross(first) / (1.0 + from.dot(to))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emission::SpheroidLaw;
    use crate::particle::Particle;
    use crate::render::waves::{Cylinder, Lens, PupilFunction, WaveOptics, WavesRenderer};
    use crate::render::{ExpectedRenderer, Render};
    use crate::settings::Settings;

    fn settings() -> Settings {
        Settings { pixel_dim_x: 121, pixel_dim_y: 121, points_per_pixel: 20.0, ..Settings::setting1() }
    }

    fn rods() -> [Particle; 4] {
        let of = |e_p: f64, d_um: f64, z_um: f64, axis: [f64; 3]| Particle {
            spheroid: Some(Spheroid::from_axis(e_p, axis)),
            ..Particle::sphere(60.7, 61.2, z_um, d_um)
        };
        [
            of(2.0, 1.4, -9.0, [0.7, 0.3, 0.6]),
            of(3.0, 1.2, 5.0, [0.2, 0.9, -0.5]),
            of(0.4, 2.0, -7.0, [0.5, 0.2, 0.8]),
            of(2.0, 1.4, -4.0, [0.0, 0.0, 1.0]),
        ]
    }

    fn waves(emission: Emission) -> WavesRenderer {
        let optics = WaveOptics { lens: Lens::Aplanatic, emission, ..WaveOptics::new(0.52) };
        // Light is in whole points, which differences would show.
        let settings = Settings { points_per_pixel: 1e4, ..settings() };
        WavesRenderer::new(&settings, &optics, 1e-3).unwrap()
    }

    #[test]
    fn images_are_those_that_are_drawn() {
        let expected = ExpectedRenderer::new(&settings(), SpheroidLaw::Original, 1e-3).unwrap();
        let renderers: [&dyn Render; 3] = [&waves(Emission::Surface), &waves(Emission::Volume), &expected];
        for renderer in renderers {
            for particle in rods() {
                let drawn = renderer.mean_patch(&particle).unwrap();
                let ours = renderer.shape_gradient(&particle, Some(drawn.window)).unwrap();
                let peak = drawn.counts.iter().copied().fold(0.0, f64::max);
                let off =
                    drawn.counts.iter().zip(&ours.pixels).map(|(a, b)| (a - b[0]).abs()).fold(0.0, f64::max);
                assert!(off < 0.004 * peak, "{} {particle:?}: {}", renderer.traits().name, off / peak);
            }
        }
    }

    #[test]
    fn round_optics_turn_images_with_their_particles() {
        let lens = WaveOptics { lens: Lens::Aplanatic, ..WaveOptics::new(0.52) };
        let cylinder = Some(Cylinder { focal_length_mm: 100.0, to_sensor_mm: 40.0 });
        let astigmatic = PupilFunction { zernike: vec![(6, 0.3)], ..PupilFunction::default() };
        let waves = |optics: WaveOptics| WavesRenderer::new(&settings(), &optics, 0.01).unwrap();
        let rays =
            |settings: Settings| ExpectedRenderer::new(&settings, SpheroidLaw::Uniform, 0.003).unwrap();
        let behind = Settings { cyl_focal_length: Settings::setting1a().cyl_focal_length, ..settings() };
        let renderers: [(&dyn Render, bool); 5] = [
            (&rays(settings()), true),
            (&rays(behind), false),
            (&waves(lens.clone()), true),
            (&waves(WaveOptics { cylinder, ..lens.clone() }), false),
            (&waves(WaveOptics { pupil: astigmatic, ..lens }), false),
        ];
        for (renderer, is_round) in renderers {
            assert_eq!(renderer.traits().is_round, is_round);
            let side = 61;
            let window = Window { x0: 31, y0: 31, width: side, height: side };
            let [along, down] = [[0.9, 0.0, 0.3], [0.0, 0.9, 0.3]].map(|axis| {
                let spheroid = Some(Spheroid::from_axis(3.0, axis));
                let rod = Particle { spheroid, ..Particle::sphere(61.0, 61.0, -8.0, 2.0) };
                renderer.mean_patch(&rod).unwrap().on(window)
            });
            let peak = along.iter().copied().fold(0.0, f64::max);
            let turned = |i: usize| along[(side - 1 - i % side) * side + i / side];
            let off = (0..side * side).map(|i| (turned(i) - down[i]).abs()).fold(0.0, f64::max) / peak;
            assert_eq!(off < 0.02, is_round, "{}: {off}", renderer.description().optics);
        }
    }

    /// Derivatives of sums of emitters are those of the images themselves, to 1e-3 of the largest one; that with respect
    /// to the aspect ratio, to 4e-3: emitters are as many as images need, and their number changes with it.
    #[test]
    fn derivatives_are_those_of_the_image() {
        let renderer = waves(Emission::Surface);
        for particle in rods() {
            let at = renderer.shape_gradient(&particle, None).unwrap();
            let shape = particle.spheroid.unwrap();
            let axis = DVec3::from_array(shape.axis());
            let moved = |p: usize, by: f64| {
                let (mut moved, mut axis, mut e_p) = (particle, axis, shape.e_p);
                match p {
                    0 => moved.x_px += by,
                    1 => moved.y_px += by,
                    2 => moved.z_um += by,
                    3 | 4 => axis += by * at.turns[p - 3],
                    _ => e_p *= libm::exp(by),
                }
                moved.spheroid = Some(Spheroid::from_axis(e_p, axis.to_array()));
                renderer.shape_gradient(&moved, Some(at.window)).unwrap()
            };
            for (p, step) in [0.01, 0.01, 0.01, 0.003, 0.003, 0.01].into_iter().enumerate() {
                let tolerance = if p == 5 { 4e-3 } else { 1e-3 };
                let (low, high) = (moved(p, -step), moved(p, step));
                let (mut worst, mut most) = (0.0f64, 0.0f64);
                for ((low, high), at) in low.pixels.iter().zip(&high.pixels).zip(&at.pixels) {
                    worst = worst.max(((high[0] - low[0]) / (2.0 * step) - at[1 + p]).abs());
                    most = most.max(at[1 + p].abs());
                }
                assert!(
                    worst < tolerance * most,
                    "{particle:?}, parameter {p}: {} of the largest",
                    worst / most
                );
            }
        }
    }
}
