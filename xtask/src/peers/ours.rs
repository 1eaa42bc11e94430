//! Our side of the comparison: in-focus image pairs in memory, on one thread, as a process of its own.

use std::hint::black_box;

use microsig_core::render::{GaussianRenderer, Spot};
use microsig_core::sensor::Sensor;
use microsig_core::stream::{Purpose, Streams};
use microsig_core::{Particle, Settings};

/// Edge of an image, px.
pub(super) const SIDE: u32 = 512;

/// Draws image pairs of a vortex: diameters within 9 % of `diameter_px`, peaks of 50 to 250 counts, Gaussian noise of 5 counts.
pub(crate) fn draw(pairs: u32, ppp: f64, diameter_px: f64) -> anyhow::Result<()> {
    let settings = Settings {
        pixel_dim_x: SIDE,
        pixel_dim_y: SIDE,
        background_mean: 20.0,
        background_noise: 5.0,
        gain: 1.0,
        ..Settings::setting1()
    };
    let spot = Spot { diameter_px, reference_um: Some(1.0), peak_counts: 250.0 };
    let renderer = GaussianRenderer::new(&settings, spot)?;
    let sensor = Sensor::new(&settings);
    let streams = Streams::new(1);
    let side = f64::from(SIDE);
    let n = (ppp * side * side).round() as usize;
    let vortex = Grid::vortex();
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    one.install(|| {
        for pair in 0..pairs {
            let mut stream = streams.stream(Purpose::Seeding, pair, 0);
            let mut within = |low: f64, high: f64| low + (high - low) * stream.uniform();
            let first: Vec<Particle> = (0..n)
                .map(|_| {
                    let (x, y) = (within(0.5, side + 0.5), within(0.5, side + 0.5));
                    Particle { c_int: within(0.2, 1.0), ..Particle::sphere(x, y, 0.0, within(0.91, 1.09)) }
                })
                .collect();
            let second: Vec<Particle> = first
                .iter()
                .map(|p| {
                    let [dx, dy] = vortex.at(p.x_px, p.y_px);
                    Particle { x_px: p.x_px + dx, y_px: p.y_px + dy, ..*p }
                })
                .collect();
            for (particles, frame) in [(first, 2 * pair), (second, 2 * pair + 1)] {
                let light = renderer.light(&particles);
                black_box(sensor.expose(&light, &streams, Purpose::BackgroundNoise, frame));
            }
        }
    });
    Ok(())
}

/// Displacements on pixel centres, px, between which they are linear, as the peer takes them.
struct Grid(Vec<[f64; 2]>);

impl Grid {
    /// A vortex in the middle of the image, as in the peers' scripts.
    fn vortex() -> Self {
        let middle = f64::from(SIDE + 1) / 2.0;
        let displacement = |k: u32| {
            let (x, y) = (f64::from(k % SIDE + 1) - middle, f64::from(k / SIDE + 1) - middle);
            let r2 = x * x + y * y + 1e-9;
            let turn = (1.0 - (-r2 / (93.0 * 93.0)).exp()) / r2 * 500.0;
            [-y * turn, x * turn]
        };
        Grid((0..SIDE * SIDE).map(displacement).collect())
    }

    fn at(&self, x_px: f64, y_px: f64) -> [f64; 2] {
        let last = f64::from(SIDE - 2);
        let (x, y) = ((x_px - 1.0).clamp(0.0, last + 1.0), (y_px - 1.0).clamp(0.0, last + 1.0));
        let (column, row) = (x.floor().min(last), y.floor().min(last));
        let (right, down) = (x - column, y - row);
        let corner =
            |dx: usize, dy: usize| self.0[(row as usize + dy) * SIDE as usize + column as usize + dx];
        let (a, b, c, d) = (corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1));
        [0, 1].map(|i| {
            (a[i] * (1.0 - right) + b[i] * right) * (1.0 - down)
                + (c[i] * (1.0 - right) + d[i] * right) * down
        })
    }
}
