//! `truth/field.csv`: the displacement field on a grid, the reference for scores of PIV results.

use flows::VelocityField;
use microsig_core::visibility::DepthScan;
use rayon::prelude::*;
use scenario::{Nodes, Scenario, Weighting};
use storage::dataset::rows::{BACKWARD, WEIGHTED, WINDOW};
use storage::dataset::{FieldRow, ImageFlow, Row, Table, TableWriter};
use storage::{OutputFolder, Result};

use super::texts;

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

/// Grid and flow of a scenario that has both.
fn grid(scenario: &Scenario) -> Option<(Nodes, &dyn VelocityField)> {
    Some((scenario.truth_grid()?, scenario.field()?))
}

/// Number of rows that are in memory at a time.
const ROWS: usize = 1 << 16;

/// Writes the table into a dataset's folder, one pair after the other.
pub(super) fn write(folder: &OutputFolder, scenario: &Scenario, stack: &DepthScan) -> Result<()> {
    let Some((nodes, field)) = grid(scenario) else { return Ok(()) };
    let table = table(&nodes);
    let mut writer = TableWriter::create(folder, &table)?;
    let depths = nodes.weighting.depths(stack);
    for rows in rows(scenario, field, &nodes, &depths) {
        texts(&table, &rows).iter().try_for_each(|text| writer.append(text))?;
    }
    writer.seal().map(drop)
}

/// The table, if the scenario has one.
pub fn in_memory(scenario: &Scenario, stack: &DepthScan) -> Option<(Table, Vec<FieldRow>)> {
    let (nodes, field) = grid(scenario)?;
    let depths = nodes.weighting.depths(stack);
    Some((table(&nodes), rows(scenario, field, &nodes, &depths).flatten().collect()))
}

fn rows<'a>(
    scenario: &'a Scenario,
    field: &'a dyn VelocityField,
    nodes: &'a Nodes,
    depths: &'a [(f64, f64)],
) -> impl Iterator<Item = Vec<FieldRow>> + 'a {
    scenario.field_intervals(field).into_iter().flat_map(move |(pair, interval)| {
        let flow = scenario.image_flow(field, depths);
        let flow = ImageFlow { window_px: nodes.window_px, backward: nodes.backward, ..flow };
        let (across, n) = (nodes.x_px.len(), nodes.x_px.len() * nodes.y_px.len());
        let place = move |i: usize| [nodes.x_px[i % across], nodes.y_px[i / across]];
        let weighted: Vec<[f64; 3]> =
            (0..n).into_par_iter().map(|i| flow.weighted(place(i), interval)).collect();
        let row = move |k: usize| {
            let (plane, [x_px, y_px]) = (k / n, place(k % n));
            let (z_um, plane) = (nodes.planes_um[plane], plane as u32);
            let at = FieldRow { pair, plane, x_px, y_px, z_um, ..FieldRow::default() };
            flow.row(at, weighted[k % n], interval)
        };
        let all = nodes.planes_um.len() * n;
        let chunk = move |first| (first..all.min(first + ROWS)).into_par_iter().map(&row).collect();
        (0..all).step_by(ROWS).map(chunk)
    })
}
