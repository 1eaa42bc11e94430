//! The pictures of docs/microscope.md: renderers side by side, and what `microsig optics` shows.

use std::path::Path;

use bench::optics::{Optics, svg};
use image::GrayImage;
use microsig_core::Particle;
use microsig_core::render::Context;
use microsig_core::stream::{Purpose, Streams};
use scenario::{Scenario, load, parse, resolve};
use suite::picture::{magnified, side_by_side, square_roots, write};

/// Depths of the particles, um.
const DEPTHS_UM: [f64; 5] = [-60.0, -40.0, -12.0, 0.0, 20.0];
/// Side of an image, px, and screen pixels for one of them.
const SIDE: u32 = 81;
const ZOOM: u32 = 2;

/// Name of the picture, optics and renderer.
const RENDERERS: [(&str, &str, &str); 4] = [
    ("rays", "", "mode: rays"),
    ("expected", "", "mode: expected"),
    ("waves", "", "mode: waves, wavelength_um: 0.52"),
    ("aplanatic", "lens: aplanatic, ", "mode: waves, wavelength_um: 0.52"),
];

/// Draws them below `out`.
pub(super) fn run(out: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(out)?;
    for (name, optics, render) in RENDERERS {
        write(&magnified(&row(&scenario(optics, render)?), ZOOM), out, name)?;
    }
    let shown = Optics::of(&load(Path::new("scenarios/objective_20x.ron"), &[], None, &Context::default())?)?;
    std::fs::write(out.join("objective_20x.svg"), svg(&[shown])?)?;
    Ok(())
}

fn scenario(optics: &str, render: &str) -> anyhow::Result<Scenario> {
    let text = format!(
        "(name: \"renderers\", optics: (preset: setting1, pixel_dim_x: {SIDE}, pixel_dim_y: {SIDE}, {optics}), \
         motion: flow(field: poiseuille()), timing: pairs(count: 1), render: ({render}))"
    );
    Ok(resolve(parse(&text, "renderers")?, Path::new("."), &Context::default())?)
}

/// One particle at each depth, as the renderer draws it.
fn row(scenario: &Scenario) -> GrayImage {
    let middle = f64::from(SIDE / 2 + 1);
    let tiles = DEPTHS_UM.map(|z_um| {
        let particle = Particle::sphere(middle, middle, z_um, 2.0);
        let light = scenario.renderer.light(&[particle], &Streams::new(1), Purpose::Rays, 0);
        square_roots(&light.values, SIDE)
    });
    side_by_side(&tiles)
}
