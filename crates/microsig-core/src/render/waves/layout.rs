//! The planes of the tables of images by wave optics: coefficients of a quintic spline through the light on
//! pixels.

use crate::bspline;
use crate::render::depth_table::{DepthTable, InterpolatedPlane, PlaneLayout};
use crate::render::field_nodes::FieldNodes;
use crate::render::node_layout::NodeLayout;
use crate::render::store::{Reader, Writer};

/// A table of images by wave optics.
pub(super) type Table = DepthTable<Layout>;

/// Larger than the number of nodes along any axis.
const MAX: usize = 1 << 20;

/// Nodes of a plane.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    pub(super) nodes: NodeLayout,
    /// Half width and half height of the computed area, px.
    pub(super) edge_px: [usize; 2],
    /// Whether images are displaced against coma ([`super::tilt`]).
    pub(super) tilted: bool,
}

impl PlaneLayout for Layout {
    fn length(&self) -> usize {
        self.nodes.length()
    }

    fn at(&self, plane: &InterpolatedPlane, dx: f64, dy: f64) -> [f64; 4] {
        self.nodes.at(plane, [dx, dy], bspline::quintic)
    }

    fn write(table: &Table) -> Vec<u8> {
        let Layout { nodes: NodeLayout { per_px, columns, rows, mirrored, origin, .. }, edge_px, tilted } =
            table.layout;
        let mut out = Writer::default();
        [table.start_um, table.step_um, table.error].into_iter().for_each(|value| out.number(value));
        let (degree, size_px) = table.field.parts();
        out.whole(degree);
        size_px.into_iter().for_each(|size| out.number(size));
        let nodes = [table.planes, per_px, columns, rows, usize::from(mirrored), usize::from(tilted)];
        nodes.into_iter().chain(origin).chain(edge_px).for_each(|value| out.whole(value));
        out.numbers(&table.radii);
        out.numbers(table.reach_px.as_flattened());
        out.singles(&table.coefficients);
        out.0
    }

    fn read(bytes: &[u8]) -> Option<Table> {
        let mut from = Reader(bytes);
        let [start_um, step_um, error] = [from.number()?, from.number()?, from.number()?];
        let field = FieldNodes::from_parts((from.whole()?, [from.number()?, from.number()?]))?;
        let [planes, per_px, columns, rows] = [from.whole()?, from.whole()?, from.whole()?, from.whole()?];
        let [mirrored, tilted] = [from.whole()? == 1, from.whole()? == 1];
        let [origin, edge_px] = [[from.whole()?, from.whole()?], [from.whole()?, from.whole()?]];
        if per_px == 0 || per_px.max(columns).max(rows) > MAX {
            return None;
        }
        let nodes = NodeLayout::new(per_px, [columns, rows], mirrored);
        let layout = Layout { nodes, edge_px, tilted };
        let (radii, reach) = (from.numbers()?, from.numbers()?);
        let reach_px = reach.as_chunks::<2>().0.to_vec();
        let (length, coefficients) = (layout.length(), from.singles()?);
        let table = Table { start_um, step_um, planes, radii, field, layout, reach_px, coefficients, error };
        (table.holds(Some(length)) && table.layout.nodes.origin == origin && from.is_done()).then_some(table)
    }
}
