//! Divergence of a field: the rate at which it concentrates or dilutes a tracer cloud.
//!
//! Along a trajectory the number density n obeys d ln n / dt = -div u (continuity), so that no cloud stays
//! uniform in a field with divergence, regardless of its seeding; particles that enter have the seeding
//! density.

use crate::{FluidRegion, Region, VelocityField};
use glam::DVec3;

/// Number of sampling points of the divergence along each axis.
const NODES: u32 = 16;

/// Smallest and largest divergence (1/s) on a lattice of points of `view` that are in the fluid at `t` (s);
/// `None` if the field is divergence-free or no sampled point is in the fluid.
pub fn range(
    field: &dyn VelocityField,
    fluid: &FluidRegion<'_>,
    view: &Region,
    t: f64,
) -> Option<(f64, f64)> {
    if field.is_divergence_free() {
        return None;
    }
    let found = lattice(view, NODES).filter(|x| fluid.contains(*x, t)).map(|x| {
        let gradient = field.gradient(x, t);
        (0..3).map(|i| gradient.col(i)[i]).sum::<f64>()
    });
    found.filter(|rate| rate.is_finite()).fold(None, |range, rate| {
        let (low, high) = range.unwrap_or((rate, rate));
        Some((low.min(rate), high.max(rate)))
    })
}

/// The centers (um) of `nodes`^3 equal cells of a box.
pub(crate) fn lattice(part: &Region, nodes: u32) -> impl Iterator<Item = DVec3> {
    let part = *part;
    (0..nodes * nodes * nodes).map(move |i| {
        let place =
            DVec3::new(f64::from(i % nodes), f64::from(i / nodes % nodes), f64::from(i / (nodes * nodes)));
        part.at((place + 0.5) / f64::from(nodes))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::{Boundary, Domain};
    use crate::fields::{Linear, Source, SourceParams};

    #[test]
    fn divergence_is_that_of_the_field() {
        let region = Region::new(DVec3::splat(-50.0), DVec3::splat(50.0)).unwrap();
        let domain = Domain::new(region, [Boundary::Open; 3]);
        let of =
            |field: &dyn VelocityField| range(field, &FluidRegion::new(field, &domain, &[]), &region, 0.0);
        let zoom = of(&Linear::dilatation(-10.0, DVec3::ZERO).unwrap()).unwrap();
        assert!((zoom.0 + 30.0).abs() < 1e-12 && (zoom.1 + 30.0).abs() < 1e-12);
        assert_eq!(of(&Linear::uniform(DVec3::X).unwrap()), None);
        // In the core of a line source, twice the radial strain rate of 1290 / 20 1/s; zero outside.
        let (low, high) = of(&Source::new(&SourceParams::default()).unwrap()).unwrap();
        assert!(low.abs() < 1e-9 && (high - 129.0).abs() < 1e-9, "{low} {high}");
    }
}
