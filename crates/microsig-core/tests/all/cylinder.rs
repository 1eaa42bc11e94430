//! Images behind a cylindrical lens before the camera, against matrices of rays.

use microsig_core::render::waves::{Cylinder, Layers, Lens, WaveOptics, WavesRenderer};
use microsig_core::{Particle, Settings, Spheroid};

const HALF_PX: i32 = 110;

fn settings() -> Settings {
    Settings { magnification: 20.0, numerical_aperture: 0.2, pixel_size: 6.5, ..Settings::setting1() }
}

fn optics(cylinder: Cylinder) -> WaveOptics {
    WaveOptics { lens: Lens::Aplanatic, cylinder: Some(cylinder), ..WaveOptics::new(0.52) }
}

/// Distances between the 10 and 90 % quantiles of the light along the direction at this azimuth and across
/// it.
fn extents(renderer: &WavesRenderer, z_um: f64, azimuth_deg: f64) -> [f64; 2] {
    let side = 2 * HALF_PX + 1;
    let places: Vec<[f64; 2]> =
        (0..side * side).map(|i| [i % side, i / side].map(|c| f64::from(c - HALF_PX))).collect();
    let shares = renderer.share_at(z_um, 0.0, &places);
    let (sine, cosine) = libm::sincos(azimuth_deg.to_radians());
    [[cosine, sine], [-sine, cosine]].map(|[u, v]| {
        let along: Vec<(f64, f64)> =
            places.iter().zip(&shares).map(|([x, y], share)| (u * x + v * y, *share)).collect();
        let total: f64 = shares.iter().sum();
        // The light of a pixel lies evenly over one pixel.
        let below =
            |at: f64| along.iter().map(|(x, share)| share * (at - x + 0.5).clamp(0.0, 1.0)).sum::<f64>();
        let quantile = |share: f64| {
            let mut ends = [-2.0, 2.0].map(|k| k * f64::from(HALF_PX));
            for _ in 0..30 {
                let middle = f64::midpoint(ends[0], ends[1]);
                ends[usize::from(below(middle) > share * total)] = middle;
            }
            ends[0]
        };
        quantile(0.9) - quantile(0.1)
    })
}

/// Out of focus, images of a point are M_x NA |z - z_x| / n wide and M NA |z| / n high; quantiles of the
/// light scale with these.
#[test]
fn images_grow_about_their_focal_planes() {
    let layers = Layers { focus_depth_um: 150.0, ..Layers::default() };
    for (cylinder, layers, angle_deg) in [
        (Cylinder { focal_length_mm: 1000.0, to_sensor_mm: 75.0 }, None, 0.0),
        (Cylinder { focal_length_mm: 300.0, to_sensor_mm: 40.0 }, None, 0.0),
        (Cylinder { focal_length_mm: -600.0, to_sensor_mm: 80.0 }, Some(layers), 0.0),
        (Cylinder { focal_length_mm: 300.0, to_sensor_mm: 40.0 }, None, 30.0),
    ] {
        let n = layers.map_or(1.0, |layers| layers.n_s);
        let optics = WaveOptics { layers, cyl_angle_deg: angle_deg, ..optics(cylinder) };
        let renderer = WavesRenderer::new(&settings(), &optics, 3e-3).unwrap();
        let plane_um = n * cylinder.focus_um(20.0);
        for z_um in [-100.0 * n, 100.0 * n] {
            let [along, across] = extents(&renderer, z_um, angle_deg);
            let expected = cylinder.growth() * (z_um - plane_um).abs() / z_um.abs();
            // Aberrations of the layers and the difference of sine and tangent act on both directions nearly
            // alike.
            assert!(
                (along / across / expected - 1.0).abs() < 0.025,
                "{cylinder:?} {z_um}: {along} {across} {expected}"
            );
        }
    }
}

/// A particle's own structure is magnified M_x along x: the modes of a sphere and the points that stand for a
/// spheroid of nearly its shape agree.
#[test]
fn spheres_and_spheroids_are_magnified_alike() {
    let cylinder = Cylinder { focal_length_mm: 150.0, to_sensor_mm: 40.0 };
    let settings = Settings { pixel_dim_x: 101, pixel_dim_y: 101, ..settings() };
    let renderer = WavesRenderer::new(&settings, &optics(cylinder), 1e-3).unwrap();
    let sphere = Particle::sphere(51.0, 51.0, -3.0, 3.0);
    let rod = Particle { spheroid: Some(Spheroid::from_axis(1.001, [1.0, 0.0, 0.0])), ..sphere };
    let [a, b] = [sphere, rod].map(|particle| renderer.draw(&[particle]));
    let total = |light: &microsig_core::sensor::Light| light.values.iter().sum::<f64>();
    let (ta, tb) = (total(&a), total(&b));
    let peak = a.values.iter().copied().fold(0.0, f64::max);
    for (a, b) in a.values.iter().zip(&b.values) {
        let off = a - b * ta / tb;
        assert!(off.abs() < 0.02 * peak, "{a} {b}");
    }
}
