//! In-focus image pairs in memory, on one thread: microsig's side of the comparison with other generators (results/peers).

use std::hint::black_box;

use microsig_core::render::{GaussianRenderer, GaussianSpot, ImageStreams, Render};
use microsig_core::sensor::Sensor;
use microsig_core::stream::{Purpose, Stream, Streams};
use microsig_core::{Particle, Settings};

/// Edge of an image, px.
const SIDE: u32 = 512;

/// Renders image pairs of a vortex: diameters within 9 % of `diameter_px`, peaks of 50 to 250 counts,
/// Gaussian noise of 5 counts.
pub(crate) fn draw(pairs: u32, ppp: f64, diameter_px: f64) -> anyhow::Result<()> {
    let settings = Settings {
        pixel_dim_x: SIDE,
        pixel_dim_y: SIDE,
        background_mean: 20.0,
        background_noise: 5.0,
        gain: 1.0,
        ..Settings::setting1()
    };
    let spot = GaussianSpot { diameter_px, reference_um: Some(1.0), peak_counts: 250.0 };
    let renderer = GaussianRenderer::new(&settings, spot)?;
    let sensor = Sensor::new(&settings);
    let streams = Streams::new(1);
    let (rays, noise) = (Purpose::Rays, Purpose::BackgroundNoise);
    let random = |frame| ImageStreams { streams: &streams, rays, noise, frame };
    let n = (ppp * f64::from(SIDE * SIDE)).round() as usize;
    let vortex = Grid::vortex();
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build()?;
    one.install(|| {
        let (mut words, mut particles) = (vec![0; 4 * n], Vec::with_capacity(n));
        for pair in 0..pairs {
            scatter(streams.stream(Purpose::Seeding, pair, 0), &mut words, &mut particles);
            black_box(renderer.image(&particles, &sensor, random(2 * pair)));
            for particle in &mut particles {
                let [dx, dy] = vortex.at(particle.x_px as f32, particle.y_px as f32);
                particle.x_px += f64::from(dx);
                particle.y_px += f64::from(dy);
            }
            black_box(renderer.image(&particles, &sensor, random(2 * pair + 1)));
        }
    });
    Ok(())
}

/// Randomly placed particles, each from four 32-bit random numbers: the same number and resolution as the
/// peer's.
fn scatter(mut stream: Stream, words: &mut [u32], particles: &mut Vec<Particle>) {
    stream.fill(words);
    particles.clear();
    particles.extend(words.as_chunks::<4>().0.iter().map(|numbers| {
        let [x, y, size, brightness] = numbers.map(|number| f64::from(number) / 4_294_967_296.0);
        let at = |share: f64| 0.5 + f64::from(SIDE) * share;
        let c_int = 0.2 + 0.8 * brightness;
        Particle { c_int, ..Particle::sphere(at(x), at(y), 0.0, 0.91 + 0.18 * size) }
    }));
}

/// Displacements at pixel centers, px, interpolated bilinearly in f32 as by the peer.
struct Grid(Vec<[f32; 2]>);

impl Grid {
    /// A vortex at the image center, as in the peers' scripts.
    fn vortex() -> Self {
        let middle = f64::from(SIDE + 1) / 2.0;
        let displacement = |k: u32| {
            let (x, y) = (f64::from(k % SIDE + 1) - middle, f64::from(k / SIDE + 1) - middle);
            let r2 = x * x + y * y + 1e-9;
            let turn = (1.0 - (-r2 / (93.0 * 93.0)).exp()) / r2 * 500.0;
            [(-y * turn) as f32, (x * turn) as f32]
        };
        Grid((0..SIDE * SIDE).map(displacement).collect())
    }

    fn at(&self, x_px: f32, y_px: f32) -> [f32; 2] {
        let last = (SIDE - 2) as f32;
        let (x, y) = ((x_px - 1.0).clamp(0.0, last + 1.0), (y_px - 1.0).clamp(0.0, last + 1.0));
        // For nonnegative numbers the conversion rounds down.
        let (column, row) = (x.min(last) as usize, y.min(last) as usize);
        let (right, down) = (x - column as f32, y - row as f32);
        let upper = row * SIDE as usize + column;
        let lower = upper + SIDE as usize;
        let ([a, b], [c, d]) = ([self.0[upper], self.0[upper + 1]], [self.0[lower], self.0[lower + 1]]);
        let between = |from: f32, to: f32, share: f32| from + (to - from) * share;
        [0, 1].map(|i| between(between(a[i], b[i], right), between(c[i], d[i], right), down))
    }
}
