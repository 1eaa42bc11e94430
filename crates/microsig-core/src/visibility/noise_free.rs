//! The noise-free image of any particle of a dataset.

use super::spheroid::spheres;
use crate::emission::aperture_excess;
use crate::render::{Renderer, Window};
use crate::{Particle, Settings};

/// Tolerance of images that are only used for visibility: the root mean square error relative to the peak.
/// Peaks are then accurate to 1 %.
pub const TOLERANCE: f64 = 0.005;

/// Renders single particles without noise, each at its sub-pixel position and depth. Peaks are accurate to 1
/// %, except for spheroids in ray images (10 %), which are rendered as many small spheres because an exact
/// image would take longer than the ray image itself.
///
/// Images of a dataset without ray noise come from its own renderer. For ray images, they are the limit of
/// infinitely many rays, multiplied by the excess light of few rays; where that limit takes too long
/// (numerical apertures above 0.6 with a strong cylindrical lens), they are the mean of 32 ray images.
#[derive(Debug, Clone)]
pub struct NoiseFree {
    renderer: Renderer,
    /// For ray images: the limit of infinitely many rays.
    limit: Option<Renderer>,
    /// Ratio of the light of ray images to their limit's.
    factor: f64,
}

/// The light of a particle on a rectangle of pixels, in the unit of [`crate::sensor::Light`].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Patch {
    /// Left column and top row, from 0.
    pub corner: (usize, usize),
    /// Width, px.
    pub width: usize,
    /// Light, row by row.
    pub values: Vec<f64>,
}

impl NoiseFree {
    /// Images of a dataset rendered by `renderer`; `limit`: for ray images, the renderer of their limit of
    /// infinitely many rays.
    pub fn new(renderer: Renderer, limit: Option<Renderer>) -> Self {
        let Settings { n_rays, numerical_aperture, .. } = *renderer.settings();
        let factor = if limit.is_some() { 1.0 + aperture_excess(n_rays, numerical_aperture) } else { 1.0 };
        NoiseFree { renderer, limit, factor }
    }

    /// Whether images are rendered from tables that take a long time to compute.
    pub fn needs_tables(&self) -> bool {
        self.limit.as_ref().unwrap_or(&self.renderer).needs_tables()
    }

    /// Computes the tables for images of these particles, once for all of them.
    pub fn prepare(&self, particles: &[&[Particle]]) {
        if self.needs_tables() {
            let drawn = self.drawn(particles.iter().copied().flatten());
            self.limit.as_ref().unwrap_or(&self.renderer).prepare(&[&drawn]);
        }
    }

    /// Number of tables that images of these particles need and that are not yet computed.
    pub fn missing_tables(&self, particles: &[Particle]) -> usize {
        self.limit.as_ref().unwrap_or(&self.renderer).missing_tables(&self.drawn(particles.iter()))
    }

    /// The spheres that are rendered from tables.
    fn drawn<'a>(&self, particles: impl Iterator<Item = &'a Particle>) -> Vec<Particle> {
        let parts = particles.flat_map(|particle| self.parts(particle));
        parts.filter(|part| self.by_limit(part)).collect()
    }

    /// The image of one particle; empty if no light reaches the sensor.
    pub fn draw(&self, particle: &Particle) -> Patch {
        self.parts(particle).iter().fold(Patch::default(), |whole, part| whole.joined(self.draw_part(part)))
    }

    /// What is rendered for a particle: the particle itself, or many spheres for a spheroid in ray images.
    fn parts(&self, particle: &Particle) -> Vec<Particle> {
        let parts = || {
            self.limit.as_ref()?;
            spheres(self.renderer.settings(), self.renderer.spheroid_law()?, particle)
        };
        parts().unwrap_or_else(|| vec![*particle])
    }

    /// Whether the limit of infinitely many rays can be rendered.
    fn by_limit(&self, part: &Particle) -> bool {
        self.limit.as_ref().is_none_or(|limit| limit.check(part).is_ok())
    }

    /// The renderer of a part, and the factor on its light.
    fn source(&self, part: &Particle) -> (&Renderer, f64) {
        match &self.limit {
            Some(limit) if self.by_limit(part) => (limit, self.factor),
            _ => (&self.renderer, 1.0),
        }
    }

    fn draw_part(&self, part: &Particle) -> Patch {
        let (renderer, factor) = self.source(part);
        let Some(patch) = renderer.mean_patch(part) else { return Patch::default() };
        let (window, mut values) = (patch.window, patch.counts);
        if factor != 1.0 {
            values.iter_mut().for_each(|light| *light *= factor);
        }
        // Pixels are counted from 0 here, from 1 in MicroSIG.
        Patch { corner: ((window.x0 - 1) as usize, (window.y0 - 1) as usize), width: window.width, values }
    }

    /// The image of several particles that belong together, such as the points of a streak.
    pub fn draw_all(&self, particles: &[Particle]) -> Patch {
        particles.iter().fold(Patch::default(), |whole, particle| whole.joined(self.draw(particle)))
    }

    /// The pixels on which [`NoiseFree::draw_all`] draws; an image of rays is larger in exceptional cases.
    pub fn window(&self, particles: &[Particle]) -> Window {
        let parts = particles.iter().flat_map(|particle| self.parts(particle));
        let windows = parts.map(|part| self.source(&part).0.patch_window(&part));
        windows.fold(Window::default(), Window::joined)
    }
}

