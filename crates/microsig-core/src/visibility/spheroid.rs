//! The image of a spheroid as a sum of images of small spheres, which come from tables.
//!
//! An exact image takes 20 ms or more. Here the emitting surface is divided into cells, and a sphere as wide
//! as a cell replaces the source points in it, at their centroid: at the depth of the centroid, and where its
//! chief ray lands. What is neglected, for any number of cells, is the off-axis coma of MicroSIG's lens: 2 to
//! 3 % of the peak for a rod 18 um long or a disc of 3 um.

use std::collections::BTreeMap;

use crate::emission::{
    GoldenAzimuths, SpheroidLaw, area_ratio, shining_points, sphere_points, surface_points,
};
use crate::optics::{OpticalSystem, Ray};
use crate::{Particle, Settings};

/// Approximate number of cells.
const CELLS: f64 = 120.0;

/// Widths of cells are multiples of this, um, so that few tables are needed.
const STEP_UM: f64 = 0.05;

/// Spheres whose images add up to the spheroid's; `None` for a sphere.
pub(super) fn spheres(settings: &Settings, law: SpheroidLaw, particle: &Particle) -> Option<Vec<Particle>> {
    let e_p = particle.spheroid?.e_p;
    let (mut azimuths, mut points) = (GoldenAzimuths::default(), Vec::new());
    shining_points(particle, surface_points(settings, particle), law, &mut azimuths, &mut points);
    // The side that faces the lens is about half of the surface.
    let lit_um2 = 0.5 * area_ratio(e_p) * std::f64::consts::PI * particle.d_um * particle.d_um;
    let width_um = (libm::rint((lit_um2 / CELLS).sqrt() / STEP_UM) * STEP_UM).max(STEP_UM);
    let sphere_number = sphere_points(settings, width_um).max(1) as f64;
    // Number of points and sum of their offsets, by cell.
    let mut cells: BTreeMap<[i64; 3], (f64, [f64; 3])> = BTreeMap::new();
    for point in points {
        let (number, sum) = cells.entry(point.map(|e| libm::floor(e / width_um) as i64)).or_default();
        *number += 1.0;
        sum.iter_mut().zip(point).for_each(|(sum, e)| *sum += e);
    }
    let system = OpticalSystem::new(settings);
    let sphere = |(number, sum): &(f64, [f64; 3])| {
        let [e1, e2, e3] = sum.map(|sum| sum / number);
        let distance = system.objective.object_distance(particle.z_um) + e1;
        let chief = Ray { q_x: e2, q_y: e3, p_x: -e2 / distance, p_y: -e3 / distance };
        let (x_um, y_um) = system.trace(chief, distance)?;
        Some(Particle {
            x_px: particle.x_px + x_um / settings.pixel_size,
            y_px: particle.y_px + y_um / settings.pixel_size,
            z_um: particle.z_um + e1,
            d_um: width_um,
            c_int: particle.c_int * number / sphere_number,
            spheroid: None,
        })
    };
    Some(cells.values().filter_map(sphere).collect())
}
