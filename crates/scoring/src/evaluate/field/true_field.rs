//! The true field: displacements at any position from the flow, or from values on a grid, one for each image
//! pair or one for all, by cubic splines.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use super::grid_spline::GridSpline;
use crate::evaluate::statistics::{distinct, ratio};
use crate::results::{Conventions, FlowVector, Position, read_field};
use microsig_core::render::Context;
use rayon::prelude::*;
use scenario::ScenarioFlow;
use schemars::JsonSchema;
use serde::Deserialize;
use storage::dataset::{DatasetInMemory, DatasetPlace, FieldRow, RecordingFacts, Row, TableReader, TrueFlow};
use storage::error::{Error, Result};

/// True displacements on a grid, one field for each image pair or one for all.
#[derive(Debug, Default)]
pub struct TrueField {
    x_px: Vec<f64>,
    y_px: Vec<f64>,
    pairs: BTreeMap<Option<u32>, Nodes>,
}

/// Displacements at the nodes, row by row, NaN where the truth is masked, and the spline through them.
#[derive(Debug)]
struct Nodes {
    values: Vec<[f64; 3]>,
    spline: OnceLock<GridSpline<3>>,
}

/// Largest number of image pairs whose interpolation error is estimated.
const PAIRS: usize = 10;

impl TrueField {
    pub(super) fn new(nodes: &[FlowVector]) -> Self {
        let mut grid = TrueField {
            x_px: distinct(nodes.iter().map(|v| v.at.x_px)),
            y_px: distinct(nodes.iter().map(|v| v.at.y_px)),
            pairs: BTreeMap::new(),
        };
        let size = grid.x_px.len() * grid.y_px.len();
        // Scattered nodes are not a grid: such a table has no truth.
        if size <= 100 * nodes.len() + 1000 {
            for node in nodes {
                let (i, j) = (index(&grid.x_px, node.at.x_px), index(&grid.y_px, node.at.y_px));
                let empty = || Nodes { values: vec![[f64::NAN; 3]; size], spline: OnceLock::new() };
                grid.pairs.entry(node.pair).or_insert_with(empty).values[j * grid.x_px.len() + i] =
                    node.moved;
            }
        }
        grid
    }

    /// x of the columns and y of the rows, px.
    pub fn nodes(&self) -> (&[f64], &[f64]) {
        (&self.x_px, &self.y_px)
    }

    /// Whether this image pair has a truth: its own, or one for all pairs.
    pub fn has_pair(&self, pair: u32) -> bool {
        self.pairs.contains_key(&Some(pair)) || self.pairs.contains_key(&None)
    }

    /// Whether image pairs have different truths.
    pub fn needs_pairs(&self) -> bool {
        self.pairs.len() > 1
    }

    /// The image pairs that have truths of their own.
    pub(super) fn pairs(&self) -> impl Iterator<Item = Option<u32>> {
        self.pairs.keys().copied()
    }

    /// The image pair whose truth a vector has, which is `None` for a truth of all pairs; `None` without truth.
    fn pair_of(&self, vector: &FlowVector) -> Option<Option<u32>> {
        let own = [vector.pair, None].into_iter().find(|pair| self.pairs.contains_key(pair));
        let single =
            || self.pairs.keys().next().copied().filter(|_| vector.pair.is_none() && !self.needs_pairs());
        own.or_else(single)
    }

    /// The true displacement of an image pair at a position, as [`TrueField::at`].
    pub fn for_pair(&self, pair: Option<u32>, x_px: f64, y_px: f64) -> Option<[f64; 3]> {
        let at = Position { x_px, y_px, ..Position::default() };
        self.at(&FlowVector { pair, at, ..FlowVector::default() })
    }

    /// The true displacement [px, px, um] at the position of a vector, interpolated between the nodes by cubic
    /// splines; `None` outside the grid and in cells with a masked node.
    pub fn at(&self, vector: &FlowVector) -> Option<[f64; 3]> {
        let Nodes { values, spline } = &self.pairs[&self.pair_of(vector)?];
        let spline = spline.get_or_init(|| GridSpline::new(&self.x_px, &self.y_px, values));
        spline.at(vector.at.x_px, vector.at.y_px).filter(|moved| moved[1].is_finite())
    }

