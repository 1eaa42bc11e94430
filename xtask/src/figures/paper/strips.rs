//! Fig. 3A and B: the image of one particle from below focus to above, for settings 1 and 2, and 1a.

use std::path::Path;

use microsig_core::emission::SpheroidLaw;
use microsig_core::render::RayRenderer;
use microsig_core::render::Render;
use microsig_core::sensor::Sensor;
use microsig_core::stream::{Purpose, Streams};
use microsig_core::{Particle, Settings};

use suite::picture::{side_by_side, stretch, write};

struct Strip {
    name: &'static str,
    settings: Settings,
    d_um: f64,
    /// Edge of a tile, px, odd.
    tile: u32,
    depths_um: Vec<i32>,
    /// White level, as a share of each tile's maximum above the background.
    white: f64,
}

pub(super) fn draw(out: &Path) -> anyhow::Result<()> {
    let strips = [
        Strip {
            name: "fig3a_setting1",
            settings: Settings::setting1(),
            d_um: 2.0,
            tile: 65,
            depths_um: (-80..=40).step_by(10).collect(),
            white: 1.0,
        },
        Strip {
            name: "fig3a_setting1a",
            settings: Settings::setting1a(),
            d_um: 2.0,
            tile: 65,
            depths_um: (-80..=40).step_by(10).collect(),
            white: 1.0,
        },
        Strip {
            name: "fig3b_setting2",
            settings: Settings::setting2(),
            d_um: 1.0,
            tile: 141,
            depths_um: (-40..=5).step_by(5).collect(),
            // Saturates the core to make the rings visible.
            white: 0.6,
        },
    ];
    strips.iter().try_for_each(|strip| strip.draw(out))
}

impl Strip {
    fn draw(&self, out: &Path) -> anyhow::Result<()> {
        let settings = Settings { pixel_dim_x: self.tile, pixel_dim_y: self.tile, ..self.settings.clone() };
        let renderer = RayRenderer::new(&settings, SpheroidLaw::Original)?;
        let sensor = Sensor::new(&settings);
        let streams = Streams::new(1);
        let middle = f64::from(self.tile / 2 + 1);
        let mut tiles = Vec::new();
        for (step, &z_um) in self.depths_um.iter().enumerate() {
            let particle = Particle::sphere(middle, middle, f64::from(z_um), self.d_um);
            let light = renderer.light(&[particle], &streams, Purpose::Rays, step as u32);
            let image = sensor.expose(&light, &streams, Purpose::BackgroundNoise, step as u32);
            let peak = image.counts.values().fold(1.0, f64::max);
            let background = settings.background_mean;
            let white = background + self.white * (peak - background);
            tiles.push(stretch(&image, background - settings.background_noise, white));
        }
        write(&side_by_side(&tiles), out, self.name)
    }
}