impl Patch {
    /// The smallest patch that contains both, with the sum of their light.
    pub fn joined(self, other: Patch) -> Patch {
        if other.values.is_empty() {
            return self;
        }
        if self.values.is_empty() {
            return other;
        }
        let end = |p: &Patch| (p.corner.0 + p.width, p.corner.1 + p.values.len() / p.width);
        let corner = (self.corner.0.min(other.corner.0), self.corner.1.min(other.corner.1));
        let (a, b) = (end(&self), end(&other));
        let width = a.0.max(b.0) - corner.0;
        let mut values = vec![0.0; width * (a.1.max(b.1) - corner.1)];
        for part in [&self, &other] {
            let first = (part.corner.1 - corner.1) * width + part.corner.0 - corner.0;
            for (row, light) in part.values.chunks(part.width).enumerate() {
                let line = &mut values[first + row * width..][..light.len()];
                line.iter_mut().zip(light).for_each(|(sum, l)| *sum += l);
            }
        }
        Patch { corner, width, values }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Spheroid;
    use crate::emission::SpheroidLaw;
    use crate::render::waves::WaveOptics;
    use crate::render::{Context, GaussianSpot, RayRenderer, RenderMethod, RendererSpec};
    use crate::stream::{Purpose, Streams};

    const RAYS: RenderMethod = RenderMethod::Rays { spheroids: SpheroidLaw::Original };

    fn settings() -> Settings {
        Settings { pixel_dim_x: 160, pixel_dim_y: 140, ..Settings::setting1a() }
    }

    fn noise_free(spec: impl Into<RendererSpec>, settings: &Settings) -> NoiseFree {
        let spec = spec.into();
        let renderer = spec.clone().build(settings, &Context::default()).unwrap();
        let limit = renderer
            .has_ray_noise()
            .then(|| spec.without_ray_noise(TOLERANCE).build(settings, &Context::default()).unwrap());
        NoiseFree::new(renderer, limit)
    }

    fn peak(values: &[f64]) -> f64 {
        values.iter().copied().fold(0.0, f64::max)
    }

    /// Particles at sub-pixel positions, from one side of focus to the other, some at the edges of the
    /// sensor.
    fn particles() -> Vec<Particle> {
        (0..12)
            .map(|k| {
                let k = f64::from(k);
                let (x_px, y_px) = (80.0 + 83.0 * libm::sin(1.7 * k), 70.0 + 30.0 * libm::cos(2.9 * k));
                Particle { c_int: 1.0 + 0.1 * k, ..Particle::sphere(x_px, y_px, -45.3 + 5.37 * k, 2.0) }
            })
            .collect()
    }

    #[test]
    fn images_are_those_of_the_datasets_renderer() {
        let waves = RenderMethod::Waves { optics: WaveOptics::new(0.52), tolerance: 0.003 };
        let expected = RendererSpec::from(RAYS).without_ray_noise(0.003);
        let spot = |reference_um| GaussianSpot { diameter_px: 1.5, reference_um, peak_counts: 800.0 };
        let gaussian = [RenderMethod::Gaussian(spot(None)), RenderMethod::Gaussian(spot(Some(0.3)))];
        for spec in gaussian.into_iter().chain([waves]).map(RendererSpec::from).chain([expected]) {
            let settings = settings();
            let (single, renderer) =
                (noise_free(spec.clone(), &settings), spec.build(&settings, &Context::default()).unwrap());
            for particle in particles() {
                let light = renderer.light(&[particle], &Streams::new(0), Purpose::Rays, 0).values;
                let patch = single.draw(&particle);
                assert_eq!(single.window(&[particle]).area(), patch.values.len(), "{particle:?}");
                let mut drawn = vec![0.0; light.len()];
                for (row, values) in patch.values.chunks(patch.width.max(1)).enumerate() {
                    let first = (patch.corner.1 + row) * settings.pixel_dim_x as usize + patch.corner.0;
                    drawn[first..][..values.len()].copy_from_slice(values);
                }
                let most = light.iter().zip(&drawn).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                let name = renderer.name();
                assert!(most < 2e-5 * peak(&light).max(1.0), "{name} {particle:?}: {most}");
            }
        }
    }

    /// The bound of 1 % holds for the peak at any sub-pixel position and depth.
    #[test]
    fn peaks_of_ray_images_are_right_to_one_percent() {
        let settings = settings();
        let single = noise_free(RAYS, &settings);
        let accurate =
            RendererSpec::from(RAYS).without_ray_noise(1e-3).build(&settings, &Context::default()).unwrap();
        for particle in particles().into_iter().skip(1) {
            let exact = accurate.mean_patch(&particle).map_or(0.0, |patch| peak(&patch.counts));
            let found = peak(&single.draw(&particle).values);
            assert!((found - exact).abs() < 0.01 * exact, "{particle:?}: {found} {exact}");
        }
    }

    /// In focus, where a pixel-centered image of 2.5 px would be too bright by 20 % on average.
    #[test]
    fn ray_images_have_this_mean_even_with_few_rays() {
        let settings = Settings { numerical_aperture: 0.13, n_rays: 59, ..settings() };
        let rays = RayRenderer::new(&settings, SpheroidLaw::Original).unwrap();
        let single = noise_free(RAYS, &settings);
        let particle = Particle::sphere(80.42, 70.31, -4.3, 2.0);
        let mut scratch = Default::default();
        let mut image =
            |frame| rays.patch(&particle, &Streams::new(3), Purpose::Rays, frame, 0, &mut scratch);
        const IMAGES: u32 = 400;
        let total: u64 = (0..IMAGES).map(|frame| image(frame).unwrap().total()).sum();
        let mean = total as f64 / f64::from(IMAGES);
        let found: f64 = single.draw(&particle).values.iter().sum();
        assert!((found / mean - 1.0).abs() < 0.003, "{found} {mean}");
    }

    /// 32 ray images have a noise of 2 to 3 % in the peak.
    #[test]
    fn without_a_limit_ray_images_are_averaged() {
        let settings = settings();
        let (averaged, exact) = (
            NoiseFree::new(RendererSpec::from(RAYS).build(&settings, &Context::default()).unwrap(), None),
            noise_free(RAYS, &settings),
        );
        let particle = Particle::sphere(80.42, 70.31, -20.0, 2.0);
        let [a, b] = [averaged, exact].map(|of| of.draw(&particle).values);
        let sum = |values: &[f64]| values.iter().sum::<f64>();
        assert!((sum(&a) / sum(&b) - 1.0).abs() < 0.005 && (peak(&a) / peak(&b) - 1.0).abs() < 0.08);
    }

    /// Rods and discs, lying to standing and on both sides of focus, with and without a cylindrical lens.
    /// Without ray noise, the dataset's own renderer makes the image; a sum of small spheres would be
    /// off by up to 9 %.
    #[test]
    fn spheroids_have_images_of_their_own() {
        let shapes =
            [(3.0, 3.0, 0.7, 0.5), (2.0, 6.0, 0.1, 1.4), (4.0, 0.25, 1.3, 0.2), (3.0, 2.0, -0.8, 2.6)];
        let round = Settings { pixel_dim_x: 160, pixel_dim_y: 140, ..Settings::setting1() };
        let sum = |values: &[f64]| values.iter().sum::<f64>();
        for settings in [settings(), round] {
            let dataset = RendererSpec::from(RAYS)
                .without_ray_noise(3e-3)
                .build(&settings, &Context::default())
                .unwrap();
            let own = noise_free(RendererSpec::from(RAYS).without_ray_noise(3e-3), &settings);
            let by_rays = noise_free(RAYS, &settings);
            for (d_um, e_p, alpha_rad, beta_rad) in shapes {
                for z_um in [-60.0, -25.0, -8.0, 5.0, 30.0] {
                    let spheroid = Some(Spheroid { e_p, alpha_rad, beta_rad });
                    let particle = Particle { spheroid, ..Particle::sphere(80.3, 70.2, z_um, d_um) };
                    let image = dataset.light(&[particle], &Streams::new(0), Purpose::Rays, 0).values;
                    for (single, most, light) in [(&own, 0.01, 1e-4), (&by_rays, 0.1, 0.004)] {
                        let found = single.draw(&particle).values;
                        let off = peak(&found) / (single.factor * peak(&image)) - 1.0;
                        let total = sum(&found) / (single.factor * sum(&image)) - 1.0;
                        let what = format!("d {d_um}, e_p {e_p}, axis {alpha_rad} {beta_rad}, z {z_um}");
                        assert!(off.abs() < most && total.abs() < light, "{what}: {off} {total}");
                    }
                }
            }
        }
    }
}
