//! Manipulated results do not rank before a genuine one, by any score.

use storage::dataset::manifest::Metric;

use super::{Contestant, rank};
use crate::evaluate::truth::TrueParticles;
use crate::evaluate::{EvaluateOptions, Evaluation, particles};
use crate::results::{Points, Position, TrackRow, Velocities, VelocityUnit};

const FRAMES: u32 = 6;
const PARTICLES: u32 = 40;

/// A pseudorandom number from 0 to 1.
fn chance(seed: u32, i: u32) -> f64 {
    let mixed = (i ^ seed.wrapping_mul(0x9e37_79b9)).wrapping_mul(2_654_435_761).rotate_left(13);
    let mixed = (mixed ^ (mixed >> 15)).wrapping_mul(0x85eb_ca6b);
    f64::from(mixed ^ (mixed >> 13)) / f64::from(u32::MAX)
}

fn at(particle: u32, frame: u32) -> Position {
    let (column, row) = (particle % 8, particle / 8);
    let moved = f64::from(frame) * (1.0 + 0.1 * f64::from(row));
    let z_um = -40.0 + 80.0 * chance(7, particle);
    Position { x_px: 20.0 + 25.0 * f64::from(column) + moved, y_px: 20.0 + 25.0 * f64::from(row), z_um }
}

fn rows() -> Vec<TrackRow> {
    let of = |frame| (0..PARTICLES).map(move |i| TrackRow { frame, track: i64::from(i), at: at(i, frame) });
    (0..FRAMES).flat_map(of).collect()
}

fn truth() -> TrueParticles {
    let rows = rows();
    let mut truth =
        TrueParticles { visible: vec![true; rows.len()], has_z: true, ..TrueParticles::default() };
    truth.facts.depth_um = Some((-40.0, 40.0));
    truth.facts.um_per_px = Some(1.0);
    truth.facts.dt_s = Some(0.01);
    truth.velocity_um_s =
        rows.iter().map(|row| [100.0 * (1.0 + 0.1 * f64::from(row.track as u32 / 8)), 0.0, 0.0]).collect();
    // Axes near one direction, as in a shear flow.
    truth.axes = rows
        .iter()
        .map(|row| [1.0, chance(1, row.track as u32) - 0.5, chance(2, row.track as u32) - 0.5])
        .collect();
    truth.sizes = rows.iter().map(|row| [d_um(row.track), 1.0]).collect();
    truth.rows = rows;
    truth
}

/// Two classes of diameters.
fn d_um(track: i64) -> f64 {
    if chance(11, track as u32) < 0.6 { 2.0 } else { 3.0 }
}

/// A tracker that misses a twelfth of the particles and has errors of up to half a pixel and 2 um.
fn genuine() -> Points {
    let mut rows = rows();
    rows.retain(|row| chance(3, row.frame * 100 + row.track as u32) > 1.0 / 12.0);
    for (i, row) in rows.iter_mut().enumerate() {
        row.at.x_px += chance(4, i as u32) - 0.5;
        row.at.z_um += 4.0 * chance(5, i as u32) - 2.0;
    }
    Points { rows, has_z: true, ..Points::default() }
}

fn scored(points: &Points) -> Evaluation {
    particles(&truth(), points, &EvaluateOptions::default()).unwrap()
}

/// Two results with their ranks, the first one first.
fn ranks(both: [&Points; 2], by: &[Metric]) -> Vec<(usize, usize)> {
    let both = both.map(scored);
    rank(&both.each_ref().map(|e| Contestant { score: &e.score, units: Some(&e.units) }), by, 1)
}

/// Whether the second is behind the first.
fn is_behind(first: &Points, second: &Points, by: &[Metric]) -> bool {
    ranks([first, second], by) == [(0, 1), (1, 2)]
}

fn with_ghosts(points: &Points, ghosts: impl Iterator<Item = (u32, Position)>) -> Points {
    let mut all = points.clone();
    all.rows.extend(ghosts.map(|(frame, at)| TrackRow { frame, track: -1, at }));
    all
}

/// A point at each node of a grid, in every frame.
fn grid([columns, rows, depths]: [u32; 3], at: impl Fn(u32, u32, u32) -> Position) -> Points {
    let column = move |i| (0..rows).flat_map(move |j| (0..depths).map(move |k| (i, j, k)));
    let nodes = (0..columns).flat_map(column);
    let of_frame = |frame| nodes.clone().map(|(i, j, k)| at(i, j, k)).map(move |at| (frame, at));
    with_ghosts(&Points { has_z: true, ..Points::default() }, (0..FRAMES).flat_map(of_frame))
}

