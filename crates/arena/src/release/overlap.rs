//! Detects what the test split shares with train beyond chance: particle positions, velocity field.
//!
//! If the seeding is (nearly) deterministic, particles do not depend on the key, and the truth of train,
//! submitted as a result, scores well on the test split. It is therefore matched to the test split here; as a
//! control, the same truth is matched after shifts by a few gates in many directions, which gives the rate of
//! chance matches at the same particle density. A deterministic flow has a single velocity field, so
//! train and test have the same `truth/field.csv`.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use scoring::evaluate::field::{squares, true_field};
use scoring::evaluate::gate::Gate;
use scoring::evaluate::matching::{Cost, optimal};
use scoring::evaluate::track_set::{Position, TrackSet, UnsortedPoint};
use scoring::evaluate::truth::TrueParticles;
use scoring::results::{Conventions, FlowVector};
use storage::dataset::manifest::{ResultKind, ScoringGates};
use storage::dataset::{FieldRow, RecordingFacts, Row};
use storage::error::Result;

/// Maximum number of frames compared.
const FRAMES: u32 = 50;
/// Approximate maximum number of particles compared.
const POINTS: usize = 20_000;
/// Shifts of the control in units of the gate: well beyond the gate, but small compared with flow structures.
const MOVES: [f64; 3] = [2.6, 3.7, 4.8];
/// Directions of each shift.
const DIRECTIONS: usize = 5;

/// Numbers of tracks of the test split that train's truth, and the shifted truth, match in at least half of
/// their frames. Matches within a track are not independent, so tracks are counted rather than particles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shared {
    pub(super) found: f64,
    /// Mean over the shifts.
    pub(super) by_chance: f64,
    /// Number of tracks.
    pub(super) tracks: usize,
}

impl Shared {
    /// Whether the match exceeds chance by five standard errors (of a Poisson distribution), by 2 % of the
    /// tracks, and by four tracks (of a few tracks: by half of them).
    pub(super) fn is_beyond_chance(&self) -> bool {
        let tracks = self.tracks as f64;
        let margin = (5.0 * self.by_chance.sqrt()).max(0.02 * tracks).max(4.0_f64.min(0.5 * tracks));
        self.found > self.by_chance + margin
    }
}

/// Compares the particles of two datasets; `None` if one of them has none.
pub(super) fn particles(train: &Path, test: &Path) -> Result<Option<Shared>> {
    let read = |path: &Path| TrueParticles::read(path, &Conventions::default());
    let (train, test) = (read(train)?, read(test)?);
    let gate = gate(&test.facts);
    let (mut end, mut n) = (0, 0);
    while end < FRAMES && n < POINTS {
        n += test.rows.iter().filter(|row| row.frame == end).count();
        end += 1;
    }
    let points = |of: &TrueParticles, move_px: [f64; 2]| {
        let rows = of.rows.iter().enumerate().filter(|(i, row)| row.frame < end && of.is_scored(*i, 0.0));
        let point = |(i, row): (usize, &scoring::results::TrackRow)| UnsortedPoint {
            frame: row.frame,
            track: None,
            at: Position { x_px: row.at.x_px + move_px[0], y_px: row.at.y_px + move_px[1], ..row.at },
            source: i as u32,
        };
        TrackSet::new(rows.map(point).collect())
    };
    let truth = points(&test, [0.0; 2]);
    if truth.is_empty() || train.rows.is_empty() {
        return Ok(None);
    }
    let track = |point: usize| test.rows[truth.points[point].source as usize].track;
    let count = |points: &mut dyn Iterator<Item = usize>| {
        let mut frames: HashMap<i64, usize> = HashMap::new();
        points.for_each(|point| *frames.entry(track(point)).or_default() += 1);
        frames
    };
    let lengths = count(&mut (0..truth.len()));
    let matched = |move_px: [f64; 2]| -> Result<f64> {
        let matching = optimal(&truth, &points(&train, move_px), &gate, Cost::Squares)?;
        let frames = count(&mut matching.pairs().map(|(t, _)| t));
        Ok(frames.into_iter().filter(|(track, n)| 2 * n >= lengths[track]).count() as f64)
    };
    let mut control = Vec::new();
    for (k, size) in MOVES.iter().enumerate() {
        for direction in 0..DIRECTIONS {
            let turn = (direction as f64 + 0.31 * (k + 1) as f64) / DIRECTIONS as f64;
            let angle = 2.0 * std::f64::consts::PI * turn;
            control.push(matched([size * gate.xy_px * angle.cos(), size * gate.xy_px * angle.sin()])?);
        }
    }
    let by_chance = control.iter().sum::<f64>() / control.len() as f64;
    Ok(Some(Shared { found: matched([0.0; 2])?, by_chance, tracks: lengths.len() }))
}

/// Number of tracks or squares of nodes over which scores of the test split can be averaged.
pub(super) fn units(test: &Path, scored: &[ResultKind]) -> Result<usize> {
    if scored == [ResultKind::Fields] {
        let truth = true_field::from_dataset(test, None)?;
        return Ok(truth.fields.first().map_or(0, |(_, field)| squares(field, &truth.facts)));
    }
    let truth = TrueParticles::read(test, &Conventions::default())?;
    let rows = truth.rows.iter().enumerate().filter(|(i, _)| truth.is_scored(*i, 0.0));
    Ok(rows.map(|(_, row)| row.track).collect::<HashSet<_>>().len())
}

/// The default gate with which the split is scored.
fn gate(facts: &RecordingFacts) -> Gate {
    match facts.depth_h_um() {
        Some(h) => Gate::ellipsoid(ScoringGates::XY_PX, ScoringGates::over(h).z_um),
        None => Gate::radial(ScoringGates::XY_PX),
    }
}

/// Whether both splits have a true field and these agree to 10 % of the RMS displacement or 0.05 px.
pub(super) fn field(train: &Path, test: &Path) -> Result<bool> {
    if !train.join(FieldRow::PATH).exists() || !test.join(FieldRow::PATH).exists() {
        return Ok(false);
    }
    let (train, test) = (true_field::from_dataset(train, None)?, true_field::from_dataset(test, None)?);
    let (Some((_, known)), Some((_, asked))) = (train.fields.first(), test.fields.first()) else {
        return Ok(false);
    };
    let (columns, rows) = asked.nodes();
    let pair = (asked.needs_pairs() || known.needs_pairs()).then_some(0);
    let (mut difference, mut size, mut n) = (0.0, 0.0, 0.0);
    for (&x_px, &y_px) in rows.iter().flat_map(|y| columns.iter().map(move |x| (x, y))) {
        let node = FlowVector { pair, at: Position { x_px, y_px, z_um: 0.0 }, ..FlowVector::default() };
        if let Some((a, b)) = known.at(&node).zip(asked.at(&node)) {
            difference += (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2);
            size += b[0] * b[0] + b[1] * b[1];
            n += 1.0;
        }
    }
    let root = |sum: f64| (sum / n).sqrt();
    Ok(n > 0.0 && root(difference) <= (0.1 * root(size)).max(0.05))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matches_are_beyond_chance_from_five_standard_errors() {
        let is_beyond = |found| Shared { found, by_chance: 4.0, tracks: 50 }.is_beyond_chance();
        assert!(is_beyond(14.5) && !is_beyond(14.0));
    }
}
