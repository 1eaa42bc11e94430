//! Fig. 4: random particles in a channel, without and with the cylindrical lens (A, B), and spheroids (C).

use std::path::Path;

use image::GrayImage;
use microsig_core::emission::SpheroidLaw;
use microsig_core::render::RayRenderer;
use microsig_core::render::Render;
use microsig_core::sensor::{Image, Sensor};
use microsig_core::stream::{Purpose, Streams};
use microsig_core::{Particle, Settings, Spheroid};

use suite::picture::{crop, quantile, stacked, stretch, write};

pub(super) fn draw(out: &Path) -> anyhow::Result<()> {
    channel(out, "fig4a_channel", &Settings::setting1())?;
    channel(out, "fig4b_channel_astigmatic", &Settings::setting1a())?;
    spheroids(out, "fig4c_spheroids_original", SpheroidLaw::Original)?;
    spheroids(out, "fig4c_spheroids_uniform", SpheroidLaw::Uniform)
}

fn image(settings: &Settings, particles: &[Particle], law: SpheroidLaw) -> anyhow::Result<Image> {
    let streams = Streams::new(1);
    let light = RayRenderer::new(settings, law)?.light(particles, &streams, Purpose::Rays, 0);
    Ok(Sensor::new(settings).expose(&light, &streams, Purpose::BackgroundNoise, 0))
}

fn channel(out: &Path, name: &str, settings: &Settings) -> anyhow::Result<()> {
    let mut places = Streams::new(4).stream(Purpose::Seeding, 0, 0);
    let particles: Vec<Particle> = (0..90)
        .map(|_| {
            let x = 0.5 + f64::from(settings.pixel_dim_x) * places.uniform();
            let y = 0.5 + f64::from(settings.pixel_dim_y) * places.uniform();
            Particle::sphere(x, y, -80.0 + 100.0 * places.uniform(), 2.0)
        })
        .collect();
    let image = image(settings, &particles, SpheroidLaw::Original)?;
    let white = quantile(&image, 0.992);
    let black = settings.background_mean - settings.background_noise;
    write(&stretch(&image, black, white), out, name)
}

/// Spheroids, with one shape and depth per row and one orientation per column.
fn spheroids(out: &Path, name: &str, law: SpheroidLaw) -> anyhow::Result<()> {
    const CELL: u32 = 80;
    const ROWS: u32 = 5;
    let diagonal = 0.5f64.sqrt();
    // Axes of symmetry: along x, along y, in the image plane at 45 degrees, tilted by 45 degrees with the
    // right, the left and the lower end nearer the lens, along z.
    let columns = [
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [diagonal, diagonal, 0.0],
        [diagonal, 0.0, -diagonal],
        [diagonal, 0.0, diagonal],
        [0.0, diagonal, -diagonal],
        [0.0, 0.0, 1.0],
    ];
    // Aspect ratio, equatorial diameter (um) and depth (um): four rods and a disc.
    let rows: [_; ROWS as usize] =
        [(3.0, 6.0, -60.0), (3.0, 6.0, -30.0), (3.0, 6.0, 0.0), (3.0, 6.0, 20.0), (0.3, 12.0, -30.0)];
    let settings = Settings {
        pixel_dim_x: CELL * columns.len() as u32,
        pixel_dim_y: CELL * ROWS,
        ..Settings::setting1()
    };
    let middle = |index: usize| (index as f64 + 0.5) * f64::from(CELL);
    let mut particles = Vec::new();
    for (row, (e_p, d_um, z_um)) in rows.into_iter().enumerate() {
        for (column, axis) in columns.iter().enumerate() {
            particles.push(Particle {
                spheroid: Some(Spheroid::from_axis(e_p, *axis)),
                ..Particle::sphere(0.5 + middle(column), 0.5 + middle(row), z_um, d_um)
            });
        }
    }
    let image = image(&settings, &particles, law)?;
    let black = settings.background_mean - settings.background_noise;
    let bands: Vec<GrayImage> = (0..ROWS)
        .map(|row| {
            let band = crop(&image, row * CELL, CELL);
            let white = quantile(&band, 0.993);
            stretch(&band, black, white)
        })
        .collect();
    write(&stacked(&bands), out, name)
}
