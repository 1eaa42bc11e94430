//! `score.json`: all scores of a result. Its keys are an interface: the changelog names every one that is renamed.
//!
//! The doc comments define the keys: docs/score_keys.md is generated from them. `compare` checks the ranges.

use std::collections::BTreeMap;

use storage::dataset::manifest::Metric;

use super::gate::Gate;
use super::hint::Hint;
use super::uncertainty::Uncertainty;
use super::{
    boxes, clear, crlb, crps, ctc, curves, detection, field, gdpt, hota, identity, isbi, links, lpt,
    orientation, planes, size,
};

scores! {
    /// All scores of a result.
    pub struct Score {
        /// Name of the dataset.
        pub dataset: String,
        /// Name of the result file.
        pub result: String,
        /// Detection and localization; null for fields.
        pub detection: Option<detection::Detection>,
        /// Detection at additional gates.
        pub gates: Vec<DetectionAtGate>,
        /// Links between consecutive points of tracks.
        pub links: Option<links::Links>,
        /// Scores of the ISBI Particle Tracking Challenge.
        pub isbi: Option<isbi::Isbi>,
        /// The same in the image plane only, if `isbi` has depth.
        pub isbi_2d: Option<isbi::Isbi>,
        /// Higher order tracking accuracy (HOTA).
        pub hota: Option<hota::Hota>,
        /// CLEAR MOT scores.
        pub clear: Option<clear::Clear>,
        /// Identity scores (IDF1).
        pub identity: Option<identity::Identity>,
        /// Scores of the Cell Tracking Challenge.
        pub ctc: Option<ctc::Ctc>,
        /// Scores of general defocusing particle tracking; null without depth.
        pub gdpt: Option<gdpt::Gdpt>,
        /// Calibration of claimed uncertainties of positions.
        pub uncertainty: Option<PositionUncertainty>,
        /// Positions with their claimed uncertainties, by a proper scoring rule (CRPS); null for fields.
        pub crps: Option<crps::Crps>,
        /// Scores of Lagrangian particle tracking.
        pub lpt: Option<lpt::Lpt>,
        /// Boxes of a detector; null without boxes in result and truth.
        pub boxes: Option<boxes::BoxScore>,
        /// Errors of z where all particles of a frame are in a plane of known height (recordings).
        pub planes: Option<planes::PlaneScore>,
        /// Orientation of spheroids; null without axes in the truth.
        pub orientation: Option<orientation::Orientation>,
        /// Diameters; null without diameters in result and truth.
        pub size: Option<size::Size>,
        /// Displacement field (PIV); null for particles.
        pub field: Option<field::FieldScore>,
        /// Cramer-Rao bound (`--crlb`).
        pub crlb: Option<crlb::Crlb>,
        /// Recall and errors against depth, neighbor distance, SNR and overlap.
        pub curves: Vec<curves::Curve>,
        /// Numbers of frames, points and tracks that were scored and ignored.
        pub counts: Counts,
        /// Shift of the whole result that fits best (`--auto-offset`).
        pub offset: Option<Offset>,
        /// Rules by which the result was scored.
        pub definitions: Definitions,
        /// How the files were interpreted.
        pub assumptions: Vec<String>,
        /// Probable mistakes of convention: interpretations of the file under which the result would score
        /// better.
        pub hints: Vec<Hint>,
        /// What cannot be scored, because only a part of the truth is known (recordings).
        pub unknown: Vec<String>,
        /// Caveats for reading the scores.
        pub warnings: Vec<String>,
        /// Whether the truth is withheld; the folder `for_team` then contains the scores that participants may
        /// see.
        pub truth_is_secret: bool,
    }
}

impl Score {
    /// Number of frames or image pairs that are missing in the result.
    pub fn missing(&self) -> usize {
        self.counts.frames_missing + self.field.as_ref().map_or(0, |field| field.n_pairs_missing)
    }

    /// Hints and warnings, in this order.
    pub fn caveats(&self) -> impl Iterator<Item = &str> {
        self.hints.iter().map(|hint| hint.what.as_str()).chain(self.warnings.iter().map(String::as_str))
    }
}

