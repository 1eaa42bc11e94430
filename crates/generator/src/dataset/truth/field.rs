//! `truth/field.csv`: the displacement field on a grid, the reference for scores of PIV results.
//!
//! Definitions of displacement: [`flows::eulerian`]. The depth-weighted displacement is that found by
//! correlating images that contain particles at all depths: D = sum w(z) D(z) / sum w(z), D(z) the central
//! displacement. The contribution of a particle to the correlation decreases with its blur; Olsen & Adrian
//! (Exp. Fluids 29 (2000) S166) derive it for Gaussian images, where it is the squared peak. Here w is
//! measured on noise-free images of the dataset's own optics ([`DepthScan`]): the squared
//! peak, or the curvature of the autocorrelation at its peak, times the square of the illumination at that
//! depth. The number density is assumed to be uniform over depth.

use std::path::Path;
use std::sync::Arc;

use flows::VelocityField;
use flows::eulerian::{backward, central, forward};
use flows::scale::ImagePoint;
use glam::DVec3;
use microsig_core::quadrature::GAUSS_LEGENDRE_8;
use rayon::prelude::*;
use storage::dataset::rows::{BACKWARD, WEIGHTED, WINDOW};
use storage::dataset::{FieldRow, Row, Table, TableWriter, TrueFlow};

use crate::dataset::secret;
use microsig_core::render::Context;
use microsig_core::visibility::{DepthScan, ScanImage};
use scenario::{Nodes, Scenario, Weighting};
use storage::{OutputFolder, Result};

/// The table with the columns of this grid.
pub fn table(nodes: &Nodes) -> Table {
    let parts = [
        (WEIGHTED, nodes.weighting != Weighting::None),
        (WINDOW, nodes.window_px.is_some()),
        (BACKWARD, nodes.backward),
    ];
    let parts: Vec<&str> = parts.into_iter().filter(|(_, wanted)| *wanted).map(|(part, _)| part).collect();
    FieldRow::table(&parts)
}

/// The weights of a scan's depths at illumination 1, not normalized: trapezoidal rule, with half weights at
/// the ends.
pub(super) fn weights(stack: &DepthScan, weighting: Weighting) -> Vec<f64> {
    let last = stack.images.len() - 1;
    let weight = |spot: &ScanImage| match weighting {
        Weighting::PeakSquared => spot.peak * spot.peak,
        Weighting::Curvature => spot.curvature,
        Weighting::None => 0.0,
    };
    let ends = |k: usize| if k == 0 || k == last { 0.5 } else { 1.0 };
    stack.images.iter().enumerate().map(|(k, spot)| ends(k) * weight(spot)).collect()
}

/// The depths of a scan (um) with their weights at illumination 1.
fn depths(stack: &DepthScan, weighting: Weighting) -> Vec<(f64, f64)> {
    stack.depths_um.iter().copied().zip(weights(stack, weighting)).collect()
}

/// The weights at the given illumination, normalized to a sum of 1; a weight is proportional to the square of
/// the illumination.
pub(super) fn normalized(weights: &[f64], light: impl Iterator<Item = f64>) -> Vec<f64> {
    let lit: Vec<f64> = weights.iter().zip(light).map(|(weight, light)| weight * light * light).collect();
    let sum: f64 = lit.iter().sum();
    lit.into_iter().map(|weight| weight / sum).collect()
}

/// Grid and flow of a scenario that has both.
fn grid(scenario: &Scenario) -> Option<(Nodes, &dyn VelocityField)> {
    Some((scenario.truth_grid()?, scenario.field()?))
}

/// The flow of a scenario, which gives the displacements of `truth/field.csv` at any position.
#[derive(Debug)]
pub struct ScenarioFlow {
    scenario: Arc<Scenario>,
    nodes: Nodes,
    depths: Vec<(f64, f64)>,
    intervals: Vec<(Option<u32>, (f64, f64))>,
}

impl ScenarioFlow {
    /// The flow of a scenario; `None` if it has no true field. `scan` belongs to the mean diameter
    /// ([`Scenario::scan_of_mean`]), which is made if it is needed.
    pub fn new(scenario: Arc<Scenario>, scan: Option<&DepthScan>) -> Result<Option<Self>> {
        let Some((nodes, field)) = grid(&scenario) else { return Ok(None) };
        let depths = match scan {
            _ if nodes.weighting == Weighting::None => Vec::new(),
            Some(scan) => depths(scan, nodes.weighting),
            None => depths(&scenario.scan_of_mean()?, nodes.weighting),
        };
        let (intervals, nodes) =
            (intervals(&scenario, field), Nodes { window_px: None, backward: false, ..nodes });
        Ok(Some(ScenarioFlow { scenario, nodes, depths, intervals }))
    }

