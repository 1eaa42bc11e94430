//! Images by counting rays, the paper's method.
//!
//! Every particle gives a patch of whole counts that depends on nothing but its own row (values, seed, frame, row
//! number); patches times c_int are added per pixel in the order of rows. So images do not depend on threads.

use rayon::prelude::*;

use super::fan::Fan;
use super::instructions::InstructionSet;
use super::kernel::{self, Lens, Run, Volley};
use super::patch::{Patch, Window};
use super::sources::Sources;
use super::tally::Tally;
use crate::emission::{self, GoldenAzimuths, Point, SpheroidLaw};
use crate::error::Error;
use crate::optics::{OpticalSystem, Ray};
use crate::particle::{Particle, Spheroid};
use crate::sensor::Light;
use crate::settings::Settings;
use crate::stream::{Purpose, Stream, Streams};

/// Pixels of patches held at a time while an image is added up: 64 MB.
const PATCH_PIXELS: usize = 1 << 24;

/// Particles traced before their patches are added.
const PATCHES: usize = 1024;

/// Rows of pixels to which patches are added at a time.
const BAND: usize = 64;

/// Draws particles by counting rays.
#[derive(Debug, Clone)]
pub struct RayRenderer {
    settings: Settings,
    system: OpticalSystem,
    law: SpheroidLaw,
    fan: Fan,
    lens: Lens,
    instructions: InstructionSet,
}

/// Working memory of one thread and one renderer.
#[derive(Debug, Default)]
pub struct Scratch {
    azimuths: GoldenAzimuths,
    /// Diameter and form to which the points of `sources` belong.
    shape: Option<(f64, Option<Spheroid>)>,
    points: Vec<Point>,
    phases: Vec<u32>,
    sources: Sources,
    runs: Vec<Run>,
    volleys: Vec<Volley>,
    tally: Tally,
}

impl RayRenderer {
    /// A renderer for these settings.
    ///
    /// # Errors
    /// [`Error::Malformed`] if a setting is out of range.
    pub fn new(settings: &Settings, law: SpheroidLaw) -> Result<Self, Error> {
        settings.validate()?;
        let system = OpticalSystem::new(settings);
        Ok(RayRenderer {
            system,
            law,
            fan: Fan::new(settings.n_rays),
            lens: Lens::new(&system, settings.pixel_size),
            instructions: InstructionSet::best(),
            settings: settings.clone(),
        })
    }

    /// The same renderer with its kernel on another instruction set.
    pub fn with_instruction_set(self, instructions: InstructionSet) -> Self {
        RayRenderer { instructions, ..self }
    }

    /// The settings.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Which points of a spheroid shine.
    pub(super) fn law(&self) -> SpheroidLaw {
        self.law
    }

    /// Whether this particle can be drawn, and what should be known about its image if so.
    ///
    /// # Errors
    /// [`Error::Unsupported`] if points_per_pixel gives it no source point or more than [`emission::MAX_POINTS`], or
    /// if it reaches behind the lens.
    pub fn check(&self, particle: &Particle) -> Result<Option<String>, Error> {
        let n = emission::surface_points(&self.settings, particle);
        let (d, ppp) = (particle.d_um, self.settings.points_per_pixel);
        if n == 0 {
            return Err(Error::Unsupported(format!(
                "d_p = {d} um is too small for points_per_pixel = {ppp}: it gets no source point"
            )));
        }
        if n > emission::MAX_POINTS {
            return Err(Error::Unsupported(format!(
                "d_p = {d} um with points_per_pixel = {ppp} asks for {n} source points; at most {} are possible",
                emission::MAX_POINTS
            )));
        }
        let nearest = self.system.objective.object_distance(particle.z_um) - greatest_radius(particle);
        if nearest <= 0.0 {
            return Err(Error::Unsupported(format!(
                "z = {} um reaches the lens, which is at z = {} um",
                particle.z_um, -self.system.objective.object_distance_0
            )));
        }
        Ok((n < 20).then(|| format!("d_p = {d} um has only {n} source points: its image is coarse")))
    }

