//! The pictures of docs/microscope.md of optics that vary over the field: one row for each term.

use std::path::Path;

use image::GrayImage;
use microsig_core::Particle;
use microsig_core::render::Context;
use scenario::{Scenario, parse, resolve};
use suite::picture::{magnified, side_by_side, square_roots, write};

/// Name of the picture, and the term: all are exaggerated.
const TERMS: [(&str, &str); 8] = [
    ("curvature", "focus: (curvature_um_per_mm2: 30)"),
    ("tilt", "focus: (tilt_um_per_mm: (25, 0))"),
    ("chief_ray", "chief_ray: (per_mm: -0.6)"),
    ("distortion", "distortion_per_mm2: 0.03"),
    ("light", "light_per_mm2: -2.5"),
    ("vignetting", "vignetting: (meridional_per_mm2: 1.8)"),
    ("coma", "coma: (per_mm: -0.25)"),
    ("astigmatism", "astigmatism: (per_mm: 0.5)"),
];

/// Side of the sensor and of a tile, px; screen pixels for one of them.
const SENSOR: u32 = 1024;
const SIDE: u32 = 35;
const ZOOM: u32 = 2;
/// Depths of the particles, um.
const DEPTHS_UM: [f64; 2] = [0.0, 12.0];
/// Steps from the center to the corner.
const STEPS: u32 = 4;

/// Draws them below `out`.
pub(super) fn run(out: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(out)?;
    for (name, term) in TERMS {
        write(&magnified(&row(&scenario(term)?, name == "light")?, ZOOM), out, name)?;
    }
    Ok(())
}

/// A 20x / 0.45 objective that images a square of 0.82 mm.
fn scenario(term: &str) -> anyhow::Result<Scenario> {
    let text = format!(
        "(name: \"field\", optics: (magnification: 10, numerical_aperture: 0.45, pixel_size: 8, pixel_dim_x: {SENSOR}, \
         pixel_dim_y: {SENSOR}, cyl_focal_length: 0, lens: aplanatic, field: ({term})), \
         render: (mode: waves, wavelength_um: 0.56, emission: volume, tolerance: 0.01), \
         boundaries: (z_um: (-15, 15)), motion: flow(field: poiseuille()), timing: pairs(count: 1))"
    );
    Ok(resolve(parse(&text, "field")?, Path::new("."), &Context::default())?)
}

/// Particles from the center to the corner at each depth; each tile is centered on the ideal image and scaled to
/// its own peak, or to its depth's.
fn row(scenario: &Scenario, is_scaled_together: bool) -> anyhow::Result<GrayImage> {
    let (middle, half) = (f64::from(SENSOR / 2), f64::from(SIDE / 2));
    let mut tiles = Vec::new();
    for z_um in DEPTHS_UM {
        let lights: Vec<Vec<f64>> = (0..=STEPS)
            .map(|step| {
                let at = (middle + f64::from(step) * (middle - half) / f64::from(STEPS)).round();
                tile(scenario, &Particle::sphere(at, at, z_um, 2.0))
            })
            .collect::<Option<_>>()
            .ok_or_else(|| anyhow::anyhow!("no images of single particles"))?;
        let peak = |lights: &[f64]| lights.iter().copied().fold(0.0, f64::max);
        let highest = lights.iter().map(|light| peak(light)).fold(0.0, f64::max);
        tiles.extend(lights.iter().map(|light| {
            let mut tile = square_roots(light, SIDE);
            if is_scaled_together {
                let share = (peak(light) / highest).sqrt();
                tile.pixels_mut()
                    .for_each(|pixel| pixel.0[0] = (share * f64::from(pixel.0[0])).round() as u8);
            }
            tile
        }));
    }
    Ok(side_by_side(&tiles))
}

/// The light on a square around the ideal image.
fn tile(scenario: &Scenario, particle: &Particle) -> Option<Vec<f64>> {
    let patch = scenario.renderer.mean_patch(particle)?;
    let half = i64::from(SIDE / 2);
    let (x, y) = (particle.x_px as i64, particle.y_px as i64);
    let of = |row: i64, column: i64| {
        let (dx, dy) = (column - patch.window.x0, row - patch.window.y0);
        let inside = |d: i64, size: usize| usize::try_from(d).ok().filter(|d| *d < size);
        let at = inside(dx, patch.window.width).zip(inside(dy, patch.window.height));
        at.map_or(0.0, |(dx, dy)| patch.counts[dy * patch.window.width + dx])
    };
    let columns = || (x - half)..=(x + half);
    Some(
        ((y - half)..=(y + half))
            .flat_map(|row| columns().map(move |column| (row, column)))
            .map(|(r, c)| of(r, c))
            .collect(),
    )
}
