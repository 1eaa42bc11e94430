//! Tables of an evaluation: `per_frame.csv`, `matches.csv`, `curves.csv`, `vectors.csv`.

use serde::Serialize;

use scoring::evaluate::curves::Bin;
use scoring::evaluate::detection::{error, per_frame};
use scoring::evaluate::matching::NONE;
use scoring::evaluate::statistics::ratio;
use scoring::evaluate::{Evaluation, Particles};
use storage::OutputFolder;
use storage::error::{Error, Result};

/// Name of the file with all scores.
pub const SCORE: &str = "score.json";

/// Name of the file with the input of the paired comparison.
pub(super) const UNITS: &str = "units.json";

/// Writes rows as CSV, with the names of their fields as header.
pub(super) fn rows<R: Serialize>(
    folder: &OutputFolder,
    file: &str,
    rows: impl Iterator<Item = R>,
) -> Result<()> {
    let failed = |e: csv::Error| Error::Write { path: folder.join(file), source: std::io::Error::other(e) };
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer.serialize(row).map_err(failed)?;
    }
    let bytes = writer.into_inner().map_err(|e| failed(e.into_error().into()))?;
    folder.save_bytes(file, bytes)
}

#[derive(Serialize)]
pub(super) struct FrameRow {
    frame: u32,
    tp: usize,
    #[serde(rename = "fn")]
    missed: usize,
    fp: usize,
    rmse_xy_px: Option<f64>,
    rmse_z_um: Option<f64>,
    bias_x_px: Option<f64>,
    bias_y_px: Option<f64>,
}

pub(super) fn frames(of: &Particles) -> impl Iterator<Item = FrameRow> {
    let depth = of.depth;
    per_frame(&of.scored.truth, &of.scored.result, &of.matching).into_iter().map(move |f| {
        let [tp, missed, fp] = f.counts;
        let n = tp as f64;
        FrameRow {
            frame: f.frame,
            tp,
            missed,
            fp,
            rmse_xy_px: ratio(f.axes[0] + f.axes[1], n).map(f64::sqrt),
            rmse_z_um: ratio(f.axes[2], n).map(f64::sqrt).filter(|_| depth),
            bias_x_px: ratio(f.sums[0], n),
            bias_y_px: ratio(f.sums[1], n),
        }
    })
}

#[derive(Serialize)]
pub(super) struct MatchRow {
    frame: u32,
    kind: &'static str,
    /// Row in the table of the truth or of the result, from 0.
    truth_row: Option<u32>,
    result_row: Option<u32>,
    x_px: f64,
    y_px: f64,
    z_um: Option<f64>,
    dx_px: Option<f64>,
    dy_px: Option<f64>,
    dz_um: Option<f64>,
}

/// Every scored point once: matched (at its true position), missed or ghost.
pub(super) fn matches(of: &Particles) -> impl Iterator<Item = MatchRow> + '_ {
    let (truth, result) = (&of.scored.truth, &of.scored.result);
    let z = |z: f64| of.depth.then_some(z);
    let true_ones = truth.points.iter().enumerate().map(move |(i, p)| {
        let r = of.matching.result_for[i];
        let found =
            (r != NONE).then(|| (result.points[r as usize].source, error(truth, result, (i, r as usize))));
        MatchRow {
            frame: p.frame,
            kind: if found.is_some() { "match" } else { "miss" },
            truth_row: Some(p.source),
            result_row: found.map(|f| f.0),
            x_px: p.at.x_px,
            y_px: p.at.y_px,
            z_um: z(p.at.z_um),
            dx_px: found.map(|f| f.1[0]),
            dy_px: found.map(|f| f.1[1]),
            dz_um: found.and_then(|f| z(f.1[2])),
        }
    });
    let ghosts = result.points.iter().enumerate().filter(|(j, _)| of.matching.truth_for[*j] == NONE).map(
        move |(_, p)| MatchRow {
            frame: p.frame,
            kind: "ghost",
            truth_row: None,
            result_row: Some(p.source),
            x_px: p.at.x_px,
            y_px: p.at.y_px,
            z_um: z(p.at.z_um),
            dx_px: None,
            dy_px: None,
            dz_um: None,
        },
    );
    true_ones.chain(ghosts)
}

/// A bin of a curve. The csv crate cannot flatten structs, so the fields of [`Bin`] are repeated.
#[derive(Serialize)]
pub(super) struct CurveLine<'a> {
    against: &'a str,
    from: f64,
    /// Empty if the bin is open.
    to: Option<f64>,
    n_true: usize,
    tp: usize,
    recall: Option<f64>,
    bias_x_px: Option<f64>,
    random_x_px: Option<f64>,
    rms_x_px: Option<f64>,
    bias_y_px: Option<f64>,
    random_y_px: Option<f64>,
    rms_y_px: Option<f64>,
    bias_z_um: Option<f64>,
    random_z_um: Option<f64>,
    rms_z_um: Option<f64>,
}

pub(super) fn curves(evaluation: &Evaluation) -> impl Iterator<Item = CurveLine<'_>> {
    fn line<'a>(against: &'a str, b: &Bin) -> CurveLine<'a> {
        CurveLine {
            against,
            from: b.from,
            to: Some(b.to).filter(|to| to.is_finite()),
            n_true: b.n_true,
            tp: b.tp,
            recall: b.recall,
            bias_x_px: b.bias_x_px,
            random_x_px: b.random_x_px,
            rms_x_px: b.rms_x_px,
            bias_y_px: b.bias_y_px,
            random_y_px: b.random_y_px,
            rms_y_px: b.rms_y_px,
            bias_z_um: b.bias_z_um,
            random_z_um: b.random_z_um,
            rms_z_um: b.rms_z_um,
        }
    }
    evaluation.score.curves.iter().flat_map(|c| c.bins.iter().map(move |b| line(&c.against, b)))
}

#[derive(Serialize)]
pub(super) struct VectorRow {
    pair: Option<u32>,
    x_px: f64,
    y_px: f64,
    dx_px: f64,
    dy_px: f64,
    true_dx_px: f64,
    true_dy_px: f64,
    flag: u8,
}

pub(super) fn vectors(evaluation: &Evaluation) -> impl Iterator<Item = VectorRow> + '_ {
    evaluation.vectors.iter().map(|c| VectorRow {
        pair: c.measured.pair,
        x_px: c.measured.at.x_px,
        y_px: c.measured.at.y_px,
        dx_px: c.measured.moved[0],
        dy_px: c.measured.moved[1],
        true_dx_px: c.truth[0],
        true_dy_px: c.truth[1],
        flag: c.measured.flag,
    })
}
