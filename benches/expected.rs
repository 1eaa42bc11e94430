//! Cost of expected images: drawing particles from existing tables, and building tables.
//!
//! Run with `cargo bench --manifest-path benches/Cargo.toml --bench expected`.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use microsig_core::emission::SpheroidLaw;
use microsig_core::render::expected::DEFAULT_TOLERANCE;
use microsig_core::render::{ExpectedRenderer, Tables, TablesState};
use microsig_core::stream::{Purpose, Streams};
use microsig_core::{Particle, Settings};

/// Particles of one image.
const PARTICLES: usize = 500;

/// Name, settings, range of depths in the paper's plots (um), and diameter (um).
fn cases() -> [(&'static str, Settings, [f64; 2], f64); 3] {
    [
        ("setting 1", Settings::setting1(), [-80.0, 40.0], 2.0),
        ("setting 1a", Settings::setting1a(), [-80.0, 40.0], 2.0),
        ("setting 2", Settings::setting2(), [-40.0, 5.0], 1.0),
    ]
}

fn scattered(settings: &Settings, [low, high]: [f64; 2], d_um: f64) -> Vec<Particle> {
    let mut places = Streams::new(1).stream(Purpose::Seeding, 0, 0);
    let mut between = |low: f64, high: f64| low + (high - low) * places.uniform();
    let (width, height) = (f64::from(settings.pixel_dim_x), f64::from(settings.pixel_dim_y));
    (0..PARTICLES)
        .map(|_| {
            let (x, y) = (between(0.5, width + 0.5), between(0.5, height + 0.5));
            Particle::sphere(x, y, between(low, high), d_um)
        })
        .collect()
}

fn renderer(settings: &Settings) -> ExpectedRenderer {
    ExpectedRenderer::new(settings, SpheroidLaw::Original, DEFAULT_TOLERANCE)
        .expect("the tolerance is allowed")
}

/// Prints the quantities by which the times below are to be divided, and the memory of the tables.
#[expect(clippy::print_stdout, reason = "it belongs to what criterion prints")]
fn print_sizes(name: &str, renderer: &ExpectedRenderer, particles: &[Particle]) {
    let lit = |counts: Vec<f64>| counts.into_iter().filter(|&count| count > 0.0).count();
    let pixels: usize =
        particles.iter().filter_map(|particle| renderer.patch(particle)).map(|patch| lit(patch.counts)).sum();
    let TablesState { count, bytes, error } = renderer.state();
    println!(
        "{name}: {:.0} lit pixels a particle; {count} tables, {:.1} MB, largest error {error:.1e} of the peak",
        pixels as f64 / particles.len() as f64,
        bytes as f64 / 1e6
    );
}

/// Images of particles at all depths, and at single depths; throughput is in particles.
fn drawing(c: &mut Criterion) {
    let mut group = c.benchmark_group("expected");
    group.throughput(Throughput::Elements(PARTICLES as u64));
    for (name, settings, depths, d_um) in cases() {
        let renderer = renderer(&settings);
        let draw = |b: &mut criterion::Bencher, particles: Vec<Particle>| {
            renderer.prepare(&[&particles]);
            b.iter(|| renderer.draw(black_box(&particles)));
        };
        let mut told = false;
        group.bench_function(BenchmarkId::new(name, "all depths"), |b| {
            let particles = scattered(&settings, depths, d_um);
            renderer.prepare(&[&particles]);
            if !std::mem::replace(&mut told, true) {
                print_sizes(name, &renderer, &particles);
            }
            draw(b, particles);
        });
        for share in [0.0, 0.25, 0.5, 0.75, 1.0] {
            let z_um = depths[0] + share * (depths[1] - depths[0]);
            let particles = scattered(&settings, [z_um; 2], d_um);
            group.bench_function(BenchmarkId::new(name, format!("z = {z_um}")), |b| {
                draw(b, particles.clone())
            });
        }
    }
    group.finish();
}

/// Building the tables for all depths.
fn tables(c: &mut Criterion) {
    let mut group = c.benchmark_group("tables");
    group.sample_size(10);
    for (name, settings, depths, d_um) in cases() {
        let particles = scattered(&settings, depths, d_um);
        group.bench_function(name, |b| b.iter(|| renderer(&settings).prepare(&[&particles])));
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(30);
    targets = drawing, tables
}
criterion_main!(benches);
