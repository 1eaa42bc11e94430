//! Scores: any tracker's result against the truth.
//!
//! Scores never see images; they compare points. Definitions, gates and what other programs do differently are in
//! docs/scoring.md. [`evaluate`] is the whole path: read, keep what is scored, match, score.

pub mod assignment;
pub mod clear;
pub mod cloud;
pub mod crlb;
pub mod ctc;
pub mod curves;
pub mod detection;
pub mod diagnosis;
pub mod field;
pub mod gate;
pub mod gdpt;
pub mod hota;
pub mod identity;
pub mod isbi;
pub mod links;
pub mod lpt;
pub mod matching;
pub mod motion;
pub mod neighbours;
pub mod statistics;
pub mod truth;
pub mod uncertainty;
pub mod wide;

use std::path::Path;

use serde::Serialize;

use crate::dataset::manifest::GENERATOR_VERSION;
use crate::error::{Error, Result};
use crate::results::{self, Conventions, Found, Points};
use diagnosis::Diagnosis;
use gate::{Edge, Gate, Shape};
use matching::{Cost, Matching};
use statistics::Bootstrap;
use truth::{Facts, Scored, Truth};

/// How to score; `None`: as the dataset says.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// What is known about the result's file.
    pub conventions: Conventions,
    /// Shape of the gate.
    pub shape: Option<Shape>,
    /// Its width, px.
    pub gate_xy_px: Option<f64>,
    /// Its height, um.
    pub gate_z_um: Option<f64>,
    /// 2 or 3 dimensions.
    pub dims: Option<u8>,
    /// Gate of the ISBI scores, px.
    pub isbi_gate_px: Option<f64>,
    /// Particles this near to the edge of the sensor are not scored, px.
    pub border_px: f64,
    /// Depth of the plane whose truth fields are scored against, um; `None`: the particles' focus.
    pub plane_um: Option<f64>,
    /// Whether to look for a shift of the whole result.
    pub auto_offset: bool,
    /// Whether to compute the Cramer-Rao bound of the dataset's optics.
    pub crlb: bool,
    /// Seed of the bootstrap.
    pub seed: u64,
}

impl Options {
    /// The first option given that is of the other kind of results.
    fn of_others(&self, field: bool) -> Option<&'static str> {
        let of_particles = [
            ("--gate", self.shape.is_some()),
            ("--gate-xy", self.gate_xy_px.is_some()),
            ("--gate-z", self.gate_z_um.is_some()),
            ("--dims", self.dims.is_some()),
            ("--isbi-gate", self.isbi_gate_px.is_some()),
            ("--border", self.border_px > 0.0),
            ("--auto-offset", self.auto_offset),
        ];
        let of_fields = [("--plane", self.plane_um.is_some())];
        let others = if field { &of_particles[..] } else { &of_fields[..] };
        others.iter().find(|(_, given)| *given).map(|(name, _)| *name)
    }
}

/// The gate of the image plane if nobody asks for another, px.
pub const GATE_XY_PX: f64 = 2.0;
/// The gate of the ISBI scores, px.
pub const ISBI_GATE_PX: f64 = 5.0;

/// All scores of a result. The keys are a contract: they are added to, never renamed.
#[derive(Debug, Clone, Default, Serialize)]
#[allow(missing_docs)]
pub struct Score {
    pub dataset: String,
    pub result: String,
    pub detection: Option<detection::Detection>,
    /// Detection at further gates.
    pub gates: Vec<AtGate>,
    pub links: Option<links::Links>,
    pub isbi: Option<isbi::Isbi>,
    /// The ISBI scores in the image plane alone, if `isbi` has depth.
    pub isbi_2d: Option<isbi::Isbi>,
    pub hota: Option<hota::Hota>,
    pub clear: Option<clear::Clear>,
    pub identity: Option<identity::Identity>,
    pub ctc: Option<ctc::Ctc>,
    pub gdpt: Option<gdpt::Gdpt>,
    /// Claimed uncertainties of x and y (px) and z (um).
    pub uncertainty: Option<Claims>,
    pub lpt: Option<lpt::Lpt>,
    pub field: Option<field::FieldScore>,
    pub crlb: Option<crlb::Crlb>,
    pub curves: Vec<curves::Curve>,
    pub counts: Counts,
    pub offset: Option<Offset>,
    pub definitions: Definitions,
    pub assumptions: Vec<String>,
    pub warnings: Vec<String>,
}

/// Claimed uncertainties of positions, by axis; null without claims.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Claims {
    pub x: Option<uncertainty::Uncertainty>,
    pub y: Option<uncertainty::Uncertainty>,
    pub z: Option<uncertainty::Uncertainty>,
}

