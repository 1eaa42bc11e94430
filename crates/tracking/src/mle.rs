//! Maximum likelihood with the optical model: the search of `ncc` with templates computed from the settings,
//! then a fit of position, depth and brightness with the images and derivatives of the model.
//!
//! The model is free of noise, so the fit can reach the Cramér-Rao bound except for overlapping particles.
//! Where the optics vary over the field of view, the fit uses the model at each particle's place, the search
//! that of the nearest of a grid of places. Particles are spheres with the diameter of a calibration particle, or of any diameter if that is
//! fitted, and of any brightness. The calibration stacks provide the counts per ray and the camera noise.

use std::sync::Arc;

use glam::DVec3;
use microsig_core::cancel::checkpoint;
use microsig_core::optics::FieldOptics;
use microsig_core::render::{Context, Gradient, RenderMethod, Renderer, RendererSpec, Window};
use microsig_core::{Particle, Settings, Spheroid};
use rayon::prelude::*;

use super::calibration::{self, Origin};
use super::denoise::{PixelNoise, RecordedNoise};
use super::field_images::FieldPlaces;
use super::gray_image::GrayImage;
use super::images::{ImagePatch, ParticleImages};
use super::job::Job;
use super::locate::Locator;
use super::shape_fit::Pose;
use super::shape_table::{PER_PX, ShapeTable};
use super::spheroids;
use super::stack::{Stack, brightest};
use super::templates::Templates;
use super::{Method, ParticleShape};
use storage::Progress;
use storage::error::{Error, Result};

/// Tolerance of the model images, relative to their peaks.
const TOLERANCE: f64 = 3e-3;

/// Number of places across the field of view, in x and in y, with templates for the search.
const PLACES: u32 = 5;

/// Tolerance of drafts of spheroids by rays, which no table makes cheaper. Their errors of about 0.3 % of the peak would be
/// seen in results at an SNR of 20, but not in how a fit gets there.
const TOLERANCE_OF_DRAFTS: f64 = 0.02;

/// Tolerance of images of spheroids in tables, from which fits start.
const TOLERANCE_OF_TABLES: f64 = 0.01;

/// Numbers of depths and of tilts of a table of spheroids: for starts and comparisons, and for fits.
pub(super) const COARSE: [usize; 2] = [20, 8];
pub(super) const FINE: [usize; 2] = [30, 12];

/// Memory of a table, bytes; larger ones are not made.
const LARGEST_TABLE: usize = 1 << 28;

/// Half the difference of logarithms of aspect ratios over which images from tables are differentiated.
const ASPECT_STEP: f64 = 0.05;

/// Tolerance of images that depend on the place in the field, whose tables take long.
const TOLERANCE_OF_FIELD: f64 = 0.02;

/// Aspect ratio of spheroids for which there is room at least.
const LONGEST: f64 = 5.0;

/// Relative error of the model images assumed in the weights.
const MODEL_ERROR: f32 = 0.01;

/// Minimum correlation of the model with the calibration stack: below the first value an error, below the
/// second a warning.
const LEAST_CORRELATION: (f64, f64) = (0.6, 0.97);

pub(super) const METHOD: Method = Method {
    name: "mle",
    about: "Position and depth by maximum likelihood with the optical model, linked",
    run: |job| match job.options.shape {
        ParticleShape::Sphere => locator(job)?.particles(job),
        ParticleShape::Spheroid { aspect } => spheroids::particles(job, aspect),
    },
};

/// Particle images from the optical model.
#[derive(Clone)]
struct ModelImages {
    renderer: Arc<Renderer>,
    d_um: f64,
    /// Physical depth over depth in the model.
    depth_factor: f64,
    /// Depth at which the depth in the model is 0, um.
    zero_um: f64,
    /// Counts per ray.
    unit: f64,
    /// Central pixel of the renderer's sensor, from 1.
    middle: i64,
    /// Images at their places on the whole sensor, if the optics vary over the field.
    over_field: Option<Arc<Renderer>>,
    depths_um: Vec<f64>,
    /// Half widths at these depths, px.
    radii: Vec<usize>,
}

