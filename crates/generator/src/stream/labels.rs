use flows::Frame;
use flows::eulerian::{central, forward};
use flows::scale::ImagePoint;
use glam::DVec3;
use microsig_core::Spheroid;
use microsig_core::render::expected::DEFAULT_TOLERANCE;
use microsig_core::sensor::Sensor;
use rayon::prelude::*;

use crate::dataset::truth::{View, size_class};
use microsig_core::visibility::NoiseFree;
use scenario::Scenario;
use storage::error::{Error, Result};

/// Columns of [`Sample::particles`].
pub const PARTICLE_COLUMNS: [&str; 8] = ["x_px", "y_px", "z_um", "d_um", "c_int", "dx_px", "dy_px", "dz_um"];

/// Definition of the dense displacement field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Flow {
    /// Forward displacement at a physical depth, um.
    At(f64),
    /// Central displacement averaged over the depth range.
    Mean,
}

/// Selection of labels. Particles are always included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LabelOptions {
    /// Boxes around particle images.
    pub boxes: bool,
    /// Axes and aspect ratios of particles.
    pub shapes: bool,
    /// Index of the particle that each pixel belongs to.
    pub instances: bool,
    /// Depth of the particle that each pixel belongs to.
    pub depth: bool,
    /// A heatmap of particle positions.
    pub heatmap: bool,
    /// Dense displacement field from the first to the second frame.
    pub flow: Option<Flow>,
    /// Whether the displacement field has a component along z.
    pub flow_z: bool,
    /// Noise-free images.
    pub clean: bool,
    /// Pixels above this fraction of its peak, and above the noise, belong to a particle's image.
    pub share: f64,
    /// Standard deviation of a particle's Gaussian in the heatmap, px.
    pub heatmap_sigma_px: f64,
}

impl Default for LabelOptions {
    fn default() -> Self {
        LabelOptions {
            boxes: false,
            shapes: false,
            instances: false,
            depth: false,
            heatmap: false,
            flow: None,
            flow_z: false,
            clean: false,
            share: 0.1,
            heatmap_sigma_px: 1.5,
        }
    }
}

impl LabelOptions {
    pub(super) fn needs_single_images(&self) -> bool {
        self.boxes || self.instances || self.depth
    }

    /// Whether samples of a scenario need tables of images.
    pub(super) fn needs_tables(&self, scenario: &Scenario) -> Result<bool> {
        let noise_free = self.clean || self.needs_single_images();
        let limit = || scenario.without_ray_noise(DEFAULT_TOLERANCE);
        Ok(scenario.renderer.needs_tables() || noise_free && limit()?.needs_tables())
    }

    /// Checks the options for a scenario and a number of frames.
    pub(super) fn check(&self, scenario: &Scenario, frames: u32) -> Result<()> {
        if !(self.share > 0.0 && self.share < 1.0) {
            return Err(Error::input(format!("share = {}: expected a number between 0 and 1", self.share)));
        }
        if !(self.heatmap_sigma_px > 0.0 && self.heatmap_sigma_px <= 1000.0) {
            return Err(Error::input(format!(
                "heatmap_sigma_px = {}: expected a number > 0, at most 1000",
                self.heatmap_sigma_px
            )));
        }
        let Some(flow) = self.flow else { return Ok(()) };
        if frames < 2 {
            return Err(Error::input(
                "labels flow: extends from the first to the second frame; expected frames >= 2",
            ));
        }
        if scenario.field().is_none() {
            return Err(Error::input("labels flow: recorded tracks have no velocity field"));
        }
        match flow {
            Flow::At(z_um) if !z_um.is_finite() => {
                Err(Error::input(format!("flow_depth_um = {z_um}: expected a depth in um")))
            }
            _ => Ok(()),
        }
    }
}

/// Images with labels. Rows of arrays are in the order of y, from the top.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Sample {
    /// Index of the sample.
    pub index: u64,
    /// Counts, shape (frames, rows, columns).
    pub images: Vec<u16>,
    /// Noise-free counts, not rounded, shape (frames, rows, columns).
    pub clean: Vec<f32>,
    /// Particles whose center is on the sensor in the first frame, in the order of track numbers, with the
    /// columns [`PARTICLE_COLUMNS`]. Displacements are those to the second frame, NaN without a second frame.
    pub particles: Vec<[f32; 8]>,
    /// For the same particles: center x and y (px), width and height (px) of the bounding box of the pixels
    /// that belong to its image, z (um), and class: the index of the diameter in
    /// `particles.diameter_um.list`, otherwise 0. The box of a particle without light has size 0.
    pub boxes: Vec<[f32; 6]>,
    /// For the same particles: unit vector along the axis, up to its sign (x right, y down, z away from the lens), and
    /// polar over equatorial diameter; 0, 0, 0 and 1 for spheres.
    pub shapes: Vec<[f32; 4]>,
    /// Number, from 1, of the particle that is brightest at each pixel, or 0, shape (rows, columns).
    pub instances: Vec<i32>,
    /// Depth of that particle, um; NaN without a particle, shape (rows, columns).
    pub depth: Vec<f32>,
    /// Maximum over particles of Gaussians of height 1 at their positions, shape (rows, columns).
    pub heatmap: Vec<f32>,
    /// Displacement along x, y (px) and, if requested, z (um), shape (2 or 3, rows, columns); NaN outside the
    /// fluid.
    pub flow: Vec<f32>,
}

