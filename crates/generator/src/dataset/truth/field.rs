//! `truth/field.csv`: the displacement field on a grid, which results of PIV are scored against.
//!
//! Definitions of displacement: [`flows::eulerian`]. The depth-weighted one is what a correlation of images
//! finds that show all depths at once: D = sum w(z) D(z) / sum w(z), D(z) the central displacement. A
//! particle's share in the correlation falls with its blur; Olsen & Adrian (Exp. Fluids 29 (2000) S166)
//! derive it for Gaussian images, where it is the squared peak. Here w is measured from noise-free images of
//! the dataset's own optics ([`visibility::DepthScan`]): the squared peak, or the curvature of the
//! autocorrelation at its top, times the square of the illumination there. Particles are taken as equally
//! dense at all depths.

use std::io::Write;
use std::path::Path;

use flows::VelocityField;
use flows::eulerian::{backward, central, forward};
use flows::scale::ImagePoint;
use glam::DVec3;
use microsig_core::quadrature::GAUSS_LEGENDRE_8;
use rayon::prelude::*;

use scenario::{Nodes, Scenario, Weighting};
use storage::error::Result;
use storage::tables::{Column, Table, TableFile, TableWriter, column};
use visibility::{DepthScan, ScanImage};

static FIELD: Table = Table::new(
    "truth/field.csv",
    "The displacement of the fluid from the first to the second frame of a pair, at the nodes of a grid. A steady flow is \
     written once, with pair empty.",
    &[
        column(
            "pair",
            "integer",
            "",
            "number of the pair, as in displacements.csv; empty if the flow is the same for all",
        ),
        column("plane", "integer", "", "number of the plane, from 0, in the order of depth"),
        column("x_px", "number", "px", "column of the node"),
        column("y_px", "number", "px", "row of the node"),
        column("z_um", "number", "um", "depth of the node"),
        column(
            "forward_dx_px",
            "number",
            "px",
            "displacement along x of what is at the node in the first frame",
        ),
        column("forward_dy_px", "number", "px", "the same along y"),
        column("forward_dz_um", "number", "um", "the same along z"),
        column(
            "central_dx_px",
            "number",
            "px",
            "displacement along x of what is at the node half-way in time",
        ),
        column("central_dy_px", "number", "px", "the same along y"),
        column("central_dz_um", "number", "um", "the same along z"),
    ],
);

const WEIGHTED: [Column; 3] = [
    column(
        "weighted_dx_px",
        "number",
        "px",
        "central displacement along x, averaged over depth with the weight of the manifest",
    ),
    column("weighted_dy_px", "number", "px", "the same along y"),
    column("weighted_dz_um", "number", "um", "the same along z"),
];

const MASK: [Column; 1] = [column(
    "mask",
    "integer",
    "",
    "1 if there is no fluid at the node (walls, bodies): no displacement then",
)];

const WINDOW: [Column; 3] = [
    column(
        "window_dx_px",
        "number",
        "px",
        "central displacement along x, averaged over a square window about the node",
    ),
    column("window_dy_px", "number", "px", "the same along y"),
    column("window_dz_um", "number", "um", "the same along z"),
];

const BACKWARD: [Column; 3] = [
    column(
        "backward_dx_px",
        "number",
        "px",
        "displacement along x of what is at the node in the second frame",
    ),
    column("backward_dy_px", "number", "px", "the same along y"),
    column("backward_dz_um", "number", "um", "the same along z"),
];

/// The table with the columns that this grid asks for.
pub fn table(nodes: &Nodes) -> Table {
    FIELD
        .clone()
        .with(&WEIGHTED, nodes.weighting != Weighting::None)
        .with(&MASK, true)
        .with(&WINDOW, nodes.window_px.is_some())
        .with(&BACKWARD, nodes.backward)
}

/// The weights of a stack's depths in light of strength 1, not normalised: by the trapezoidal rule, so that
/// the ends count half.
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