fn locator(job: &Job) -> Result<Locator<ModelImages>> {
    let stacks: Vec<Stack> = calibration::read(job.dataset)?.iter().map(|steps| Stack::new(steps)).collect();
    let noise = brightest(&stacks).noise;
    let recorded = RecordedNoise::read(job.dataset)?;
    let noise = recorded.map_or(noise, |recorded| recorded.frame_noise(noise));
    let manifest = job.dataset.manifest()?;
    let sensor = manifest.microsig.sensor.as_ref().map(|sensor| [sensor.width_px, sensor.height_px]);
    let (mut search, mut images) = (Vec::<Vec<Templates>>::new(), Vec::new());
    let origins = calibration::origins(job.dataset)?;
    let sizes =
        stacks.into_iter().zip(&origins).map(|(stack, origin)| size_templates(job, stack, origin, sensor));
    let (sizes, left_out) = calibration::usable_sizes(sizes)?;
    left_out.into_iter().for_each(|warning| job.warn(warning));
    for (templates, model) in sizes {
        search.resize_with(templates.len(), Vec::new);
        search
            .iter_mut()
            .zip(templates)
            .for_each(|(place_templates, templates)| place_templates.push(templates));
        images.push(model);
    }
    let places = FieldPlaces::new(sensor.map_or_else(Vec::new, places));
    let ladder = if job.options.fit_diameter { ladder(&images) } else { Vec::new() };
    let diameters_um = images.iter().map(|model| model.d_um).collect();
    let locator = Locator::over_field(search, places, images, MODEL_ERROR, noise).with_deviations();
    let locator = locator.on_uneven(recorded.is_some());
    Ok(if ladder.is_empty() { locator.with_classes(diameters_um) } else { locator.with_diameters(ladder) })
}

/// Ratio of neighboring diameters between which diameters are fitted.
const LADDER: f64 = 1.25;

/// Images at diameters from half the smallest to twice the largest of these models, of the model with the nearest diameter.
fn ladder(models: &[ModelImages]) -> Vec<(f64, ModelImages)> {
    let all = || models.iter().map(|model| model.d_um);
    let (low, high) = (0.5 * all().fold(f64::INFINITY, f64::min), 2.0 * all().fold(0.0, f64::max));
    let n = ((high / low).ln() / LADDER.ln()).ceil();
    let at = |k: usize| {
        let d_um = low * (high / low).powf(k as f64 / n);
        let off = |model: &&ModelImages| (model.d_um / d_um).ln().abs();
        let nearest = models.iter().min_by(|a, b| off(a).total_cmp(&off(b)))?;
        Some((d_um, ModelImages { d_um, ..nearest.clone() }))
    };
    (0..=n as usize).filter_map(at).collect()
}

/// Images of spheroids, and the noise of a frame.
pub(super) struct OfSpheroids {
    pub(super) images: ShapeImages,
    pub(super) noise: PixelNoise,
}

