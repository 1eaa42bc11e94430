//! Cost of one particle with the ray-counting renderer: per particle, per emitted ray, per traced ray.
//!
//! Run with `cargo bench --manifest-path benches/Cargo.toml --bench rays`. Throughput is reported twice: elements of `emitted` are all rays
//! that the source points emit toward the lens side, elements of `traced` only those that the kernel traces.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use microsig_core::emission::{self, SpheroidLaw};
use microsig_core::render::{InstructionSet, RayRenderer, exact, rays::Scratch};
use microsig_core::stream::{Purpose, Streams};
use microsig_core::{Particle, Settings};

fn particle_by_rays(c: &mut Criterion) {
    let cases = [
        ("setting 1", Settings::setting1(), Particle::sphere(376.3, 183.2, -30.0, 2.0)),
        ("setting 1a", Settings::setting1a(), Particle::sphere(376.3, 183.2, -30.0, 2.0)),
        ("setting 2", Settings::setting2(), Particle::sphere(71.3, 70.8, -10.0, 1.0)),
    ];
    let mut group = c.benchmark_group("particle");
    for (name, settings, particle) in cases {
        let streams = Streams::new(1);
        for set in InstructionSet::available().into_iter().rev() {
            let renderer =
                RayRenderer::new(&settings, SpheroidLaw::Original).unwrap().with_instruction_set(set);
            let mut scratch = Scratch::default();
            let points = emission::surface_points(&settings, &particle);
            let emitted = points as u64 * u64::from(settings.n_rays);
            let traced = renderer.patch_with_angles(&particle, &[], &mut scratch).1;
            for (unit, rays) in [("emitted", emitted), ("traced", traced)] {
                group.throughput(Throughput::Elements(rays));
                group.bench_function(BenchmarkId::new(format!("{name}, {set}"), unit), |b| {
                    let mut row = 0;
                    b.iter(|| {
                        row += 1;
                        renderer.patch(black_box(&particle), &streams, Purpose::Rays, 0, row, &mut scratch)
                    });
                });
            }
        }
    }
    group.finish();
}

/// The same particle traced ray by ray in f64, for comparison.
fn particle_exact(c: &mut Criterion) {
    let settings = Settings { pixel_dim_x: 121, pixel_dim_y: 121, ..Settings::setting1() };
    let particle = Particle::sphere(61.3, 60.8, -30.0, 2.0);
    let mut points = Vec::new();
    let n = emission::surface_points(&settings, &particle);
    emission::shining_points(&particle, n, SpheroidLaw::Original, &mut Default::default(), &mut points);
    let angles = vec![0.3; points.len()];
    c.bench_function("particle exact/setting 1", |b| {
        b.iter(|| exact::count_rays(&settings, black_box(&particle), &points, &angles));
    });
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(30);
    targets = particle_by_rays, particle_exact
}
criterion_main!(benches);