/// Detection at one more gate.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct AtGate {
    pub gate: String,
    pub precision: Option<f64>,
    pub recall: Option<f64>,
    pub f1: Option<f64>,
    pub rmse_xy_px: Option<f64>,
    pub rmse_z_um: Option<f64>,
}

/// What was scored and what was not.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Counts {
    pub frames: usize,
    pub n_truth: usize,
    pub n_result: usize,
    pub ignored_truth: usize,
    pub ignored_result: usize,
    pub n_nan: usize,
    pub n_unlinked: usize,
    pub tracks_truth: usize,
    pub tracks_result: usize,
}

/// The shift of the whole result that would fit best. It is reported, never applied.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Offset {
    pub x_px: f64,
    pub y_px: f64,
    pub f1_without: f64,
}

/// By which rules.
#[derive(Debug, Clone, Default, Serialize)]
#[allow(missing_docs)]
pub struct Definitions {
    /// Name of the dataset, and the SHA-256 of its true particles: what tells datasets apart.
    pub dataset: String,
    pub truth_sha256: Option<String>,
    pub gate: Option<Gate>,
    pub dims: u8,
    pub assignment: &'static str,
    pub isbi_gate_px: f64,
    pub border_px: f64,
    pub depth_range_h_um: Option<f64>,
    pub bootstrap_resamples: usize,
    pub bootstrap_seed: u64,
    pub versions: Versions,
}

/// Versions of scorer and dataset.
#[derive(Debug, Clone, Default, Serialize)]
#[allow(missing_docs)]
pub struct Versions {
    pub microsig: &'static str,
    pub dataset_generator: Option<String>,
}

/// A score with all that it was made from, for tables and reports.
#[derive(Debug, Clone)]
pub struct Evaluation {
    /// The scores.
    pub score: Score,
    /// Truth and matched result, if the result holds particles.
    pub particles: Option<Particles>,
    /// The vectors with their truth, if it holds a field.
    pub vectors: Vec<field::Compared>,
}

/// Truth and matched result.
#[derive(Debug, Clone)]
pub struct Particles {
    /// What was scored.
    pub scored: Scored,
    /// Who is whom.
    pub matching: Matching,
    /// Whether depth was scored.
    pub depth: bool,
    /// Width and height of the images, px.
    pub sensor_px: Option<(f64, f64)>,
}

/// Scores a result.
///
/// # Errors
/// Files that cannot be read or do not hold what they should; options that do not fit them.
pub fn evaluate(dataset: &Path, result: &Path, options: &Options) -> Result<Evaluation> {
    let mut given = options.conventions;
    if dataset.is_dir() {
        given = truth::conventions(dataset, given)?;
    }
    let name = result.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let found = results::read(result, &given)?;
    let is_field = matches!(found, Found::Field(_));
    if let Some(option) = options.of_others(is_field) {
        let [of, is] = if is_field { ["particles", "a field"] } else { ["fields", "particles"] };
        return Err(Error::input(format!("{option}: is for results that are {of}; this one is {is}")));
    }
    let mut evaluation = match found {
        Found::Points(points) => particles(&Truth::read(dataset, &given)?, &points, options)?,
        Found::Field(found) => {
            let field::Scored { score, vectors, notes, warnings } =
                field::evaluate(dataset, &found, options.plane_um, options.seed)?;
            let facts = Facts::of(dataset, &given)?;
            let definitions = Definitions {
                dataset: facts.name.clone(),
                truth_sha256: facts.sha256,
                assignment: "none",
                bootstrap_resamples: statistics::RESAMPLES,
                bootstrap_seed: options.seed,
                versions: Versions { microsig: GENERATOR_VERSION, dataset_generator: facts.generator },
                ..Definitions::default()
            };
            let counts = Counts { n_nan: found.n_nan, ..Counts::default() };
            let score = Score {
                dataset: facts.name,
                field: Some(score),
                assumptions: [found.notes, notes].concat(),
                warnings,
                definitions,
                counts,
                ..Score::default()
            };
            Evaluation { score, particles: None, vectors }
        }
    };
    let score = &mut evaluation.score;
    score.result = name;
    if options.crlb {
        if !dataset.is_dir() {
            return Err(Error::input("--crlb: a bare table of the truth does not tell the optics"));
        }
        match crlb::of_dataset(dataset, score)? {
            Ok(bound) => score.crlb = Some(bound),
            Err(why) => score.warnings.push(format!("no Cramer-Rao bound: {why}")),
        }
    }
    Ok(evaluation)
}