/// Images of spheroids whose polar diameter is up to `longest` times the calibration particle's.
pub(super) fn shape_images(job: &Job, longest: f64) -> Result<OfSpheroids> {
    let stacks: Vec<Stack> = calibration::read(job.dataset)?.iter().map(|steps| Stack::new(steps)).collect();
    let noise = brightest(&stacks).noise;
    let noise = RecordedNoise::read(job.dataset)?.map_or(noise, |recorded| recorded.frame_noise(noise));
    let mut origins = calibration::origins(job.dataset)?;
    if stacks.len() > 1 {
        job.warn("spheroids are taken to have the largest of the calibrated diameters");
    }
    let (Some(stack), Some(origin)) = (stacks.into_iter().next_back(), origins.pop()) else {
        return Err(Error::input("mle of spheroids: expected a calibration stack"));
    };
    if origin.over_field.field.is_some_and(|field| field != FieldOptics::default()) {
        return Err(Error::input("mle of spheroids: optics that vary over the field are not supported"));
    }
    let (side, depths_um) = (stack.images[0].width, stack.depths_um.clone());
    let (templates, sphere) = size_templates(job, stack, &origin, None)?;
    let aspect_px = 0.5 * origin.d_um * origin.settings.magnification / origin.settings.pixel_size;
    let room = (aspect_px * (longest.max(LONGEST) - 1.0)).ceil() as usize;
    let (side, context) = (side + 2 * room, &job.options.context);
    let model = ModelImages::new(&origin, &depths_um, side, TOLERANCE, context)?;
    let draft = match origin.waves {
        Some(_) => None,
        None => {
            Some(Arc::new(renderer(&origin, TOLERANCE_OF_DRAFTS).build(model.renderer.settings(), context)?))
        }
    };
    let radii = depths_um.iter().map(|z_um| templates[0].radius_px(*z_um, 0.0)).collect();
    let model = ModelImages { unit: sphere.unit, ..model };
    let per_px = f64::from(PER_PX);
    let settings = Settings {
        pixel_size: origin.settings.pixel_size / per_px,
        points_per_pixel: origin.settings.points_per_pixel / per_px.powi(2),
        ..origin.settings.clone()
    };
    let finer = Origin { settings, ..origin };
    let fits = ShapeTable::bytes(FINE, side / 2) < LARGEST_TABLE;
    let fine = (fits && model.renderer.traits().is_round)
        .then(|| ModelImages::new(&finer, &depths_um, side * PER_PX as usize, TOLERANCE_OF_TABLES, context))
        .transpose()?
        .map(|fine| ModelImages { unit: sphere.unit, ..fine });
    let progress = job.options.progress.clone();
    let images = ShapeImages { model, draft, fine, table: None, progress, radii, aspect_px, room };
    Ok(OfSpheroids { images: images.up_to(longest), noise })
}

/// How well images of spheroids are computed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Detail {
    /// Well enough to come near a solution. The errors of derivatives by differences would make standard deviations too small.
    Draft,
    Full,
}

/// Images of spheroids with the equatorial diameter of a calibration particle.
#[derive(Clone)]
pub(super) struct ShapeImages {
    model: ModelImages,
    /// For drafts, if they are cheaper.
    draft: Option<Arc<Renderer>>,
    /// For tables, with [`PER_PX`] pixels per px, if the optics are round and tables not too large.
    fine: Option<ModelImages>,
    /// Drafts of the one aspect ratio, if that is known.
    table: Option<Arc<ShapeTable>>,
    progress: Progress,
    /// Half widths of images of spheres, px, and how much larger an aspect ratio makes them.
    radii: Vec<usize>,
    aspect_px: f64,
    room: usize,
}

impl ShapeImages {
    /// With room for a polar diameter up to `longest` times the calibration particle's, if there is as much.
    pub(super) fn up_to(mut self, longest: f64) -> Self {
        let more = ((self.aspect_px * (longest - 1.0)).ceil() as usize).min(self.room);
        self.model.radii = self.radii.iter().map(|radius| radius + more).collect();
        self
    }

    pub(super) fn depths_um(&self) -> [f64; 2] {
        self.model.depths_um()
    }

    /// Half width of an image at a depth, and the largest one, px.
    pub(super) fn radius_at(&self, z_um: f64) -> usize {
        self.model.radius_px(z_um, 2.0)
    }

    pub(super) fn radius(&self) -> usize {
        self.model.radii.iter().copied().max().unwrap_or(0)
    }

    /// Images of this aspect ratio over depth and axis, if there can be tables.
    pub(super) fn tabled(&self, e_p: f64, nodes: [usize; 2]) -> Option<Arc<ShapeTable>> {
        let fine = self.fine.as_ref()?;
        let bar = self.progress.images(ShapeTable::images(nodes));
        let image = |z_um: f64, axis: DVec3, half: usize| {
            checkpoint();
            bar.inc(1);
            let pose = Pose { at: [0.5; 2], z_um, axis, e_p, brightness: 1.0 };
            let first = fine.middle + 1 - half as i64;
            let window = Window { x0: first, y0: first, width: 2 * half, height: 2 * half };
            fine.spheroid(&fine.renderer, &pose, [0; 2], window)
        };
        let table = ShapeTable::new(self.depths_um(), nodes, self.radius() + 2, image);
        bar.finish();
        Some(Arc::new(table))
    }

    /// With this table for drafts.
    pub(super) fn with_table(self, table: Option<Arc<ShapeTable>>) -> Self {
        ShapeImages { table, ..self }
    }

