//! A renderer that draws spheres from tables: what all image models have in common.
//!
//! An [`ImageModel`] says what the image of a sphere is at each depth and size. [`TabledRenderer`] builds its
//! tables when they are first needed, takes them from the store of its [`Context`] where it has one, adds up
//! images, and differentiates them. When tables exceed 512 MB, those not needed by the current image are
//! dropped.

use std::fmt::Debug;
use std::ops::RangeInclusive;
use std::sync::{Arc, Mutex, PoisonError};

use glam::DVec3;
use rayon::prelude::*;

use super::depth_table::{DepthTable, PlaneLayout};
use super::gradient::Gradient;
use super::image_sum::{self, ImageBand, ImageSum, SphereImage};
use super::instructions::InstructionSet;
use super::interface::{Description, ImageStreams, Render, Tables, Traits};
use super::patch::{ExpectedPatch, Window};
use super::rays::RayRenderer;
use super::refinement::TableSpan;
use super::shape::{self, ShapeEmitter, ShapeGradient, SpheroidLight, VALUES};
use super::store::Context;
use super::tables::{Key, SharedTables, TableRanges, TablesState};
use crate::cancel::checkpoint;
use crate::error::Error;
use crate::particle::Particle;
use crate::pool::BufferPool;
use crate::sensor::{Image, Light, Sensor};
use crate::settings::Settings;
use crate::stream::{Purpose, Streams};

/// The allowed range of tolerances, relative to the peak of an image.
pub const TOLERANCES: RangeInclusive<f64> = 1e-4..=0.1;

/// Images whose error exceeds this number of tolerances are refused.
const LARGEST_SHORTFALL: f64 = 10.0;

/// Number of sources after which those gathered are drawn, which bounds the tables and images in memory at
/// the same time.
const SOURCES: usize = 1024;

/// What is drawn for a particle: itself, or one of several spheres that stand for it.
#[derive(Debug, Clone, Copy)]
pub struct Source {
    pub(super) at: Particle,
    /// Light emitted toward the lens, in rays; of a source that is drawn directly, the factor on its light.
    pub(super) light: f64,
    /// Whether [`ImageModel::direct`] computes its image, not a table.
    pub(super) is_direct: bool,
}

/// The image of a sphere as a function of depth and size, and of the particles that spheres stand for.
///
/// Optics that move an image, change its depth or its light do so in [`ImageModel::sources`].
pub trait ImageModel: Debug + Send + Sync {
    /// Layout of the planes of its tables.
    type Layout: PlaneLayout;
    /// Working memory for drawing.
    type Pen: Pen<Self::Layout>;

    /// Its images, as the subject of a message.
    const IMAGES: &'static str;

    fn traits(&self) -> Traits;

    fn settings(&self) -> &Settings;

    fn description(&self) -> Description;

    fn warning(&self) -> Option<String>;

    /// The largest error of an image due to tables, relative to its peak.
    fn tolerance(&self) -> f64;

    /// The ray renderer of the same lens: what all renderers check, and which particles reach the sensor.
    fn rays(&self) -> &RayRenderer;

    /// What this model, other than rays, demands of a particle; a warning about its image, if any.
    fn check(&self, particle: &Particle) -> Result<Option<String>, Error>;

    /// Distance from a particle within which the spheres that stand for it are, px; `None` if its image is
    /// computed wherever it lies.
    fn spread_px(&self, particle: &Particle) -> Option<f64>;

    /// Half width and half height of the image of a particle, px, without its table.
    fn extent_px(&self, particle: &Particle) -> (f64, f64);

    fn accepted_light(&self, particle: &Particle) -> Option<f64>;

    /// Whether light of a particle can land on the sensor.
    fn reaches_sensor(&self, particle: &Particle) -> bool {
        self.rays().reaches_sensor(particle)
    }

    /// Appends what is drawn for a particle whose brightness is `factor`.
    fn sources(&self, particle: &Particle, factor: f64, out: &mut Vec<Source>);

    /// Appends spheres, of any brightness, whose tables are made for the sources of a particle.
    fn table_spheres(&self, particle: &Particle, out: &mut Vec<Particle>);

    /// What emits the light of a spheroid, if its image is a sum of images of points.
    fn spheroid_light(&self, spheroid: &Particle) -> Option<SpheroidLight> {
        let _ = spheroid;
        None
    }

    /// Puts the sources of an image in the order in which they are added.
    fn arrange(&self, sources: &mut [Source]) {
        let _ = sources;
    }

