use super::gate::{Edge, Gate, Shape};
use super::truth::{Region, TrueParticles};
use crate::results::{Conventions, Points};
use clap::Args;
use microsig_core::render::Context;
use storage::advice::{Advice, flag, option};
use storage::argument::choice;
use storage::dataset::manifest::{ScoringGates, ScoringRules};
use storage::error::{Error, Result};
use storage::range::faults;
use storage::{NumberRange, advice};

/// Options of scoring. `None` means the default for the dataset.
#[derive(Debug, Clone, Default, Args)]
pub struct EvaluateOptions {
    /// Conventions of the result file.
    #[command(flatten)]
    pub conventions: Conventions,
    /// Shape of the gate [default: ellipsoid with depth, radial without]
    #[arg(long = "gate", value_name = "GATE", value_parser = choice::<Shape>())]
    pub shape: Option<Shape>,
    /// Radius of the gate in the image plane, of `--gate box` half its width [default: the
    /// dataset's, or 2]
    #[arg(long = "gate-xy", value_name = "PX")]
    pub gate_xy_px: Option<f64>,
    /// Half height of the gate along z [default: the dataset's, or a tenth of the depth range]
    #[arg(long = "gate-z", value_name = "UM")]
    pub gate_z_um: Option<f64>,
    /// Score in 2 or 3 dimensions [default: the dataset's, or 3 if truth and result have a depth]
    #[arg(long, value_name = "N")]
    pub dims: Option<u8>,
    /// Radius of the gate of the ISBI scores [default: 5]
    #[arg(long = "isbi-gate", value_name = "PX")]
    pub isbi_gate_px: Option<f64>,
    /// Exclude particles within this distance of the image edge from scoring
    #[arg(long = "border", value_name = "PX", default_value_t = 0.0)]
    pub border_px: f64,
    /// Score a field against the truth plane nearest to this depth [default: where particles are in best
    /// focus]
    #[arg(long = "plane", value_name = "UM")]
    pub plane_um: Option<f64>,
    /// Report the uniform shift that best aligns the result with the truth; it is not applied
    #[arg(long)]
    pub auto_offset: bool,
    /// Add the Cramér-Rao bound of the dataset's optics over depth, and the efficiency of the result (takes a
    /// while)
    #[arg(long)]
    pub crlb: bool,
    /// Seed of the bootstrap.
    #[arg(skip)]
    pub seed: u64,
    /// Where the renderer of the Cramér-Rao bound keeps its tables.
    #[arg(skip)]
    pub context: Context,
}

impl EvaluateOptions {
    /// The allowed values: of the gates, the border and the plane. The square of a much smaller gate could underflow, of a much
    /// larger one overflow.
    pub const RANGES: [NumberRange; 5] = [
        NumberRange { key: "gate_xy_px", least: 1e-6, most: 1e9, unit: "px" },
        NumberRange { key: "gate_z_um", least: 1e-6, most: 1e9, unit: "um" },
        NumberRange { key: "isbi_gate_px", least: 1e-6, most: 1e9, unit: "px" },
        NumberRange { key: "border_px", least: 0.0, most: 1e7, unit: "px" },
        NumberRange { key: "plane_um", least: -1e9, most: 1e9, unit: "um" },
    ];

    /// Refuses values out of range.
    pub fn check(&self) -> Result<()> {
        let [gate_xy, gate_z, isbi_gate, border, plane] = Self::RANGES;
        let mut wrong = self.conventions.faults();
        wrong.extend(faults(&[
            (self.gate_xy_px, gate_xy),
            (self.gate_z_um, gate_z),
            (self.isbi_gate_px, isbi_gate),
            (Some(self.border_px), border),
            (self.plane_um, plane),
        ]));
        if wrong.is_empty() { Ok(()) } else { Err(Error::Options(wrong)) }
    }

    /// The same with the rules of the dataset in place of options that are not given.
    pub(super) fn or(&self, rules: &ScoringRules) -> Self {
        let dims = self.dims.or(rules.dims);
        EvaluateOptions {
            gate_xy_px: self.gate_xy_px.or(rules.gate_xy_px),
            gate_z_um: self.gate_z_um.or(rules.gate_z_um.filter(|_| dims != Some(2))),
            dims,
            ..self.clone()
        }
    }

