//! Light emission by a particle: source points on its surface, and a fan of rays from each point.
//!
//! Points lie on golden-angle spirals: point k has the azimuth k 2 pi (1 - 1/phi), phi = (1 + sqrt 5)/2, and
//! the polar cosines decrease in equal steps. The internal axes (e1, e2, e3) are as in `optics`: e1 points
//! away from the lens; the polar axis of both spirals is e3; azimuths run from +e1 toward +e2.
//!
//! The ray directions of a source point are a spiral of n_rays + 2 points without its poles, rotated about e3
//! by a random angle per source point and reflected into the half space toward the lens. These angles are the
//! only random element of the rays. Emission is thus isotropic over the half space toward the lens, not
//! Lambertian and not about the local surface normal; its total is (n_rays + 1)/n_rays of ideal isotropic
//! emission.

use crate::particle::{Particle, Spheroid};
use crate::settings::Settings;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A point on a particle's surface relative to its center, um, in internal axes.
pub type Point = [f64; 3];

/// Distribution of the source points over a spheroid's surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SpheroidLaw {
    /// As in MicroSIG's program: a stretched spiral, denser toward the poles; the points on the lens side of
    /// a plane through four extreme points emit, about half of them.
    #[default]
    Original,
    /// Uniform in area, as the paper describes it; of each pair of points mirrored at the center, the one
    /// whose surface normal faces the lens emits. With e_p = 1 this is the sphere.
    Uniform,
}

/// Maximum number of source points of a particle (16.7 million, far beyond any practical need); bounds
/// memory.
pub const MAX_POINTS: usize = 1 << 24;

/// Cosines and sines of the golden-angle azimuths k 2 pi (1 - 1/phi), extended on demand.
#[derive(Debug, Clone, Default)]
pub struct GoldenAzimuths {
    cos_sin: Vec<(f64, f64)>,
}

impl GoldenAzimuths {
    /// The first `n` azimuths as (cosine, sine).
    pub fn first(&mut self, n: usize) -> &[(f64, f64)] {
        self.cos_sin.extend((self.cos_sin.len()..n).map(|k| {
            let (sine, cosine) = libm::sincos(golden_azimuth(k));
            (cosine, sine)
        }));
        &self.cos_sin[..n]
    }
}

/// Azimuth of point k of a golden-angle spiral, rad.
pub fn golden_azimuth(k: usize) -> f64 {
    let golden_ratio = (1.0 + libm::sqrt(5.0)) / 2.0;
    k as f64 * (2.0 * std::f64::consts::PI * (1.0 - 1.0 / golden_ratio))
}

/// Number of source points on a sphere: points_per_pixel 2 pi (d_p M / px)^2, rounded.
pub fn sphere_points(settings: &Settings, d_um: f64) -> usize {
    libm::rint(unrounded_points(settings, d_um)) as usize
}

fn unrounded_points(settings: &Settings, d_um: f64) -> f64 {
    let image_diameter = d_um * settings.magnification / settings.pixel_size;
    settings.points_per_pixel * 2.0 * std::f64::consts::PI * image_diameter * image_diameter
}

/// Surface area of a spheroid relative to the sphere with its equatorial diameter.
pub fn area_ratio(e_p: f64) -> f64 {
    let eccentricity = libm::sqrt((1.0 - if e_p > 1.0 { 1.0 / (e_p * e_p) } else { e_p * e_p }).max(0.0));
    // Below this eccentricity both formulas lose digits, while (1 + 2 e_p) / 3 is accurate to 1e-9.
    if eccentricity < 1e-4 {
        (1.0 + 2.0 * e_p) / 3.0
    } else if e_p > 1.0 {
        0.5 * (1.0 + e_p / eccentricity * libm::asin(eccentricity))
    } else {
        0.5 * (1.0 + e_p * e_p / eccentricity * libm::atanh(eccentricity))
    }
}

/// Number of points on the surface of a particle (of a spheroid's, only about half emit).
pub fn surface_points(settings: &Settings, particle: &Particle) -> usize {
    let sphere = sphere_points(settings, particle.d_um);
    match particle.spheroid {
        None => sphere,
        Some(spheroid) => libm::rint(area_ratio(spheroid.e_p) * sphere as f64) as usize,
    }
}