fn without(points: &Points, is_left_out: impl Fn(&TrackRow) -> bool) -> Points {
    let mut all = points.clone();
    all.rows.retain(|row| !is_left_out(row));
    all
}

const D3: [Metric; 3] = [Metric::F1, Metric::SigmaZOverH, Metric::RmseXyPx];
const T: [Metric; 4] = [Metric::Hota, Metric::LptCorrect, Metric::LptGhost, Metric::VelocityRmsUmS];
const S: [Metric; 3] = [Metric::AngleMeanAllDeg, Metric::F1, Metric::RmseXyPx];

#[test]
fn frames_left_out_are_behind_the_complete_result() {
    let corner = Position { x_px: 1.0, y_px: 1.0, z_um: 0.0 };
    for left_out in 1..FRAMES {
        let cut = without(&genuine(), |row| row.frame < left_out);
        let cut = with_ghosts(&cut, (0..left_out).map(|frame| (frame, corner)));
        for by in [&D3[..], &T, &S, &[Metric::LinkF1, Metric::RmseXyPx]] {
            assert!(is_behind(&genuine(), &cut, by), "{left_out} {by:?}");
        }
    }
}

#[test]
fn the_worst_particles_left_out_gain_nothing() {
    // Each error is nearer to a tracker's that is a little better in some and worse in others.
    let z = |row: &TrackRow| (row.at.z_um - at(row.track as u32, row.frame).z_um).abs();
    let own = genuine();
    for limit in [1.9, 1.5, 1.0] {
        let cut = without(&own, |row| z(row) > limit);
        assert!(!is_behind(&cut, &own, &D3) && !is_behind(&cut, &own, &[Metric::SigmaZOverH]), "{limit}");
    }
    let cut = without(&own, |row| z(row) > 1.5);
    assert!(scored(&cut).score.gdpt.unwrap().sigma_z_um < scored(&own).score.gdpt.unwrap().sigma_z_um);
    assert!(is_behind(&own, &cut, &[Metric::SigmaZOverH]));
}

#[test]
fn ghosts_at_one_place_or_in_one_frame_are_significant() {
    let at = |i: u32| Position { x_px: 20.0 + 0.001 * f64::from(i), y_px: 24.0, z_um: 0.0 };
    let ghosts = with_ghosts(&genuine(), (0..500).map(|i| (2, at(i))));
    let far = with_ghosts(&genuine(), (0..500).map(|i| (1000, at(i))));
    for worse in [ghosts, far] {
        for by in [&D3[..], &T, &[Metric::Precision], &[Metric::IsbiBeta]] {
            assert!(is_behind(&genuine(), &worse, by), "{by:?}");
        }
    }
}

#[test]
fn answers_beside_each_other_are_no_better_than_one() {
    let own = genuine();
    let hedges = own
        .rows
        .iter()
        .flat_map(|row| [-1.0, 1.0].map(|z| (row.frame, Position { z_um: row.at.z_um + z, ..row.at })));
    let hedged = with_ghosts(&own, hedges);
    for by in [&[Metric::SigmaZOverH][..], &[Metric::RmseXyPx], &[Metric::VelocityRmsUmS]] {
        assert!(is_behind(&own, &hedged, by), "{by:?}");
    }
}

#[test]
fn answers_around_each_particle_gain_nothing() {
    // A tracker with errors of up to three gates along y: F1 is a third.
    let mut own = genuine();
    own.rows.iter_mut().enumerate().for_each(|(i, row)| row.at.y_px += 12.0 * chance(13, i as u32) - 6.0);
    for distance in [3.0, 4.0] {
        let around = own.rows.iter().flat_map(|row| {
            let at = |y_px: f64| (row.frame, Position { y_px, ..row.at });
            [at(row.at.y_px - distance), at(row.at.y_px + distance)]
        });
        let hedged = with_ghosts(&own, around);
        let [own_f1, f1] = [&own, &hedged].map(|points| scored(points).score.detection.unwrap().f1.unwrap());
        assert!(own_f1 < f1, "{own_f1} {f1}");
        assert!(is_behind(&own, &hedged, &[Metric::F1]), "{distance}");
    }
}