    /// What should be known about all images of these settings.
    pub fn warning(&self) -> Option<String> {
        let n_rays = self.settings.n_rays;
        (n_rays < 50).then(|| {
            format!(
                "n_rays = {n_rays} is so few that total light is off (+5 % at 20, +15 % at 10, black at 2)"
            )
        })
    }

    /// The ray counts of one particle, whose random angles come from the streams of `purpose`. `None`: none of its
    /// light can fall on the sensor.
    pub fn patch(
        &self,
        particle: &Particle,
        streams: &Streams,
        purpose: Purpose,
        frame: u32,
        row: u32,
        scratch: &mut Scratch,
    ) -> Option<Patch> {
        let mut stream = streams.stream(purpose, frame, row);
        self.patch_in(self.window(particle), particle, &mut stream, scratch)
    }

    fn patch_in(
        &self,
        window: Window,
        particle: &Particle,
        angles: &mut Stream,
        scratch: &mut Scratch,
    ) -> Option<Patch> {
        if window.area() == 0 {
            return None;
        }
        self.shine(particle, scratch);
        scratch.phases.resize(scratch.points.len(), 0);
        angles.fill(&mut scratch.phases);
        Some(self.trace(particle, window, scratch).0)
    }

    /// The ray counts of one particle with given angles of its source points, rad; angles that are missing are zero.
    /// Also the number of rays that were traced for it.
    pub fn patch_with_angles(
        &self,
        particle: &Particle,
        angles: &[f64],
        scratch: &mut Scratch,
    ) -> (Patch, u64) {
        self.shine(particle, scratch);
        let per_radian = 4_294_967_296.0 / (2.0 * std::f64::consts::PI);
        scratch.phases.clear();
        scratch.phases.extend(angles.iter().map(|a| libm::rint(a * per_radian) as i64 as u32));
        scratch.phases.resize(scratch.points.len(), 0);
        self.trace(particle, self.window(particle), scratch)
    }

    /// Adds up the light of all particles of one image.
    pub fn light(&self, particles: &[Particle], streams: &Streams, purpose: Purpose, frame: u32) -> Light {
        let mut light = Light::dark(&self.settings);
        let width = light.width as usize;
        let windows: Vec<Window> = particles.par_iter().map(|p| self.window(p)).collect();
        let mut first = 0;
        while first < particles.len() {
            let last = first + fitting(&windows[first..]);
            let (chunk, windows) = (&particles[first..last], &windows[first..last]);
            let patches: Vec<(&Particle, Patch)> = chunk
                .par_iter()
                .zip(windows)
                .enumerate()
                .map_init(Scratch::default, |scratch, (i, (particle, &window))| {
                    let mut angles = streams.stream(purpose, frame, (first + i) as u32);
                    self.patch_in(window, particle, &mut angles, scratch).map(|patch| (particle, patch))
                })
                .flatten()
                .collect();
            // Bands of pixels, not particles, are dealt out to threads: each pixel sees the particles in order.
            light.values.par_chunks_mut(BAND * width).enumerate().for_each(|(band, pixels)| {
                for (particle, patch) in &patches {
                    patch.add(band * BAND, particle.c_int, pixels, width);
                }
            });
            first = last;
        }
        light
    }

    /// Where on the sensor a particle's light is expected.
    fn window(&self, particle: &Particle) -> Window {
        Window::around(
            particle.x_px,
            particle.y_px,
            self.image_extent(particle),
            (self.settings.pixel_dim_x, self.settings.pixel_dim_y),
        )
    }

    /// Whether some of a particle's light may fall on the sensor.
    pub fn reaches_sensor(&self, particle: &Particle) -> bool {
        // Every window holds the pixel of its centre.
        let on = |x: f64, size: u32| x >= 0.5 && x < f64::from(size) + 0.5;
        let centre =
            on(particle.x_px, self.settings.pixel_dim_x) && on(particle.y_px, self.settings.pixel_dim_y);
        centre || self.window(particle).area() > 0
    }