    /// Whether a vector is at a node, where nothing is interpolated.
    fn is_node(&self, at: Position) -> bool {
        self.x_px.binary_search_by(|x| x.total_cmp(&at.x_px)).is_ok()
            && self.y_px.binary_search_by(|y| y.total_cmp(&at.y_px)).is_ok()
    }

    /// Estimated RMS error of interpolation between the nodes, px: every second node of each row and column
    /// predicts the others. Splines of half the spacing have a sixteenth of this error where the nodes resolve
    /// the field, and where they do not, no less; which is the case follows from the same at twice the spacing.
    /// `None` with too few nodes.
    fn interpolation_error_px(&self) -> Option<f64> {
        let every = |step: usize| -> Option<f64> {
            let axis = |nodes: &[f64]| nodes.iter().copied().step_by(step).collect::<Vec<f64>>();
            let (x_px, y_px) = (axis(&self.x_px), axis(&self.y_px));
            let (columns, half) = (self.x_px.len(), step / 2);
            // A line of fewer than four nodes has no spline.
            if x_px.len().min(y_px.len()) < 4 {
                return None;
            }
            let (mut squares, mut n) = (0.0, 0.0);
            for Nodes { values, .. } in self.pairs.values().step_by(self.pairs.len().div_ceil(PAIRS)) {
                let known: Vec<[f64; 3]> = (0..self.y_px.len())
                    .step_by(step)
                    .flat_map(|j| (0..columns).step_by(step).map(move |i| values[j * columns + i]))
                    .collect();
                let spline = GridSpline::new(&x_px, &y_px, &known);
                for (j, y) in self.y_px.iter().enumerate().step_by(half) {
                    for (i, x) in self.x_px.iter().enumerate().step_by(half) {
                        let value = values[j * columns + i];
                        let is_new = i % step != 0 || j % step != 0;
                        if let Some(found) = spline.at(*x, *y).filter(|_| is_new && value[0].is_finite()) {
                            squares += (found[0] - value[0]).powi(2) + (found[1] - value[1]).powi(2);
                            n += 1.0;
                        }
                    }
                }
            }
            ratio(squares, n).map(f64::sqrt)
        };
        let coarse = every(2)?;
        let gain = every(4).and_then(|coarser| ratio(coarse, coarser)).unwrap_or(1.0);
        Some(coarse * gain.clamp(1.0 / 16.0, 1.0))
    }
}

pub(super) fn index(axis: &[f64], v: f64) -> usize {
    axis.partition_point(|a| *a < v)
}

/// The true field of a bare table.
pub(in super::super) fn bare(path: &Path) -> Result<TrueFields> {
    let field = read_field(path, &Conventions::default())?;
    let fields = vec![(None, TrueField::new(&field.vectors))];
    Ok(TrueFields { fields, ..TrueFields::default() })
}

/// Kinds of true displacement fields.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Displacement {
    /// Displacement of the fluid element that is at the node half-way between the two frames.
    Central,
    /// Displacement of the fluid element that is at the node in the first frame.
    Forward,
    /// The central displacement averaged over depth.
    Weighted,
}

impl Displacement {
    /// Prefix of its columns in `truth/field.csv`.
    pub fn name(self) -> &'static str {
        match self {
            Displacement::Central => "central",
            Displacement::Forward => "forward",
            Displacement::Weighted => "weighted",
        }
    }

    /// At a position that is not masked [px, px, um].
    fn at(self, row: &FieldRow) -> Option<[f64; 3]> {
        Some(self.of(row)).filter(|[u, v, _]| !row.mask && u.is_finite() && v.is_finite())
    }

    /// At a node [px, px, um].
    fn of(self, row: &FieldRow) -> [f64; 3] {
        match self {
            Displacement::Central => [row.central_dx_px, row.central_dy_px, row.central_dz_um],
            Displacement::Forward => [row.forward_dx_px, row.forward_dy_px, row.forward_dz_um],
            Displacement::Weighted => [row.weighted_dx_px, row.weighted_dy_px, row.weighted_dz_um],
        }
    }
}

/// The true fields of a dataset on one plane.
#[derive(Debug, Default)]
pub struct TrueFields {
    /// Kind (`None` for a bare table) and field; the first is the main truth.
    pub fields: Vec<(Option<Displacement>, TrueField)>,
    /// Depth of the plane, um; `None` for a bare table.
    pub plane_um: Option<f64>,
    /// Facts from the dataset's manifest.
    pub facts: RecordingFacts,
    /// Why this plane and this main truth were chosen, if this needs an explanation.
    pub note: Option<String>,
    /// The flow, if it is known: displacements are then computed at each position instead of interpolated
    /// between the nodes.
    pub(super) flow: Option<Arc<dyn TrueFlow>>,
    /// Why displacements are interpolated although there is a flow.
    pub warning: Option<String>,
}