/// The weights in light of these strengths, their sum being 1; a weight goes with the square of the light.
pub(super) fn normalised(weights: &[f64], light: impl Iterator<Item = f64>) -> Vec<f64> {
    let lit: Vec<f64> = weights.iter().zip(light).map(|(weight, light)| weight * light * light).collect();
    let sum: f64 = lit.iter().sum();
    lit.into_iter().map(|weight| weight / sum).collect()
}

/// Writes the table into a dataset's folder.
///
/// # Errors
/// Writing.
pub fn write(folder: &Path, scenario: &Scenario, stack: &DepthScan) -> Result<()> {
    let Some(nodes) = scenario.truth_grid().filter(|_| scenario.field().is_some()) else { return Ok(()) };
    let mut writer = TableFile::create(folder, &table(&nodes))?;
    rows(&mut writer, scenario, &nodes, stack)?;
    writer.finish()
}

/// The table as CSV, if the scenario has one.
///
/// # Errors
/// None for a scenario that could be resolved.
pub fn in_memory(scenario: &Scenario, stack: &DepthScan) -> Result<Option<(Table, Vec<u8>)>> {
    let Some(nodes) = scenario.truth_grid().filter(|_| scenario.field().is_some()) else { return Ok(None) };
    let table = table(&nodes);
    let mut writer = TableWriter::new(&table, Vec::new())?;
    rows(&mut writer, scenario, &nodes, stack)?;
    Ok(Some((table, writer.into_writer()?)))
}

fn rows<W: Write>(
    writer: &mut TableWriter<W>,
    scenario: &Scenario,
    nodes: &Nodes,
    stack: &DepthScan,
) -> Result<()> {
    let Some(field) = scenario.field() else { return Ok(()) };
    let truth = Truth { scenario, field, nodes, stack, weights: weights(stack, nodes.weighting) };
    for (pair, interval) in intervals(scenario, field) {
        let pair = pair.map(|pair| pair.to_string()).unwrap_or_default();
        let (across, down) = (nodes.x_px.len(), nodes.y_px.len());
        let columns: Vec<NodeColumn> = (0..across * down)
            .into_par_iter()
            .map(|i| truth.column(nodes.x_px[i % across], nodes.y_px[i / across], interval))
            .collect();
        for (plane, z_um) in nodes.planes_um.iter().enumerate() {
            for (i, column) in columns.iter().enumerate() {
                let node = &column.planes[plane];
                let row = writer.cells();
                row.cells(&[&pair, &plane]);
                row.numbers(&[nodes.x_px[i % across], nodes.y_px[i / across], *z_um]);
                row.numbers(&node.forward);
                row.numbers(&node.central);
                if nodes.weighting != Weighting::None {
                    row.numbers(&column.weighted);
                }
                row.whole_numbers(&[u64::from(node.mask)]);
                if nodes.window_px.is_some() {
                    row.numbers(&node.window);
                }
                if nodes.backward {
                    row.numbers(&node.backward);
                }
                writer.end_row()?;
            }
        }
    }
    Ok(())
}

/// The pairs of frames that differ in their displacement field, with their times (s): one without a number if
/// the flow is steady and all pairs last equally long.
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
    // Differences of times are rounded.
    let equal = all.iter().all(|pair| (duration(pair) / first - 1.0).abs() < 1e-9);
    if field.is_steady() && equal { vec![(None, all[0].1)] } else { all }
}

/// dx (px), dy (px), dz (um); NaN where there is none.
type Moved = [f64; 3];

const NOWHERE: Moved = [f64::NAN; 3];

struct Node {
    forward: Moved,
    backward: Moved,
    central: Moved,
    window: Moved,
    mask: bool,
}

/// The nodes of all planes at one place of the image.
struct NodeColumn {
    planes: Vec<Node>,
    weighted: Moved,
}