/// Scores particles.
///
/// # Errors
/// Options that do not fit; a gate that is too wide.
pub fn particles(truth: &Truth, points: &Points, options: &Options) -> Result<Evaluation> {
    if options.border_px > 0.0 && truth.facts.sensor_px.is_none() {
        return Err(Error::input("--border: the size of the images is not known from a bare table"));
    }
    let depth = dimensions(truth, points, options)?;
    let gate = gate(truth, depth, options)?;
    let h = truth.facts.depth_h_um();
    let isbi_gate_px = options.isbi_gate_px.unwrap_or(ISBI_GATE_PX);
    let scored = truth.scored(points, &gate, !depth, options.border_px)?;
    let (t, r) = (&scored.truth, &scored.result);
    let matching = matching::optimal(t, r, &gate, Cost::Squares)?;
    let bootstrap = &Bootstrap { seed: options.seed, pairs: truth.facts.pairs };
    let detection = detection::Detection::of(t, r, &matching, depth, bootstrap);

    let diagnosis = Diagnosis::new(truth, points, &gate, !depth, options.border_px);
    let mut warnings = diagnosis.warnings(&detection)?;
    let beyond = |frames: u32| points.rows.iter().filter(|p| p.frame >= frames).count();
    if let Some(n) = truth.facts.frames.map(beyond).filter(|n| *n > 0) {
        warnings.push(format!(
            "{n} points lie in frames beyond the dataset's {}",
            truth.facts.frames.unwrap_or(0)
        ));
    }
    let n_unlinked = points.rows.iter().filter(|p| p.track < 0).count();
    if n_unlinked == points.rows.len() && n_unlinked > 0 {
        warnings.push("no point is linked: scores of tracks take each for a track of its own".to_owned());
    }
    if t.is_empty() && r.is_empty() {
        warnings.push(
            "neither truth nor result has a particle that is scored: nothing was missed, rates are null"
                .to_owned(),
        );
    }
    let offset = if options.auto_offset { diagnosis.offset()? } else { None };

    let wide = wide::Wide::new(t, r, &gate)?;
    let isbi_gate = |depth: bool| match gate.z_um {
        z if depth && z.is_finite() => Gate::ellipsoid(isbi_gate_px, isbi_gate_px * z / gate.xy_px),
        _ => Gate::radial(isbi_gate_px),
    };
    let isbi = isbi::Isbi::of(t, r, &isbi_gate(depth), bootstrap)?;
    let isbi_2d =
        if isbi.dims == 3 { Some(isbi::Isbi::of(t, r, &isbi_gate(false), bootstrap)?) } else { None };
    let gdpt = match (depth, truth.facts.depth_um, h) {
        (true, Some(range), Some(h)) => {
            let gates = (gate.xy_px, options.gate_z_um.unwrap_or(h / 10.0));
            Some(gdpt::Gdpt::of(t, r, gates, range, bootstrap)?)
        }
        _ => None,
    };
    let mut gates = Vec::new();
    for other in other_gates(&gate, h) {
        let matching = matching::optimal(t, r, &other, Cost::Squares)?;
        let at = detection::Detection::of(t, r, &matching, depth, bootstrap);
        gates.push(AtGate {
            gate: words(&other),
            precision: at.precision,
            recall: at.recall,
            f1: at.f1,
            rmse_xy_px: at.rmse_xy_px,
            rmse_z_um: at.rmse_z_um,
        });
    }
    let mut assumptions = truth.notes.clone();
    assumptions.extend(points.notes.iter().cloned());
    let velocities = motion::reported(truth, points).unwrap_or_else(|note| {
        assumptions.push(note);
        None
    });
    let score = Score {
        dataset: truth.facts.name.clone(),
        links: Some(links::Links::of(t, r, &matching, bootstrap)),
        isbi: Some(isbi),
        isbi_2d,
        hota: Some(hota::Hota::of(t, r, &wide, bootstrap)),
        clear: Some(clear::Clear::of(t, r, &wide, gate.xy_px, bootstrap)),
        identity: Some(identity::Identity::of(t, r, &wide, bootstrap)),
        ctc: Some(ctc::Ctc::of(t, r, &matching)),
        gdpt,
        uncertainty: claims(points, (t, r), &matching, depth),
        lpt: Some(lpt::Lpt::of(truth, (t, r), &matching, depth, velocities.as_deref(), bootstrap)),
        curves: curves::curves(truth, (t, r), &matching, depth),
        counts: Counts {
            frames: cloud::side_by_side(t, r).len(),
            n_truth: t.len(),
            n_result: r.len(),
            ignored_truth: scored.ignored_truth,
            ignored_result: scored.ignored_result,
            n_nan: points.n_nan,
            n_unlinked,
            tracks_truth: t.n_tracks(),
            tracks_result: r.n_tracks(),
        },
        offset: offset.map(|(shift, f1_without)| Offset { x_px: shift[0], y_px: shift[1], f1_without }),
        definitions: Definitions {
            dataset: truth.facts.name.clone(),
            truth_sha256: truth.facts.sha256.clone(),
            gate: Some(gate),
            dims: if depth { 3 } else { 2 },
            assignment: "lap-maxcard-d2",
            isbi_gate_px,
            border_px: options.border_px,
            depth_range_h_um: h,
            bootstrap_resamples: statistics::RESAMPLES,
            bootstrap_seed: options.seed,
            versions: Versions {
                microsig: GENERATOR_VERSION,
                dataset_generator: truth.facts.generator.clone(),
            },
        },
        gates,
        assumptions,
        warnings,
        detection: Some(detection),
        ..Score::default()
    };
    let sensor_px = truth.facts.sensor_px;
    Ok(Evaluation {
        score,
        particles: Some(Particles { scored, matching, depth, sensor_px }),
        vectors: Vec::new(),
    })
}

