//! Images by ray counting, the paper's method.
//!
//! Every particle gives a patch of integer counts that depends only on its own row of the data file (values
//! and row number), the seed and the frame; at each pixel, patches times c_int are summed in the order of
//! rows. Images therefore do not depend on the number of threads.

mod fan;
mod kernel;
mod mean;
mod ray_counter;
mod sources;

use rayon::prelude::*;

use crate::cancel::checkpoint;
use crate::emission::{self, GoldenAzimuths, Point, SpheroidLaw};
use crate::error::{Error, shown};
use crate::optics::{self, OpticalSystem, Ray};
use crate::particle::{Particle, Spheroid};
use crate::render::instructions::InstructionSet;
use crate::render::interface::{Description, ImageStreams, Render, Traits};
use crate::render::patch::{ExpectedPatch, Patch, Window};
use crate::sensor::{Image, Light, Sensor};
use crate::settings::Settings;
use crate::stream::{Purpose, Stream, Streams};
use fan::RayFan;
use kernel::{RayPacket, SourceRun, ThinLens};
use ray_counter::RayCounter;
use sources::Sources;

/// Maximum number of pixels of all patches held in memory together: 64 MB.
const PATCH_PIXELS: usize = 1 << 24;

/// Maximum number of particles traced before their patches are added.
const PATCHES: usize = 1024;

/// Number of pixels of an image that are exposed at a time: 128 MB of light.
const PART_PIXELS: usize = 1 << 24;

/// Rows per band of pixels in parallel summation.
const BAND: usize = 64;

/// Number of rays per source point below which images show the pattern of the fan.
const FEW_RAYS: u32 = 100;

/// Relative excess of light (`emission::aperture_excess`) above which a warning is given.
pub(super) const LARGEST_EXCESS: f64 = 0.01;

/// Renders particles by ray counting.
#[derive(Debug, Clone)]
pub struct RayRenderer {
    settings: Settings,
    system: OpticalSystem,
    law: SpheroidLaw,
    fan: RayFan,
    lens: ThinLens,
    instructions: InstructionSet,
}

/// Working memory of one thread and one renderer.
#[derive(Debug, Default)]
pub struct Scratch {
    azimuths: GoldenAzimuths,
    /// Diameter and shape of the particle whose points are in `sources`.
    shape: Option<(f64, Option<Spheroid>)>,
    points: Vec<Point>,
    phases: Vec<u32>,
    sources: Sources,
    runs: Vec<SourceRun>,
    packets: Vec<RayPacket>,
    counter: RayCounter,
}

impl RayRenderer {
    /// A renderer for these settings.
    pub fn new(settings: &Settings, law: SpheroidLaw) -> Result<Self, Error> {
        settings.validate()?;
        let system = OpticalSystem::new(settings);
        Ok(RayRenderer {
            system,
            law,
            fan: RayFan::new(settings.n_rays),
            lens: ThinLens::new(&system, settings.pixel_size),
            instructions: InstructionSet::best(),
            settings: settings.clone(),
        })
    }

    /// The same renderer using the given instruction set; its counts are identical.
    pub fn with_instruction_set(self, instructions: InstructionSet) -> Self {
        RayRenderer { instructions, ..self }
    }

    /// The ray counts of one particle, whose random angles come from the streams of `purpose`. `None`: its
    /// light cannot reach the sensor.
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

    /// The ray counts of one particle with given rotation angles of the fans of its source points (rad;
    /// missing angles are zero), and the number of rays traced.
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

    /// Whether a particle is in front of the lens.
    pub(super) fn check_depth(&self, particle: &Particle) -> Result<(), Error> {
        if self.system.objective.object_distance(particle.z_um) > greatest_radius(particle) {
            return Ok(());
        }
        Err(Error::Unsupported(format!(
            "z = {} um reaches the lens, which is at z = {} um",
            shown(particle.z_um),
            -libm::rint(1e6 * self.system.objective.object_distance_0) / 1e6
        )))
    }