    /// Whether there can be tables.
    pub(super) fn can_have_tables(&self) -> bool {
        self.fine.is_some()
    }

    /// Whether drafts are smooth, so that images near an exact one differ from it as their drafts do.
    pub(super) fn has_table(&self) -> bool {
        self.table.is_some()
    }

    fn renderer(&self, detail: Detail) -> &Renderer {
        match &self.draft {
            Some(draft) if detail == Detail::Draft => draft,
            _ => &self.model.renderer,
        }
    }

    /// The image at brightness 1 on the square of this half width around a pixel, row by row, counts.
    pub(super) fn light(&self, pose: &Pose, middle: [isize; 2], radius: usize, detail: Detail) -> Vec<f64> {
        match &self.table {
            Some(table) if detail == Detail::Draft => table.light(pose, middle, radius),
            _ => self.rendered(pose, middle, radius, detail),
        }
    }

    fn rendered(&self, pose: &Pose, middle: [isize; 2], radius: usize, detail: Detail) -> Vec<f64> {
        self.model.spheroid(self.renderer(detail), pose, middle, self.model.square(radius))
    }

    /// The same with derivatives, and the directions of turns (see `ShapeGradient`). Drafts from a table have none with respect to
    /// the aspect ratio.
    pub(super) fn gradient(
        &self,
        pose: &Pose,
        middle: [isize; 2],
        radius: usize,
        detail: Detail,
    ) -> Option<(Vec<[f64; 7]>, [DVec3; 2])> {
        let Some(table) = &self.table else {
            let (model, window) = (&self.model, self.model.square(radius));
            let particle = model.spheroid_on_sensor(pose, middle);
            let mut gradient = self.renderer(detail).shape_gradient(&particle, Some(window))?;
            for pixel in &mut gradient.pixels {
                pixel.iter_mut().for_each(|value| *value *= model.unit);
                pixel[3] /= model.depth_factor;
            }
            return Some((gradient.pixels, gradient.turns));
        };
        let (mut pixels, turns) = table.gradient(pose, middle, radius);
        if detail == Detail::Full {
            let by_aspect = self.by_aspect(pose, middle, radius, Detail::Draft);
            let light = self.rendered(pose, middle, radius, Detail::Full);
            for ((pixel, light), by_aspect) in pixels.iter_mut().zip(light).zip(by_aspect) {
                (pixel[0], pixel[6]) = (light, by_aspect);
            }
        }
        Some((pixels, turns))
    }

    /// The derivative of an image with respect to the logarithm of the aspect ratio.
    pub(super) fn by_aspect(
        &self,
        pose: &Pose,
        middle: [isize; 2],
        radius: usize,
        detail: Detail,
    ) -> Vec<f64> {
        let stretched = |by: f64| Pose { e_p: pose.e_p * by.exp(), ..*pose };
        let image = |by: f64| self.rendered(&stretched(by), middle, radius, detail);
        let [low, high] = [-ASPECT_STEP, ASPECT_STEP].map(image);
        high.iter().zip(low).map(|(high, low)| (high - low) / (2.0 * ASPECT_STEP)).collect()
    }
}

/// Places of the field of view for which templates are made, px from 0.
fn places(sensor: [u32; 2]) -> Vec<[f64; 2]> {
    let at = |k: u32, side: u32| (f64::from(k) + 0.5) * f64::from(side) / f64::from(PLACES) - 0.5;
    let row = |j: u32| (0..PLACES).map(move |i| [at(i, sensor[0]), at(j, sensor[1])]);
    (0..PLACES).flat_map(row).collect()
}

