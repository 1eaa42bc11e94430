//! Scores of displacement fields (PIV): every vector is compared with the true displacement at its position.
//!
//! The true displacement is computed from the flow of the scenario; without it, it is interpolated between
//! the nodes of `truth/field.csv` by cubic splines. If there are several planes, one is chosen
//! (`true_field.rs`). Errors are result - truth over valid vectors (flag 0);
//! interpolated vectors (flag 2) are only counted. Definitions: docs/scoring.md.

mod errors;
mod gradients;
mod grid_spline;
mod hints;
mod nodes;
mod peak_locking;
mod spectrum;
#[cfg(test)]
mod tests;
pub mod true_field;
mod vectors;

use std::collections::{BTreeMap, BTreeSet};

use super::hint::Hint;
use super::statistics::ratio;
use super::units::UnitScores;
use crate::results::{Field, FlowVector};
pub use errors::{ComponentErrors, EnsembleErrors, FieldErrors, VectorUncertainty};
pub use gradients::Gradients;
pub use nodes::{NodeErrors, squares};
pub use peak_locking::PeakLocking;
pub use spectrum::{SpectralPoint, Spectrum};
use true_field::{Displacement, TrueFields};
pub use vectors::ComparedVector;

/// RMS of the true displacement about its mean below which a flow is uniform, px.
const UNIFORM_PX: f64 = 0.05;

/// Largest error of an interpolated truth that does not matter, as a share of the vectors' error: it adds
/// 3 % to their RMS error.
const SMALL_SHARE: f64 = 0.25;
/// Error of an interpolated truth that never matters, px: far below the noise of any image.
const NEGLIGIBLE_PX: f64 = 1e-3;

scores! {
    /// Scores of a displacement field: errors against the main truth at this level, against every truth under
    /// `truths`.
    pub struct FieldScore {
        /// Number of vectors in the result.
        pub n_total: usize,
        /// Number of valid vectors (flag 0).
        pub n_reported: usize,
        /// Number of interpolated vectors (flag 2).
        pub n_interpolated: usize,
        /// Number of valid vectors at positions without a truth.
        pub n_outside: usize,
        /// Number of image pairs of the dataset without vectors, if the result gives the image pair of its
        /// vectors.
        pub n_pairs_missing: usize,
        /// Fraction of vectors that are valid, n_reported / n_total.
        fraction data_yield: Option<f64>,
        /// Depth of the plane of the true field; null for a bare table.
        pub plane_um: Option<f64>,
        /// The main truth: central, forward or weighted (by depth).
        pub against: String,
        /// Estimated RMS error of the main truth at the positions of valid vectors; 0 where it is computed from the
        /// flow of the scenario or at nodes, null if a truth is interpolated between too few nodes for an estimate.
        not_negative interpolation_error_px: Option<f64>,
        /// Scores at reference nodes, independent of the positions of the vectors in the result.
        pub nodes: NodeErrors,
        /// Errors against the main truth.
        #[serde(flatten)]
        pub main: FieldErrors,
        /// The same keys for each true field of the dataset.
        pub truths: BTreeMap<String, FieldErrors>,
    }
}

/// A scored displacement field.
#[derive(Debug, Clone, Default)]
pub struct ScoredField {
    /// The scores.
    pub score: FieldScore,
    /// Valid and interpolated vectors with the main truth.
    pub vectors: Vec<ComparedVector>,
    /// Data for a paired comparison with other results.
    pub units: UnitScores,
    /// Number of squares of 32 px in which a reference node is covered in any image pair.
    pub squares_found: usize,
    /// How the truth was chosen, if this needs an explanation.
    pub notes: Vec<String>,
    /// Probable mistakes of convention.
    pub hints: Vec<Hint>,
    /// Caveats for reading the scores.
    pub warnings: Vec<String>,
}

/// A warning if the error of an interpolated truth is not small compared with the result's.
fn coarse_truth(score: &FieldScore) -> Option<String> {
    let interpolated = "the truth is interpolated between its nodes";
    let Some(own) = score.interpolation_error_px else {
        return Some(format!("{interpolated}, which are too few to estimate the error of this"));
    };
    let [u, v] = [&score.main.u_inliers, &score.main.v_inliers].map(|e| e.rms_px.unwrap_or(0.0));
    // The error of the vectors is not quoted: of a withheld truth, it would tell the truth.
    (own > (SMALL_SHARE * u.hypot(v)).max(NEGLIGIBLE_PX)).then(|| {
        format!(
            "{interpolated} with an estimated error of {own:.3} px, which is not small compared with that of the vectors: the \
             nodes are too coarse for this result"
        )
    })
}

