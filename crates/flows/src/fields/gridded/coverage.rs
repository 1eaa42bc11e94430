//! The part of a region that the nodes of a grid cover.

use super::{Gridded, Nodes};
use crate::region::Region;

impl Gridded {
    /// Fraction of the volume of a region beyond the outermost nodes, 0 to 1. Periodic axes, and axes with a
    /// single node, cover everything.
    pub(super) fn uncovered(&self, region: &Region) -> f64 {
        let covered = |axis: usize, nodes: &Nodes| {
            if nodes.periodic || nodes.count == 1 {
                return 1.0;
            }
            let last = nodes.origin + (nodes.count - 1) as f64 * nodes.spacing;
            let (low, high) = (region.min()[axis], region.max()[axis]);
            ((high.min(last) - low.max(nodes.origin)) / (high - low)).clamp(0.0, 1.0)
        };
        1.0 - self.axes.iter().enumerate().map(|(axis, nodes)| covered(axis, nodes)).product::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Interpolation, sampled};
    use super::*;
    use crate::fields::Linear;
    use glam::DVec3;

    #[test]
    fn the_uncovered_share_is_that_of_the_volume() {
        // Nodes from (-240, -120, -80) to (240, 120, 20) um.
        let grid = sampled(&Linear::uniform(DVec3::X).unwrap()).unwrap();
        let share = |periodic: [bool; 3], min: [f64; 3], max: [f64; 3]| {
            let region = Region::new(DVec3::from_array(min), DVec3::from_array(max)).unwrap();
            Gridded::new(&grid, Interpolation::Trilinear, periodic).unwrap().uncovered(&region)
        };
        let none = [false; 3];
        assert_eq!(share(none, [-240.0, -100.0, -80.0], [240.0, 120.0, 20.0]), 0.0);
        assert_eq!(share(none, [-240.0, -120.0, -80.0], [720.0, 120.0, 20.0]), 0.5);
        assert_eq!(share(none, [-240.0, -120.0, -280.0], [720.0, 120.0, 20.0]), 1.0 - 0.5 / 3.0);
        assert_eq!(share([true, false, false], [-240.0, -120.0, -80.0], [720.0, 120.0, 20.0]), 0.0);
        assert_eq!(share(none, [300.0, 0.0, 0.0], [400.0, 10.0, 10.0]), 1.0);
    }
}
