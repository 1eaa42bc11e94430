//! Results of the baseline trackers as microsig's tables of particles or displacements.

use storage::dataset::{Columns, Values};

use super::{Localization, ShapeEstimate, ShapeUncertainty};

/// A particle of a result.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Row {
    pub(super) frame: u32,
    /// -1: not linked.
    pub(super) track: i64,
    pub(super) found: Localization,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct DisplacementVector {
    /// Center of its interrogation window, relative to the center of the first pixel, px.
    pub(super) at: [f32; 2],
    /// Displacement, px.
    pub(super) d: [f32; 2],
    /// Whether it is an outlier replaced by the median of its neighbors.
    pub(super) replaced: bool,
}

/// A complete result.
#[derive(Debug)]
pub(super) enum Output {
    /// Particles.
    Points(Vec<Row>),
    /// Number and displacement field of each image pair.
    Fields(Vec<(usize, Vec<DisplacementVector>)>),
    /// One displacement field for all image pairs.
    MeanField(Vec<DisplacementVector>),
}

impl Output {
    /// Number of rows of the table.
    pub(super) fn rows(&self) -> usize {
        match self {
            Output::Points(points) => points.len(),
            Output::Fields(fields) => fields.iter().map(|(_, vectors)| vectors.len()).sum(),
            Output::MeanField(vectors) => vectors.len(),
        }
    }

    pub(super) fn columns(&self) -> Columns {
        let whole = |name: &str, values: Vec<i64>| (name.to_owned(), Values::Whole(values));
        let numbers = |name: &str, values: Vec<f64>| (name.to_owned(), Values::Numbers(values));
        let (pairs, vectors) = match self {
            Output::Points(points) => {
                let any = |has: fn(&Localization) -> bool| points.iter().any(|p| has(&p.found));
                let of = |value: fn(&Localization) -> f64| points.iter().map(|p| value(&p.found)).collect();
                let mut columns = vec![
                    whole("frame", points.iter().map(|p| i64::from(p.frame)).collect()),
                    whole("track", points.iter().map(|p| p.track).collect()),
                    numbers("x_px", of(|p| p.x_px)),
                    numbers("y_px", of(|p| p.y_px)),
                ];
                if points.is_empty() || any(|p| p.z_um.is_some()) {
                    columns.push(numbers("z_um", of(|p| p.z_um.unwrap_or(f64::NAN))));
                }
                if any(|p| p.deviations.is_some()) {
                    columns.extend(["sx_px", "sy_px", "sz_um"].iter().enumerate().map(|(axis, name)| {
                        let deviation = |p: &Row| p.found.deviations.map_or(f64::NAN, |sd| sd[axis]);
                        numbers(name, points.iter().map(deviation).collect())
                    }));
                }
                if any(|p| p.d_um.is_some()) {
                    columns.push(numbers("d_um", of(|p| p.d_um.unwrap_or(f64::NAN))));
                }
                if any(|p| p.other.is_some()) {
                    columns.push(numbers("other_z_um", of(|p| p.other.map_or(f64::NAN, |other| other.z_um))));
                    let likelihood = |p: &Localization| p.other.map_or(f64::NAN, |other| other.likelihood());
                    columns.push(numbers("other_likelihood", of(likelihood)));
                }
                columns.extend(shapes(points));
                return Columns(columns);
            }
            Output::Fields(fields) => {
                let pairs = fields.iter().flat_map(|(pair, all)| vec![*pair as i64; all.len()]);
                let vectors = fields.iter().flat_map(|(_, vectors)| vectors).collect();
                (Some(whole("pair", pairs.collect())), vectors)
            }
            Output::MeanField(vectors) => (None, vectors.iter().collect::<Vec<_>>()),
        };
        let of = |value: fn(&DisplacementVector) -> f32| vectors.iter().map(|v| decimal(value(v))).collect();
        let flag = |v: &&DisplacementVector| if v.replaced { 2 } else { 0 };
        let columns = [
            numbers("x_px", of(|v| v.at[0] + 1.0)),
            numbers("y_px", of(|v| v.at[1] + 1.0)),
            numbers("dx_px", of(|v| v.d[0])),
            numbers("dy_px", of(|v| v.d[1])),
            whole("flag", vectors.iter().map(flag).collect()),
        ];
        Columns(pairs.into_iter().chain(columns).collect())
    }
}

/// The number that the shortest decimal of a single-precision one is, so that tables have no digits that are
/// not measured.
fn decimal(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::from(value))
}

/// The columns of shapes, if there are any; NaN where a particle has none.
fn shapes(points: &[Row]) -> Vec<(String, Values)> {
    let any = |has: fn(&ShapeEstimate) -> bool| {
        points.iter().any(|point| point.found.shape.as_ref().is_some_and(has))
    };
    let of = |name: &str, value: &dyn Fn(&ShapeEstimate) -> Option<f64>| {
        let value = |point: &Row| point.found.shape.as_ref().and_then(value).unwrap_or(f64::NAN);
        (name.to_owned(), Values::Numbers(points.iter().map(value).collect()))
    };
    let uncertain = |name: &str, value: &dyn Fn(&ShapeUncertainty) -> Option<f64>| {
        of(name, &|shape| shape.uncertainty.as_ref().and_then(value))
    };
    let mut columns = Vec::new();
    if any(|_| true) {
        columns.extend([
            of("axis_x", &|s| Some(s.axis.x)),
            of("axis_y", &|s| Some(s.axis.y)),
            of("axis_z", &|s| Some(s.axis.z)),
        ]);
    }
    if any(|shape| shape.aspect.is_some()) {
        columns.push(of("aspect_ratio", &|s| s.aspect));
    }
    if !any(|shape| shape.uncertainty.is_some()) {
        return columns;
    }
    columns.extend([
        uncertain("axis_sd_deg", &|s| Some(s.axis_deviations[0].to_degrees())),
        uncertain("axis_least_sd_deg", &|s| Some(s.axis_deviations[1].to_degrees())),
        uncertain("axis_sd_x", &|s| Some(s.uncertain.x)),
        uncertain("axis_sd_y", &|s| Some(s.uncertain.y)),
        uncertain("axis_sd_z", &|s| Some(s.uncertain.z)),
        uncertain("other_z_um", &|s| s.other.map(|other| other.0)),
        uncertain("other_axis_x", &|s| s.other.map(|other| other.1.x)),
        uncertain("other_axis_y", &|s| s.other.map(|other| other.1.y)),
        uncertain("other_axis_z", &|s| s.other.map(|other| other.1.z)),
        uncertain("other_likelihood", &|s| s.other.map(|other| other.2)),
    ]);
    if any(|shape| shape.aspect.is_some()) {
        columns.push(uncertain("aspect_ratio_sd", &|s| Some(s.aspect)));
    }
    columns
}
