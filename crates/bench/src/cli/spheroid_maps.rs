//! `microsig optics --spheroids`: what images can tell about spheroids, over depth and tilt.

use microsig_core::Spheroid;
use rayon::prelude::*;

use scenario::Scenario;
use scoring::evaluate::crlb::{SpheroidBound, SpheroidBounds};
use storage::Progress;
use storage::dataset::{Columns, Values};
use storage::error::{Error, Result};
use tracking::ParticleShape;

/// Number of depths in the depth range, and of angles between axis and image plane from 0 to 90 degrees.
const DEPTHS: u32 = 15;
const TILTS: u32 = 7;

/// Direction of the axis in the image plane, degrees from x: between the axes of a cylindrical lens.
const AZIMUTH_DEG: f64 = 30.0;

/// Aspect ratios if the scenario has no spheroids.
const ASPECTS: [f64; 2] = [0.4, 2.0];

/// The bound of a spheroid.
#[derive(Debug)]
struct Place {
    e_p: f64,
    tilt_deg: f64,
    z_um: f64,
    bound: Option<SpheroidBound>,
}

/// Bounds over depth, tilt and aspect ratio as a table.
pub(super) fn table(scenario: &Scenario, aspects: &[f64], progress: &Progress) -> Result<Columns> {
    if let Some(e_p) = aspects.iter().find(|e_p| !ParticleShape::ASPECTS.allows(**e_p)) {
        return Err(Error::input(format!("--aspect-ratios {e_p}: expected {}", ParticleShape::ASPECTS)));
    }
    let of_scenario = scenario.spec.particles.spheroids.map(|spheroids| vec![spheroids.e_p]);
    let aspects = if aspects.is_empty() { of_scenario.unwrap_or(ASPECTS.to_vec()) } else { aspects.to_vec() };
    let d_um = scenario.diameters_um()[1];
    let bounds = SpheroidBounds::new(scenario, d_um)?;
    let part = |k: u32, of: u32| f64::from(k) / f64::from(of - 1);
    // Where a spheroid of any direction is between the ends of the depth range.
    let z_um = |k: u32, e_p: f64| {
        let ((low, high), radius_um) = (scenario.depth_range_um, 0.5 * d_um * e_p.max(1.0));
        let inset_um = radius_um.min(0.5 * (high - low));
        low + inset_um + (high - low - 2.0 * inset_um) * part(k, DEPTHS)
    };
    let places: Vec<[f64; 3]> = (aspects.iter())
        .flat_map(|&e_p| (0..TILTS).map(move |k| (e_p, 90.0 * part(k, TILTS))))
        .flat_map(|(e_p, tilt)| (0..DEPTHS).map(move |k| [e_p, tilt, z_um(k, e_p)]))
        .collect();
    let bar = progress.images(places.len() as u64);
    let found = places.into_par_iter().map(|[e_p, tilt_deg, z_um]| {
        progress.check()?;
        let ((sine, cosine), (s, c)) = (tilt_deg.to_radians().sin_cos(), AZIMUTH_DEG.to_radians().sin_cos());
        let bound = bounds.at(z_um, Spheroid::from_axis(e_p, [cosine * c, cosine * s, sine]))?;
        bar.inc(1);
        Ok(Place { e_p, tilt_deg, z_um, bound })
    });
    let found: Vec<Place> = found.collect::<Result<_>>()?;
    bar.finish();
    let known = |value: fn(&Place) -> f64| Values::Numbers(found.iter().map(value).collect());
    let bound = |value: fn(&SpheroidBound) -> f64| {
        Values::Numbers(found.iter().map(|place| place.bound.as_ref().map_or(f64::NAN, value)).collect())
    };
    let columns = [
        ("e_p", known(|place| place.e_p)),
        ("tilt_deg", known(|place| place.tilt_deg)),
        ("z_um", known(|place| place.z_um)),
        ("snr", bound(|b| b.snr)),
        ("crlb_x_px", bound(|b| b.x_px)),
        ("crlb_y_px", bound(|b| b.y_px)),
        ("crlb_z_um", bound(|b| b.z_um)),
        ("crlb_axis_deg", bound(|b| b.axis_deg)),
        ("crlb_aspect", bound(|b| if b.aspect.is_finite() { b.aspect } else { f64::NAN })),
        ("mirror_sd", bound(|b| b.mirror_sd)),
    ];
    Ok(Columns(columns.into_iter().map(|(name, values)| (name.to_owned(), values)).collect()))
}