/// Model of one size of particles, and its templates: in the middle, or at all places of the field of view if
/// the optics vary over it.
fn size_templates(
    job: &Job,
    stack: Stack,
    origin: &Origin,
    sensor: Option<[u32; 2]>,
) -> Result<(Vec<Templates>, ModelImages)> {
    let side = stack.images[0].width;
    let mut model = ModelImages::new(origin, &stack.depths_um, side, TOLERANCE, &job.options.context)?;
    let images = model.stack([0.0; 2], side);
    let correlation = model.calibrate(&images, &stack.images, origin.d_um)?;
    if correlation < LEAST_CORRELATION.1 {
        job.warn(format!(
            "the correlation of the optical model with the calibration stack of {} um is {correlation:.3} (1 is perfect); \
             check that the settings match the images. `ncc` needs no model",
            origin.d_um
        ));
    }
    let mut stacks = vec![images];
    if let Some(sensor) = sensor
        && let Some(renderer) = over_field(sensor, origin, &job.options.context)?
    {
        job.note("images by the optics at the place of each particle in the field of view".to_owned());
        model.over_field = Some(Arc::new(renderer));
        stacks = places(sensor).into_iter().map(|at| model.stack(at, side)).collect();
    }
    let unit = model.unit as f32;
    let templates: Vec<Templates> = stacks
        .into_iter()
        .map(|mut images| {
            images.iter_mut().flat_map(|image| &mut image.counts).for_each(|c| *c *= unit);
            Templates::new(stack.depths_um.clone(), images, stack.noise)
        })
        .collect();
    let radius =
        |z_um: &f64| templates.iter().map(|place_templates| place_templates.radius_px(*z_um, 0.0)).max();
    model.radii = model.depths_um.iter().map(|z_um| radius(z_um).unwrap_or(0)).collect();
    Ok((templates, model))
}

/// The renderer of a whole sensor, if the optics vary over it.
fn over_field([width, height]: [u32; 2], origin: &Origin, context: &Context) -> Result<Option<Renderer>> {
    let spec = renderer(origin, TOLERANCE_OF_FIELD);
    if *spec.field() == FieldOptics::default() {
        return Ok(None);
    }
    let settings = Settings { pixel_dim_x: width, pixel_dim_y: height, ..origin.settings.clone() };
    Ok(Some(spec.build(&settings, context)?))
}

fn renderer(Origin { waves, over_field, .. }: &Origin, tolerance: f64) -> RendererSpec {
    let method = match waves.clone() {
        Some(optics) => RenderMethod::Waves { optics, tolerance },
        None => RenderMethod::Expected { spheroids: over_field.spheroids, tolerance },
    };
    RendererSpec::from(method).through(over_field.blur_um, over_field.field.unwrap_or_default())
}

impl ModelImages {
    fn new(
        origin: &Origin,
        depths_um: &[f64],
        side: usize,
        tolerance: f64,
        context: &Context,
    ) -> Result<Self> {
        let Origin { d_um, depth_factor, zero_um, .. } = *origin;
        // Margin for sub-pixel shifts.
        let size = side as u32 + 4;
        let settings = Settings { pixel_dim_x: size, pixel_dim_y: size, ..origin.settings.clone() };
        let radii = vec![side / 2; depths_um.len()];
        let renderer = renderer(origin, tolerance).build(&settings, context)?;
        let middle = i64::from(size / 2 + 1);
        let depths_um = depths_um.to_vec();
        Ok(ModelImages {
            renderer: Arc::new(renderer),
            d_um,
            depth_factor,
            zero_um,
            unit: 1.0,
            middle,
            over_field: None,
            depths_um,
            radii,
        })
    }

    /// The square of this half width around the middle of the sensor.
    fn square(&self, radius: usize) -> Window {
        let (first, side) = (self.middle - radius as i64, 2 * radius + 1);
        Window { x0: first, y0: first, width: side, height: side }
    }

    /// A spheroid on the sensor, with this pixel in the middle.
    fn spheroid_on_sensor(&self, pose: &Pose, middle: [isize; 2]) -> Particle {
        let [x, y] = [0, 1].map(|axis| self.middle as f64 + pose.at[axis] - middle[axis] as f64);
        let z_um = (pose.z_um - self.zero_um) / self.depth_factor;
        let spheroid = Some(Spheroid::from_axis(pose.e_p, pose.axis.to_array()));
        Particle { spheroid, ..Particle::sphere(x, y, z_um, self.d_um) }
    }

    /// Its image in a window, row by row, counts.
    fn spheroid(&self, renderer: &Renderer, pose: &Pose, middle: [isize; 2], window: Window) -> Vec<f64> {
        let patch = renderer.mean_patch(&self.spheroid_on_sensor(pose, middle));
        let mut light = patch.map_or_else(|| vec![0.0; window.area()], |patch| patch.on(window));
        light.iter_mut().for_each(|light| *light *= self.unit);
        light
    }