    /// Half width and half height of a particle's image, px, with some margin.
    pub fn image_extent(&self, particle: &Particle) -> (f64, f64) {
        let radius = greatest_radius(particle);
        let centre = self.system.image_extent(particle.z_um);
        // The near end of the particle has the larger image of those beyond focus, the far end of the others.
        let near = self.system.image_extent(particle.z_um - radius);
        let far = self.system.image_extent(particle.z_um + radius);
        let side = |blur: f64| {
            (1.1 * blur + 1.5 * radius * self.settings.magnification) / self.settings.pixel_size + 2.0
        };
        (side(centre.0.max(near.0).max(far.0)), side(centre.1.max(near.1).max(far.1)))
    }

    /// Radius in the lens plane beyond which no ray of this particle lands on the sensor, um; at most the aperture's.
    ///
    /// With a high NA, rays near the rim land far beyond a small sensor (or are lost to total reflection). Only rays from
    /// the particle's centre are followed; what its surface adds is bounded with room to spare. The landing place of
    /// astigmatic rays depends on more than their radius: with a cylinder the whole aperture is used.
    fn useful_aperture(&self, particle: &Particle) -> f64 {
        const STEPS: u32 = 64;
        let objective = &self.system.objective;
        let aperture = objective.aperture_radius;
        if self.system.cylinder.is_some() {
            return aperture;
        }
        let side = |x: f64, size: u32| (x - 0.5).abs().max((f64::from(size) + 0.5 - x).abs());
        let (x, y) =
            (side(particle.x_px, self.settings.pixel_dim_x), side(particle.y_px, self.settings.pixel_dim_y));
        let farthest_corner_um = libm::sqrt(x * x + y * y) * self.settings.pixel_size;
        let radius = greatest_radius(particle);
        let surface = 2.0 * radius * self.settings.magnification + self.settings.pixel_size;
        let distance = objective.object_distance(particle.z_um);
        // A point nearer to the lens or farther away lands elsewhere: both ends of the particle must miss.
        let misses = |q: f64| {
            [distance - radius, distance, distance + radius].into_iter().all(|distance| {
                let ray = Ray { q_x: 0.0, q_y: 0.0, p_x: q / distance, p_y: 0.0 };
                self.system.trace(ray, distance).is_none_or(|(x, _)| x.abs() - surface > farthest_corner_um)
            })
        };
        let step = aperture / f64::from(STEPS);
        let missing = (0..STEPS).take_while(|&i| misses(aperture - f64::from(i) * step)).count();
        // One step back, because only the grid was tested, and one more for good measure.
        (aperture - step * (missing as f64 - 2.0)).min(aperture)
    }

    /// Puts the particle's shining points into `scratch`; those of the particle before serve again if it had the same shape.
    fn shine(&self, particle: &Particle, scratch: &mut Scratch) {
        let shape = Some((particle.d_um, particle.spheroid));
        if scratch.shape != shape {
            let n = emission::surface_points(&self.settings, particle);
            emission::shining_points(particle, n, self.law, &mut scratch.azimuths, &mut scratch.points);
            scratch.sources.set_points(&scratch.points, 1.0 / self.lens.unit_um);
            scratch.shape = shape;
        }
    }