    /// The image of a direct source at brightness 1 on the pixels of a window.
    fn direct(&self, particle: &Particle, window: Window) -> Vec<f32> {
        let _ = particle;
        vec![0.0; window.area()]
    }

    /// The factor between depths in tables and of a particle.
    fn depth_scale(&self, particle: &Particle) -> f64 {
        let _ = particle;
        1.0
    }

    /// A source as a table of this layout has it.
    fn placed(&self, at: &Particle, layout: &Self::Layout) -> Particle {
        let _ = layout;
        *at
    }

    /// The ranges of depth and size of one table.
    fn ranges(&self) -> &TableRanges;

    /// All that tables follow from, in words that say each number to the last digit.
    fn parameters(&self) -> String;

    /// What tables that the sensor cuts off follow from, too; `None` if the sensor is one of the parameters.
    fn cut_parameters(&self) -> Option<String> {
        None
    }

    /// Whether the sensor cuts a table off.
    fn is_cut(&self, layout: &Self::Layout) -> bool {
        let _ = layout;
        false
    }

    /// Prepares for images that are computed one by one instead of from tables.
    fn without_tables(&mut self, context: &Context);

    /// The image of a sphere, computed for its own depth and size, as a table of this depth alone;
    /// `with_derivative`: with its change with depth.
    fn single(&self, sphere: &Particle, with_derivative: bool) -> DepthTable<Self::Layout>;

    /// Makes a table.
    fn build(&self, span: TableSpan) -> DepthTable<Self::Layout>;
}

/// Draws spheres one after the other with its working memory.
pub trait Pen<L>: Debug + Default + Send {
    /// Adds a sphere to a band that contains some of its pixels.
    fn add(&mut self, sphere: &SphereImage<'_, L>, band: &mut ImageBand<'_>);
}

/// Renders particles without ray noise, from tables.
#[derive(Debug)]
pub struct TabledRenderer<M: ImageModel> {
    pub(super) model: M,
    instructions: InstructionSet,
    context: Context,
    /// Whether each image is computed for itself, without tables.
    is_single: bool,
    tables: SharedTables<M::Layout>,
    /// Working memory, reused from image to image.
    images: BufferPool<Vec<f32>>,
    pens: Mutex<Vec<M::Pen>>,
}

/// A table, and the source drawn from it as the table has it.
type PlacedTable<L> = (Particle, Arc<DepthTable<L>>);

/// Where the image of a source comes from.
enum ImageSource<L> {
    Table(Particle, Arc<DepthTable<L>>),
    Patch(Window, Vec<f32>),
}

/// Refuses tolerances out of range.
pub(super) fn check_tolerance(tolerance: f64) -> Result<(), Error> {
    if TOLERANCES.contains(&tolerance) {
        return Ok(());
    }
    let (least, most) = TOLERANCES.into_inner();
    let allowed = format!("{least} to {most}, a fraction of an image's peak");
    Err(Error::Unsupported(format!("tolerance = {tolerance}: expected {allowed}")))
}

/// Largest distance (px) from the sensor of a particle whose light falls on it.
fn margin(settings: &Settings) -> f64 {
    (f64::from(settings.pixel_dim_x.max(settings.pixel_dim_y)) / 2.0).max(50.0)
}

/// Largest distances of pixels from a particle whose light falls on them, along x and y, px.
pub(super) fn farthest_px(settings: &Settings) -> [f64; 2] {
    [settings.pixel_dim_x, settings.pixel_dim_y].map(|size| f64::from(size) + margin(settings))
}

/// The pixels within `reach_px` of a particle.
pub(super) fn window(settings: &Settings, particle: &Particle, reach_px: (f64, f64)) -> Window {
    let sensor = (settings.pixel_dim_x, settings.pixel_dim_y);
    Window::around(particle.x_px, particle.y_px, reach_px, sensor)
}

/// [`Render::check`] of a renderer by this model.
pub(super) fn check<M: ImageModel>(model: &M, particle: &Particle) -> Result<Option<String>, Error> {
    let warning = model.check(particle)?;
    let Some(spread_px) = model.spread_px(particle) else { return Ok(warning) };
    let (settings, margin) = (model.settings(), margin(model.settings()));
    let outside = |at: f64, size: u32| (0.5 - at).max(at - f64::from(size) - 0.5);
    let farthest = outside(particle.x_px, settings.pixel_dim_x)
        .max(outside(particle.y_px, settings.pixel_dim_y))
        + spread_px;
    if farthest > margin && model.reaches_sensor(particle) {
        return Err(Error::Unsupported(format!(
            "it reaches {farthest:.1} px outside the sensor, onto which its light falls; {} support particles up to {margin} px \
             outside",
            M::IMAGES
        )));
    }
    Ok(warning)
}