/// Largest difference between displacements of a flow and the stored ones, px, and relative to them: integration errors are
/// below 1e-9, values are stored with all digits.
const SAME_FLOW: f64 = 1e-6;

impl TrueFields {
    /// The same with displacements of `flow`, if these are the stored ones at the nodes.
    pub fn with_flow(mut self, flow: Result<Option<Arc<dyn TrueFlow>>>) -> Self {
        let because = |why: String| Some(format!("the truth is interpolated between its nodes: {why}"));
        match flow {
            Ok(None) => {}
            Err(error) => self.warning = because(format!("the flow cannot be computed: {error}")),
            Ok(Some(flow)) if self.agrees_with(&*flow) => self.flow = Some(flow),
            Ok(Some(_)) => {
                self.warning = because(
                    "the flow of the scenario has other displacements there than the stored ones".to_owned(),
                );
            }
        }
        self
    }

    /// Whether displacements are computed at each position.
    pub fn has_flow(&self) -> bool {
        self.flow.is_some()
    }

    /// Compares the flow with the stored displacements at some of the nodes.
    fn agrees_with(&self, flow: &dyn TrueFlow) -> bool {
        let Some(z_um) = self.plane_um else { return false };
        let some = |n: usize, most: usize| (0..n).step_by(n.div_ceil(most).max(1));
        self.fields.iter().all(|(kind, field)| {
            some(field.pairs.len(), 3).all(|k| {
                let Some((pair, Nodes { values, .. })) = field.pairs.iter().nth(k) else { return true };
                some(values.len(), 50).all(|node| {
                    let (x_px, y_px) =
                        (field.x_px[node % field.x_px.len()], field.y_px[node / field.x_px.len()]);
                    let stored = values[node];
                    let computed = kind.and_then(|kind| kind.at(&flow.row(*pair, [x_px, y_px, z_um], true)));
                    match computed {
                        None => !stored[0].is_finite(),
                        Some(moved) => (0..2)
                            .all(|c| (moved[c] - stored[c]).abs() <= SAME_FLOW * (1.0 + stored[c].abs())),
                    }
                })
            })
        })
    }

    /// The true displacements [px, px, um] of all fields at the positions of vectors: computed from the flow
    /// anywhere in the image, or else as [`TrueField::at`].
    pub fn at(&self, vectors: &[FlowVector]) -> Vec<Vec<Option<[f64; 3]>>> {
        let Some((flow, z_um)) = self.flow.as_deref().zip(self.plane_um) else {
            return self
                .fields
                .iter()
                .map(|(_, field)| vectors.iter().map(|v| field.at(v)).collect())
                .collect();
        };
        let Some((_, first)) = self.fields.first() else { return Vec::new() };
        // Vectors of all pairs in a steady flow, and of several results, share their positions.
        let place = |v: &FlowVector| {
            let pair = first.pair_of(v)?;
            let is_inside =
                |at: f64, size: Option<f64>| size.is_none_or(|size| (0.5..=size + 0.5).contains(&at));
            let (width, height) = self.facts.sensor_px.unzip();
            (is_inside(v.at.x_px, width) && is_inside(v.at.y_px, height)).then_some((
                pair,
                v.at.x_px.to_bits(),
                v.at.y_px.to_bits(),
            ))
        };
        let mut places: Vec<_> = vectors.iter().filter_map(place).collect();
        places.sort_unstable();
        places.dedup();
        let is_weighted = self.fields.iter().any(|(kind, _)| *kind == Some(Displacement::Weighted));
        let rows = places.par_iter().map(|&(pair, x, y)| {
            let row = flow.row(pair, [f64::from_bits(x), f64::from_bits(y), z_um], is_weighted);
            self.fields.iter().map(|(kind, _)| kind.and_then(|kind| kind.at(&row))).collect()
        });
        let rows: Vec<Vec<Option<[f64; 3]>>> = rows.collect();
        let found: Vec<Option<usize>> =
            vectors.iter().map(|v| places.binary_search(&place(v)?).ok()).collect();
        (0..self.fields.len()).map(|k| found.iter().map(|at| rows[(*at)?][k]).collect()).collect()
    }

