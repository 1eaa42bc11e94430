//! Ray counts do not depend on the instruction set or the number of threads.

use microsig_core::emission::SpheroidLaw;
use microsig_core::render::{InstructionSet, RayRenderer, Render, rays::Scratch};
use microsig_core::stream::{Purpose, Streams};
use microsig_core::{Particle, Settings, Spheroid};

fn spheroid(particle: Particle, e_p: f64, alpha_rad: f64, beta_rad: f64) -> Particle {
    Particle { spheroid: Some(Spheroid { e_p, alpha_rad, beta_rad }), ..particle }
}

/// Spheres and spheroids, in focus and far out of focus, at the edge of the sensor, and with fewer points
/// than a vector has lanes.
#[test]
fn every_instruction_set_counts_the_same_rays() {
    let sets = InstructionSet::available();
    assert_eq!(sets.last().unwrap().to_string(), InstructionSet::best().to_string());
    let streams = Streams::new(5);
    let (mut compared, mut rays) = (0, 0);
    for (name, settings, depths) in [
        ("setting 1", Settings::setting1(), [-80.0, -25.0, 0.0, 40.0]),
        ("setting 1a", Settings::setting1a(), [-80.0, -25.0, 0.0, 40.0]),
        ("setting 2", Settings::setting2(), [-40.0, -10.0, 0.0, 5.0]),
    ] {
        let (width, height) = (f64::from(settings.pixel_dim_x), f64::from(settings.pixel_dim_y));
        for law in [SpheroidLaw::Original, SpheroidLaw::Uniform] {
            let renderer = RayRenderer::new(&settings, law).unwrap();
            for (frame, z) in depths.into_iter().enumerate() {
                let middle = Particle::sphere(width / 2.0 + 0.3, height / 2.0 - 0.2, z, 1.0);
                let particles = [
                    middle,
                    Particle { d_um: 0.1, ..middle },
                    Particle { d_um: 0.3, ..middle },
                    Particle { x_px: 2.2, y_px: height + 1.0, ..middle },
                    spheroid(middle, 3.0, 0.8, 0.6),
                    spheroid(middle, 0.4, 0.3, 1.2),
                ];
                for (row, particle) in particles.iter().enumerate() {
                    let patches: Vec<_> = sets
                        .iter()
                        .map(|&set| {
                            let renderer = renderer.clone().with_instruction_set(set);
                            let (frame, row) = (frame as u32, row as u32);
                            renderer.patch(
                                particle,
                                &streams,
                                Purpose::Rays,
                                frame,
                                row,
                                &mut Scratch::default(),
                            )
                        })
                        .collect();
                    for (set, patch) in sets.iter().zip(&patches) {
                        assert!(*patch == patches[0], "{name}, {law:?}, z {z} um, row {row}: {set} differs");
                    }
                    compared += patches.len();
                    rays += patches[0].as_ref().map_or(0, |patch| patch.total());
                }
            }
        }
    }
    assert_eq!(compared, 144 * sets.len());
    assert!(rays > 1_000_000, "only {rays} rays were counted at all");
}

/// One large image, with more than one batch of particles, on 1, 2 and 7 threads; its light is the sum of its
/// patches in the order of rows.
#[test]
fn threads_share_out_one_image_without_a_trace() {
    let settings = Settings {
        pixel_dim_x: 1500,
        pixel_dim_y: 1100,
        points_per_pixel: 1.0,
        n_rays: 100,
        ..Settings::setting1a()
    };
    let fraction = |i: u32, factor: u32| f64::from(i.wrapping_mul(factor)) / 4_294_967_296.0;
    let particles: Vec<Particle> = (0..2500)
        .map(|i| Particle {
            c_int: 0.5 + fraction(i, 3_266_489_917),
            ..Particle::sphere(
                1500.0 * fraction(i, 2_654_435_761),
                1100.0 * fraction(i, 2_246_822_519),
                100.0 * fraction(i, 668_265_263) - 70.0,
                1.0 + fraction(i, 374_761_393),
            )
        })
        .collect();
    let renderer = RayRenderer::new(&settings, SpheroidLaw::Original).unwrap();
    let streams = Streams::new(6);
    let bits = |threads: usize| -> Vec<u64> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let light = pool.install(|| renderer.light(&particles, &streams, Purpose::Rays, 3));
        light.values.iter().map(|value| value.to_bits()).collect()
    };
    let one = bits(1);
    for threads in [2, 7] {
        assert!(bits(threads) == one, "{threads} threads");
    }

    let (mut sum, scratch) = (vec![0.0f64; one.len()], &mut Scratch::default());
    for (row, particle) in particles.iter().enumerate() {
        let patch = renderer.patch(particle, &streams, Purpose::Rays, 3, row as u32, scratch).unwrap();
        for (i, &count) in patch.counts.iter().enumerate() {
            let (x, y) = (i % patch.window.width, i / patch.window.width);
            let pixel = (y + patch.window.y0 as usize - 1) * 1500 + x + patch.window.x0 as usize - 1;
            sum[pixel] += particle.c_int * f64::from(count);
        }
    }
    assert!(sum.iter().map(|value| value.to_bits()).eq(one), "patches do not add up to the image");
    assert!(sum.iter().sum::<f64>() > 1e5);
}
