//! Time per particle and step of every field, and the cost of the two reference clouds: 1000 particles over
//! one frame of a Lamb-Oseen vortex and of 200 Kraichnan modes (100,000 particles over 100 frames cost 10,000
//! times as much).

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use flows::integrate::advance;
use flows::registry::{ENTRIES, find};
use flows::{Region, VelocityField};
use glam::DVec3;
use std::hint::black_box;

const DT_S: f64 = 0.005;

fn points() -> Vec<DVec3> {
    let view = Region::new(DVec3::new(-239.0, -118.0, -79.0), DVec3::new(239.0, 118.0, 19.0)).unwrap();
    let unit = |i: f64| DVec3::new(i * 0.819_172 % 1.0, i * 0.671_044 % 1.0, i * 0.549_700 % 1.0);
    (0..1000).map(|i| view.at(unit(f64::from(i)))).collect()
}

fn step(field: &dyn VelocityField, points: &[DVec3]) -> DVec3 {
    points.iter().map(|x| advance(field, *x, 0.0, DT_S).unwrap()).sum()
}

fn fields(criterion: &mut Criterion) {
    let points = points();
    let mut group = criterion.benchmark_group("step");
    group.throughput(Throughput::Elements(points.len() as u64)).sample_size(10);
    for entry in ENTRIES {
        let field = (entry.make)().unwrap();
        group.bench_function(entry.name, |bencher| bencher.iter(|| step(field.as_ref(), black_box(&points))));
    }
    group.finish();
}

fn evaluations(criterion: &mut Criterion) {
    let points = points();
    let field = (find("kraichnan").unwrap().make)().unwrap();
    let mut group = criterion.benchmark_group("evaluation");
    group.throughput(Throughput::Elements(points.len() as u64)).sample_size(20);
    group.bench_function("kraichnan velocity", |bencher| {
        bencher.iter(|| black_box(&points).iter().map(|x| field.velocity(*x, 0.0)).sum::<DVec3>());
    });
    group.finish();
}

criterion_group!(benches, fields, evaluations);
criterion_main!(benches);