/// The light of a particle emitted into the half space toward the lens, in rays, if all points of its surface
/// shine. A sphere too small for a single point, which rays cannot draw, has its fraction of one.
pub fn emitted_rays(settings: &Settings, particle: &Particle) -> f64 {
    let points = match surface_points(settings, particle) {
        0 => unrounded_points(settings, particle.d_um),
        n => n as f64,
    };
    points * (f64::from(settings.n_rays) + 1.0)
}

/// The source points of a particle with `n` points on its surface, in the order of their random angles.
pub fn shining_points(
    particle: &Particle,
    n: usize,
    law: SpheroidLaw,
    azimuths: &mut GoldenAzimuths,
    points: &mut Vec<Point>,
) {
    points.clear();
    let radius = particle.d_um / 2.0;
    let azimuths = azimuths.first(n);
    match (particle.spheroid, law) {
        (None, _) => sphere(radius, azimuths, points),
        (Some(s), SpheroidLaw::Original) => stretched_spiral(radius, &s, azimuths, points),
        (Some(s), SpheroidLaw::Uniform) if s.e_p == 1.0 => sphere(radius, azimuths, points),
        (Some(s), SpheroidLaw::Uniform) => area_uniform(radius, &s, azimuths, points),
    }
}

/// Polar cosine of point k of n, from +1 to -1, poles included.
fn polar_cosine(k: usize, n: usize) -> f64 {
    if n < 2 { 1.0 } else { 1.0 - 2.0 * k as f64 / (n - 1) as f64 }
}

fn spiral_point(cosine: f64, (cos_azimuth, sin_azimuth): (f64, f64)) -> Point {
    let sine = libm::sqrt((1.0 - cosine * cosine).max(0.0));
    [sine * cos_azimuth, sine * sin_azimuth, cosine]
}

/// Source points of a sphere: points on the far hemisphere are rotated about e3 to the hemisphere facing the
/// lens.
fn sphere(radius: f64, azimuths: &[(f64, f64)], points: &mut Vec<Point>) {
    points.extend(azimuths.iter().enumerate().map(|(k, &azimuth)| {
        let [e1, e2, e3] = spiral_point(polar_cosine(k, azimuths.len()), azimuth);
        let turn = if e1 > 0.0 { -radius } else { radius };
        [turn * e1, turn * e2, radius * e3]
    }));
}

/// Source points of MicroSIG's spheroid: the spiral of the sphere, stretched along its axis and rotated; the
/// points on the lens side of a plane emit.
fn stretched_spiral(radius: f64, spheroid: &Spheroid, azimuths: &[(f64, f64)], points: &mut Vec<Point>) {
    let rotation = Rotation::new(spheroid);
    points.extend(azimuths.iter().enumerate().map(|(k, &azimuth)| {
        let [e1, e2, e3] = spiral_point(polar_cosine(k, azimuths.len()), azimuth);
        rotation.apply([radius * e1, radius * e2, radius * spheroid.e_p * e3])
    }));
    if let Some(plane) = silhouette_plane(points) {
        points.retain(|p| p[0] < plane[0] * p[1] + plane[1] * p[2] + plane[2]);
    }
}

/// The plane e1 = c0 e2 + c1 e3 + c2 fitted by least squares to the points with smallest and largest e2 and
/// e3 (the first of ties), which are near the silhouette that separates the lens side from the far side.
fn silhouette_plane(points: &[Point]) -> Option<[f64; 3]> {
    let extreme = |axis: usize, sign: f64| {
        points.iter().copied().reduce(|best, p| if sign * p[axis] > sign * best[axis] { p } else { best })
    };
    let rim = [extreme(1, -1.0)?, extreme(1, 1.0)?, extreme(2, -1.0)?, extreme(2, 1.0)?];
    let mean = |axis: usize| rim.iter().map(|p| p[axis]).sum::<f64>() / 4.0;
    let [m1, m2, m3] = [mean(0), mean(1), mean(2)];
    let sum =
        |a: usize, ma: f64, b: usize, mb: f64| rim.iter().map(|p| (p[a] - ma) * (p[b] - mb)).sum::<f64>();
    let (s22, s33, s23) = (sum(1, m2, 1, m2), sum(2, m3, 2, m3), sum(1, m2, 2, m3));
    let (s12, s13) = (sum(0, m1, 1, m2), sum(0, m1, 2, m3));
    let determinant = s22 * s33 - s23 * s23;
    // One or two points do not define a plane; all of them emit.
    if determinant <= 0.0 {
        return None;
    }
    let c0 = (s12 * s33 - s13 * s23) / determinant;
    let c1 = (s13 * s22 - s12 * s23) / determinant;
    Some([c0, c1, m1 - c0 * m2 - c1 * m3])
}

