//! Scores of recordings, of which only a part of the truth is known: scores that need the rest are left out,
//! and the result says so.

use super::planes::PlaneScore;
use super::read::Truth;
use super::{
    Counts, Definitions, EvaluateOptions, Evaluation, Score, UnitScores, definitions, particles, statistics,
};
use crate::results::Points;
use storage::error::{Error, Result};

/// What some known positions cannot tell.
const SOME: &str = "precision, F1, Jaccard and scores of whole tracks: positions of some of the particles are known, so that a found \
                    point that is none of them may be a particle or a ghost";

/// What heights of planes cannot tell.
const NO_POSITIONS: &str =
    "recall, precision, errors in the image plane, links: positions of particles are not known";

/// What positions without track numbers cannot tell.
const NO_TRACKS: &str = "links and tracks: track numbers of the known particles are not known";

/// What positions without heights cannot tell.
const NO_HEIGHTS: &str = "errors of z: depths of particles are not known";

/// Scores the points of a recording.
pub(super) fn evaluate(truth: &Truth, points: &Points, options: &EvaluateOptions) -> Result<Evaluation> {
    let name = &truth.facts.name;
    let planes = truth.planes.as_deref().filter(|planes| !planes.is_empty());
    let known = truth.particles.as_ref();
    if planes.is_none() && known.is_none() {
        return Err(Error::input(format!(
            "{name}: a recording of which nothing is known; `microsig import --truth` adds heights of planes or positions of particles"
        )));
    }
    let (mut evaluation, mut unknown) = match known {
        Some(known) => {
            let evaluation = particles(known, points, options)?;
            let unknown = if truth.facts.has_all_particles { Vec::new() } else { vec![SOME.to_owned()] };
            (evaluation, unknown)
        }
        None => (without_positions(truth, points, options), vec![NO_POSITIONS.to_owned()]),
    };
    if known.is_some() && !truth.facts.has_all_particles {
        leave_out(&mut evaluation);
    }
    if known.is_some_and(|known| known.rows.iter().all(|row| row.track < 0)) {
        leave_out_tracks(&mut evaluation.score);
        unknown.push(NO_TRACKS.to_owned());
    }
    match planes {
        Some(_) if !points.has_depth() && known.is_none() => {
            return Err(Error::input(format!(
                "{name}: heights of planes are known, and the result has no depths (z_um is missing, or 0 in every row)"
            )));
        }
        Some(planes) if points.has_depth() => {
            let (score, compared) = PlaneScore::of(planes, points, &truth.facts, options);
            (evaluation.score.planes, evaluation.plane_points) = (Some(score), compared);
            evaluation.sensor_px = truth.facts.sensor_px;
        }
        _ if known.is_some_and(|known| !known.has_z) => unknown.push(NO_HEIGHTS.to_owned()),
        _ => {}
    }
    evaluation.score.unknown = unknown;
    Ok(evaluation)
}

fn without_positions(truth: &Truth, points: &Points, options: &EvaluateOptions) -> Evaluation {
    let score = Score {
        dataset: truth.facts.name.clone(),
        assumptions: points.notes.clone(),
        counts: Counts { n_result: points.rows.len(), n_nan: points.n_nan, ..Counts::default() },
        definitions: Definitions {
            dims: 3,
            assignment: "none".to_owned(),
            border_px: options.border_px,
            depth_range_h_um: truth.facts.depth_h_um(),
            bootstrap_resamples: statistics::RESAMPLES,
            bootstrap_seed: options.seed,
            ..definitions(&truth.facts)
        },
        ..Score::default()
    };
    Evaluation { score, ..Evaluation::default() }
}

fn leave_out_tracks(score: &mut Score) {
    (score.isbi, score.isbi_2d, score.hota, score.clear) = (None, None, None, None);
    (score.identity, score.ctc, score.links, score.lpt) = (None, None, None, None);
}

/// Leaves out the scores to which unmatched result points contribute.
fn leave_out(evaluation: &mut Evaluation) {
    let score = &mut evaluation.score;
    if let Some(own) = &mut score.detection {
        (own.precision, own.f1, own.jaccard) = (None, None, None);
        (own.interval_precision, own.interval_f1, own.interval_jaccard) = (None, None, None);
    }
    for gate in &mut score.gates {
        (gate.precision, gate.f1) = (None, None);
    }
    score.gdpt = None;
    leave_out_tracks(score);
    score.hints.clear();
    evaluation.units = UnitScores::default();
}