    /// Estimated RMS error of the main truth by interpolation at the positions of vectors, px: 0 if it is
    /// computed or all of them are at nodes; `None` if there are too few nodes for an estimate.
    pub(super) fn interpolation_error_px(&self, vectors: &[FlowVector]) -> Option<f64> {
        let (_, field) = self.fields.first()?;
        if self.has_flow() || vectors.iter().all(|v| field.is_node(v.at)) {
            return Some(0.0);
        }
        field.interpolation_error_px()
    }
}

/// The rows of `truth/field.csv`.
#[derive(Debug, Clone, Copy)]
pub enum Source<'a> {
    /// Those of a file, which is read twice: it may be large, and one plane is kept.
    File(&'a Path),
    /// Those of a dataset in memory.
    Memory(&'a [FieldRow]),
}

impl Source<'_> {
    fn name(&self) -> String {
        match self {
            Source::File(path) => path.display().to_string(),
            Source::Memory(_) => FieldRow::PATH.to_owned(),
        }
    }

    fn each(&self, mut each: impl FnMut(&FieldRow)) -> Result<()> {
        match self {
            Source::Memory(rows) => rows.iter().for_each(each),
            Source::File(path) => {
                let read = |_: u64, row: FieldRow| {
                    each(&row);
                    Ok(())
                };
                TableReader::open(path)?.rows(&["x_px", "y_px", "z_um"], read)?;
            }
        }
        Ok(())
    }
}

/// The true fields in a dataset's folder, as [`from_rows`].
pub fn from_dataset(dataset: &Path, plane_um: Option<f64>) -> Result<TrueFields> {
    from_recording(dataset, RecordingFacts::read(dataset)?, plane_um)
}

/// [`from_dataset`] of a folder, or of a dataset in memory.
pub fn from_place(dataset: &DatasetPlace) -> Result<TrueFields> {
    match dataset {
        DatasetPlace::Folder(folder) => {
            let flow = ScenarioFlow::of_dataset(folder, &Context::default());
            Ok(from_dataset(folder, None)?.with_flow(flow))
        }
        DatasetPlace::Memory(made) => from_memory(&**made, dataset.facts()?, None),
    }
}

/// The true fields of a dataset in memory, as [`from_rows`], with its flow.
pub fn from_memory(
    made: &dyn DatasetInMemory,
    facts: RecordingFacts,
    plane_um: Option<f64>,
) -> Result<TrueFields> {
    let what = "this dataset has no true displacement field; score particles";
    let rows = made.field()?.ok_or_else(|| Error::input(what))?;
    Ok(from_rows(Source::Memory(&rows), facts, plane_um)?.with_flow(made.flow()))
}

/// [`from_dataset`] with the facts that its manifest gives.
pub(in super::super) fn from_recording(
    dataset: &Path,
    facts: RecordingFacts,
    plane_um: Option<f64>,
) -> Result<TrueFields> {
    facts.needs_truth(dataset)?;
    let path = &dataset.join(FieldRow::PATH);
    if !path.exists() {
        return Err(Error::input(format!(
            "{}: missing; this dataset has no true displacement field (score particles, or give a table of the true field)",
            path.display()
        )));
    }
    from_rows(Source::File(path), facts, plane_um)
}

/// The true fields of a dataset on one of its planes: the plane nearest to `plane_um` if given. Otherwise,
/// among the planes that are not completely masked, the one nearest to the focal depth of the particles; to
/// the center of the depth range if all depths are equally sharp; or to 0 if the focal depth is unknown.
///
/// If all depths are equally sharp, correlation measures their average, so the depth-weighted truth is the
/// main one.
pub fn from_rows(rows: Source<'_>, facts: RecordingFacts, plane_um: Option<f64>) -> Result<TrueFields> {
    let middle = facts.depth_um.map(|(low, high)| f64::midpoint(low, high)).filter(|_| facts.is_all_in_focus);
    let chosen = choose(rows, plane_um, facts.focus_um.or(middle).unwrap_or(0.0))?;
    let by_depth = facts.is_all_in_focus && plane_um.is_none();
    let [central, forward, weighted] = [Displacement::Central, Displacement::Forward, Displacement::Weighted];
    let order = if by_depth { [weighted, central, forward] } else { [central, forward, weighted] };
    let fields = on_plane(rows, chosen, order)?;
    let note = match fields.first() {
        None => {
            return Err(Error::input(format!(
                "{}: no values in columns central_dx_px, forward_dx_px or weighted_dx_px on the plane z = {chosen} um",
                rows.name()
            )));
        }
        Some((main, _)) if by_depth => Some(format!(
            "all depths are equally sharp: the {} truth is the main one; truths on a plane are those at z = {chosen} um",
            main.name()
        )),
        _ => None,
    };
    let fields = fields.into_iter().map(|(kind, field)| (Some(kind), field)).collect();
    Ok(TrueFields { fields, plane_um: Some(chosen), facts, note, ..TrueFields::default() })
}