/// Source points uniform in area; of each point and its mirror image through the center, the one facing the
/// lens emits.
fn area_uniform(radius: f64, spheroid: &Spheroid, azimuths: &[(f64, f64)], points: &mut Vec<Point>) {
    let rotation = Rotation::new(spheroid);
    let axial = AxialDistribution::new(spheroid.e_p);
    let e_p = spheroid.e_p;
    points.extend(azimuths.iter().enumerate().map(|(k, &azimuth)| {
        let [e1, e2, u] = spiral_point(axial.quantile(polar_cosine(k, azimuths.len())), azimuth);
        let point = rotation.apply([radius * e1, radius * e2, radius * e_p * u]);
        let normal = rotation.apply([e1, e2, u / e_p]);
        if normal[0] > 0.0 { [-point[0], -point[1], -point[2]] } else { point }
    }));
}

/// Rotates the symmetry axis from e3 to its orientation: by beta about e2, then by alpha about e3.
pub(crate) struct Rotation {
    sin_a: f64,
    cos_a: f64,
    sin_b: f64,
    cos_b: f64,
}

impl Rotation {
    pub(crate) fn new(spheroid: &Spheroid) -> Self {
        let (sin_a, cos_a) = libm::sincos(spheroid.alpha_rad);
        let (sin_b, cos_b) = libm::sincos(spheroid.beta_rad);
        Rotation { sin_a, cos_a, sin_b, cos_b }
    }

    pub(crate) fn apply(&self, [e1, e2, e3]: Point) -> Point {
        let tilted = e1 * self.cos_b + e3 * self.sin_b;
        [
            tilted * self.cos_a - e2 * self.sin_a,
            tilted * self.sin_a + e2 * self.cos_a,
            -e1 * self.sin_b + e3 * self.cos_b,
        ]
    }

    /// The rotation back.
    pub(crate) fn inverse(&self, [e1, e2, e3]: Point) -> Point {
        let tilted = e1 * self.cos_a + e2 * self.sin_a;
        [
            tilted * self.cos_b - e3 * self.sin_b,
            e2 * self.cos_a - e1 * self.sin_a,
            tilted * self.sin_b + e3 * self.cos_b,
        ]
    }
}

/// Distribution of the surface area of a spheroid along its axis: density sqrt(1 + (1/e^2 - 1) u^2) for u in
/// [-1, 1], in units of the semi-axis.
struct AxialDistribution {
    /// 1/e^2 - 1: negative for prolate spheroids.
    k2: f64,
    total: f64,
}

impl AxialDistribution {
    fn new(e_p: f64) -> Self {
        let k2 = 1.0 / (e_p * e_p) - 1.0;
        let mut distribution = AxialDistribution { k2, total: 1.0 };
        distribution.total = distribution.integral(1.0);
        distribution
    }

    fn density(&self, u: f64) -> f64 {
        libm::sqrt((1.0 + self.k2 * u * u).max(0.0))
    }

    /// Twice the integral of the density from 0 to u; odd in u.
    fn integral(&self, u: f64) -> f64 {
        let k = libm::sqrt(self.k2.abs());
        // Nearly a sphere: the density is 1 + k2 u^2 / 2 with an error of k2^2 / 8.
        if k < 1e-4 {
            return 2.0 * u + self.k2 * u * u * u / 3.0;
        }
        let inverse = if self.k2 < 0.0 { libm::asin((k * u).clamp(-1.0, 1.0)) } else { libm::asinh(k * u) };
        u * self.density(u) + inverse / k
    }

    /// The u below which the fraction (1 + s)/2 of the surface lies, s in [-1, 1].
    fn quantile(&self, s: f64) -> f64 {
        let target = s * self.total;
        let (mut low, mut high) = (-1.0, 1.0);
        let mut u = s;
        // Newton's method with a bracket: the integral is monotonic, so each step either converges or halves
        // the bracket.
        for _ in 0..60 {
            let excess = self.integral(u) - target;
            if excess > 0.0 {
                high = u;
            } else {
                low = u;
            }
            let newton = u - excess / (2.0 * self.density(u)).max(1e-300);
            let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
            if (next - u).abs() < 1e-15 {
                return next;
            }
            u = next;
        }
        u
    }
}