    /// The part of the sensor on which the light of a particle is expected.
    fn window(&self, particle: &Particle) -> Window {
        Window::around(
            particle.x_px,
            particle.y_px,
            self.image_extent(particle),
            (self.settings.pixel_dim_x, self.settings.pixel_dim_y),
        )
    }

    /// Radius in the lens plane beyond which no ray of this particle lands on the sensor, um; at most the
    /// aperture's.
    ///
    /// With a high NA, rays near the rim land far outside a small sensor (or are totally reflected). Only
    /// rays from the particle center are traced; the contribution of its surface is bounded conservatively.
    /// With a cylinder, where the landing position depends on more than the radius, the whole aperture is
    /// used.
    fn useful_aperture(&self, particle: &Particle) -> f64 {
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
        // Rays from points at other depths land elsewhere: both ends of the particle must miss too.
        let misses = |q: f64| {
            [distance - radius, distance, distance + radius].into_iter().all(|distance| {
                let ray = Ray { q_x: 0.0, q_y: 0.0, p_x: q / distance, p_y: 0.0 };
                self.system.trace(ray, distance).is_none_or(|(x, _)| x.abs() - surface > farthest_corner_um)
            })
        };
        // One step because only grid radii are tested, and one more as a margin.
        optics::useful_radius(aperture, 64, 2, misses)
    }

    /// Puts the source points of a particle into `scratch`; the previous particle's are reused if it
    /// has the same shape.
    fn shine(&self, particle: &Particle, scratch: &mut Scratch) {
        let shape = Some((particle.d_um, particle.spheroid));
        if scratch.shape != shape {
            let n = emission::surface_points(&self.settings, particle);
            emission::shining_points(particle, n, self.law, &mut scratch.azimuths, &mut scratch.points);
            scratch.sources.set_points(&scratch.points, 1.0 / self.lens.unit_um);
            scratch.shape = shape;
        }
    }

    /// Traces the rays of the points and phases in `scratch`, and returns the patch and the number of rays;
    /// if the window proves too small, it is enlarged and the rays are traced again.
    fn trace(&self, particle: &Particle, window: Window, scratch: &mut Scratch) -> (Patch, u64) {
        let Scratch { phases, sources, runs, packets, counter, .. } = scratch;
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
            counter.begin(window, particle.x_px, particle.y_px);
            kernel::trace(self.instructions, &self.lens, sources, runs, packets, counter);
            if !counter.overflows(sensor) {
                return (counter.patch(), traced);
            }
            let reach = (window.width.max(window.height) * 2) as f64;
            window = Window::around(particle.x_px, particle.y_px, (reach, reach), sensor);
        }
    }
}

impl Render for RayRenderer {
    fn traits(&self) -> Traits {
        Traits {
            name: "rays",
            depends_on_depth: true,
            has_ray_noise: true,
            is_diffracted: false,
            is_round: self.system.cylinder.is_none(),
            spheroid_law: Some(self.law),
        }
    }

    fn description(&self) -> Description {
        Description {
            optics: lens_phrase(&self.settings, cylinder_phrase(&self.settings)),
            method: "traces rays from points on each particle through the lens (model: M. Rossi, Meas. Sci. Technol. 31, \
                     017003, 2020)",
        }
    }

    fn mean_light(&self, particle: &Particle) -> Light {
        mean::mean_light(self, particle)
    }

    fn mean_patch(&self, particle: &Particle) -> Option<ExpectedPatch> {
        mean::mean_patch(self, particle)
    }

    fn settings(&self) -> &Settings {
        &self.settings
    }

    fn check(&self, particle: &Particle) -> Result<Option<String>, Error> {
        let n = emission::surface_points(&self.settings, particle);
        let (d, ppp) = (shown(particle.d_um), shown(self.settings.points_per_pixel));
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
        self.check_depth(particle)?;
        Ok((n < 20).then(|| format!("d_p = {d} um has only {n} source points: its image is coarse")))
    }

