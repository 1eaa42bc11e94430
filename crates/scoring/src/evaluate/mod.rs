//! Scores any tracker's result against the truth.
//!
//! Scores compare points or vectors and never read images. docs/scoring.md has the definitions, the gates and
//! the differences to other programs. [`evaluate`] runs all steps: select the scored points, match, score;
//! [`evaluate_files`] reads truth and result first.

/// Declares scores, which are null where they are undefined and may be missing in files: a `fraction` is within 0 and 1, a
/// `not_negative` one is 0 or more; of an interval or a list this holds for each number.
macro_rules! scores {
    ($($(#[$meta:meta])* pub struct $name:ident { $($fields:tt)* })*) => {
        $(scores!(@ [$(#[$meta])* $name] {} $($fields)*);)*
    };
    (@ $head:tt {$($done:tt)*} $(#[$meta:meta])* pub $field:ident: $type:ty, $($rest:tt)*) => {
        scores!(@ $head {$($done)* $(#[$meta])* pub $field: $type,} $($rest)*);
    };
    (@ $head:tt {$($done:tt)*} $(#[$meta:meta])* $kind:ident $field:ident: Interval, $($rest:tt)*) => {
        scores!(@@ $kind inner $head {$($done)* $(#[$meta])*} $field: Interval, $($rest)*);
    };
    (@ $head:tt {$($done:tt)*} $(#[$meta:meta])* $kind:ident $field:ident: Vec<f64>, $($rest:tt)*) => {
        scores!(@@ $kind inner $head {$($done)* $(#[$meta])*} $field: Vec<f64>, $($rest)*);
    };
    (@ $head:tt {$($done:tt)*} $(#[$meta:meta])* $kind:ident $field:ident: $type:ty, $($rest:tt)*) => {
        scores!(@@ $kind own $head {$($done)* $(#[$meta])*} $field: $type, $($rest)*);
    };
    (@@ fraction own $head:tt {$($done:tt)*} $field:ident: $type:ty, $($rest:tt)*) => {
        scores!(@ $head {$($done)* #[schemars(range(min = 0.0, max = 1.0))] pub $field: $type,} $($rest)*);
    };
    (@@ fraction inner $head:tt {$($done:tt)*} $field:ident: $type:ty, $($rest:tt)*) => {
        scores!(@ $head {$($done)* #[schemars(inner(range(min = 0.0, max = 1.0)))] pub $field: $type,} $($rest)*);
    };
    (@@ not_negative own $head:tt {$($done:tt)*} $field:ident: $type:ty, $($rest:tt)*) => {
        scores!(@ $head {$($done)* #[schemars(range(min = 0.0))] pub $field: $type,} $($rest)*);
    };
    (@@ not_negative inner $head:tt {$($done:tt)*} $field:ident: $type:ty, $($rest:tt)*) => {
        scores!(@ $head {$($done)* #[schemars(inner(range(min = 0.0)))] pub $field: $type,} $($rest)*);
    };
    (@ [$(#[$meta:meta])* $name:ident] {$($fields:tt)*}) => {
        $(#[$meta])*
        #[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
        #[serde(default)]
        pub struct $name {
            $($fields)*
        }
    };
}

pub mod boxes;
pub mod candidates;
pub mod clear;
pub mod convention_check;
pub mod crlb;
pub mod crps;
pub mod ctc;
pub mod curves;
pub mod detection;
pub mod field;
pub mod gate;
pub mod gdpt;
mod hint;
pub mod hota;
pub mod identity;
pub mod isbi;
pub mod links;
pub mod lpt;
pub mod matching;
pub mod measurement;
pub mod motion;
pub mod neighbors;
mod options;
pub mod orientation;
pub mod planes;
mod read;
mod recorded;
mod score;
pub mod score_keys;
pub mod size;
pub mod statistics;
pub mod track_set;
pub mod truth;
pub mod uncertainty;
pub mod units;

use crate::results::{Field, Points, TrackerResult};
use convention_check::ConventionCheck;
use detection::Detection;
use field::true_field::TrueFields;
use gate::Gate;
pub use hint::Hint;
use matching::{Cost, Matching};
use motion::TrackComparison;
pub use options::EvaluateOptions;
pub use read::{Truth, evaluate_files, evaluate_source};
pub use score::{Counts, Definitions, DetectionAtGate, Offset, PositionUncertainty, Score, Versions};
use storage::advice;
use storage::dataset::RecordingFacts;
use storage::dataset::manifest::{GENERATOR_VERSION, ScoringGates};
use storage::error::{Error, Result};
use track_set::TrackSet;
use truth::{ScoredPoints, TrueParticles};
pub use units::UnitScores;
use units::{Divided, Units};

/// A score together with the points or vectors it was computed from, for tables and reports.
#[derive(Debug, Clone, Default)]
pub struct Evaluation {
    /// The scores.
    pub score: Score,
    /// Truth and matched result, if the result holds particles.
    pub particles: Option<Particles>,
    /// Vectors with their true displacements, if the result holds a field.
    pub vectors: Vec<field::ComparedVector>,
    /// Points in frames whose plane is known (recordings).
    pub plane_points: Vec<planes::PlanePoint>,
    /// Width and height of the images with these points, px.
    pub sensor_px: Option<(f64, f64)>,
    /// What a paired comparison with other results needs.
    pub units: UnitScores,
}

/// True particles and the result points matched to them.
#[derive(Debug, Clone)]
pub struct Particles {
    /// The scored points of truth and result.
    pub scored: ScoredPoints,
    /// The one-to-one matching A1.
    pub matching: Matching,
    /// Whether depth was scored.
    pub depth: bool,
    /// Width and height of the images, px.
    pub sensor_px: Option<(f64, f64)>,
    /// True velocity along x of every row of the truth, um/s; empty if unknown.
    pub true_u_um_s: Vec<f64>,
    /// Velocity along x of every result point, as reported or from differences of positions, um/s; NaN if
    /// undefined.
    pub found_u_um_s: Vec<f64>,
}

/// Scores a result.
/// Errors: a truth without what the result is; options that do not apply to it.
pub fn evaluate(truth: &Truth, result: &TrackerResult, options: &EvaluateOptions) -> Result<Evaluation> {
    options.check()?;
    let is_field = matches!(result, TrackerResult::Field(_));
    if let Some(option) = options.foreign_option(is_field) {
        let [of, is] = if is_field { ["particles", "a field"] } else { ["fields", "particles"] };
        let what = format!(": is for results that are {of}; this one is {is}");
        return Err(Error::option(advice!(option, what)));
    }
    let options = &options.or(&truth.facts.rules);
    options.check()?;
    let lacks = |what: &str| Error::input(format!("{}: no truth of {what}", truth.facts.name));
    let mut evaluation = match result {
        TrackerResult::Points(points) if truth.facts.is_recording => {
            let mut evaluation = recorded::evaluate(truth, points, options)?;
            evaluation.score.warnings.extend(truth.warnings.iter().cloned());
            evaluation
        }
        TrackerResult::Points(points) => {
            let of = truth.particles.as_ref().ok_or_else(|| lacks("particles"))?;
            let mut evaluation = particles(of, points, options)?;
            evaluation.score.warnings.extend(truth.warnings.iter().cloned());
            match &truth.boxes {
                _ if points.boxes.is_empty() => {}
                Some(boxes) => evaluation.score.boxes = Some(boxes::BoxScore::of(boxes, points)),
                None => evaluation.score.warnings.push(NO_BOXES.to_owned()),
            }
            evaluation
        }
        TrackerResult::Field(found) => {
            let of = truth.fields.as_ref().ok_or_else(|| lacks("fields"))?;
            vectors(of, found, &truth.facts, options)
        }
    };
    let score = &mut evaluation.score;
    score.truth_is_secret = truth.facts.is_from_key;
    if score.truth_is_secret {
        // A hash of the truth would confirm guesses.
        score.definitions.truth_sha256 = None;
    }
    score.definitions.axes = truth.axes.clone();
    score.definitions.rank_by.clone_from(&truth.facts.rules.rank_by);
    if let Some(scenario) = truth.scenario.as_ref().filter(|_| options.crlb) {
        let sizes = truth.particles.as_ref().map_or(&[][..], |particles| &particles.sizes);
        match crlb::from_scenario(
            scenario,
            sizes,
            score.detection.as_ref(),
            &score.curves,
            score.size.is_some(),
        )? {
            Ok(bound) => {
                let spheroids = truth.particles.as_ref().map_or_else(Vec::new, TrueParticles::spheroids);
                let median_deg = score.orientation.as_ref().and_then(|orientation| orientation.median_deg);
                score.crlb = Some(bound.with_axes(scenario, &spheroids, median_deg)?);
            }
            Err(why) => score.warnings.push(format!("no Cramer-Rao bound: {why}")),
        }
    }
    Ok(evaluation)
}

const NO_BOXES: &str = "boxes are not scored: the dataset has no truth/boxes.csv (truth: (boxes: true))";

const NO_DEPTH: &str =
    "z is 0 in every row of the result, which is taken as no depth: positions in the image plane are scored";

/// Scores a displacement field.
fn vectors(
    truth: &TrueFields,
    found: &Field,
    facts: &RecordingFacts,
    options: &EvaluateOptions,
) -> Evaluation {
    let field::ScoredField { score, vectors, units, squares_found, notes, hints, warnings } =
        field::evaluate(truth, found, options.seed);
    let score = Score {
        dataset: facts.name.clone(),
        field: Some(score),
        assumptions: [found.notes.clone(), notes].concat(),
        hints,
        warnings: [found.warnings.clone(), warnings].concat(),
        definitions: Definitions {
            assignment: "none".to_owned(),
            bootstrap_resamples: statistics::RESAMPLES,
            bootstrap_seed: options.seed,
            ..definitions(facts)
        },
        counts: Counts {
            n_nan: found.n_nan,
            units: units.n_units(),
            units_found: squares_found,
            ..Counts::default()
        },
        ..Score::default()
    };
    Evaluation { score, vectors, units, ..Evaluation::default() }
}

/// The part of the definitions that comes from the dataset.
fn definitions(facts: &RecordingFacts) -> Definitions {
    Definitions {
        dataset: facts.name.clone(),
        truth_sha256: facts.sha256.clone(),
        versions: Versions {
            microsig: GENERATOR_VERSION.to_owned(),
            dataset_generator: facts.generator.clone(),
        },
        ..Definitions::default()
    }
}

/// Scores particles.
/// Errors: options that do not apply; a gate so wide that a frame has too many pairs.
pub fn particles(truth: &TrueParticles, points: &Points, options: &EvaluateOptions) -> Result<Evaluation> {
    let depth = options::dimensions(truth, points, options)?;
    let gate = options::gate(truth, depth, options)?;
    let h = truth.facts.depth_h_um();
    let isbi_gate_px = options.isbi_gate_px.unwrap_or(ScoringGates::ISBI_PX);
    let region = options::region(truth, options)?;
    let scored = truth.scored(points, &gate, !depth, region)?;
    let (t, r) = (&scored.truth, &scored.result);
    let matching = matching::optimal(t, r, &gate, Cost::Squares)?;
    let candidates = candidates::Candidates::new(t, r, &gate)?;
    let resampled = &Units::new((t, r), &matching, &candidates, options.seed);
    let (detection, of_points) = Detection::of(t, r, &matching, depth, resampled);

    let convention_check = ConventionCheck::new(truth, points, &gate, !depth, region);
    let hints = convention_check.hints(&detection)?;
    let offset = if options.auto_offset { convention_check.offset()? } else { None };
    let n_unlinked = points.rows.iter().filter(|p| p.track < 0).count();
    let counts = counts(&scored, &matching, points, n_unlinked, &of_points);
    let warnings = cautions(truth, points, &counts, !depth && options.dims.is_none());
    // Positions alone say nothing about links.
    let is_linked = points.rows.is_empty() || n_unlinked < points.rows.len();

    let divided = Divided { clouds: (t, r), matching: &matching, candidates: &candidates, depth };
    let (isbi, of_isbi) = isbi::Isbi::of(t, r, &isbi_gate(&gate, isbi_gate_px, depth), resampled)?;
    let (hota, of_hota) = hota::Hota::of(t, r, &candidates, resampled);
    let (links, of_links) = links::Links::of(t, r, &matching, resampled);
    let (axes, ambiguous) = ((&truth.axes[..], &points.axes[..]), divided.ambiguous());
    let matched = (&matching, &ambiguous[..]);
    let (orientation, of_angles) = orientation::Orientation::of((t, r), axes, matched, resampled).unzip();
    let (size, of_sizes) = size::Size::of(truth, (t, r), &points.diameters_um, matched, resampled).unzip();
    let z_um = if gate.z_um.is_finite() { Some(gate.z_um) } else { h.map(|h| ScoringGates::over(h).z_um) };
    let gates = (gate.xy_px, z_um.filter(|_| depth));
    let (crps, of_crps) = crps::Crps::of((t, r), &points.sigma, matched, gates, resampled);
    let in_plane = || isbi::Isbi::of(t, r, &isbi_gate(&gate, isbi_gate_px, false), resampled);
    let isbi_2d = (isbi.dims == 3).then(in_plane).transpose()?.map(|(isbi, _)| isbi);
    let mut assumptions = truth.notes.clone();
    assumptions.extend(points.notes.iter().cloned());
    let velocities = motion::reported(truth, points).unwrap_or_else(|note| {
        assumptions.push(note);
        None
    });
    let compared = TrackComparison {
        truth,
        clouds: (t, r),
        matching: &matching,
        depth,
        reported: velocities.as_deref(),
    };
    let units = UnitScores {
        detection: of_points.iter().map(|s| [s[0], s[1], s[2]]).collect(),
        links: of_links,
        hota: of_hota.iter().map(|sums| sums.to_vec()).collect(),
        isbi: of_isbi,
        angles: of_angles.unwrap_or_default(),
        sizes: of_sizes.unwrap_or_default(),
        crps: of_crps,
        velocity: divided.velocity(&compared),
        ..divided.points(resampled)
    };
    let score = Score {
        dataset: truth.facts.name.clone(),
        gates: at_other_gates((t, r), &gate, h, depth)?,
        links: is_linked.then_some(links),
        isbi: Some(isbi),
        isbi_2d,
        hota: Some(hota),
        clear: Some(clear::Clear::of(t, r, &candidates, gate.xy_px, resampled)),
        identity: Some(identity::Identity::of(t, r, &candidates, resampled)),
        ctc: Some(ctc::Ctc::of(t, r, &matching)),
        gdpt: gdpt_of(truth, (t, r), (gate.xy_px, depth), options, resampled)?,
        uncertainty: claims(points, (t, r), &matching, depth),
        crps: Some(crps),
        orientation,
        size,
        lpt: Some(lpt::Lpt::of(truth, (t, r), &matching, depth, velocities.as_deref(), resampled)),
        curves: curves::curves(truth, (t, r), &matching, depth),
        counts,
        offset: offset.map(|(shift, f1_without)| Offset { x_px: shift[0], y_px: shift[1], f1_without }),
        definitions: Definitions {
            gate: Some(gate),
            dims: if depth { 3 } else { 2 },
            assignment: "lap-maxcard-d2".to_owned(),
            isbi_gate_px,
            border_px: options.border_px,
            depth_range_h_um: h,
            bootstrap_resamples: statistics::RESAMPLES,
            bootstrap_seed: options.seed,
            ..definitions(&truth.facts)
        },
        assumptions,
        hints,
        warnings,
        detection: Some(detection),
        ..Score::default()
    };
    let particles = Particles {
        found_u_um_s: motion::found_u(truth, (t, r), &matching, velocities.as_deref()),
        true_u_um_s: truth.velocity_um_s.iter().map(|v| v[0]).collect(),
        sensor_px: truth.facts.sensor_px,
        matching,
        depth,
        scored,
    };
    Ok(Evaluation { score, particles: Some(particles), units, ..Evaluation::default() })
}

/// The scores of general defocusing particle tracking, if depth is scored and its range known.
fn gdpt_of(
    truth: &TrueParticles,
    (t, r): (&TrackSet, &TrackSet),
    (xy_px, depth): (f64, bool),
    options: &EvaluateOptions,
    units: &Units,
) -> Result<Option<gdpt::Gdpt>> {
    let range = truth.facts.depth_um.zip(truth.facts.depth_h_um()).filter(|_| depth);
    let gdpt = range.map(|(range, h)| {
        let gates = (xy_px, options.gate_z_um.unwrap_or(ScoringGates::over(h).z_um));
        gdpt::Gdpt::of(t, r, gates, range, units)
    });
    gdpt.transpose()
}

/// Caveats for reading the scores.
fn cautions(truth: &TrueParticles, points: &Points, counts: &Counts, is_flat: bool) -> Vec<String> {
    let mut warnings = Vec::new();
    warnings.extend((is_flat && truth.has_z && points.has_z).then(|| NO_DEPTH.to_owned()));
    let beyond = |frames: u32| points.rows.iter().filter(|p| p.frame >= frames).count();
    if let Some(n) = truth.facts.frames.map(beyond).filter(|n| *n > 0) {
        let frames = truth.facts.frames.unwrap_or(0);
        warnings.push(format!("{n} points lie in frames beyond the dataset's {frames}"));
    }
    if points.n_nan > 0 && points.rows.is_empty() {
        warnings.push(format!(
            "none of the {} rows of the result has coordinates: nothing is scored",
            points.n_nan
        ));
    }
    if counts.frames_missing > 0 {
        warnings.push(format!(
            "next to nothing is found in {} of {} frames, much less than in the others",
            counts.frames_missing, counts.frames
        ));
    }
    if counts.n_unlinked == points.rows.len() && counts.n_unlinked > 0 {
        warnings.push(
            "no point is linked: links are not scored, track scores treat each point as a track of its own"
                .to_owned(),
        );
    }
    if counts.n_truth + counts.n_result == 0 {
        let what = "neither truth nor result has a scored particle: nothing was missed, rates are null";
        warnings.push(what.to_owned());
    }
    warnings
}

/// The ISBI gate; with depth, z is scaled by gate_xy / gate_z.
fn isbi_gate(gate: &Gate, isbi_px: f64, depth: bool) -> Gate {
    match gate.z_um {
        z if depth && z.is_finite() => Gate::ellipsoid(isbi_px, isbi_px * z / gate.xy_px),
        _ => Gate::radial(isbi_px),
    }
}

/// Detection scores at the additional gates.
fn at_other_gates(
    (t, r): (&TrackSet, &TrackSet),
    gate: &Gate,
    h: Option<f64>,
    depth: bool,
) -> Result<Vec<DetectionAtGate>> {
    let mut gates = Vec::new();
    for other in options::other_gates(gate, h) {
        let matching = matching::optimal(t, r, &other, Cost::Squares)?;
        let (at, _) = Detection::of(t, r, &matching, depth, &Units::single(t, r));
        gates.push(DetectionAtGate {
            gate: other.to_string(),
            precision: at.precision,
            recall: at.recall,
            f1: at.f1,
            rmse_xy_px: at.rmse_xy_px,
            rmse_z_um: at.rmse_z_um,
        });
    }
    Ok(gates)
}

fn counts<const N: usize>(
    scored: &ScoredPoints,
    matching: &Matching,
    points: &Points,
    n_unlinked: usize,
    units: &[[f64; N]],
) -> Counts {
    let (t, r) = (&scored.truth, &scored.result);
    let frames = detection::per_frame(t, r, matching);
    Counts {
        frames: frames.len(),
        frames_missing: detection::missing_frames(&frames),
        n_truth: t.len(),
        n_result: r.len(),
        ignored_truth: scored.ignored_truth,
        ignored_result: scored.ignored_result,
        n_nan: points.n_nan,
        n_unlinked,
        tracks_truth: t.n_tracks(),
        tracks_result: r.n_tracks(),
        units: units.len(),
        units_found: units.iter().filter(|unit| unit[0] > 0.0).count(),
    }
}

/// Calibration of the uncertainties claimed for matched points; `None` if the result claims none.
fn claims(
    points: &Points,
    (t, r): (&TrackSet, &TrackSet),
    matching: &Matching,
    depth: bool,
) -> Option<PositionUncertainty> {
    if points.sigma.is_empty() {
        return None;
    }
    let axis = |k: usize| {
        let errors = matching.pairs().map(|(i, j)| {
            let claimed = points.sigma[r.points[j].source as usize][k];
            (detection::error(t, r, (i, j))[k], claimed)
        });
        uncertainty::Uncertainty::of(errors)
    };
    Some(PositionUncertainty { x: axis(0), y: axis(1), z: axis(2).filter(|_| depth) })
}