    /// The stack computed by the model for the pixel at this position, on squares of this side; divided by the
    /// counts per ray.
    fn stack(&self, at: [f64; 2], side: usize) -> Vec<GrayImage> {
        let at = at.map(f64::round);
        // All tables at once, so that progress has their number.
        let spheres: Vec<Particle> = self.depths_um.iter().map(|z_um| self.place(at, *z_um).1).collect();
        self.over_field.as_ref().unwrap_or(&self.renderer).prepare(&[&spheres]);
        let unit = self.unit as f32;
        let image = |z_um: &f64| {
            let patch = self.patch(at, *z_um, side / 2);
            GrayImage { width: side, height: side, counts: patch.light.iter().map(|l| l[0] / unit).collect() }
        };
        self.depths_um.par_iter().map(image).collect()
    }

    /// The pixel (from 1) and the particle at a position: in the middle of a small sensor, or at the place on the whole one.
    fn place(&self, at: [f64; 2], z_um: f64) -> ([i64; 2], Particle) {
        let middle = at.map(f64::round);
        let center = match self.over_field {
            None => [self.middle; 2],
            Some(_) => middle.map(|at| at as i64 + 1),
        };
        let [x, y] = [0, 1].map(|axis| center[axis] as f64 + at[axis] - middle[axis]);
        (center, Particle::sphere(x, y, (z_um - self.zero_um) / self.depth_factor, self.d_um))
    }

    /// Fits the counts per ray to the calibration stack; returns the correlation of both stacks.
    fn calibrate(&mut self, model: &[GrayImage], stack: &[GrayImage], d_um: f64) -> Result<f64> {
        let (mut own, mut both, mut seen) = (0.0, 0.0, 0.0);
        for (model, stack) in model.iter().zip(stack) {
            for (m, s) in model.counts.iter().zip(&stack.counts) {
                let (m, s) = (f64::from(*m), f64::from(*s));
                own += m * m;
                both += m * s;
                seen += s * s;
            }
        }
        let correlation = both / (own * seen).sqrt();
        // NaN if an image has no light.
        if correlation.is_nan() || correlation < LEAST_CORRELATION.0 {
            return Err(Error::input(format!(
                "mle: the optical model of calibration/settings.txt correlates with the calibration stack of {d_um} um by \
                 {correlation:.2}; expected at least {}: the settings do not match, or the particle is fainter than the noise",
                LEAST_CORRELATION.0
            )));
        }
        self.unit = both / own;
        Ok(correlation)
    }
}

impl ParticleImages for ModelImages {
    fn depths_um(&self) -> [f64; 2] {
        [self.depths_um[0], self.depths_um[self.depths_um.len() - 1]]
    }

    fn radius_px(&self, z_um: f64, reach_um: f64) -> usize {
        let low = self.depths_um.partition_point(|d| *d <= z_um - reach_um).saturating_sub(1);
        let high = self.depths_um.partition_point(|d| *d < z_um + reach_um).min(self.radii.len() - 1);
        self.radii[low.min(high)..=high].iter().copied().max().unwrap_or(0)
    }

    fn patch(&self, at: [f64; 2], z_um: f64, radius: usize) -> ImagePatch {
        let middle = at.map(f64::round);
        let (center, particle) = self.place(at, z_um);
        let renderer = self.over_field.as_ref().unwrap_or(&self.renderer);
        let ([x0, y0], side) = (center.map(|center| center - radius as i64), 2 * radius + 1);
        let window = Window { x0, y0, width: side, height: side };
        let pixels = renderer.gradient(&particle, Some(window)).map(|Gradient { pixels, .. }| pixels);
        let by_z = self.unit / self.depth_factor;
        let light = pixels
            .unwrap_or_default()
            .into_iter()
            .map(|[light, x, y, z]| {
                [self.unit * light, self.unit * x, self.unit * y, by_z * z].map(|v| v as f32)
            })
            .collect();
        ImagePatch { middle: middle.map(|c| c as isize), radius, light }
    }
}