    /// The flow of the scenario in a dataset's folder, at the times of its frames.
    pub fn of_dataset(dataset: &Path, context: &Context) -> Result<Option<Self>> {
        let (mut scenario, _) = scenario::of_dataset(dataset, context)?;
        // Jitter of the times is random.
        if let Some(streams) = secret::streams(dataset)? {
            scenario.streams = streams;
        }
        ScenarioFlow::new(Arc::new(scenario), None)
    }
}

impl TrueFlow for ScenarioFlow {
    fn row(&self, pair: Option<u32>, [x_px, y_px, z_um]: [f64; 3], is_weighted: bool) -> FieldRow {
        let at = FieldRow { pair, x_px, y_px, z_um, mask: true, ..FieldRow::default() };
        let interval = match &self.intervals[..] {
            [(None, interval)] => Some(interval),
            all => all.binary_search_by_key(&pair, |(of, _)| *of).ok().map(|k| &all[k].1),
        };
        let (Some(interval), Some(field)) = (interval, self.scenario.field()) else { return at };
        let truth = Truth { scenario: &self.scenario, field, nodes: &self.nodes, depths: &self.depths };
        let node = truth.node(truth.position(x_px, y_px, z_um), *interval);
        let weighted =
            if is_weighted && !node.mask { truth.weighted((x_px, y_px), *interval) } else { UNDEFINED };
        NodeColumn { planes: vec![node], weighted }.row(0, at)
    }
}

/// Writes the table into a dataset's folder, one pair after the other.
pub(super) fn write(folder: &OutputFolder, scenario: &Scenario, stack: &DepthScan) -> Result<()> {
    let Some((nodes, field)) = grid(scenario) else { return Ok(()) };
    let table = table(&nodes);
    let mut writer = TableWriter::create(folder, &table)?;
    for rows in pairs(scenario, field, &nodes, stack) {
        writer.append(&table.text(&rows))?;
    }
    writer.seal().map(drop)
}

/// The table, if the scenario has one.
pub fn in_memory(scenario: &Scenario, stack: &DepthScan) -> Option<(Table, Vec<FieldRow>)> {
    let (nodes, field) = grid(scenario)?;
    Some((table(&nodes), pairs(scenario, field, &nodes, stack).flatten().collect()))
}

fn pairs<'a>(
    scenario: &'a Scenario,
    field: &'a dyn VelocityField,
    nodes: &'a Nodes,
    stack: &'a DepthScan,
) -> impl Iterator<Item = Vec<FieldRow>> + 'a {
    let depths = depths(stack, nodes.weighting);
    intervals(scenario, field).into_iter().map(move |(pair, interval)| {
        let truth = Truth { scenario, field, nodes, depths: &depths };
        let (across, down) = (nodes.x_px.len(), nodes.y_px.len());
        let place = |i: usize| (nodes.x_px[i % across], nodes.y_px[i / across]);
        let columns: Vec<NodeColumn> =
            (0..across * down).into_par_iter().map(|i| truth.column(place(i), interval)).collect();
        let planes = nodes.planes_um.iter().enumerate();
        let rows = planes.flat_map(|(plane, z_um)| {
            let plane_nodes = move |(i, column): (usize, &NodeColumn)| {
                let ((x_px, y_px), z_um) = (place(i), *z_um);
                column.row(
                    plane,
                    FieldRow { pair, plane: plane as u32, x_px, y_px, z_um, ..FieldRow::default() },
                )
            };
            columns.iter().enumerate().map(plane_nodes)
        });
        rows.collect()
    })
}

/// The pairs of frames with different displacement fields, by number and times (s): a single one without a
/// number if the flow is steady and all pairs have the same time between frames.
fn intervals(scenario: &Scenario, field: &dyn VelocityField) -> Vec<(Option<u32>, (f64, f64))> {
    let recordings = &scenario.recordings;
    let mut all = Vec::new();
    for recording in 0..recordings.count() {
        let first_frame = recording * recordings.frames_each();
        let times = recordings.times_s(recording, scenario.streams);
        let pairs = times.windows(2).zip(first_frame + 1..);
        all.extend(pairs.filter_map(|(t, frame)| Some((Some(recordings.link_to(frame)?), (t[0], t[1])))));
    }
    let duration = |&(_, (t0, t1)): &(Option<u32>, (f64, f64))| t1 - t0;
    let Some(first) = all.first().map(duration) else { return all };
    // Tolerance for rounding of time differences.
    let equal = all.iter().all(|pair| (duration(pair) / first - 1.0).abs() < 1e-9);
    if field.is_steady() && equal { vec![(None, all[0].1)] } else { all }
}

/// dx (px), dy (px), dz (um); NaN if undefined.
type Displacement = [f64; 3];

const UNDEFINED: Displacement = [f64::NAN; 3];

#[derive(Clone, Copy)]
struct Node {
    forward: Displacement,
    backward: Displacement,
    central: Displacement,
    window: Displacement,
    mask: bool,
}

/// The nodes of all planes at one image position.
struct NodeColumn {
    planes: Vec<Node>,
    weighted: Displacement,
}