struct Truth<'a> {
    scenario: &'a Scenario,
    field: &'a dyn VelocityField,
    nodes: &'a Nodes,
    stack: &'a DepthScan,
    weights: Vec<f64>,
}

impl Truth<'_> {
    fn column(&self, x_px: f64, y_px: f64, interval: (f64, f64)) -> NodeColumn {
        let planes =
            self.nodes.planes_um.iter().map(|&z| self.node(self.place(x_px, y_px, z), interval)).collect();
        let weighted = if self.nodes.weighting == Weighting::None {
            NOWHERE
        } else {
            let depths = self.stack.depths_um.iter().zip(&self.weights);
            mean(depths.map(|(&z, &weight)| {
                let place = self.place(x_px, y_px, z);
                let light = self.scenario.illumination.at(place);
                (weight * light * light, self.central(place, interval))
            }))
        };
        NodeColumn { planes, weighted }
    }

    fn node(&self, x: DVec3, interval: (f64, f64)) -> Node {
        let field = self.field;
        let ask = |displacement: flows::Result<DVec3>| displacement.map_or(NOWHERE, |d| self.moved(d));
        if !self.is_fluid(x, interval.0) {
            return Node {
                forward: NOWHERE,
                backward: NOWHERE,
                central: NOWHERE,
                window: NOWHERE,
                mask: true,
            };
        }
        let (forward, central) = (ask(forward(field, x, interval)), ask(central(field, x, interval)));
        let backward = if self.nodes.backward { ask(backward(field, x, interval)) } else { NOWHERE };
        let window = self.nodes.window_px.map_or(NOWHERE, |side| self.window(x, side, interval));
        Node { forward, backward, central, window, mask: !(forward[0].is_finite() && central[0].is_finite()) }
    }

    /// The average of the central displacement over a square, by the Gauss-Legendre rule.
    fn window(&self, x: DVec3, side_px: f64, interval: (f64, f64)) -> Moved {
        let half_um = 0.5 * side_px * self.scenario.scale.um_per_px();
        let rule = || GAUSS_LEGENDRE_8.into_iter().flat_map(|(at, weight)| [(-at, weight), (at, weight)]);
        mean(
            rule()
                .flat_map(|(v, b)| rule().map(move |(u, a)| (u, v, a * b)))
                .map(|(u, v, weight)| (weight, self.central(x + DVec3::new(u, v, 0.0) * half_um, interval))),
        )
    }

    fn central(&self, x: DVec3, interval: (f64, f64)) -> Moved {
        if !self.is_fluid(x, interval.0) {
            return NOWHERE;
        }
        central(self.field, x, interval).map_or(NOWHERE, |d| self.moved(d))
    }

    fn place(&self, x_px: f64, y_px: f64, z_um: f64) -> DVec3 {
        // Depths are physical here, not those of a data file.
        self.scenario.scale.to_object(ImagePoint { x_px, y_px, z_um: 0.0 }).with_z(z_um)
    }

    fn moved(&self, displacement: DVec3) -> Moved {
        let image = self.scenario.scale.displacement_to_image(displacement);
        [image.dx_px, image.dy_px, displacement.z]
    }

    /// Whether there is fluid at a place: not behind a wall, in a body, or beyond a surface of the field's
    /// own.
    fn is_fluid(&self, x: DVec3, t: f64) -> bool {
        self.scenario.fluid(self.field).contains(x, t)
    }
}

/// The weighted mean of those that are there.
fn mean(weighted: impl Iterator<Item = (f64, Moved)>) -> Moved {
    let (mut sum, mut weights) = ([0.0; 3], 0.0);
    for (weight, moved) in weighted.filter(|(_, moved)| moved[0].is_finite()) {
        sum.iter_mut().zip(moved).for_each(|(s, m)| *s += weight * m);
        weights += weight;
    }
    // Of nothing: NaN.
    sum.map(|s| s / weights)
}