    fn warning(&self) -> Option<String> {
        let Settings { n_rays, numerical_aperture, .. } = self.settings;
        let excess = emission::aperture_excess(n_rays, numerical_aperture);
        let light = (excess.abs() > LARGEST_EXCESS)
            .then(|| format!("total light is off by {:+.1} %, and ", 100.0 * excess));
        (n_rays < FEW_RAYS || light.is_some()).then(|| {
            format!(
                "n_rays = {n_rays} is so few for NA {numerical_aperture} that {}images show the fixed directions of the rays; use \
                 {}",
                light.unwrap_or_default(),
                if n_rays < FEW_RAYS { format!("{FEW_RAYS} or more") } else { "more".to_owned() }
            )
        })
    }

    fn image_extent(&self, particle: &Particle) -> (f64, f64) {
        let radius = greatest_radius(particle);
        let center = self.system.image_extent(particle.z_um);
        // The end of the particle nearest to the lens has the larger image for particles beyond focus, the
        // far end for the others.
        let near = self.system.image_extent(particle.z_um - radius);
        let far = self.system.image_extent(particle.z_um + radius);
        let side = |blur: f64| {
            (1.1 * blur + 1.5 * radius * self.settings.magnification) / self.settings.pixel_size + 2.0
        };
        (side(center.0.max(near.0).max(far.0)), side(center.1.max(near.1).max(far.1)))
    }

    fn patch_window(&self, particle: &Particle) -> Window {
        self.window(particle)
    }

    fn reaches_sensor(&self, particle: &Particle) -> bool {
        // Every window contains the pixel of its center.
        self.settings.is_on_sensor(particle.x_px, particle.y_px) || self.window(particle).area() > 0
    }

    /// Of spheres.
    fn accepted_light(&self, particle: &Particle) -> Option<f64> {
        if particle.elongated().is_some() {
            return None;
        }
        let Settings { numerical_aperture: na, focal_length, magnification, .. } = self.settings;
        let distance = focal_length * (1.0 + 1.0 / magnification);
        // The source points of a sphere, on the half that faces the lens, are nearer by half its radius.
        let to_points = distance + particle.z_um - 0.25 * particle.d_um;
        let tangent = na / (1.0 - na * na).sqrt() * distance / to_points;
        let share = 1.0 - 1.0 / (1.0 + tangent * tangent).sqrt();
        Some(emission::emitted_rays(&self.settings, particle) * share)
    }

    fn light(&self, particles: &[Particle], streams: &Streams, purpose: Purpose, frame: u32) -> Light {
        let mut light = Light::dark(&self.settings);
        let angles = |row: usize| streams.stream(purpose, frame, row as u32);
        self.add(particles, angles, 0, &mut light.values);
        light
    }

    /// A large image is exposed in parts, so that the light is never stored as a whole.
    fn image(&self, particles: &[Particle], sensor: &Sensor, random: ImageStreams<'_>) -> Image {
        let ImageStreams { streams, rays, noise, frame } = random;
        let (width, height) = (self.settings.pixel_dim_x, self.settings.pixel_dim_y);
        let rows = (PART_PIXELS / width as usize).clamp(1, height as usize);
        let angles = |row: usize| streams.stream(rays, frame, row as u32);
        let mut is_complete = true;
        let image = sensor.expose_parts((width, height), rows, streams, noise, frame, |rows| {
            let mut light = vec![0.0; rows.len() * width as usize];
            is_complete &= self.add(particles, angles, rows.start, &mut light);
            light
        });
        if is_complete || rows == height as usize {
            return image;
        }
        drop(image);
        sensor.expose(&self.light(particles, streams, rays, frame), streams, noise, frame)
    }
}