/// What was claimed of the matched points, if anything was.
fn claims(
    points: &Points,
    (t, r): (&cloud::Cloud, &cloud::Cloud),
    matching: &Matching,
    depth: bool,
) -> Option<Claims> {
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
    Some(Claims { x: axis(0), y: axis(1), z: axis(2).filter(|_| depth) })
}

/// A gate in words.
pub fn words(gate: &Gate) -> String {
    match gate.shape {
        Shape::Radial => format!("radial {} px", gate.xy_px),
        Shape::Ellipsoid => format!("ellipsoid {} px, {} um", gate.xy_px, gate.z_um),
        Shape::Box => format!("box {} px, {} um", gate.xy_px, gate.z_um),
    }
}

/// Whether depth is scored.
fn dimensions(truth: &Truth, points: &Points, options: &Options) -> Result<bool> {
    let both = truth.has_z && points.has_z;
    match options.dims {
        None => Ok(both),
        Some(2) => Ok(false),
        Some(3) if both => Ok(true),
        Some(3) => Err(Error::input("--dims 3: truth and result must both have a depth")),
        Some(other) => Err(Error::input(format!("--dims {other}: expected 2 or 3"))),
    }
}

fn gate(truth: &Truth, depth: bool, options: &Options) -> Result<Gate> {
    let xy_px = options.gate_xy_px.unwrap_or(GATE_XY_PX);
    let z_um = options.gate_z_um.or(truth.facts.depth_h_um().map(|h| h / 10.0));
    let shape = match options.shape {
        Some(Shape::Ellipsoid | Shape::Box) if !depth => {
            return Err(Error::input("--gate: without depth in truth and result the gate is radial"));
        }
        Some(shape) => shape,
        None if depth && z_um.is_some() => Shape::Ellipsoid,
        None => Shape::Radial,
    };
    let z_um = match (shape, z_um) {
        (Shape::Radial, _) => f64::INFINITY,
        (_, Some(z_um)) => z_um,
        (_, None) => {
            return Err(Error::input(
                "--gate: the depth range is not known; give --gate-z or --depth LOW HIGH",
            ));
        }
    };
    for (name, value) in [
        ("--gate-xy", xy_px),
        ("--gate-z", z_um),
        ("--isbi-gate", options.isbi_gate_px.unwrap_or(ISBI_GATE_PX)),
    ] {
        // A square of a smaller gate could vanish, of a larger one it could be infinite.
        let allowed = (1e-6..=1e9).contains(&value) || (name == "--gate-z" && value == f64::INFINITY);
        if !allowed {
            return Err(Error::input(format!("{name} {value}: expected a number from 1e-6 to 1e9")));
        }
    }
    Ok(Gate { shape, xy_px, z_um, edge: Edge::Open })
}

/// The gates that are reported beside the chosen one.
fn other_gates(gate: &Gate, h: Option<f64>) -> Vec<Gate> {
    let mut gates: Vec<Gate> = [1.0, 2.0, 5.0].iter().map(|&xy_px| Gate { xy_px, ..*gate }).collect();
    if gate.shape != Shape::Radial {
        gates.extend(h.map(|h| Gate { z_um: h / 20.0, ..*gate }));
        gates.push(Gate::radial(gate.xy_px));
    }
    gates.retain(|g| g != gate);
    gates
}