/// The first frame of a sample.
pub(super) struct FirstFrame<'a> {
    pub(super) scenario: &'a Scenario,
    pub(super) view: &'a View<'a>,
    pub(super) frame: &'a Frame,
    pub(super) next: Option<&'a Frame>,
    pub(super) single: Option<&'a NoiseFree>,
    pub(super) sensor: &'a Sensor,
}

pub(super) fn frame_labels(wanted: &LabelOptions, shot: &FirstFrame<'_>, sample: &mut Sample) {
    let settings = &shot.scenario.settings;
    let (width, height) = (settings.pixel_dim_x as usize, settings.pixel_dim_y as usize);
    sample.particles = particles(shot);
    if wanted.shapes {
        let visible = shot.view.seen_tracers.iter().filter(|seen_tracer| seen_tracer.visible);
        sample.shapes = visible.map(|seen_tracer| shape(seen_tracer.particle.elongated())).collect();
    }
    if let Some(single) = shot.single {
        let mut instances = Instances::new(wanted, width * height);
        single.prepare(&[&shot.view.rendered]);
        let visible = shot.view.seen_tracers.iter().filter(|seen_tracer| seen_tracer.visible);
        for (number, seen_tracer) in visible.enumerate() {
            let patch = single.draw_all(&shot.view.rendered[seen_tracer.rows.clone()]);
            let z_um = seen_tracer.tracer.position.z as f32;
            let bounds = instances.add(
                patch.belonging(wanted.share, shot.sensor, width),
                width,
                (number as i32 + 1, z_um),
            );
            if wanted.boxes {
                let [x, y, w, h] =
                    bounds.unwrap_or([seen_tracer.particle.x_px, seen_tracer.particle.y_px, 0.0, 0.0]);
                let class = size_class(shot.scenario, seen_tracer.particle.d_um) as f32;
                sample.boxes.push([x as f32, y as f32, w as f32, h as f32, z_um, class]);
            }
        }
        if wanted.instances {
            sample.instances = instances.owner;
        }
        if wanted.depth {
            sample.depth = instances.depth;
        }
    }
    if wanted.heatmap {
        sample.heatmap = heatmap(&sample.particles, (width, height), wanted.heatmap_sigma_px);
    }
}

fn particles(shot: &FirstFrame<'_>) -> Vec<[f32; 8]> {
    let scale = &shot.scenario.scale;
    let is_linked = |next: &&Frame| shot.scenario.recordings.link_to(next.index).is_some();
    let next = shot.next.filter(is_linked);
    // Links and seen_tracers are both sorted by id.
    let mut links = next.into_iter().flat_map(|next| shot.frame.links(next)).peekable();
    let row = |seen_tracer: &crate::dataset::truth::SeenTracer<'_>| {
        let (tracer, particle) = (seen_tracer.tracer, &seen_tracer.particle);
        while links.next_if(|(from, _)| from.id < tracer.id).is_some() {}
        let link = links.next_if(|(from, _)| from.id == tracer.id);
        let moved = link.map(|(from, to)| to.step.map_or(to.position - from.position, |step| step.actual));
        let [dx, dy, dz] = moved.map_or([f64::NAN; 3], |d| {
            let image = scale.displacement_to_image(d);
            [image.dx_px, image.dy_px, d.z]
        });
        let c_int = particle.c_int * seen_tracer.light;
        [particle.x_px, particle.y_px, tracer.position.z, particle.d_um, c_int, dx, dy, dz].map(|v| v as f32)
    };
    let mut rows = Vec::with_capacity(shot.view.seen_tracers.len());
    rows.extend(shot.view.seen_tracers.iter().filter(|seen_tracer| seen_tracer.visible).map(row));
    rows
}

/// Axis and aspect ratio.
fn shape(spheroid: Option<Spheroid>) -> [f32; 4] {
    let Some(spheroid) = spheroid else { return [0.0, 0.0, 0.0, 1.0] };
    let [x, y, z] = spheroid.axis();
    [x, y, z, spheroid.e_p].map(|v| v as f32)
}

/// The brightest particle at each pixel.
struct Instances {
    owner: Vec<i32>,
    depth: Vec<f32>,
    brightest: Vec<f32>,
}

impl Instances {
    fn new(wanted: &LabelOptions, pixels: usize) -> Self {
        let pixels = if wanted.instances || wanted.depth { pixels } else { 0 };
        Instances { owner: vec![0; pixels], depth: vec![f32::NAN; pixels], brightest: vec![0.0; pixels] }
    }