/// Scores a field against true fields; `seed`: of the bootstrap.
pub fn evaluate(truth: &TrueFields, field: &Field, seed: u64) -> ScoredField {
    let TrueFields { fields: truths, plane_um, facts, note, .. } = truth;
    let is_there = |v: &FlowVector| v.pair.is_none_or(|pair| facts.has_pair(pair));
    let count = |flag: u8| field.vectors.iter().filter(|v| v.flag == flag).count();
    let n_total = field.vectors.len();
    let mut scored = ScoredField {
        score: FieldScore {
            n_total,
            n_reported: count(0),
            n_interpolated: count(2),
            data_yield: ratio(count(0) as f64, n_total as f64),
            plane_um: *plane_um,
            ..FieldScore::default()
        },
        notes: note.iter().cloned().collect(),
        warnings: truth.warning.iter().cloned().collect(),
        ..ScoredField::default()
    };
    let there: Vec<FlowVector> = field.vectors.iter().copied().filter(is_there).collect();
    for (i, ((kind, grid), moved)) in truths.iter().zip(truth.at(&there)).enumerate() {
        let name = kind.map_or("truth", Displacement::name);
        // Positions without a truth, such as inside a body, are not scored.
        let asked: Vec<ComparedVector> = (there.iter().zip(moved))
            .filter_map(|(v, moved)| Some(ComparedVector { measured: *v, truth: moved? }))
            .collect();
        let compared: Vec<ComparedVector> = asked.iter().copied().filter(|c| c.measured.flag != 1).collect();
        let asked: Vec<FlowVector> = asked.into_iter().map(|c| c.measured).collect();
        let against = FieldErrors::of(&compared, &asked, seed);
        if i == 0 {
            let valid = compared.iter().filter(|c| c.measured.flag == 0).count();
            scored.score.n_outside = scored.score.n_reported - valid;
            (scored.score.against, scored.score.main) = (name.to_owned(), against.clone());
            if 10 * scored.score.n_outside > scored.score.n_reported {
                let pairs =
                    if grid.needs_pairs() { ", or the file does not give their image pair" } else { "" };
                let place = if truth.has_flow() { "the image or the fluid" } else { "its grid" };
                scored.warnings.push(format!(
                    "{} of {} valid vectors have no truth: they lie outside {place}{pairs}",
                    scored.score.n_outside, scored.score.n_reported
                ));
            }
            let (nodes, of_squares, found) = NodeErrors::of(grid, &field.vectors, facts, seed);
            scored.squares_found = found;
            scored.score.nodes = nodes;
            scored.units.nodes = of_squares;
            if scored.score.nodes.spread_px.is_some_and(|spread| spread < UNIFORM_PX) {
                scored.warnings.push(
                    "the true displacement is the same everywhere: a constant field would be correct, so these scores do not \
                     show what a method resolves"
                        .to_owned(),
                );
            }
            scored.hints = hints::hints(field, &compared, truth, facts);
            let valid: Vec<FlowVector> =
                compared.iter().map(|c| c.measured).filter(|v| v.flag == 0).collect();
            scored.score.interpolation_error_px = truth.interpolation_error_px(&valid);
            scored.warnings.extend(coarse_truth(&scored.score));
            scored.vectors = compared;
        }
        scored.score.truths.insert(name.to_owned(), against);
    }
    let named: BTreeSet<u32> = field.vectors.iter().filter_map(|v| v.pair).collect();
    if !named.is_empty() {
        let pairs = || (0..facts.frames.unwrap_or(0)).filter(|pair| facts.has_pair(*pair));
        let missing = pairs().filter(|pair| !named.contains(pair)).count();
        scored.score.n_pairs_missing = missing;
        if missing > 0 {
            scored.warnings.push(format!("{missing} of the {} image pairs have no vectors", pairs().count()));
        }
    }
    let mut unknown: Vec<u32> =
        field.vectors.iter().filter(|v| !is_there(v)).filter_map(|v| v.pair).collect();
    if !unknown.is_empty() {
        let n = unknown.len();
        unknown.sort_unstable();
        unknown.dedup();
        let first: Vec<String> = unknown.iter().take(5).map(u32::to_string).collect();
        let more = if unknown.len() > 5 { ", ..." } else { "" };
        let pairs = format!("{}{more}", first.join(", "));
        scored
            .warnings
            .push(format!("{n} vectors belong to image pairs that the dataset does not have ({pairs})"));
    }
    scored
}