impl NodeColumn {
    /// Adds the displacements at the node of a plane to its row.
    fn row(&self, plane: usize, mut at: FieldRow) -> FieldRow {
        let Node { forward, backward, central, window, mask } = self.planes[plane];
        [at.forward_dx_px, at.forward_dy_px, at.forward_dz_um] = forward;
        [at.central_dx_px, at.central_dy_px, at.central_dz_um] = central;
        [at.weighted_dx_px, at.weighted_dy_px, at.weighted_dz_um] = self.weighted;
        [at.window_dx_px, at.window_dy_px, at.window_dz_um] = window;
        [at.backward_dx_px, at.backward_dy_px, at.backward_dz_um] = backward;
        FieldRow { mask, ..at }
    }
}

struct Truth<'a> {
    scenario: &'a Scenario,
    field: &'a dyn VelocityField,
    nodes: &'a Nodes,
    /// Depths (um) and their weights at illumination 1.
    depths: &'a [(f64, f64)],
}

impl Truth<'_> {
    fn column(&self, (x_px, y_px): (f64, f64), interval: (f64, f64)) -> NodeColumn {
        let planes =
            self.nodes.planes_um.iter().map(|&z| self.node(self.position(x_px, y_px, z), interval)).collect();
        NodeColumn { planes, weighted: self.weighted((x_px, y_px), interval) }
    }

    /// The central displacement averaged over depth; NaN without weights.
    fn weighted(&self, (x_px, y_px): (f64, f64), interval: (f64, f64)) -> Displacement {
        if self.nodes.weighting == Weighting::None {
            return UNDEFINED;
        }
        mean(self.depths.iter().map(|&(z, weight)| {
            let position = self.position(x_px, y_px, z);
            let light = self.scenario.illumination.at(position);
            (weight * light * light, self.central(position, interval))
        }))
    }

    fn node(&self, x: DVec3, interval: (f64, f64)) -> Node {
        let field = self.field;
        let or_undefined =
            |displacement: flows::Result<DVec3>| displacement.map_or(UNDEFINED, |d| self.to_image(d));
        if !self.is_fluid(x, interval.0) {
            let [forward, backward, central, window] = [UNDEFINED; 4];
            return Node { forward, backward, central, window, mask: true };
        }
        let (forward, central) =
            (or_undefined(forward(field, x, interval)), or_undefined(central(field, x, interval)));
        let backward =
            if self.nodes.backward { or_undefined(backward(field, x, interval)) } else { UNDEFINED };
        let window = self.nodes.window_px.map_or(UNDEFINED, |side| self.window(x, side, interval));
        Node { forward, backward, central, window, mask: !(forward[0].is_finite() && central[0].is_finite()) }
    }

    /// The central displacement averaged over a square window, by Gauss-Legendre quadrature.
    fn window(&self, x: DVec3, side_px: f64, interval: (f64, f64)) -> Displacement {
        let scale = &self.scenario.scale;
        let half_um = 0.5 * side_px * scale.um_per_px();
        let at = |u: f64, v: f64| {
            let [u, v] = scale.unstretched([u, v]);
            x + DVec3::new(u, v, 0.0) * half_um
        };
        let rule = || GAUSS_LEGENDRE_8.into_iter().flat_map(|(at, weight)| [(-at, weight), (at, weight)]);
        mean(
            rule()
                .flat_map(|(v, b)| rule().map(move |(u, a)| (u, v, a * b)))
                .map(|(u, v, weight)| (weight, self.central(at(u, v), interval))),
        )
    }

    fn central(&self, x: DVec3, interval: (f64, f64)) -> Displacement {
        if !self.is_fluid(x, interval.0) {
            return UNDEFINED;
        }
        central(self.field, x, interval).map_or(UNDEFINED, |d| self.to_image(d))
    }

    fn position(&self, x_px: f64, y_px: f64, z_um: f64) -> DVec3 {
        // Depths are physical, unlike in data files.
        self.scenario.scale.to_object(ImagePoint { x_px, y_px, z_um: 0.0 }).with_z(z_um)
    }

    fn to_image(&self, displacement: DVec3) -> Displacement {
        let image = self.scenario.scale.displacement_to_image(displacement);
        [image.dx_px, image.dy_px, displacement.z]
    }

    /// Whether there is fluid at a position at time `t` (s): not behind a wall, in a body, or outside the
    /// field's own surface.
    fn is_fluid(&self, x: DVec3, t: f64) -> bool {
        self.scenario.fluid(self.field).contains(x, t)
    }
}

/// The weighted mean of the defined displacements; NaN if there are none.
fn mean(weighted: impl Iterator<Item = (f64, Displacement)>) -> Displacement {
    let (mut sum, mut weights) = ([0.0; 3], 0.0);
    for (weight, moved) in weighted.filter(|(_, moved)| moved[0].is_finite()) {
        sum.iter_mut().zip(moved).for_each(|(s, m)| *s += weight * m);
        weights += weight;
    }
    sum.map(|s| s / weights)
}