    /// Adds the pixels of a particle; returns center (px, from 1) and size (px) of their bounding box.
    fn add(
        &mut self,
        pixels: impl Iterator<Item = (usize, usize, f64)>,
        width: usize,
        (number, z_um): (i32, f32),
    ) -> Option<[f64; 4]> {
        let mut bounds: Option<[usize; 4]> = None;
        for (x, y, light) in pixels {
            let [left, top, right, bottom] = bounds.unwrap_or([x, y, x, y]);
            bounds = Some([left.min(x), top.min(y), right.max(x), bottom.max(y)]);
            let pixel = y * width + x;
            if self.brightest.get(pixel).is_some_and(|brightest| light as f32 > *brightest) {
                self.brightest[pixel] = light as f32;
                self.owner[pixel] = number;
                self.depth[pixel] = z_um;
            }
        }
        bounds.map(|[left, top, right, bottom]| {
            let middle = |a: usize, b: usize| (a + b) as f64 / 2.0 + 1.0;
            [middle(left, right), middle(top, bottom), (right - left + 1) as f64, (bottom - top + 1) as f64]
        })
    }
}

/// The heatmap of positions; Gaussians are truncated at four standard deviations.
fn heatmap(particles: &[[f32; 8]], (width, height): (usize, usize), sigma_px: f64) -> Vec<f32> {
    let mut map = vec![0.0f32; width * height];
    let reach = libm::ceil(4.0 * sigma_px);
    for particle in particles {
        let (x, y) = (f64::from(particle[0]) - 1.0, f64::from(particle[1]) - 1.0);
        let span = |at: f64, size: usize| {
            let (first, last) = ((at - reach).max(0.0), (at + reach).min(size as f64 - 1.0));
            libm::ceil(first) as usize..(last.max(-1.0) + 1.0) as usize
        };
        let fall = |d: f64| libm::exp(-0.5 * d * d / (sigma_px * sigma_px));
        let columns: Vec<f64> = span(x, width).map(|column| fall(column as f64 - x)).collect();
        for row in span(y, height) {
            let row_share = fall(row as f64 - y);
            let first = row * width + span(x, width).start;
            for (pixel, column_share) in map[first..].iter_mut().zip(&columns) {
                *pixel = pixel.max((row_share * column_share) as f32);
            }
        }
    }
    map
}

/// The displacement at every pixel.
#[derive(Debug)]
pub(super) struct FlowField {
    /// Times of the two frames, s.
    pub(super) interval: (f64, f64),
    pub(super) values: Vec<f32>,
}

/// Number of depths over which the displacement is averaged.
const PLANES: usize = 16;

impl FlowField {
    pub(super) fn of(scenario: &Scenario, (flow, with_z): (Flow, bool), interval: (f64, f64)) -> Self {
        let settings = &scenario.settings;
        let (width, height) = (settings.pixel_dim_x as usize, settings.pixel_dim_y as usize);
        let pixel = |i: usize| {
            let (x_px, y_px) = ((i % width + 1) as f64, (i / width + 1) as f64);
            displacement(scenario, flow, (x_px, y_px), interval)
        };
        let moved: Vec<[f64; 3]> = (0..width * height).into_par_iter().map(pixel).collect();
        let axes = if with_z { 3 } else { 2 };
        let values = (0..axes).flat_map(|axis| moved.iter().map(move |d| d[axis] as f32)).collect();
        FlowField { interval, values }
    }
}

fn displacement(scenario: &Scenario, flow: Flow, (x_px, y_px): (f64, f64), interval: (f64, f64)) -> [f64; 3] {
    let Some(field) = scenario.field() else { return [f64::NAN; 3] };
    let fluid = scenario.fluid(field);
    let position = |z_um: f64| scenario.scale.to_object(ImagePoint { x_px, y_px, z_um: 0.0 }).with_z(z_um);
    let image = |d: DVec3| {
        let d_px = scenario.scale.displacement_to_image(d);
        [d_px.dx_px, d_px.dy_px, d.z]
    };
    match flow {
        Flow::At(z_um) => {
            let x = position(z_um);
            let moved = fluid.contains(x, interval.0).then(|| forward(field, x, interval).ok()).flatten();
            moved.map_or([f64::NAN; 3], image)
        }
        Flow::Mean => {
            let (low, high) = scenario.depth_range_um;
            let (mut sum, mut n) = (DVec3::ZERO, 0.0);
            for k in 0..PLANES {
                let x = position(low + (high - low) * (k as f64 + 0.5) / PLANES as f64);
                if let (true, Ok(moved)) = (fluid.contains(x, interval.0), central(field, x, interval)) {
                    sum += moved;
                    n += 1.0;
                }
            }
            image(sum / n)
        }
    }
}