impl<M: ImageModel> TabledRenderer<M> {
    pub(super) fn of(model: M, instructions: InstructionSet) -> Self {
        let (context, tables, images) = (Context::default(), SharedTables::default(), BufferPool::default());
        let pens = Mutex::default();
        TabledRenderer { model, instructions, context, is_single: false, tables, images, pens }
    }

    /// The same renderer, which computes each image for itself, at its own depth, instead of from tables: for
    /// optics of which few images are drawn. Errors come from the quadrature alone, without verification.
    pub fn without_tables(mut self) -> Self {
        self.model.without_tables(&self.context);
        TabledRenderer { is_single: true, ..self }
    }

    /// The same renderer, whose tables are kept where `context` says.
    pub fn within(self, context: &Context) -> Self {
        TabledRenderer { context: context.clone(), ..self }
    }

    /// The largest error of an image due to tables, relative to its peak.
    pub fn tolerance(&self) -> f64 {
        self.model.tolerance()
    }

    /// The counts of one particle if its brightness were 1. `None`: its light cannot reach the sensor.
    pub fn patch(&self, particle: &Particle) -> Option<ExpectedPatch> {
        let sources = self.sources(particle);
        let tables = self.tables_of(&sources, false);
        let on = self.window_of(&sources, &tables);
        let images = self.images_of(&sources, tables, Some(on));
        image_sum::patch(on, |band| self.add(&sources, &images, band))
    }

    /// The light of all particles of one image.
    pub fn draw(&self, particles: &[Particle]) -> Light {
        self.sum(particles).light(self.settings())
    }

    pub(super) fn sources(&self, particle: &Particle) -> Vec<Source> {
        let mut sources = Vec::new();
        self.model.sources(particle, 1.0, &mut sources);
        sources
    }

    /// The smallest window that contains the images of sources.
    pub(super) fn window(&self, sources: &[Source]) -> Window {
        self.window_of(sources, &self.tables_of(sources, false))
    }

    fn window_of(&self, sources: &[Source], tables: &[PlacedTable<M::Layout>]) -> Window {
        let mut tables = tables.iter();
        let windows = sources.iter().map(|source| match source.is_direct {
            true => self.direct_window(source),
            false => tables.next().map_or_else(Window::default, |(at, table)| self.table_window(at, table)),
        });
        windows.fold(Window::default(), Window::joined)
    }

    /// The sources on a window that contains theirs; those drawn directly, on all of it.
    pub(super) fn drawn(&self, sources: &[Source], on: Window) -> Option<ExpectedPatch> {
        let images = self.images(sources, Some(on));
        image_sum::patch(on, |band| self.add(sources, &images, band))
    }

