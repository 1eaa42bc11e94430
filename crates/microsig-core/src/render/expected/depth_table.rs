//! The planes of the tables of expected images.

use super::radial_layout::RadialLayout;
use crate::bspline;
use crate::render::depth_table::{self, InterpolatedPlane};
use crate::render::field_nodes::FieldNodes;
use crate::render::node_layout::NodeLayout;
use crate::render::store::{Reader, Writer};

/// A table of expected images.
pub(super) type DepthTable = depth_table::DepthTable<PlaneLayout>;

/// Layout of the coefficients of a plane.
#[derive(Debug, Clone, PartialEq)]
pub enum PlaneLayout {
    /// Spherical lens: azimuthal orders of a quadratic spline along the radius.
    Radial(RadialLayout),
    /// A cubic spline over one quadrant: always with a cylindrical lens, otherwise if few nodes suffice.
    Quadrant(NodeLayout),
}

impl PlaneLayout {
    /// Number of coefficients per plane of a layout that was read; `None` if no plane is so large.
    fn checked_length(&self) -> Option<usize> {
        match self {
            PlaneLayout::Radial(rings) => rings.orders.checked_mul(rings.columns),
            PlaneLayout::Quadrant(layout) => layout.per_px.checked_mul(layout.run)?.checked_mul(layout.rows),
        }
    }
}

impl depth_table::PlaneLayout for PlaneLayout {
    fn length(&self) -> usize {
        match self {
            PlaneLayout::Radial(rings) => rings.length(),
            PlaneLayout::Quadrant(layout) => layout.length(),
        }
    }

    fn at(&self, plane: &InterpolatedPlane, dx: f64, dy: f64) -> [f64; 4] {
        match self {
            PlaneLayout::Radial(rings) => rings.at(plane, dx, dy),
            PlaneLayout::Quadrant(layout) => {
                let [value, by_x, by_y, by_z] = layout.at(plane, [dx.abs(), dy.abs()], bspline::cubic);
                [value, by_x * dx.signum(), by_y * dy.signum(), by_z]
            }
        }
    }

    fn write(table: &DepthTable) -> Vec<u8> {
        let mut out = Writer::default();
        match &table.layout {
            PlaneLayout::Radial(layout) => {
                out.whole(0);
                layout.write(&mut out);
            }
            PlaneLayout::Quadrant(layout) => {
                out.whole(1);
                [layout.per_px, layout.rows, layout.run].into_iter().for_each(|value| out.whole(value));
            }
        }
        // The same at all depths.
        let [x, y] = table.reach_px[0];
        [table.start_um, table.step_um, x, y, table.error].into_iter().for_each(|value| out.number(value));
        out.whole(table.planes);
        out.numbers(&table.radii);
        out.singles(&table.coefficients);
        out.0
    }

    fn read(bytes: &[u8]) -> Option<DepthTable> {
        let mut from = Reader(bytes);
        let layout = match from.whole()? {
            0 => PlaneLayout::Radial(RadialLayout::read(&mut from)?),
            1 => {
                let [per_px, rows, run] = [from.whole()?, from.whole()?, from.whole()?];
                // Nodes beyond the columns that were stored are zero.
                let (columns, mirrored, origin) = (per_px.checked_mul(run)?, true, [0; 2]);
                PlaneLayout::Quadrant(NodeLayout { per_px, columns, rows, mirrored, origin, run })
            }
            _ => return None,
        };
        let [start_um, step_um, x, y, error] =
            [from.number()?, from.number()?, from.number()?, from.number()?, from.number()?];
        let planes = from.whole()?;
        let (radii, coefficients) = (from.numbers()?, from.singles()?);
        if planes > coefficients.len() {
            return None;
        }
        let (length, reach_px) = (layout.checked_length(), vec![[x, y]; planes]);
        let field = FieldNodes::one();
        let table =
            DepthTable { start_um, step_um, planes, radii, field, layout, reach_px, coefficients, error };
        (table.holds(length) && from.is_done()).then_some(table)
    }
}
