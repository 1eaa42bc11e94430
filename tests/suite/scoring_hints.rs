//! Mistakes of convention are detected and reported with the score without them.

use scoring::evaluate::field::FieldScore;
use scoring::evaluate::truth::TrueParticles;
use scoring::evaluate::{EvaluateOptions, Hint, Score, evaluate_files, particles};
use scoring::results::{Points, Position, TrackRow};
use storage::dataset::RecordingFacts;

/// A sequence of particles on straight lines, and a result with noise, misses, ghosts and broken tracks.
pub(crate) fn scene() -> (TrueParticles, Points) {
    let (mut rows, mut found) = (Vec::new(), Vec::new());
    let mut state = 1u64;
    let mut random = move || {
        // Noise by Knuth's linear congruential generator.
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    for track in 0..40i64 {
        let (x0, y0, z) = (10.0 + 180.0 * random(), 10.0 + 130.0 * random(), -20.0 + 40.0 * random());
        let (u, v) = (4.0 * random() - 2.0, 4.0 * random() - 2.0);
        for frame in 0..12u32 {
            let t = f64::from(frame);
            let at = Position { x_px: x0 + u * t, y_px: y0 + v * t, z_um: z };
            rows.push(TrackRow { frame, track, at });
            if random() < 0.9 {
                let mut noise = || 0.6 * (random() - 0.5);
                let at =
                    Position { x_px: at.x_px + noise(), y_px: at.y_px + noise(), z_um: at.z_um + noise() };
                found.push(TrackRow { frame, track: if frame > 7 { track + 100 } else { track }, at });
            }
            if random() < 0.1 {
                let at = Position { x_px: 200.0 * random(), y_px: 150.0 * random(), z_um: 0.0 };
                found.push(TrackRow { frame, track: -1, at });
            }
        }
    }
    let facts = RecordingFacts { depth_um: Some((-20.0, 20.0)), ..RecordingFacts::default() };
    let visible = vec![true; rows.len()];
    (
        TrueParticles { facts, rows, has_z: true, visible, ..TrueParticles::default() },
        Points { rows: found, has_z: true, ..Points::default() },
    )
}

pub(crate) fn scores(truth: &TrueParticles, points: &Points) -> Score {
    particles(truth, points, &EvaluateOptions::default()).unwrap().score
}

/// A result of another recording, or far from the true places, is not only a low score.
#[test]
fn a_result_that_matches_no_more_than_chance_is_recognized() {
    let (mut truth, points) = scene();
    truth.facts.sensor_px = Some((200.0, 150.0));
    let hint = |points: &Points| -> Option<String> {
        scores(&truth, points).hints.first().map(|hint| hint.what.clone())
    };
    let mut other = points.clone();
    // Other particles: each track at a place of its own.
    for row in &mut other.rows {
        let k = (row.track.rem_euclid(100) + 1) as f64;
        row.at.x_px = (row.at.x_px + 61.8 * k).rem_euclid(200.0);
        row.at.y_px = (row.at.y_px + 41.4 * k).rem_euclid(150.0);
    }
    let said = hint(&other).unwrap_or_default();
    assert!(said.contains("points match a particle, no more than at random positions"), "{said}");
    let mut far = points.clone();
    far.rows.iter_mut().for_each(|row| row.at.x_px += 400.0);
    let said = hint(&far).unwrap_or_default();
    assert!(said.contains("? 0 of ") && said.starts_with("is this the result of another dataset"), "{said}");
    // A tenth of the points in their places is far more than chance.
    let few = other
        .rows
        .iter()
        .zip(&points.rows)
        .enumerate()
        .map(|(i, (other, own))| if i % 10 == 0 { *own } else { *other });
    assert_eq!(hint(&Points { rows: few.collect(), ..points.clone() }), None);
    let said = hint(&Points::default()).unwrap_or_default();
    assert!(said.starts_with("the result is empty"), "{said}");
}

/// The most frequent mistakes in depth: a perfect result with another unit, sign or origin is recognized as perfect. Those
/// in the image plane have options (`convention_check`).
#[test]
fn units_signs_and_origins_of_depths_are_hinted_with_the_score_they_would_give() {
    let (mut truth, _) = scene();
    truth.facts.sensor_px = Some((200.0, 150.0));
    truth.facts.um_per_px = Some(0.65);
    let perfect = Points { rows: truth.rows.clone(), has_z: true, ..Points::default() };
    assert_eq!(scores(&truth, &perfect).hints, []);
    let hinted = |change: &dyn Fn(&mut Position), hint: &str| {
        let mut changed = perfect.clone();
        changed.rows.iter_mut().for_each(|r| change(&mut r.at));
        let score = scores(&truth, &changed);
        let found = score.hints.iter().find(|h| h.what.contains(hint));
        let Some(Hint { f1, f1_now, .. }) = found else { panic!("{hint}: {:?}", score.hints) };
        assert!(*f1 > Some(0.99) && f1 >= f1_now, "{hint}: {:?}", score.hints);
        // Hints come first.
        assert_eq!(score.caveats().next(), Some(score.hints[0].what.as_str()));
        assert!(!score.warnings.contains(&score.hints[0].what));
    };
    hinted(&|at| at.z_um = -at.z_um, "z with the other sign? With z_um = -1.0000 z");
    hinted(&|at| at.z_um = 20.0 - at.z_um, "z with the other sign? With z_um = -1.0000 z +20.000");
    hinted(&|at| at.z_um += 20.0, "z from another origin? With z_um = z -20.000");
    hinted(&|at| at.z_um *= 1e-3, "z in mm?");
    hinted(&|at| at.z_um = (at.z_um + 20.0) / 40.0, "z as a fraction of the depth range?");
    hinted(&|at| at.z_um /= 1.33, "z scaled (refraction, or a depth factor)? With z_um = 1.33");
    hinted(&|at| (at.x_px, at.y_px) = (201.0 - at.x_px, 151.0 - at.y_px), "image turned by 180 degrees?");
    let mut shifted = perfect.clone();
    shifted.rows.iter_mut().for_each(|r| r.at.x_px += 5.0);
    let options = EvaluateOptions { auto_offset: true, ..EvaluateOptions::default() };
    let offset = particles(&truth, &shifted, &options).unwrap().score.offset.unwrap();
    assert_eq!(offset.f1_without, 1.0, "{offset:?}");
}

/// A field of shear and waves, measured with noise, with shifted positions.
fn field(shift_px: f64) -> (FieldScore, Vec<Hint>) {
    let place = tempfile::tempdir().unwrap();
    let (x, y) = (place.path().join("truth.csv"), place.path().join("result.csv"));
    let header = "x_px,y_px,dx_px,dy_px\n";
    let exact = |x: f64, y: f64| [4.0 * (y / 40.0).sin() + 0.01 * x, 2.0 * (x / 30.0).cos()];
    let (mut truth, mut result) = (header.to_owned(), header.to_owned());
    let mut state = 7u64;
    for i in 0..64 {
        for j in 0..64 {
            let (x, y) = (4.0 * f64::from(i) + 1.0, 4.0 * f64::from(j) + 1.0);
            let [u, v] = exact(x, y);
            truth += &format!("{x},{y},{u},{v}\n");
            let inside = (2..62).contains(&i) && (2..62).contains(&j);
            if inside && (i + j) % 4 == 0 {
                // Noise of 0.06 px standard deviation by Knuth's linear congruential generator.
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                let noise = 0.2 * ((state >> 11) as f64 / (1u64 << 53) as f64 - 0.5);
                result += &format!("{},{},{},{}\n", x - shift_px, y - shift_px, u + noise, v - noise);
            }
        }
    }
    std::fs::write(&x, truth).unwrap();
    std::fs::write(&y, result).unwrap();
    let Score { field, hints, .. } = evaluate_files(&x, &y, &EvaluateOptions::default()).unwrap().score;
    (field.unwrap(), hints)
}

#[test]
fn a_field_half_a_pixel_off_is_noticed_by_the_gradients_of_the_flow() {
    let (_, hints) = field(0.0);
    assert_eq!(hints, []);
    for (shift, option) in
        [(0.5, "; --origin corner0"), (1.0, "; --origin center0"), (-0.5, "off by -0.5 px?")]
    {
        let (_, hints) = field(shift);
        assert!(hints.len() == 1 && hints[0].what.contains(option), "{shift}: {hints:?}");
        assert!(hints[0].rms_px < hints[0].rms_px_now, "{hints:?}");
    }
}