    /// The first given option that applies only to the other kind of result (`field` or particles).
    pub(super) fn foreign_option(&self, field: bool) -> Option<Advice> {
        let of_particles = [
            (option("gate"), self.shape.is_some()),
            (option("gate_xy_px"), self.gate_xy_px.is_some()),
            (option("gate_z_um"), self.gate_z_um.is_some()),
            (option("dims"), self.dims.is_some()),
            (option("isbi_gate_px"), self.isbi_gate_px.is_some()),
            (option("border_px"), self.border_px > 0.0),
            (flag("auto_offset"), self.auto_offset),
        ];
        let of_fields = [
            (option("plane_um"), self.plane_um.is_some()),
            (option("pair"), self.conventions.pair.is_some()),
        ];
        let others = if field { of_particles.to_vec() } else { of_fields.to_vec() };
        others.into_iter().find(|(_, given)| *given).map(|(name, _)| name)
    }
}

/// Whether depth is scored: by default if truth and result have one, which a depth of 0 in every row is not.
pub(super) fn dimensions(truth: &TrueParticles, points: &Points, options: &EvaluateOptions) -> Result<bool> {
    let both = truth.has_z && points.has_z;
    match options.dims {
        None => Ok(both && (points.has_depth() || !truth.has_depth())),
        Some(2) if options.gate_z_um.is_some() => {
            let (gate, dims) = (option("gate_z_um"), option("dims").of(2));
            Err(Error::option(advice!(gate, ": has no meaning with ", dims, ", in the image plane")))
        }
        Some(2) => Ok(false),
        Some(3) if both => Ok(true),
        Some(3) => {
            let by_rules =
                if truth.facts.rules.dims == Some(3) { ", as the rules of the dataset state" } else { "" };
            let what = format!(": truth and result must both have a depth{by_rules}");
            Err(Error::option(advice!(option("dims").of(3), what)))
        }
        Some(other) => Err(Error::option(advice!(option("dims").of(other), ": expected 2 or 3"))),
    }
}

/// The part of the volume that is scored.
pub(super) fn region(truth: &TrueParticles, options: &EvaluateOptions) -> Result<Region> {
    let region = Region { border_px: options.border_px, depth_um: options.conventions.depth_um };
    if region.border_px > 0.0 && truth.facts.sensor_px.is_none() {
        let what = ": a bare table does not contain the size of the images";
        return Err(Error::option(advice!(option("border_px"), what)));
    }
    let is_empty = |(low, high): (f64, f64)| {
        truth.has_z && !truth.rows.iter().any(|row| (low..=high).contains(&row.at.z_um))
    };
    if let Some((low, high)) = region.depth_um.filter(|range| !truth.rows.is_empty() && is_empty(*range)) {
        let what = format!(": no true particle is at a depth from {low} to {high} um");
        return Err(Error::option(advice!(option("depth_um"), what)));
    }
    Ok(region)
}

/// The gate of assignment A1.
pub(super) fn gate(truth: &TrueParticles, depth: bool, options: &EvaluateOptions) -> Result<Gate> {
    let xy_px = options.gate_xy_px.unwrap_or(ScoringGates::XY_PX);
    let z_um = options.gate_z_um.or(truth.facts.depth_h_um().map(|h| ScoringGates::over(h).z_um));
    let shape = match options.shape {
        Some(Shape::Ellipsoid | Shape::Box) if !depth => {
            let what = ": without depth in truth and result the gate is radial";
            return Err(Error::option(advice!(option("gate"), what)));
        }
        Some(shape) => shape,
        None if depth && z_um.is_some() => Shape::Ellipsoid,
        None => Shape::Radial,
    };
    let z_um = match (shape, z_um) {
        (Shape::Radial, _) => f64::INFINITY,
        (_, Some(z_um)) => z_um,
        (_, None) => {
            let (what, gate_z) = (": the depth range is unknown; give ", option("gate_z_um"));
            return Err(Error::option(advice!(option("gate"), what, gate_z, " or ", option("depth_um"))));
        }
    };
    // Also the gate of a dataset whose depth range is out of all proportion.
    if let Some(wrong) = EvaluateOptions::RANGES[1].fault(z_um).filter(|_| z_um.is_finite()) {
        return Err(Error::option(wrong));
    }
    Ok(Gate { shape, xy_px, z_um, edge: Edge::Open })
}

/// Additional gates for which detection scores are reported.
pub(super) fn other_gates(gate: &Gate, h: Option<f64>) -> Vec<Gate> {
    let mut gates: Vec<Gate> = [1.0, 2.0, 5.0].iter().map(|&xy_px| Gate { xy_px, ..*gate }).collect();
    if gate.shape != Shape::Radial {
        gates.extend(h.map(|h| Gate { z_um: h / 20.0, ..*gate }));
        gates.push(Gate::radial(gate.xy_px));
    }
    gates.retain(|g| g != gate);
    gates
}