/// Depth of the plane nearest to `asked`, or else to `otherwise`, um; the first of two equally near ones.
fn choose(rows: Source<'_>, asked: Option<f64>, otherwise: f64) -> Result<f64> {
    // Depths in the order of the rows, and whether any node of the plane is not masked.
    let mut planes: Vec<(f64, bool)> = Vec::new();
    rows.each(|row| match planes.iter_mut().rev().find(|plane| plane.0 == row.z_um) {
        Some(plane) => plane.1 |= !row.mask,
        None => planes.push((row.z_um, !row.mask)),
    })?;
    let wanted = asked.unwrap_or(otherwise);
    let nearest = |planes: &mut dyn Iterator<Item = &(f64, bool)>| {
        planes.min_by(|a, b| (a.0 - wanted).abs().total_cmp(&(b.0 - wanted).abs())).copied()
    };
    let chosen = match asked {
        Some(_) => nearest(&mut planes.iter()),
        None => nearest(&mut planes.iter().filter(|p| p.1)),
    };
    match chosen {
        Some((z_um, true)) => Ok(z_um),
        Some((z_um, false)) => {
            let fluid: Vec<String> = planes.iter().filter(|p| p.1).map(|p| format!("{}", p.0)).collect();
            Err(Error::input(format!(
                "{}: the plane z = {z_um} um is masked everywhere; there is fluid at z = {} um",
                rows.name(),
                if fluid.is_empty() { "no".to_owned() } else { fluid.join(", ") }
            )))
        }
        None => Err(Error::input(format!("{}: no plane has a node that is not masked", rows.name()))),
    }
}

/// The kinds of truth that have values on a plane, in the order of `kinds`.
fn on_plane(
    rows: Source<'_>,
    plane_um: f64,
    kinds: [Displacement; 3],
) -> Result<Vec<(Displacement, TrueField)>> {
    let mut nodes: [Vec<FlowVector>; 3] = Default::default();
    rows.each(|row| {
        if row.z_um != plane_um {
            return;
        }
        let at = Position { x_px: row.x_px, y_px: row.y_px, z_um: row.z_um };
        for (nodes, kind) in nodes.iter_mut().zip(kinds) {
            let moved = if row.mask { [f64::NAN; 3] } else { kind.of(row) };
            let flag = u8::from(row.mask);
            nodes.push(FlowVector { pair: row.pair, at, moved, flag, sigma: [f64::NAN; 2] });
        }
    })?;
    let with_values = kinds
        .iter()
        .zip(nodes)
        .filter(|(_, nodes)| nodes.iter().any(|n| n.moved[0].is_finite() && n.moved[1].is_finite()));
    Ok(with_values.map(|(kind, nodes)| (*kind, TrueField::new(&nodes))).collect())
}

#[cfg(test)]
mod tests {
    use flows::fields::TaylorGreenParams;
    use generator::runner::{GenerateOptions, MemoryDataset};
    use generator::setup::{Cloud, Microscope, Recording};
    use scenario::SCENARIO;
    use scenario::spec::{Gaussian, Sequence, Timing};
    use storage::Progress;
    use storage::dataset::secret::KEY_FILE;

    use super::*;
    use crate::evaluate::field::{ScoredField, evaluate};
    use crate::evaluate::{EvaluateOptions, Truth};
    use crate::results::Field;

    /// Side of the images, px; object-space length of a pixel, um; time between frames, s.
    const SIZE: f64 = 256.0;
    const UM_PER_PX: f64 = 0.645;
    const DT_S: f64 = 0.01;
    /// The decay time of steady vortices, s.
    const STEADY: f64 = f64::INFINITY;
    /// Maximum speed, px per frame.
    const SPEED_PX: f64 = 6.0;