    fn sum(&self, particles: &[Particle]) -> ImageSum<'_> {
        let mut image = ImageSum::new(self.settings(), &self.images);
        let mut sources = Vec::new();
        for (i, particle) in particles.iter().enumerate() {
            self.model.sources(particle, particle.c_int, &mut sources);
            if sources.len() >= SOURCES || i + 1 == particles.len() {
                checkpoint();
                self.model.arrange(&mut sources);
                let images = self.images(&sources, None);
                // On every band in the same order.
                image.add(|band| self.add(&sources, &images, band));
                sources.clear();
            }
        }
        image
    }

    fn add(&self, sources: &[Source], images: &[ImageSource<M::Layout>], band: ImageBand<'_>) {
        self.instructions.dispatch(Draw { renderer: self, sources, images, band });
    }

    /// The data from which each source is drawn; those drawn directly, on a window or where their light
    /// falls.
    fn images(&self, sources: &[Source], on: Option<Window>) -> Vec<ImageSource<M::Layout>> {
        self.images_of(sources, self.tables_of(sources, false), on)
    }

    fn images_of(
        &self,
        sources: &[Source],
        tables: Vec<PlacedTable<M::Layout>>,
        on: Option<Window>,
    ) -> Vec<ImageSource<M::Layout>> {
        let mut tables = tables.into_iter().map(|(at, table)| ImageSource::Table(at, table));
        let direct = sources.par_iter().map(|source| {
            source.is_direct.then(|| {
                checkpoint();
                let window = on.unwrap_or_else(|| self.direct_window(source));
                let light =
                    if window.area() > 0 { self.model.direct(&source.at, window) } else { Vec::new() };
                ImageSource::Patch(window, light)
            })
        });
        let direct: Vec<_> = direct.collect();
        direct.into_iter().filter_map(|direct| direct.or_else(|| tables.next())).collect()
    }

    fn direct_window(&self, source: &Source) -> Window {
        window(self.settings(), &source.at, self.model.extent_px(&source.at))
    }

    fn table_window(&self, at: &Particle, table: &DepthTable<M::Layout>) -> Window {
        let [x, y] = table.reach(at.z_um);
        window(self.settings(), at, (x, y))
    }

    fn by_differences(&self, particle: &Particle) -> Option<Gradient> {
        let displaced = (0..3).flat_map(|axis| Gradient::displaced(particle, axis)).chain([*particle]);
        let windows = displaced.map(|displaced| self.window(&self.sources(&displaced)));
        let window = windows.fold(Window::default(), Window::joined);
        // The light is summed in f32.
        let draw = |at: &Particle| -> Vec<f32> {
            let patch = self.drawn(&self.sources(at), window);
            patch.into_iter().flat_map(|patch| patch.counts).map(|light| light as f32).collect()
        };
        (window.area() > 0).then(|| Gradient::by_differences(window, particle, draw))
    }

    /// The spheres whose tables particles need.
    fn table_keys<'a>(&self, particles: impl Iterator<Item = &'a Particle>) -> Vec<Key> {
        let mut spheres = Vec::new();
        particles.for_each(|particle| self.model.table_spheres(particle, &mut spheres));
        spheres.iter().map(|sphere| self.model.ranges().key(sphere)).collect()
    }

    /// The table of each source that has one, and the source as the table has it; missing tables, and all
    /// single images, are made in parallel.
    fn tables_of(&self, sources: &[Source], with_derivative: bool) -> Vec<PlacedTable<M::Layout>> {
        let tabled = || sources.iter().filter(|source| !source.is_direct);
        if self.is_single {
            let single = |source: &&Source| {
                checkpoint();
                (source.at, Arc::new(self.model.single(&source.at, with_derivative)))
            };
            return tabled().collect::<Vec<_>>().par_iter().map(single).collect();
        }
        let keys: Vec<Key> = tabled().map(|source| self.model.ranges().key(&source.at)).collect();
        let pairs = tabled().zip(self.get(&keys));
        pairs.map(|(source, table)| (self.model.placed(&source.at, &table.layout), table)).collect()
    }

    fn get(&self, keys: &[Key]) -> Vec<Arc<DepthTable<M::Layout>>> {
        self.tables.get(keys, &self.context, |key| self.table(key))
    }

    /// The table of a key: from the store, if there is one and it holds the table, or made.
    fn table(&self, key: Key) -> DepthTable<M::Layout> {
        let model = &self.model;
        let build = || model.build(model.ranges().span(key));
        let Some(store) = &self.context.tables else { return build() };
        let TableRanges { length_um, sizes_um } = model.ranges();
        let (name, parameters) = (model.traits().name, model.parameters());
        let whole = format!("{name} {parameters} {:?} {key:?}", [length_um, sizes_um]);
        // A table that the sensor does not cut off is kept for all sensors.
        let cut = model.cut_parameters().map(|more| format!("{whole} {more}"));
        let load = |description: &str| DepthTable::<M::Layout>::read(&store.load(description)?);
        let found = load(&whole).filter(|table| !model.is_cut(&table.layout));
        let table = found.or_else(|| load(cut.as_ref()?)).unwrap_or_else(|| {
            let table = build();
            let description = cut.as_ref().filter(|_| model.is_cut(&table.layout)).unwrap_or(&whole);
            store.save(description, &table.write());
            table
        });
        store.table_finished();
        table
    }
}

/// The drawing loop, compiled once for every instruction set.
struct Draw<'a, M: ImageModel> {
    renderer: &'a TabledRenderer<M>,
    sources: &'a [Source],
    images: &'a [ImageSource<M::Layout>],
    band: ImageBand<'a>,
}