/// Directions of a fan before its random rotation: unit vectors (e1, e2, e3) of the spiral of n_rays + 2
/// points without its poles.
pub fn fan(n_rays: u32) -> impl Iterator<Item = [f64; 3]> {
    let n = n_rays as usize + 2;
    (1..n - 1).map(move |j| {
        let (sine, cosine) = libm::sincos(golden_azimuth(j));
        spiral_point(polar_cosine(j, n), (cosine, sine))
    })
}

/// Relative excess of the mean light that fans of `n_rays` rays emit into the aperture, compared with
/// (n_rays + 1)/n_rays times the isotropic one, for the in-focus point on the axis.
///
/// All fans have the same polar cosines; a direction with the polar sine s is within an aperture of half
/// angle theta for a fraction (2/pi) acos(cos theta / s) of all rotation angles. Few directions sample this
/// coarsely: the excess decreases as (n_rays NA)^-1.5.
pub fn aperture_excess(n_rays: u32, numerical_aperture: f64) -> f64 {
    let cosine = libm::sqrt(1.0 - numerical_aperture * numerical_aperture);
    let n = n_rays as usize + 2;
    let passing = |j: usize| {
        let c = polar_cosine(j, n);
        let ratio = cosine / libm::sqrt(1.0 - c * c);
        if ratio < 1.0 { std::f64::consts::FRAC_2_PI * libm::acos(ratio) } else { 0.0 }
    };
    let passed: f64 = (1..n - 1).map(passing).sum();
    passed / ((f64::from(n_rays) + 1.0) * (1.0 - cosine)) - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(particle: &Particle, law: SpheroidLaw) -> Vec<Point> {
        let mut points = Vec::new();
        let n = surface_points(&Settings::setting1(), particle);
        shining_points(particle, n, law, &mut GoldenAzimuths::default(), &mut points);
        points
    }

    fn spheroid(d_um: f64, e_p: f64, alpha_rad: f64, beta_rad: f64) -> Particle {
        let spheroid = Some(Spheroid { e_p, alpha_rad, beta_rad });
        Particle { spheroid, ..Particle::sphere(0.0, 0.0, 0.0, d_um) }
    }

    /// The fraction of rays within the aperture over random rotations of one fan.
    #[test]
    fn few_rays_send_another_amount_of_light_into_an_aperture() {
        for (n_rays, na) in [(10, 0.3), (59, 0.13), (100, 0.3)] {
            let cosine = libm::sqrt(1.0 - na * na);
            let (turns, mut passed) = (20_000, 0);
            for turn in 0..turns {
                let (sine, cosine_turn) =
                    libm::sincos(std::f64::consts::TAU * (f64::from(turn) + 0.5) / f64::from(turns));
                let toward = |[e1, e2, _]: &[f64; 3]| (e1 * cosine_turn - e2 * sine).abs();
                passed += fan(n_rays).filter(|direction| toward(direction) > cosine).count();
            }
            let mean = passed as f64 / f64::from(turns);
            let excess = mean / (f64::from(n_rays + 1) * (1.0 - cosine)) - 1.0;
            assert!((excess - aperture_excess(n_rays, na)).abs() < 1e-3, "{n_rays} {na}: {excess}");
        }
        assert!(aperture_excess(500, 0.3).abs() < 1e-3 && aperture_excess(59, 0.13).abs() > 0.02);
    }

    #[test]
    fn a_sphere_has_the_programs_number_of_points_and_all_face_the_lens() {
        let sphere = points(&Particle::sphere(0.0, 0.0, 0.0, 2.0), SpheroidLaw::Original);
        assert_eq!(sphere.len(), 1087);
        for [e1, e2, e3] in sphere {
            assert!(e1 <= 0.0);
            assert!((e1 * e1 + e2 * e2 + e3 * e3 - 1.0).abs() < 1e-14);
        }
    }

    #[test]
    fn the_area_ratio_is_smooth_through_the_sphere() {
        // The area of the surface of revolution by the midpoint rule, against the closed forms.
        for e_p in [3.0, 1.2, 0.5, 0.1] {
            let steps = 100_000;
            let slope = |i: i32| {
                let u = (f64::from(i) + 0.5) / f64::from(steps);
                (1.0 + (1.0 / (e_p * e_p) - 1.0) * u * u).sqrt()
            };
            let area = e_p * (0..steps).map(slope).sum::<f64>() / f64::from(steps);
            assert!((area_ratio(e_p) / area - 1.0).abs() < 1e-9, "{e_p}: {} {area}", area_ratio(e_p));
        }
        for e_p in [1.0 - 1e-7, 1.0 + 1e-7, 1.0 - 1e-9, 1.0 + 1e-9] {
            assert!((area_ratio(e_p) - (1.0 + 2.0 * e_p) / 3.0).abs() < 1e-12);
        }
    }

    #[test]
    fn the_original_keeps_about_half_of_the_points() {
        for (e_p, alpha, beta) in [(1.0, 0.0, 0.0), (3.0, 0.8, 0.8), (0.4, 0.3, 1.2), (3.0, 0.0, 1.57)] {
            let particle = spheroid(6.0, e_p, alpha, beta);
            let all = surface_points(&Settings::setting1(), &particle) as f64;
            let share = points(&particle, SpheroidLaw::Original).len() as f64 / all;
            assert!((0.49..0.512).contains(&share), "e_p {e_p}: {share}");
        }
    }

    /// Bins of equal area contain equal numbers of points.
    #[test]
    fn uniform_points_are_uniform_in_area() {
        for e_p in [3.0, 0.3, 1.001] {
            let n = 100_000;
            let particle = spheroid(2.0, e_p, 0.0, 0.0);
            let (mut azimuths, mut points) = (GoldenAzimuths::default(), Vec::new());
            shining_points(&particle, n, SpheroidLaw::Uniform, &mut azimuths, &mut points);
            assert_eq!(points.len(), n);
            // At beta = 0 the axis is e3; cut the surface into slabs and cells of azimuth (the lens side:
            // half of them).
            let (slabs, sectors) = (20, 8);
            let mut counts = vec![0.0; slabs * sectors];
            // Area from the equator to u by Simpson's rule, independent of the closed form under test.
            let area = |u: f64| {
                let steps = 2000;
                let h = u / f64::from(steps);
                let f = |u: f64| (1.0 + (1.0 / (e_p * e_p) - 1.0) * u * u).sqrt();
                (0..steps)
                    .map(|i| {
                        f(h * f64::from(i)) + 4.0 * f(h * (f64::from(i) + 0.5)) + f(h * f64::from(i + 1))
                    })
                    .sum::<f64>()
                    * h
                    / 6.0
            };
            let total = area(1.0);
            let edges: Vec<f64> = (0..=1000).map(|i| area(f64::from(i) / 1000.0) / total).collect();
            for [e1, e2, e3] in points {
                let u = (e3 / e_p).abs() * 1000.0;
                let i = (u as usize).min(999);
                let s = edges[i] + (u - i as f64) * (edges[i + 1] - edges[i]);
                let slab = (((1.0 + s.copysign(e3)) / 2.0 * slabs as f64) as usize).min(slabs - 1);
                let azimuth = libm::atan2(e2, -e1) / std::f64::consts::PI + 0.5;
                let sector = ((azimuth * sectors as f64) as usize).min(sectors - 1);
                counts[slab * sectors + sector] += 1.0;
            }
            let expected = n as f64 / (slabs * sectors) as f64;
            let chi2: f64 = counts.iter().map(|c| (c - expected) * (c - expected) / expected).sum();
            // 159 degrees of freedom, 99.9 % quantile 219; a spiral is far below, the stretched spiral far
            // above.
            assert!(chi2 < 219.0, "e_p {e_p}: chi2 {chi2}");
        }
    }

    #[test]
    fn a_uniform_spheroid_of_aspect_one_is_the_sphere() {
        let sphere = points(&Particle::sphere(0.0, 0.0, 0.0, 2.0), SpheroidLaw::Uniform);
        assert_eq!(points(&spheroid(2.0, 1.0, 0.7, 0.4), SpheroidLaw::Uniform), sphere);
    }

    #[test]
    fn the_fan_is_a_spiral_without_poles() {
        let fan: Vec<_> = fan(500).collect();
        assert_eq!(fan.len(), 500);
        assert!((fan[0][2] - (1.0 - 2.0 / 501.0)).abs() < 1e-15);
        assert!(fan.iter().all(|d| (d[0] * d[0] + d[1] * d[1] + d[2] * d[2] - 1.0).abs() < 1e-14));
    }
}