#[test]
fn a_velocity_claimed_for_one_row_gains_nothing() {
    let own = genuine();
    let truth = truth();
    let claim = |share: f64, v: f64| {
        let velocity = |(i, row): (usize, &TrackRow)| {
            let exact = truth.velocity_um_s[(row.frame * PARTICLES + row.track as u32) as usize];
            if chance(6, i as u32) < share { exact.map(|e| e * v) } else { [f64::NAN; 3] }
        };
        let rows = own.rows.iter().enumerate().map(velocity).collect();
        Points { velocities: Some(Velocities { unit: VelocityUnit::UmPerS, rows }), ..own.clone() }
    };
    let mut one = claim(0.0, 1.0);
    one.velocities.as_mut().unwrap().rows[17] = [100.0, 0.0, 0.0];
    let error = |points: &Points| scored(points).score.lpt.unwrap().motion.velocity_rms_um_s.unwrap();
    // One exact velocity out of 200 changes the error of all by less than a percent.
    assert!((error(&one) / error(&own) - 1.0).abs() < 0.01, "{} {}", error(&one), error(&own));
    assert!(!is_behind(&one, &own, &T));
    // Velocities that are measured for all rows are better.
    assert!(is_behind(&claim(1.0, 1.01), &own, &T));
    // Absurd and constant ones are behind.
    assert!(is_behind(&own, &claim(1.0, 1e200), &T) && is_behind(&own, &claim(1.0, 0.0), &T));
}

#[test]
fn axes_of_ghosts_and_a_constant_axis_gain_nothing() {
    let own = genuine();
    let axes_of =
        |points: &Points, axis: [f64; 3]| Points { axes: vec![axis; points.rows.len()], ..points.clone() };
    let ghost = Points {
        rows: vec![TrackRow { frame: 0, track: -1, at: Position::default() }],
        axes: vec![[0.0, 0.0, 1.0]],
        has_z: true,
        ..Points::default()
    };
    assert!(is_behind(&own, &ghost, &S));
    // A grid that matches every particle, with the best constant axis.
    let at = |i: u32, j: u32, k: u32| Position {
        x_px: 10.0 + 4.0 * f64::from(i),
        y_px: 10.0 + 4.0 * f64::from(j),
        z_um: 16.0 * f64::from(k) - 32.0,
    };
    let grid = axes_of(&grid([60, 40, 5], at), [1.0, 0.0, 0.0]);
    assert!(is_behind(&own, &grid, &S));
    // Measured axes are better than none, those at random worse.
    let exact = truth();
    let of = |row: &TrackRow| exact.axes[(row.frame * PARTICLES + row.track as u32) as usize];
    let measured = Points { axes: own.rows.iter().map(of).collect(), ..own.clone() };
    assert!(is_behind(&measured, &own, &S));
    let random = (0..own.rows.len() as u32).map(|i| [8, 9, 10].map(|seed| chance(seed, i) - 0.5)).collect();
    assert!(is_behind(&own, &Points { axes: random, ..own.clone() }, &S));
}

/// Without any information on depth, three guesses for each particle are no better than one.
#[test]
fn several_depths_for_each_position_gain_nothing() {
    let guesses = |offsets_um: &[f64]| {
        let mut points = genuine();
        let guess = |row: &TrackRow| 80.0 * chance(31, row.frame * 100 + row.track as u32);
        let at =
            |row: &TrackRow, off_um: f64| Position { z_um: (guess(row) + off_um) % 80.0 - 40.0, ..row.at };
        let of = |off_um: &f64| -> Vec<TrackRow> {
            points.rows.iter().map(|row| TrackRow { track: -1, at: at(row, *off_um), ..*row }).collect()
        };
        points.rows = offsets_um.iter().flat_map(of).collect();
        points
    };
    let (one, three) = (guesses(&[0.0]), guesses(&[0.0, 27.0, 54.0]));
    let f1 = [&one, &three].map(|points| scored(points).score.detection.unwrap().f1.unwrap());
    assert!(f1[1] > f1[0] + 0.05, "{f1:?}");
    let ranks = ranks([&one, &three], &[Metric::F1]);
    assert_eq!(ranks[0], (0, 1), "{ranks:?}");
}

/// A result whose second score is worse does not gain: the level of the first does not depend on it.
#[test]
fn a_worse_second_score_separates_nothing_by_the_first() {
    let without_some =
        |seed: u32, share: f64| without(&genuine(), |row| chance(seed, row.track as u32) < share);
    let noisy = |points: &Points, px: f64| {
        let mut all = points.clone();
        let noise = |i: usize| px * (chance(41, i as u32) - 0.5);
        all.rows.iter_mut().enumerate().for_each(|(i, row)| row.at.y_px += noise(i));
        all
    };
    for seed in 0..40 {
        let (better, other) = (without_some(50 + seed, 0.02), without_some(90 + seed, 0.12));
        let ranked = |first: &Points| ranks([first, &other], &[Metric::F1, Metric::RmseXyPx]);
        // Noise that changes no match: of the same F1 and a larger error.
        let (before, after) = (ranked(&better), ranked(&noisy(&better, 2.0)));
        let lead = |ranks: &[(usize, usize)]| ranks.iter().find(|of| of.0 == 1).map(|of| of.1) == Some(2);
        assert!(!lead(&after) || lead(&before), "{seed}: {before:?} {after:?}");
    }
}