    /// Traces the points and phases in `scratch`, also giving the number of rays; a window that proves too small is
    /// widened and the rays are traced again.
    fn trace(&self, particle: &Particle, window: Window, scratch: &mut Scratch) -> (Patch, u64) {
        let Scratch { phases, sources, runs, volleys, tally, .. } = scratch;
        let radius = greatest_radius(particle);
        let distance = self.system.objective.object_distance(particle.z_um);
        sources.place(self.instructions, phases, (distance / self.lens.unit_um) as f32);
        let max_slope = (self.useful_aperture(particle) + radius) / (distance - radius);
        runs.clear();
        for candidate in self.fan.candidates(max_slope) {
            let facing = sources.runs(&candidate).into_iter().filter(|run| !run.is_empty());
            runs.extend(facing.map(|sources| self.lens.run(candidate.direction, sources)));
        }
        let traced = runs.iter().map(|run| run.rays() as u64).sum();

        let sensor = (self.settings.pixel_dim_x, self.settings.pixel_dim_y);
        let mut window = window;
        loop {
            tally.begin(window, particle.x_px, particle.y_px);
            kernel::trace(self.instructions, &self.lens, sources, runs, volleys, tally);
            if !tally.overflows(sensor) {
                return (tally.patch(), traced);
            }
            let reach = (window.width.max(window.height) * 2) as f64;
            window = Window::around(particle.x_px, particle.y_px, (reach, reach), sensor);
        }
    }
}

/// How many of the first windows fit the memory set aside for patches, at least one.
fn fitting(windows: &[Window]) -> usize {
    let mut pixels = 0;
    let fits = |window: &&Window| {
        pixels += window.area();
        pixels <= PATCH_PIXELS
    };
    windows.iter().take(PATCHES).take_while(fits).count().max(1)
}

/// The farthest a point of the surface can lie from the centre, um.
fn greatest_radius(particle: &Particle) -> f64 {
    particle.d_um / 2.0 * particle.spheroid.map_or(1.0, |s| s.e_p.max(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The narrowed aperture changes no count: with it off, on a sensor of the same size, every patch is the same.
    #[test]
    fn rays_that_are_left_out_would_have_missed() {
        let mut narrowed = 0;
        for (settings, z) in
            [(Settings::setting2(), [-40.0, -10.0, 5.0]), (Settings::setting1(), [-80.0, -20.0, 40.0])]
        {
            let settings = Settings { pixel_dim_x: 61, pixel_dim_y: 41, points_per_pixel: 3.0, ..settings };
            let renderer = RayRenderer::new(&settings, SpheroidLaw::Original).unwrap();
            let mut scratch = Scratch::default();
            for z_um in z {
                for (x, y) in [(31.0, 21.0), (1.3, 40.2), (-20.0, 20.0)] {
                    let particle = Particle::sphere(x, y, z_um, 2.0);
                    let window = Window::around(x, y, (1e3, 1e3), (61, 41));
                    renderer.shine(&particle, &mut scratch);
                    scratch.phases.clear();
                    scratch
                        .phases
                        .extend((0..scratch.points.len() as u32).map(|k| k.wrapping_mul(0x9E37_79B9)));
                    let (patch, rays) = renderer.trace(&particle, window, &mut scratch);
                    // The whole aperture, by way of a sensor so large that nothing can miss it.
                    let wide = Settings { pixel_dim_x: 30_000, pixel_dim_y: 30_000, ..settings.clone() };
                    let whole = RayRenderer::new(&wide, SpheroidLaw::Original).unwrap();
                    let (all, all_rays) = whole.trace(&particle, window, &mut scratch);
                    let inside = |x: i64, y: i64| {
                        let (column, row) = (x - all.window.x0, y - all.window.y0);
                        let on = column >= 0
                            && row >= 0
                            && column < all.window.width as i64
                            && row < all.window.height as i64;
                        if on { all.counts[row as usize * all.window.width + column as usize] } else { 0 }
                    };
                    for (i, &count) in patch.counts.iter().enumerate() {
                        let x = patch.window.x0 + (i % patch.window.width) as i64;
                        let y = patch.window.y0 + (i / patch.window.width) as i64;
                        assert_eq!(
                            count,
                            inside(x, y),
                            "z {z_um}, particle at {:?}, pixel {x}, {y}",
                            (particle.x_px, particle.y_px)
                        );
                    }
                    narrowed += u32::from(rays < all_rays);
                }
            }
        }
        assert!(narrowed >= 6, "only {narrowed} cases were narrowed at all");
    }
}