impl RayRenderer {
    /// Adds the light of all particles on rows from `first_row` (from 0) on. Returns whether all images of
    /// particles are within their windows: light that falls on these rows from outside is missing otherwise.
    fn add(
        &self,
        particles: &[Particle],
        angles: impl Fn(usize) -> Stream + Sync,
        first_row: usize,
        light: &mut [f64],
    ) -> bool {
        let width = self.settings.pixel_dim_x as usize;
        let end_row = first_row + light.len() / width;
        let windows = particles.par_iter().enumerate().map(|(row, particle)| (row, self.window(particle)));
        let reaching = windows.filter(|(_, window)| {
            window.area() > 0 && window.rows().start < end_row && window.rows().end > first_row
        });
        let windows: Vec<(usize, Window)> = reaching.collect();
        let (mut rest, mut are_within) = (windows.as_slice(), true);
        while !rest.is_empty() {
            let (chunk, after) = rest.split_at(fitting(rest));
            rest = after;
            let traced = chunk.par_iter().map_init(Scratch::default, |scratch, &(row, window)| {
                checkpoint();
                self.patch_in(window, &particles[row], &mut angles(row), scratch)
            });
            let patches: Vec<Option<Patch>> = traced.collect();
            let patches = || chunk.iter().zip(&patches).filter_map(|(of, patch)| Some((of, patch.as_ref()?)));
            are_within &= patches().all(|((_, window), patch)| window.joined(patch.window) == *window);
            // Bands of pixels, not particles, are distributed to threads: at each pixel, particles are summed
            // in order.
            light.par_chunks_mut(BAND * width).enumerate().for_each(|(band, pixels)| {
                for ((row, _), patch) in patches() {
                    patch.add(first_row + band * BAND, particles[*row].c_int, pixels, width);
                }
            });
        }
        are_within
    }
}

/// MicroSIG's cylindrical lens as text.
pub(super) fn cylinder_phrase(settings: &Settings) -> String {
    match settings.cyl_focal_length {
        0.0 => "no cylindrical lens".to_owned(),
        // One that is converted from focal planes has many digits.
        f => format!("a cylindrical lens of {} um", libm::rint(10.0 * f) / 10.0),
    }
}

/// Magnification, aperture and cylindrical lens as text.
pub(super) fn lens_phrase(settings: &Settings, cylinder: String) -> String {
    format!("M {}, NA {}, {cylinder}", settings.magnification, settings.numerical_aperture)
}

/// Number of leading windows whose patches fit the memory limit, at least one.
fn fitting(windows: &[(usize, Window)]) -> usize {
    let mut pixels = 0;
    let fits = |(_, window): &&(usize, Window)| {
        pixels += window.area();
        pixels <= PATCH_PIXELS
    };
    windows.iter().take(PATCHES).take_while(fits).count().max(1)
}

/// Largest distance of a surface point from the particle center, um.
fn greatest_radius(particle: &Particle) -> f64 {
    particle.d_um / 2.0 * particle.spheroid.map_or(1.0, |s| s.e_p.max(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_an_image_have_its_light() {
        let settings = Settings { pixel_dim_x: 70, pixel_dim_y: 90, ..Settings::setting1() };
        let renderer = RayRenderer::new(&settings, SpheroidLaw::Original).unwrap();
        let at = |k: u32| (f64::from(k * 37 % 75) - 2.3, f64::from(k * 53 % 101) - 5.1);
        let sphere = |k: u32| Particle::sphere(at(k).0, at(k).1, 0.5 * f64::from(k) - 30.0, 2.0);
        let particles: Vec<Particle> =
            (0..40).map(|k| Particle { c_int: 0.1 * f64::from(k), ..sphere(k) }).collect();
        let streams = Streams::new(3);
        let whole = renderer.light(&particles, &streams, Purpose::Rays, 2).values;
        for (part, light) in whole.chunks(70 * 13).enumerate() {
            let mut own = vec![0.0; light.len()];
            let angles = |row: usize| streams.stream(Purpose::Rays, 2, row as u32);
            assert!(renderer.add(&particles, angles, 13 * part, &mut own));
            assert!(own == light, "part {part}");
        }
    }

    /// The reduced aperture changes no count: every patch is the same as with the whole aperture.
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
                    // The whole aperture, obtained by a sensor so large that no ray can miss it.
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
