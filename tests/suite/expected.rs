//! The renderer `expected` is the mean of what `rays` draws.
#![expect(clippy::print_stdout, reason = "the margins of a test are shown when it fails, or on request")]

use microsig_core::emission::SpheroidLaw;
use microsig_core::render::expected::{DEFAULT_TOLERANCE, ExpectedRenderer};
use microsig_core::stream::{Purpose, Streams};
use microsig_core::{Particle, Settings};
use suite::ensemble::Ensemble;
use suite::expected::Agreement;

fn renderer(settings: &Settings) -> ExpectedRenderer {
    ExpectedRenderer::new(settings, SpheroidLaw::Original, DEFAULT_TOLERANCE).unwrap()
}

/// A sensor of 141 x 141 px; the last particle is cut by its edge.
fn is_the_mean_of_rays(settings: &Settings, depths: &[f64], seed: u64) {
    let settings = Settings { pixel_dim_x: 141, pixel_dim_y: 141, ..settings.clone() };
    let renderer = renderer(&settings);
    let mut places = Streams::new(seed).stream(Purpose::Seeding, 0, 0);
    for (i, &z_um) in depths.iter().enumerate() {
        let x = if i + 1 == depths.len() { 1.0 } else { 70.0 };
        let particle = Particle::sphere(x + places.uniform(), 70.0 + places.uniform(), z_um, 2.0);
        let rays =
            Ensemble::draw(&settings, &[particle], SpheroidLaw::Original, seed + i as u64, 200).unwrap();
        let expected = renderer.light(&[particle]).values;
        let agreement = Agreement::of(&expected, &rays, DEFAULT_TOLERANCE);
        println!("z {z_um}: {agreement:?}");
        assert!(agreement.holds(), "z {z_um}: {agreement:?}");
    }
}

#[test]
fn it_is_the_mean_of_rays() {
    is_the_mean_of_rays(&Settings::setting1(), &[-75.0, -50.0, -13.0, 12.0, 34.0], 21);
}

#[test]
fn it_is_the_mean_of_rays_with_a_cylinder() {
    is_the_mean_of_rays(&Settings::setting1a(), &[-50.0, -13.0, 34.0], 31);
}

/// Derivatives against differences of images; the sizes cover a table of its own and one interpolated between sizes.
#[test]
fn derivatives_are_those_of_the_image() {
    let (round, astigmatic) = (Settings::setting1(), Settings::setting1a());
    for (settings, cases) in [(round, &[(-61.7, 2.0), (11.3, 1.73)][..]), (astigmatic, &[(-13.0, 2.0)])] {
        let renderer = renderer(&settings);
        for &(z_um, d_um) in cases {
            let particle = Particle::sphere(200.31, 150.77, z_um, d_um);
            let gradient = renderer.gradient(&particle).unwrap();
            let patch = renderer.patch(&particle).unwrap();
            let peak = patch.counts.iter().copied().fold(0.0, f64::max);
            // f32 sums of some hundred terms.
            for (pixel, value) in gradient.pixels.iter().zip(&patch.counts) {
                assert!((pixel[0] - value).abs() < 1e-5 * peak, "{} {value}", pixel[0]);
            }
            let step = 1e-4;
            for axis in 0..3 {
                let moved = |by: f64| {
                    let mut particle = particle;
                    *[&mut particle.x_px, &mut particle.y_px, &mut particle.z_um][axis] += by;
                    renderer.gradient(&particle).unwrap()
                };
                let (low, high) = (moved(-step), moved(step));
                assert_eq!((low.window, high.window), (gradient.window, gradient.window));
                for (i, pixel) in gradient.pixels.iter().enumerate() {
                    let slope = (high.pixels[i][0] - low.pixels[i][0]) / (2.0 * step);
                    // The tables' f32 coefficients make no difference here: both sides use the same.
                    assert!(
                        (slope - pixel[axis + 1]).abs() < 1e-4 * peak,
                        "axis {axis}: {slope} {}",
                        pixel[axis + 1]
                    );
                }
            }
        }
    }
}
