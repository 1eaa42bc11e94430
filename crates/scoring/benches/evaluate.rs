//! Speed of the scores: assignment in one dense frame, and the whole evaluation of a sequence.
//!
//! `cargo bench -p scoring`; measured figures are in docs/scoring.md.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use dataset::RecordingFacts;
use scoring::evaluate::gate::Gate;
use scoring::evaluate::matching::{Cost, greedy, optimal};
use scoring::evaluate::track_set::{TrackSet, UnsortedPoint};
use scoring::evaluate::truth::TrueParticles;
use scoring::evaluate::{EvaluateOptions, particles};
use scoring::results::{Points, Position, TrackRow};

/// Numbers in [0, 1) by Knuth's linear congruences.
fn random() -> impl FnMut() -> f64 {
    let mut state = 1u64;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Particles that drift over a square of `side` px, and the positions at which a tracker with errors of up to
/// `error` px finds them.
fn scene(n: usize, frames: u32, side: f64, error: f64) -> (Vec<TrackRow>, Vec<TrackRow>) {
    let mut random = random();
    let (mut truth, mut found) = (Vec::new(), Vec::new());
    for track in 0..n as i64 {
        let (x0, y0, z_um) = (side * random(), side * random(), 80.0 * random() - 60.0);
        for frame in 0..frames {
            let at = Position { x_px: x0 + 0.5 * f64::from(frame), y_px: y0, z_um };
            truth.push(TrackRow { frame, track, at });
            let mut noise = || error * (2.0 * random() - 1.0);
            let at = Position { x_px: at.x_px + noise(), y_px: at.y_px + noise(), z_um: at.z_um + noise() };
            found.push(TrackRow { frame, track, at });
        }
    }
    (truth, found)
}

fn cloud(rows: &[TrackRow]) -> TrackSet {
    let loose = |(i, r): (usize, &TrackRow)| UnsortedPoint {
        frame: r.frame,
        track: Some((r.track, 0)),
        at: r.at,
        source: i as u32,
    };
    TrackSet::new(rows.iter().enumerate().map(loose).collect())
}

fn matching(c: &mut Criterion) {
    // 50,000 points of a frame, with about four others of the result within the gate of each.
    let (truth, found) = scene(50_000, 1, 1000.0, 1.5);
    let (truth, found) = (cloud(&truth), cloud(&found));
    let gate = Gate::radial(5.0);
    let mut group = c.benchmark_group("one frame of 50,000");
    group.sample_size(10);
    group.bench_function("optimal", |b| b.iter(|| black_box(optimal(&truth, &found, &gate, Cost::Squares))));
    group.bench_function("greedy", |b| b.iter(|| black_box(greedy(&truth, &found, &gate))));
    group.finish();
}

fn whole(c: &mut Criterion) {
    let (rows, found) = scene(2000, 50, 1000.0, 0.5);
    let facts = RecordingFacts { depth_um: Some((-60.0, 20.0)), ..RecordingFacts::default() };
    let truth = TrueParticles {
        visible: vec![true; rows.len()],
        rows,
        facts,
        has_z: true,
        ..TrueParticles::default()
    };
    let points = Points { rows: found, has_z: true, ..Points::default() };
    let options = EvaluateOptions::default();
    let mut group = c.benchmark_group("evaluate");
    group.sample_size(10);
    group.bench_function("100,000 points in 50 frames", |b| {
        b.iter(|| black_box(particles(&truth, &points, &options)));
    });
    group.finish();
}

criterion_group!(benches, matching, whole);
criterion_main!(benches);
