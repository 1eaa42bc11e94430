//! The true field: displacements on a grid, one for each image pair or one for all, with bilinear
//! interpolation.

use std::collections::BTreeMap;
use std::path::Path;

use crate::results::{Conventions, FlowVector, Position, read_field};
use dataset::{FieldRow, RecordingFacts, Row, TableReader};
use generator::runner::DatasetPlace;
use schemars::JsonSchema;
use serde::Deserialize;
use storage::error::{Error, Result};

/// True displacements on a grid, one field for each image pair or one for all.
#[derive(Debug, Default)]
pub struct TrueField {
    x_px: Vec<f64>,
    y_px: Vec<f64>,
    pairs: BTreeMap<Option<u32>, Vec<[f64; 3]>>,
}

impl TrueField {
    pub(super) fn new(nodes: &[FlowVector]) -> Self {
        let axis = |value: fn(&FlowVector) -> f64| {
            let mut values: Vec<f64> = nodes.iter().map(value).collect();
            values.sort_unstable_by(f64::total_cmp);
            values.dedup();
            values
        };
        let mut grid =
            TrueField { x_px: axis(|v| v.at.x_px), y_px: axis(|v| v.at.y_px), pairs: BTreeMap::new() };
        let size = grid.x_px.len() * grid.y_px.len();
        // Scattered nodes are not a grid: such a table has no truth.
        if size <= 100 * nodes.len() + 1000 {
            for node in nodes {
                let (i, j) = (index(&grid.x_px, node.at.x_px), index(&grid.y_px, node.at.y_px));
                let values = grid.pairs.entry(node.pair).or_insert_with(|| vec![[f64::NAN; 3]; size]);
                values[j * grid.x_px.len() + i] = node.moved;
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

    /// The true displacement of an image pair at a position, as [`TrueField::at`].
    pub fn of_pair(&self, pair: Option<u32>, x_px: f64, y_px: f64) -> Option<[f64; 3]> {
        let at = Position { x_px, y_px, ..Position::default() };
        self.at(&FlowVector { pair, at, ..FlowVector::default() })
    }

    /// The true displacement [px, px, um] at the position of a vector; `None` outside the grid or where the
    /// truth is masked.
    pub fn at(&self, vector: &FlowVector) -> Option<[f64; 3]> {
        let single = (self.pairs.len() == 1).then(|| self.pairs.values().next()).flatten();
        let values = self
            .pairs
            .get(&vector.pair)
            .or(self.pairs.get(&None))
            .or(single.filter(|_| vector.pair.is_none()))?;
        let place = |axis: &[f64], v: f64| {
            let (first, last) = (*axis.first()?, *axis.last()?);
            if v < first || v > last {
                return None;
            }
            let i = (index(axis, v).max(1) - 1).min(axis.len().saturating_sub(2));
            let next = (i + 1).min(axis.len() - 1);
            let share = if next > i { (v - axis[i]) / (axis[next] - axis[i]) } else { 0.0 };
            Some((i, next, share))
        };
        let (i, i1, s) = place(&self.x_px, vector.at.x_px)?;
        let (j, j1, t) = place(&self.y_px, vector.at.y_px)?;
        let mut sum = [0.0; 3];
        for (row, column, weight) in
            [(j, i, (1.0 - s) * (1.0 - t)), (j, i1, s * (1.0 - t)), (j1, i, (1.0 - s) * t), (j1, i1, s * t)]
        {
            // A masked node with weight 0 does not matter: 0 * NaN would be NaN.
            if weight != 0.0 {
                let value = values[row * self.x_px.len() + column];
                sum.iter_mut().zip(value).for_each(|(s, v)| *s += weight * v);
            }
        }
        (sum[0].is_finite() && sum[1].is_finite()).then_some(sum)
    }
}

pub(super) fn index(axis: &[f64], v: f64) -> usize {
    axis.partition_point(|a| *a < v)
}

/// The true field of a bare table.
///
/// # Errors
/// A file that is not a field.
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

/// The true fields in a dataset's folder, as [`of_rows`].
///
/// # Errors
/// A dataset without a true field; a malformed table.
pub fn of_dataset(dataset: &Path, plane_um: Option<f64>) -> Result<TrueFields> {
    of_recording(dataset, RecordingFacts::read(dataset)?, plane_um)
}

/// [`of_dataset`] of a folder, or of a dataset in memory.
///
/// # Errors
/// As [`of_dataset`].
pub fn of_place(dataset: &DatasetPlace) -> Result<TrueFields> {
    match dataset {
        DatasetPlace::Folder(folder) => of_dataset(folder, None),
        DatasetPlace::Memory(made) => {
            let rows =
                made.field()?.ok_or_else(|| Error::input("this dataset has no true displacement field"))?;
            of_rows(Source::Memory(&rows), dataset.facts()?, None)
        }
    }
}

/// [`of_dataset`] with the facts that its manifest gives.
pub(in super::super) fn of_recording(
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
    of_rows(Source::File(path), facts, plane_um)
}

/// The true fields of a dataset on one of its planes: the plane nearest to `plane_um` if given. Otherwise,
/// among the planes that are not completely masked, the one nearest to the focal depth of the particles; to
/// the center of the depth range if all depths are equally sharp; or to 0 if the focal depth is unknown.
///
/// If all depths are equally sharp, correlation measures their average, so the depth-weighted truth is the
/// main one.
///
/// # Errors
/// A plane that is masked everywhere; a malformed table.
pub fn of_rows(rows: Source<'_>, facts: RecordingFacts, plane_um: Option<f64>) -> Result<TrueFields> {
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
    Ok(TrueFields { fields, plane_um: Some(chosen), facts, note })
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
    use super::*;

    #[test]
    fn the_truth_is_bilinear_between_nodes_and_absent_outside() {
        let node = |x: f64, y: f64| FlowVector {
            at: Position { x_px: x, y_px: y, z_um: 0.0 },
            moved: [1.0 + x + 2.0 * y + 0.5 * x * y, -x, 0.0],
            ..FlowVector::default()
        };
        let nodes: Vec<FlowVector> =
            [1.0, 5.0, 9.0].iter().flat_map(|&x| [2.0, 4.0].map(|y| node(x, y))).collect();
        let grid = TrueField::new(&nodes);
        for (x, y) in [(1.0, 2.0), (9.0, 4.0), (3.0, 2.5), (6.0, 4.0)] {
            let found = grid.at(&node(x, y)).unwrap();
            // Rounding error of a few operations on numbers of about 30.
            assert!((found[0] - node(x, y).moved[0]).abs() < 1e-12, "{x} {y}");
        }
        assert_eq!(grid.at(&node(0.9, 3.0)), None);
    }
}