    /// Two image pairs of Taylor-Green vortices that decay by a factor of e in `decay_s`.
    fn vortices(wavelength_px: f64, decay_s: f64, jitter_s: f64) -> MemoryDataset {
        let wavelength_um = wavelength_px * UM_PER_PX;
        let flow = TaylorGreenParams {
            max_speed_um_s: SPEED_PX * UM_PER_PX / DT_S,
            wavelength_um,
            viscosity_um2_s: (wavelength_um / std::f64::consts::TAU).powi(2) / (2.0 * decay_s),
            ..TaylorGreenParams::default()
        };
        let mut scope = Microscope::setting1().sensor(SIZE as u32, SIZE as u32);
        scope.optics.gaussian = Some(Gaussian::default());
        let timing = Timing::Sequence(Sequence { jitter_s, ..Sequence::new(3, DT_S) });
        let recording = Recording::timed(flow, &Cloud::count(3).diameter_um(1.0), &scope, timing).unwrap();
        assert!((recording.scenario().scale.um_per_px() - UM_PER_PX).abs() < 1e-12);
        recording.dataset(&Progress::default()).unwrap()
    }

    /// The central displacement in image pair `pair`, px, by the classical Runge-Kutta method.
    fn central(wavelength_px: f64, decay_s: f64, pair: u32, x_px: f64, y_px: f64) -> [f64; 2] {
        const STEPS: u32 = 50;
        let k = std::f64::consts::TAU / wavelength_px;
        let middle = 0.5 * (SIZE + 1.0);
        // Time in frames.
        let velocity = |[x, y]: [f64; 2], t: f64| {
            let (a, b) = (k * (x - middle), k * (y - middle));
            let speed = SPEED_PX * (-t * DT_S / decay_s).exp();
            [speed * a.sin() * b.cos(), -speed * a.cos() * b.sin()]
        };
        let end = |side: f64| {
            let h = 0.5 * side / f64::from(STEPS);
            (0..STEPS).fold([x_px, y_px], |x, n| {
                let t = f64::from(pair) + 0.5 + h * f64::from(n);
                let moved = |v: [f64; 2], by: f64| [x[0] + by * v[0], x[1] + by * v[1]];
                let a = velocity(x, t);
                let b = velocity(moved(a, 0.5 * h), t + 0.5 * h);
                let c = velocity(moved(b, 0.5 * h), t + 0.5 * h);
                let d = velocity(moved(c, h), t + h);
                [0, 1].map(|i| x[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]))
            })
        };
        let (before, after) = (end(-1.0), end(1.0));
        [after[0] - before[0], after[1] - before[1]]
    }

    /// Correct vectors, except for `error_px` in u, where `piv` has them: 8 px apart, between the nodes.
    fn correct(wavelength_px: f64, decay_s: f64, error_px: f64) -> Field {
        let axis = || (0..32).map(|k| 4.5 + 8.0 * f64::from(k));
        let places =
            [0, 1].into_iter().flat_map(|pair| axis().flat_map(move |y| axis().map(move |x| (pair, x, y))));
        let vector = |(pair, x_px, y_px)| {
            let [u, v] = central(wavelength_px, decay_s, pair, x_px, y_px);
            let at = Position { x_px, y_px, z_um: 0.0 };
            FlowVector { pair: Some(pair), at, moved: [u + error_px, v, f64::NAN], ..FlowVector::default() }
        };
        Field { vectors: places.map(vector).collect(), ..Field::default() }
    }

    fn save(made: &MemoryDataset, out: &Path) {
        let (out, progress) = (out.to_owned(), Progress::default());
        made.save(&GenerateOptions { out, force: false, resume: false, progress }).unwrap();
    }

    fn rms(scored: &ScoredField) -> [f64; 2] {
        [&scored.score.main.u, &scored.score.main.v].map(|errors| errors.rms_px.unwrap())
    }

    #[test]
    fn correct_vectors_between_the_nodes_have_no_error() {
        for (wavelength_px, decay_s) in [(308.0, STEADY), (154.0, STEADY), (77.0, STEADY), (77.0, 0.02)] {
            let made = vortices(wavelength_px, decay_s, 0.0);
            let (truth, _) =
                Truth::from_memory(&made, made.scenario(), true, &EvaluateOptions::default()).unwrap();
            let scored = evaluate(&truth.fields.unwrap(), &correct(wavelength_px, decay_s, 0.0), 1);
            // Errors of both integrations are below 1e-6 px.
            assert!(rms(&scored).iter().all(|rms| *rms < 1e-5), "{wavelength_px}: {:?}", rms(&scored));
            let score = &scored.score;
            assert_eq!((score.n_outside, score.interpolation_error_px), (0, Some(0.0)));
            assert!((score.main.modulation_u.unwrap() - 1.0).abs() < 1e-5);
            // Interpolation between vectors 8 px apart: 0.074 px at 77 px; bilinearly it would be 0.4 px.
            assert!(score.nodes.rms_px < Some(0.1) && score.nodes.valid == Some(1.0), "{:?}", score.nodes);
            assert!(scored.warnings.is_empty() && scored.hints.is_empty(), "{:?}", scored.warnings);
        }
    }

    #[test]
    fn a_stored_field_is_interpolated_with_a_known_error() {
        // Nodes are 16 px apart: 19, 10, 5 and 2.5 of them per wave.
        for (wavelength_px, largest_px) in [(308.0, 1e-3), (154.0, 0.01), (77.0, 0.2), (40.0, 3.0)] {
            let made = vortices(wavelength_px, STEADY, 0.0);
            let (rows, facts) =
                (made.field().unwrap().unwrap(), RecordingFacts::of(made.manifest().unwrap()));
            let truth = from_rows(Source::Memory(&rows), facts, None).unwrap();
            let scored = evaluate(&truth, &correct(wavelength_px, STEADY, 0.0), 1);
            let [u, v] = rms(&scored);
            let (error, estimated) = (u.hypot(v), scored.score.interpolation_error_px.unwrap());
            assert!(error < largest_px, "{wavelength_px}: {error}");
            // Too large where waves are hardly resolved at twice the spacing.
            let most = if wavelength_px > 100.0 { 10.0 * error } else { f64::INFINITY };
            assert!((0.5 * error..most).contains(&estimated), "{wavelength_px}: {error} {estimated}");
            let scored = evaluate(&truth, &correct(wavelength_px, STEADY, 0.1), 1);
            let is_coarse = scored.warnings.iter().any(|what| what.contains("nodes are too coarse"));
            assert_eq!(is_coarse, wavelength_px < 100.0, "{:?}", scored.warnings);
        }
    }

    #[test]
    fn a_dataset_has_the_flow_of_its_scenario_if_the_stored_field_is_of_this_flow() {
        let (made, folder) = (vortices(77.0, STEADY, 0.0), tempfile::tempdir().unwrap());
        let out = folder.path().join("dataset");
        save(&made, &out);
        let scored = || {
            let (truth, _) = Truth::read(&out, true, &EvaluateOptions::default()).unwrap();
            evaluate(&truth.fields.unwrap(), &correct(77.0, STEADY, 0.0), 1)
        };
        assert!(rms(&scored()).iter().all(|rms| *rms < 1e-5));
        // Another speed of the flow: the stored field is the truth.
        let file = out.join(SCENARIO);
        let text = std::fs::read_to_string(&file).unwrap();
        let other = text.replace("max_speed_um_s: ", "max_speed_um_s: 1");
        assert_ne!(other, text);
        std::fs::write(&file, other).unwrap();
        let found = scored();
        assert!(found.warnings[0].contains("other displacements"), "{:?}", found.warnings);
        assert!(found.score.interpolation_error_px > Some(0.01));
        std::fs::write(&file, "(").unwrap();
        assert!(scored().warnings[0].contains("the flow cannot be computed"));
        std::fs::remove_file(&file).unwrap();
        assert!(scored().warnings.iter().any(|what| what.contains("nodes are too coarse")));
    }

    #[test]
    fn the_times_of_frames_are_those_of_the_secret_key() {
        let (made, folder) = (vortices(154.0, STEADY, 0.1 * DT_S), tempfile::tempdir().unwrap());
        let out = folder.path().join("dataset");
        save(&made, &out);
        let scored = || {
            let (truth, _) = Truth::read(&out, true, &EvaluateOptions::default()).unwrap();
            evaluate(&truth.fields.unwrap(), &correct(154.0, STEADY, 0.0), 1).warnings
        };
        assert_eq!(scored(), Vec::<String>::new());
        std::fs::write(out.join(KEY_FILE), "0".repeat(64)).unwrap();
        assert!(scored()[0].contains("other displacements"));
    }
}