scores! {
    /// Calibration of claimed uncertainties of positions.
    pub struct PositionUncertainty {
        /// Calibration for x.
        pub x: Option<Uncertainty>,
        /// Calibration for y.
        pub y: Option<Uncertainty>,
        /// Calibration for z.
        pub z: Option<Uncertainty>,
    }

    /// Detection at an additional gate.
    pub struct DetectionAtGate {
        /// Description of the gate.
        pub gate: String,
        /// TP / (TP + FP).
        fraction precision: Option<f64>,
        /// TP / (TP + FN).
        fraction recall: Option<f64>,
        /// 2 TP / (2 TP + FP + FN).
        fraction f1: Option<f64>,
        /// Root mean square distance in the image plane.
        not_negative rmse_xy_px: Option<f64>,
        /// Root mean square error of z.
        not_negative rmse_z_um: Option<f64>,
    }

    /// Numbers of frames, points and tracks that were scored and ignored.
    pub struct Counts {
        /// Number of frames with a scored point in truth or result.
        pub frames: usize,
        /// Number of frames with less than a quarter of the matches expected from the recall of all frames; 0 if
        /// chance explains them.
        pub frames_missing: usize,
        /// Number of scored true particles.
        pub n_truth: usize,
        /// Number of scored result points.
        pub n_result: usize,
        /// Number of true particles that are not scored: invisible, outside the depth range, or near the edge.
        pub ignored_truth: usize,
        /// Number of result points assigned to ignored true particles.
        pub ignored_result: usize,
        /// Number of rows without coordinates, which were dropped.
        pub n_nan: usize,
        /// Number of result points without a track.
        pub n_unlinked: usize,
        /// Number of true tracks.
        pub tracks_truth: usize,
        /// Number of result tracks.
        pub tracks_result: usize,
        /// Number of independent units, over which intervals resample: true tracks (at most 2000; more are merged), or squares of
        /// 32 px with reference nodes.
        pub units: usize,
        /// Number of units in which a particle is matched; for fields, of squares in which a node is covered in any image pair.
        pub units_found: usize,
    }

    /// The shift of the whole result that fits best. It is reported, never applied.
    pub struct Offset {
        /// Shift along x.
        pub x_px: f64,
        /// Shift along y.
        pub y_px: f64,
        /// F1 without this shift.
        fraction f1_without: f64,
    }

    /// Rules by which the result was scored.
    pub struct Definitions {
        /// Name of the dataset.
        pub dataset: String,
        /// SHA-256 of the true particles (truth/tracks.csv or the bare table); identifies the dataset.
        pub truth_sha256: Option<String>,
        /// Gate of assignment A1; null for fields.
        pub gate: Option<Gate>,
        /// Number of dimensions in which particles are scored, 2 or 3; 0 for fields.
        pub dims: u8,
        /// Assignment: `lap-maxcard-d2` (A1) for particles, `none` for fields.
        pub assignment: String,
        /// Gate of the ISBI scores.
        not_negative isbi_gate_px: f64,
        /// Width of the image border in which particles are not scored.
        not_negative border_px: f64,
        /// Depth range h; null if unknown.
        pub depth_range_h_um: Option<f64>,
        /// Number of bootstrap resamples.
        pub bootstrap_resamples: usize,
        /// Seed of the bootstrap.
        pub bootstrap_seed: u64,
        /// Parameter values of the dataset in its sweep, by key; empty if it is not a case of a sweep.
        pub axes: BTreeMap<String, serde_json::Value>,
        /// The scores by which the dataset ranks results, in order of priority; left out if it states none.
        #[serde(skip_serializing_if = "Vec::is_empty")]
        pub rank_by: Vec<Metric>,
        /// Versions of scorer and dataset.
        pub versions: Versions,
    }

    /// Versions of scorer and dataset.
    pub struct Versions {
        /// Version of microsig that computed the scores.
        pub microsig: String,
        /// Version of microsig that generated the dataset.
        pub dataset_generator: Option<String>,
    }
}