impl<M: ImageModel> pulp::WithSimd for Draw<'_, M> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Draw { renderer, sources, images, mut band } = self;
        let idle = || renderer.pens.lock().unwrap_or_else(PoisonError::into_inner);
        let mut pen = idle().pop().unwrap_or_default();
        for (source, image) in sources.iter().zip(images) {
            let light = &source.light;
            match image {
                ImageSource::Patch(window, counts) => band.add(*window, counts, *light as f32),
                ImageSource::Table(at, table) => {
                    let window = renderer.table_window(at, table);
                    if window.width > 0 && !band.rows(&window).is_empty() {
                        let (x_px, y_px, z_um, radius_um) = (at.x_px, at.y_px, at.z_um, 0.5 * at.d_um);
                        let sphere =
                            SphereImage { table, window, x_px, y_px, z_um, radius_um, light: *light };
                        pen.add(&sphere, &mut band);
                    }
                }
            }
        }
        idle().push(pen);
    }
}

impl<M: ImageModel> Render for TabledRenderer<M> {
    fn traits(&self) -> Traits {
        self.model.traits()
    }

    fn settings(&self) -> &Settings {
        self.model.settings()
    }

    fn description(&self) -> Description {
        self.model.description()
    }

    fn check(&self, particle: &Particle) -> Result<Option<String>, Error> {
        check(&self.model, particle)
    }

    fn warning(&self) -> Option<String> {
        self.model.warning()
    }

    fn image_extent(&self, particle: &Particle) -> (f64, f64) {
        self.model.extent_px(particle)
    }

    fn patch_window(&self, particle: &Particle) -> Window {
        self.window(&self.sources(particle))
    }

    fn reaches_sensor(&self, particle: &Particle) -> bool {
        self.model.reaches_sensor(particle)
    }

    fn accepted_light(&self, particle: &Particle) -> Option<f64> {
        self.model.accepted_light(particle)
    }

    fn tables(&self) -> Option<&dyn Tables> {
        if self.is_single { None } else { Some(self) }
    }

    fn light(&self, particles: &[Particle], _: &Streams, _: Purpose, _: u32) -> Light {
        self.draw(particles)
    }

    /// Faster than an exposure of the light, because the light is not stored.
    fn image(&self, particles: &[Particle], sensor: &Sensor, random: ImageStreams<'_>) -> Image {
        self.sum(particles).exposed(sensor, random)
    }

    fn mean_patch(&self, particle: &Particle) -> Option<ExpectedPatch> {
        Some(self.patch(particle)?.scaled(particle.c_int))
    }

    /// For spheres from the tables, for spheroids by differences over half a pixel and 1 um.
    fn gradient(&self, particle: &Particle, window: Option<Window>) -> Option<Gradient> {
        let sources = self.sources(particle);
        let [Source { light, is_direct: false, .. }] = sources[..] else {
            return if window.is_none() { self.by_differences(particle) } else { None };
        };
        let (at, table) = self.tables_of(&sources, true).remove(0);
        let window = window.unwrap_or_else(|| self.table_window(&at, &table));
        let plane = table.plane_at(at.z_um, 0.5 * at.d_um, [at.x_px, at.y_px]);
        let scale = self.model.depth_scale(particle);
        let pixel = |dx: f64, dy: f64| {
            let [value, by_x, by_y, by_z] = table.layout.at(&plane, dx, dy);
            [value, by_x, by_y, scale * by_z]
        };
        (window.area() > 0).then(|| Gradient::new(window, &at, light, pixel))
    }

    fn shape_gradient(&self, particle: &Particle, window: Option<Window>) -> Option<ShapeGradient> {
        let particle = Particle { c_int: 1.0, ..*particle };
        let window = window.unwrap_or_else(|| self.patch_window(&particle));
        if window.area() == 0 {
            return None;
        }
        if let Some(light) = self.model.spheroid_light(&particle) {
            return self.shape_from_tables(&particle, &light, window);
        }
        let draw = |at: &Particle| match self.sources(at)[..] {
            [Source { at, light, is_direct: true }] => {
                let image = self.model.direct(&at, window);
                image.into_iter().map(|counts| light as f32 * counts).collect()
            }
            _ => Vec::new(),
        };
        shape::by_differences(window, &particle, draw)
    }
}