#[test]
fn diameters_of_ghosts_one_for_all_and_those_of_easy_particles_gain_nothing() {
    let sizes: [Metric; 3] = [Metric::SizeRight, Metric::F1, Metric::RmseXyPx];
    let own = genuine();
    let with = |points: &Points, of: &dyn Fn(&TrackRow) -> f64| Points {
        diameters_um: points.rows.iter().map(of).collect(),
        ..points.clone()
    };
    let measured =
        |row: &TrackRow| d_um(row.track) + 0.8 * (chance(12, row.frame * 97 + row.track as u32) - 0.5);
    let sized = with(&own, &measured);
    assert!(is_behind(&sized, &own, &sizes), "without diameters");
    assert!(is_behind(&sized, &with(&own, &|_| 2.0), &sizes), "the most frequent class");
    // Only the clearest tenth, without an error.
    let easy = |row: &TrackRow| if row.track < 4 { d_um(row.track) } else { f64::NAN };
    assert!(is_behind(&sized, &with(&own, &easy), &sizes), "few diameters");
    let others: Vec<(u32, Position)> = own.rows.iter().map(|row| (row.frame, row.at)).collect();
    let both = with_ghosts(&with(&own, &|_| 2.0), others.into_iter());
    let both = Points {
        diameters_um: (0..both.rows.len()).map(|i| if i < own.rows.len() { 2.0 } else { 3.0 }).collect(),
        ..both
    };
    assert!(is_behind(&sized, &both, &sizes), "a point of each class for each particle");
}

/// A tracker that knows its uncertainties: errors uniform within sqrt(3) U, half of the particles with an eighth of
/// the U of the others.
fn claiming() -> Points {
    let mut own = without(&Points { rows: rows(), has_z: true, ..Points::default() }, |row| {
        chance(3, row.frame * 100 + row.track as u32) < 1.0 / 12.0
    });
    for (i, row) in own.rows.iter_mut().enumerate() {
        let u = if row.track % 2 == 0 { 0.3 } else { 0.04 };
        let error = |seed: u32| 3f64.sqrt() * u * (2.0 * chance(seed, i as u32) - 1.0);
        let [x_px, y_px, z_um] =
            [row.at.x_px + error(21), row.at.y_px + error(22), row.at.z_um + 5.0 * error(23)];
        row.at = Position { x_px, y_px, z_um };
        own.sigma.push([u, u, 5.0 * u]);
    }
    own
}

fn with_claims(points: &Points, claim: impl Fn(f64) -> f64) -> Points {
    Points { sigma: points.sigma.iter().map(|of| of.map(&claim)).collect(), ..points.clone() }
}

const CLAIMS: [Metric; 2] = [Metric::CrpsXyPx, Metric::CrpsZUm];

#[test]
fn claims_that_are_too_large_or_too_small_are_behind_true_ones() {
    let own = claiming();
    for metric in CLAIMS {
        for factor in [3.0, 1.0 / 3.0, 1e6, 1e-6, 0.0] {
            assert!(is_behind(&own, &with_claims(&own, |u| factor * u), &[metric]), "{metric:?} {factor}");
        }
        // The best constant claim, and none.
        let rms = |of: fn(&[f64; 3]) -> f64| {
            (own.sigma.iter().map(|s| of(s) * of(s)).sum::<f64>() / own.sigma.len() as f64).sqrt()
        };
        let [xy, z] = [rms(|s| s[0]), rms(|s| s[2])];
        let constant = Points { sigma: vec![[xy, xy, z]; own.rows.len()], ..own.clone() };
        assert!(is_behind(&own, &constant, &[metric]), "{metric:?}");
        assert!(is_behind(&own, &Points { sigma: Vec::new(), ..own.clone() }, &[metric]), "{metric:?}");
    }
}

