//! Cost per image independent of the number of particles, and of Gaussian spots, on one thread.
//!
//! Run with `cargo bench --manifest-path benches/Cargo.toml --bench images`.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use microsig_core::formats::tiff::{self, PixelScale};
use microsig_core::render::{GaussianRenderer, GaussianSpot};
use microsig_core::sensor::{Light, Sensor};
use microsig_core::stream::{Purpose, Streams};
use microsig_core::{Particle, Settings};

/// Noise, gain and rounding of an image of setting 1, and encoding its file in memory.
fn exposure(c: &mut Criterion) {
    let settings = Settings::setting1();
    let light = Light::dark(&settings);
    let pixels = light.values.len();
    let streams = Streams::new(1);
    let mut group = c.benchmark_group("752 x 366 px");
    group.throughput(Throughput::Elements(pixels as u64));
    group.bench_function("Philox words", |b| {
        let mut words = vec![0; pixels];
        b.iter(|| streams.stream(Purpose::BackgroundNoise, 0, 0).fill(&mut words));
    });
    for (name, background_noise) in [("exposure without noise", 0.0), ("exposure with noise", 10.0)] {
        let sensor = Sensor::new(&Settings { background_noise, ..settings.clone() });
        group.bench_function(name, |b| {
            let mut frame = 0;
            b.iter(|| {
                frame += 1;
                sensor.expose(&light, &streams, Purpose::BackgroundNoise, frame)
            });
        });
    }
    let image = Sensor::new(&settings).expose(&light, &streams, Purpose::BackgroundNoise, 0);
    let scale = PixelScale::um_per_px(settings.um_per_px());
    group.bench_function("TIFF", |b| {
        let mut file = Vec::with_capacity(3 * pixels);
        b.iter(|| {
            file.clear();
            tiff::write(std::io::Cursor::new(&mut file), &image, &scale, "image")
        });
    });
    group.finish();
}

/// Spots on 512 x 512 px, with peaks of 50 to 250 counts and diameters varying by 9 %.
fn spots(c: &mut Criterion) {
    let settings = Settings { pixel_dim_x: 512, pixel_dim_y: 512, gain: 1.0, ..Settings::setting1() };
    let mut group = c.benchmark_group("spots, 512 x 512 px");
    for (ppp, diameter_px) in [(0.0, 2.75), (0.03, 2.75), (0.05, 4.2)] {
        let spot = GaussianSpot { diameter_px, reference_um: Some(1.0), peak_counts: 250.0 };
        let renderer = GaussianRenderer::new(&settings, spot).unwrap();
        let mut stream = Streams::new(1).stream(Purpose::Seeding, 0, 0);
        let mut within = |low: f64, high: f64| low + (high - low) * stream.uniform();
        let n = (ppp * 512.0 * 512.0) as usize;
        let particles: Vec<Particle> = (0..n)
            .map(|_| {
                let (x, y) = (within(0.5, 512.5), within(0.5, 512.5));
                Particle { c_int: within(0.2, 1.0), ..Particle::sphere(x, y, 0.0, within(0.91, 1.09)) }
            })
            .collect();
        group.throughput(Throughput::Elements(n.max(1) as u64));
        group.bench_function(BenchmarkId::new(format!("{diameter_px} px"), n), |b| {
            b.iter(|| renderer.draw(&particles));
        });
    }
    group.finish();
}

/// Runs all benchmarks on this thread.
fn all(c: &mut Criterion) {
    rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build_global().unwrap();
    exposure(c);
    spots(c);
}

criterion_group!(benches, all);
criterion_main!(benches);
