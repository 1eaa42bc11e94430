//! A spherical particle as rings of incoherent emitters.
//!
//! `surface`: the hemisphere facing the lens, uniform in area and therefore (Archimedes) uniform in depth.
//! `volume`: discs over the entire depth, each uniform in area. Both use Gauss-Legendre quadrature, which
//! converges exponentially.

use super::options::Emission;
use crate::quadrature::gauss_legendre_on;

/// Emitters at one depth and one distance from the axis.
#[derive(Debug, Clone, Copy)]
pub(in crate::render) struct Ring {
    /// Depth relative to the particle's center, um, growing away from the lens.
    pub(in crate::render) depth_um: f64,
    pub(in crate::render) radius_um: f64,
    /// Fraction of the particle's light.
    pub(in crate::render) weight: f64,
}

/// Rings of a sphere. `etendue`: k NA d/2; `more`: number of depths in addition to those needed for an error
/// of 1e-3 of the peak. Rings of the same depth are consecutive.
pub(in crate::render) fn rings(emission: Emission, radius_um: f64, etendue: f64, more: usize) -> Vec<Ring> {
    if radius_um == 0.0 {
        return vec![Ring { depth_um: 0.0, radius_um: 0.0, weight: 1.0 }];
    }
    match emission {
        Emission::Surface => {
            let depths = libm::ceil(2.0 + 0.8 * etendue) as usize + more;
            let (nodes, weights) = gauss_legendre_on(-1.0, 0.0, depths);
            let ring = |(u, weight): (&f64, &f64)| Ring {
                depth_um: radius_um * u,
                radius_um: radius_um * libm::sqrt(1.0 - u * u),
                weight: *weight,
            };
            nodes.iter().zip(&weights).map(ring).collect()
        }
        Emission::Volume => {
            let depths = libm::ceil(3.0 + etendue) as usize + more;
            let circles = libm::ceil((2.5 + 0.4 * etendue).max(1.2 + 0.55 * etendue)) as usize + more;
            let (nodes, weights) = gauss_legendre_on(-1.0, 1.0, depths);
            let (areas, shares) = gauss_legendre_on(0.0, 1.0, circles);
            let mut rings = Vec::with_capacity(depths * circles);
            for (u, weight) in nodes.iter().zip(&weights) {
                let disc = 1.0 - u * u;
                rings.extend(areas.iter().zip(&shares).map(|(area, share)| Ring {
                    depth_um: radius_um * u,
                    radius_um: radius_um * libm::sqrt(disc * area),
                    weight: 0.75 * disc * weight * share,
                }));
            }
            rings
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Total, mean depth and mean square distance from the axis, as for a hemisphere and a ball.
    #[test]
    fn moments_are_those_of_the_solid() {
        for (emission, depth, across) in [(Emission::Surface, -1.0, 8.0 / 3.0), (Emission::Volume, 0.0, 1.6)]
        {
            let rings = rings(emission, 2.0, 3.6, 0);
            let sum = |f: fn(&Ring) -> f64| -> f64 { rings.iter().map(|ring| ring.weight * f(ring)).sum() };
            assert!((sum(|_| 1.0) - 1.0).abs() < 1e-13);
            assert!((sum(|ring| ring.depth_um) - depth).abs() < 1e-13);
            assert!((sum(|ring| ring.radius_um * ring.radius_um) - across).abs() < 1e-13, "{emission:?}");
        }
    }
}
