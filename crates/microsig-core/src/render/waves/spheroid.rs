//! Spheroids: sums of the images of incoherent point emitters.
//!
//! A linear map takes a sphere to the spheroid, and the hemisphere about one direction to the side of its
//! surface that faces the lens. So the emitters lie on a sphere's rings ([`bead`](super::bead)), spaced
//! equally in azimuth, and their weights are the areas that the map makes of theirs. A volume stays uniform.

use glam::DVec3;

use super::options::Emission;
use crate::emission::Rotation;
use crate::particle::Spheroid;
use crate::render::shape::{Cloud, Numbers};

/// Azimuths of a ring in addition to two for each period of the light's phase around it.
const MORE_AZIMUTHS: f64 = 8.0;

/// Largest number of emitters of a spheroid, which bounds memory and time.
pub(super) const MAX_EMITTERS: f64 = 3e5;

/// Number of emitters of a spheroid above which there is a warning: an image of it takes seconds.
pub(super) const MANY_EMITTERS: f64 = 2e4;

/// Approximate number of emitters of a spheroid; `k_sine` as for [`emitters`].
pub(super) fn number(radius_um: f64, spheroid: &Spheroid, emission: Emission, k_sine: f64) -> f64 {
    let rim_phase = k_sine * radius_um * spheroid.e_p.max(1.0);
    // Mean radii of rings, and their number.
    let (mean, rings) = match emission {
        Emission::Surface => (1.5, 4.0 + 0.8 * rim_phase),
        Emission::Volume => (0.8, (5.0 + rim_phase) * (4.5 + 0.4 * rim_phase)),
    };
    rings * kink(spheroid.e_p) * (mean * rim_phase + MORE_AZIMUTHS)
}

/// The emitters of a spheroid: offsets from its center (um; x right, y down, z away from the lens) and shares of its
/// light. `k_sine`: largest wave number across the optical axis that the lens accepts, 1/um.
pub(super) fn emitters(
    radius_um: f64,
    spheroid: &Spheroid,
    emission: Emission,
    k_sine: f64,
) -> Vec<(DVec3, f64)> {
    let axis = DVec3::from_array(spheroid.axis()).normalize();
    let rim_phase = k_sine * radius_um * spheroid.e_p.max(1.0);
    let numbers = Numbers { rim_phase, rings: 1, around: MORE_AZIMUTHS };
    Cloud::new(radius_um, axis, spheroid.e_p, emission, numbers).points(axis, spheroid.e_p)
}

/// Factor on the number of azimuths: light around the rings of thin discs has a kink at their rim.
pub(in crate::render) fn kink(e_p: f64) -> f64 {
    (0.1 / e_p).clamp(1.0, 4.0)
}

/// Half the extent of a spheroid along each of the internal axes, um.
pub(super) fn half_extents(radius_um: f64, spheroid: &Spheroid) -> [f64; 3] {
    let rotation = Rotation::new(spheroid);
    std::array::from_fn(|axis| {
        let mut direction = [0.0; 3];
        direction[axis] = 1.0;
        let [x, y, z] = rotation.inverse(direction);
        radius_um * libm::sqrt(x * x + y * y + spheroid.e_p * spheroid.e_p * z * z)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emission::{GoldenAzimuths, SpheroidLaw, shining_points};
    use crate::particle::Particle;

    /// Means and mean squares of the places of emitters, as for very many points of the uniform law.
    #[test]
    fn emitters_are_uniform_on_the_surface_that_faces_the_lens() {
        for (e_p, alpha_rad, beta_rad) in [(3.0, 0.6, 0.9), (0.4, 0.3, 1.2), (4.0, 0.0, 0.0), (1.0, 0.2, 0.1)]
        {
            let spheroid = Spheroid { e_p, alpha_rad, beta_rad };
            let particle = Particle { spheroid: Some(spheroid), ..Particle::sphere(0.0, 0.0, 0.0, 2.0) };
            let (mut azimuths, mut points) = (GoldenAzimuths::default(), Vec::new());
            shining_points(&particle, 200_000, SpheroidLaw::Uniform, &mut azimuths, &mut points);
            for (emission, k_sine) in [Emission::Surface, Emission::Volume].into_iter().zip([3.6, 15.0]) {
                let n = emitters(1.0, &spheroid, emission, k_sine).len();
                let told = number(1.0, &spheroid, emission, k_sine) / n as f64;
                assert!((0.7..1.4).contains(&told), "{emission:?}: {told}");
            }
            let emitters = emitters(1.0, &spheroid, Emission::Surface, 3.6);
            let extents = half_extents(1.0, &spheroid);
            for axis in 0..3 {
                // From internal axes: (e1, e2, e3) = (z, -x, -y).
                let internal = |at: &DVec3| [at.z, -at.x, -at.y][axis];
                let powers: [fn(f64) -> f64; 2] = [|v| v, |v| v * v];
                for power in powers {
                    let expected = points.iter().map(|at| power(at[axis])).sum::<f64>() / points.len() as f64;
                    let found: f64 = emitters.iter().map(|(at, share)| share * power(internal(at))).sum();
                    let scale = power(extents[axis]);
                    assert!(
                        (found - expected).abs() < 2e-4 * scale,
                        "{spheroid:?} {axis}: {found} {expected}"
                    );
                }
                let farthest = emitters.iter().map(|(at, _)| internal(at).abs()).fold(0.0, f64::max);
                assert!(farthest <= extents[axis] && farthest > 0.9 * extents[axis], "{axis}: {farthest}");
            }
        }
    }
}