impl<M: ImageModel> TabledRenderer<M> {
    /// The sum of the images of a spheroid's emitters, with their derivatives.
    fn shape_from_tables(
        &self,
        particle: &Particle,
        of: &SpheroidLight,
        window: Window,
    ) -> Option<ShapeGradient> {
        let spheroid = particle.spheroid?;
        let (emitters, turns) = shape::emitters(particle.d_um, &spheroid, of);
        let mut sources = Vec::with_capacity(emitters.len());
        for emitter in &emitters {
            let at = of.magnification * emitter.offset_um.truncate();
            let z_um = particle.z_um + emitter.offset_um.z;
            let point = Particle::sphere(particle.x_px + at.x, particle.y_px + at.y, z_um, 0.0);
            self.model.sources(&point, 1.0, &mut sources);
        }
        let mut pixels = vec![[0.0; VALUES]; window.area()];
        for (emitter, (at, table)) in emitters.iter().zip(self.tables_of(&sources, true)) {
            checkpoint();
            self.add_emitter((particle, of), (emitter, &at, &table), window, &mut pixels);
        }
        let by_aspect = shape::light_by_aspect(spheroid.e_p);
        pixels.iter_mut().for_each(|pixel| pixel[6] += by_aspect * pixel[0]);
        Some(ShapeGradient { window, pixels, turns })
    }

    /// Adds the image of an emitter of a spheroid at `particle`, with its derivatives.
    fn add_emitter(
        &self,
        (particle, of): (&Particle, &SpheroidLight),
        (emitter, at, table): (&ShapeEmitter, &Particle, &DepthTable<M::Layout>),
        window: Window,
        pixels: &mut [[f64; VALUES]],
    ) {
        let plane = table.plane_at(at.z_um, 0.0, [at.x_px, at.y_px]);
        let scale = self.model.depth_scale(particle);
        let moved = emitter.offset_by.map(|by| (of.magnification * by.truncate()).extend(by.z));
        let (own, by_share) = (of.light * emitter.share, emitter.share_by.map(|by| of.light * by));
        let reach = table.reach(at.z_um);
        let along = |center: f64, reach: f64, first: i64, n: usize| {
            let low = (libm::ceil(center - reach) as i64 - first).clamp(0, n as i64);
            let high = (libm::floor(center + reach) as i64 - first + 1).clamp(low, n as i64);
            low as usize..high as usize
        };
        for j in along(at.y_px, reach[1], window.y0, window.height) {
            let dy = (window.y0 + j as i64) as f64 - at.y_px;
            for i in along(at.x_px, reach[0], window.x0, window.width) {
                let dx = (window.x0 + i as i64) as f64 - at.x_px;
                let [value, by_x, by_y, by_z] = table.layout.at(&plane, dx, dy);
                // Moving the emitter to the right is equivalent to moving the pixel to the left.
                let slope = DVec3::new(-by_x, -by_y, scale * by_z);
                let pixel = &mut pixels[j * window.width + i];
                pixel[0] += own * value;
                (0..3).for_each(|axis| pixel[1 + axis] += own * slope[axis]);
                for (p, moved) in moved.iter().enumerate() {
                    pixel[4 + p] += own * slope.dot(*moved) + by_share[p] * value;
                }
            }
        }
    }
}

impl<M: ImageModel> Tables for TabledRenderer<M> {
    fn missing(&self, particles: &[Particle]) -> usize {
        self.tables.missing(self.table_keys(particles.iter()).into_iter())
    }

    fn prepare(&self, particles: &[&[Particle]]) {
        self.get(&self.table_keys(particles.iter().copied().flatten()));
    }

    fn state(&self) -> TablesState {
        self.tables.state()
    }

    fn shortfall(&self) -> Result<Option<String>, Error> {
        shortfall(M::IMAGES, self.state().error, self.tolerance())
    }
}

/// [`Tables::shortfall`] of images with this largest error.
fn shortfall(images: &str, error: f64, tolerance: f64) -> Result<Option<String>, Error> {
    let errs = format!("{images} err by up to {error:.1e} of their peaks");
    if error > LARGEST_SHORTFALL * tolerance {
        return Err(Error::Unsupported(format!(
            "{errs}, more than {LARGEST_SHORTFALL} times the tolerance of {tolerance:.1e}: the optics vary too much over the \
             field for tables; use weaker aberrations, a smaller depth range or sensor, or a larger tolerance"
        )));
    }
    Ok((error > tolerance).then(|| format!("{errs}, more than the tolerance of {tolerance:.1e}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_that_miss_the_tolerance_are_warned_of_and_those_far_beyond_it_refused() {
        assert_eq!(shortfall("images", 2e-3, 3e-3).unwrap(), None);
        assert!(shortfall("images", 2.9e-2, 3e-3).unwrap().unwrap().contains("2.9e-2 of their peaks"));
        let message = shortfall("images", 0.32, 3e-3).unwrap_err().to_string();
        assert!(message.contains("more than 10 times the tolerance of 3.0e-3"), "{message}");
    }
}
