use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How results are scored and ranked: the defaults of `evaluate`, `compare` and of challenges made from the dataset.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct ScoringRules {
    /// Radius of the matching gate in the image plane.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1e-6, max = 1e9), extend("x-default" = "2"), example = 0.5)]
    pub gate_xy_px: Option<f64>,
    /// Half-height of the matching gate along z.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1e-6, max = 1e9), extend("x-default" = "a tenth of the depth range"), example = 1.0)]
    pub gate_z_um: Option<f64>,
    /// Dimensions in which particles are scored.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 2, max = 3), extend("x-default" = "3 if truth and result have depth"), example = 2)]
    pub dims: Option<u8>,
    /// The scores by which results are ranked, in order of priority.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    #[schemars(extend("x-default" = "those of `compare`"), example = vec![Metric::F1])]
    pub rank_by: Vec<Metric>,
    /// The suite of which the dataset is a part; `suite generate` writes it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub suite: Option<SuitePlace>,
}

/// Place of a dataset in a suite.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct SuitePlace {
    /// Name of the suite.
    #[schemars(example = &"odpc1")]
    pub name: String,
    /// Version of the suite.
    #[schemars(example = &"1.0.0")]
    pub version: String,
    /// Size: smoke, small or full.
    #[schemars(example = &"small")]
    pub size: String,
    /// Track.
    #[schemars(example = &"P2")]
    pub track: String,
    /// Case of the track.
    #[schemars(example = &"ppp_0.02")]
    pub case: String,
}

impl ScoringRules {
    /// These rules, completed by others where they state nothing.
    pub fn or(&self, others: &ScoringRules) -> Self {
        let (own, others) = (self.clone(), others.clone());
        ScoringRules {
            gate_xy_px: own.gate_xy_px.or(others.gate_xy_px),
            gate_z_um: own.gate_z_um.or(others.gate_z_um),
            dims: own.dims.or(others.dims),
            rank_by: if own.rank_by.is_empty() { others.rank_by } else { own.rank_by },
            suite: own.suite.or(others.suite),
        }
    }
}

impl SuitePlace {
    /// The suite with its version and size.
    pub fn edition(&self) -> String {
        format!("{} {}, size {}", self.name, self.version, self.size)
    }
}

/// A score by which results are ranked: its key in `score.json`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Metric {
    /// `detection.f1`.
    F1,
    /// `detection.recall`.
    Recall,
    /// `detection.precision`.
    Precision,
    /// `detection.rmse_xy_px`: RMS distance of found particles in the image plane.
    RmseXyPx,
    /// `gdpt.sigma_z_over_h`: RMS error of depth over the depth range.
    SigmaZOverH,
    /// `crps.xy_px`: positions x and y with their claimed uncertainties; missed particles and ghosts count as the
    /// gate.
    CrpsXyPx,
    /// `crps.z_um`: the same for z.
    CrpsZUm,
    /// `links.f1`.
    LinkF1,
    /// `hota.hota`.
    Hota,
    /// `isbi.beta`.
    IsbiBeta,
    /// `lpt.correct`: found particles per true particle.
    LptCorrect,
    /// `lpt.ghost`: ghosts per true particle.
    LptGhost,
    /// `lpt.velocity_rms_um_s`: RMS error of velocity.
    VelocityRmsUmS,
    /// `orientation.mean_all_deg`: mean angle between true and found axes of spheroids; missed spheroids and
    /// ghosts count as 90 degrees.
    AngleMeanAllDeg,
    /// `size.right`: particles found with the right class of diameters / (true particles + ghosts).
    SizeRight,
    /// `field.valid_vector_probability`.
    ValidVectorProbability,
    /// RMS error of displacement of inliers, from `field.u_inliers.rms_px` and `field.v_inliers.rms_px`.
    RmsInliersPx,
    /// `field.nodes.valid`: share of the reference nodes at which the error is below half of the RMS of the
    /// true displacement about its mean, at most 1 px.
    ValidNodes,
    /// `field.nodes.rms_px`: RMS error over all reference nodes; a missing displacement and an error above 1
    /// px count as 1 px.
    RmsNodesPx,
    /// `field.nodes.response`: amplitude response over all reference nodes, ranked by its distance from 1.
    ResponseNodes,
}