#[test]
fn claims_for_easy_particles_only_are_behind_claims_for_all() {
    let own = claiming();
    let mut easy = without(&own, |row| row.track % 2 == 0);
    easy.sigma.retain(|sigma| sigma[0] < 0.1);
    for metric in CLAIMS {
        // The claims of the others are missing, or they are left out.
        let limit = if metric == Metric::CrpsZUm { 1.0 } else { 0.1 };
        assert!(is_behind(&own, &with_claims(&own, |u| if u > limit { f64::NAN } else { u }), &[metric]));
        assert!(is_behind(&own, &easy, &[metric]));
        // Several answers, and ghosts elsewhere.
        let beside = own.rows.iter().map(|row| (row.frame, Position { x_px: row.at.x_px + 0.2, ..row.at }));
        let mut hedged = with_ghosts(&own, beside);
        hedged.sigma.extend(own.sigma.iter());
        assert!(is_behind(&own, &hedged, &[metric]));
        let mut ghosts = with_ghosts(&own, (0..50).map(|_| (1, Position::default())));
        ghosts.sigma.resize(ghosts.rows.len(), [1e-3; 3]);
        assert!(is_behind(&own, &ghosts, &[metric]));
    }
}

#[test]
fn grids_of_points_and_a_constant_depth_are_behind() {
    let own = genuine();
    // Steps in gates of 2 px; six depths.
    for gates in [1.4, 2.0, 3.0] {
        let (step, flat) = (2.0 * gates, 3_f64.sqrt() / 2.0);
        let at = |i: u32, j: u32, k: u32| Position {
            x_px: 10.0 + step * (f64::from(i) + 0.5 * f64::from(j % 2)),
            y_px: 10.0 + step * flat * f64::from(j),
            z_um: -40.0 + 80.0 * (f64::from(k) + 0.5) / 6.0,
        };
        let decoys = grid([(240.0 / step) as u32, (130.0 / step / flat) as u32, 6], at);
        for by in [&D3[..], &T, &[Metric::LinkF1]] {
            assert!(is_behind(&own, &decoys, by), "{gates} {by:?}");
        }
    }
    let mut flat = own.clone();
    flat.rows.iter_mut().for_each(|row| row.at.z_um = 0.0);
    assert!(is_behind(&own, &flat, &D3));
}

#[test]
fn an_empty_result_is_last_and_equals_share_a_rank() {
    let own = genuine();
    let empty = Points { has_z: true, ..Points::default() };
    for by in [&D3[..], &T, &S, &CLAIMS] {
        assert!(is_behind(&own, &empty, by), "{by:?}");
    }
    assert_eq!(ranks([&own, &own], &D3), [(0, 1), (1, 1)]);
}

#[test]
fn a_copy_with_one_ghost_fewer_and_larger_errors_is_not_ahead() {
    let corner = Position { x_px: 1.0, y_px: 1.0, z_um: 0.0 };
    let own = with_ghosts(&genuine(), [(0, corner), (1, corner)].into_iter());
    let mut copy = with_ghosts(&genuine(), [(0, corner)].into_iter());
    for (i, row) in copy.rows.iter_mut().enumerate() {
        row.at.x_px += 0.5 * chance(11, i as u32);
        row.at.z_um += 3.0 * chance(12, i as u32);
    }
    for by in [&D3[..], &[Metric::F1, Metric::RmseXyPx]] {
        assert!(is_behind(&own, &copy, by), "{by:?}");
    }
}

#[test]
fn a_tiny_shift_toward_the_truth_gains_nothing() {
    let mut own = genuine();
    own.rows.iter_mut().for_each(|row| row.at.z_um += 1.0);
    let mut shifted = own.clone();
    shifted.rows.iter_mut().for_each(|row| row.at.z_um -= 0.001);
    assert!(!is_behind(&shifted, &own, &[Metric::SigmaZOverH]));
    // One that removes the bias does.
    shifted.rows.iter_mut().for_each(|row| row.at.z_um -= 0.999);
    assert!(is_behind(&shifted, &own, &[Metric::SigmaZOverH]));
}

#[test]
fn random_numbers_added_to_a_biased_result_gain_nothing() {
    let mut own = Points { rows: rows(), has_z: true, ..Points::default() };
    own.rows.iter_mut().enumerate().for_each(|(i, row)| row.at.z_um += 1.95 + 0.1 * chance(15, i as u32));
    for size in [0.21, 0.6] {
        let mut moved = own.clone();
        let sign = |i: usize| if chance(16, i as u32) < 0.5 { -1.0 } else { 1.0 };
        moved.rows.iter_mut().enumerate().for_each(|(i, row)| row.at.z_um += size * sign(i));
        assert!(!is_behind(&moved, &own, &[Metric::SigmaZOverH]), "{size}");
    }
}
