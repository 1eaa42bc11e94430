//! The truth of a dataset: position and motion of every particle, and the displacement field.

pub mod depth;
pub mod field;
mod viewer;

use flows::Scene;
use flows::frame::{Frame, Tracer};
use glam::{DMat3, DVec3};
use microsig_core::pool::BufferPool;
use microsig_core::render::Renderer;
use microsig_core::sensor::Sensor;
use microsig_core::{Particle, Spheroid};
use rayon::prelude::*;

use super::{FileHashes, frame_paths};
use depth::ParticleImage;
use microsig_core::visibility::{DepthScan, NoiseFree, Outline, Visibility, visibility};
use scenario::Scenario;
use scenario::spec::Diameter;
use storage::dataset::rows::{GRADIENT, OPTICS};
use storage::dataset::{
    BoxRow, DepthRow, DisplacementRow, FrameRow, Row, Table, TableWriter, TrackRow, write_table,
};
use storage::{OutputFolder, Result};
pub use viewer::rendered;
pub(crate) use viewer::{SeenTracer, View, Viewer};

/// The table of tracks with the columns of this scenario.
pub fn tracks(scenario: &Scenario) -> Table {
    let optional = [(GRADIENT, scenario.spec.truth.gradient), (OPTICS, scenario.spec.optics.field.is_some())];
    let parts: Vec<&str> =
        optional.into_iter().filter(|(_, is_wanted)| *is_wanted).map(|(part, _)| part).collect();
    TrackRow::table(&parts)
}

/// Writes the tables that do not belong to single frames: depth and field. `scan`: noise-free images of a
/// sphere of the mean diameter.
pub fn write(folder: &OutputFolder, scenario: &Scenario, scan: &DepthScan) -> Result<ParticleImage> {
    field::write(folder, scenario, scan)?;
    let (rows, image) = depth::measure(scenario, scan)?;
    write_table(folder, &DepthRow::table(&[]), &rows)?;
    Ok(image)
}

/// Totals over a dataset's frames, for the manifest.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Totals {
    /// Frames written.
    pub frames: u32,
    /// Visible particles, summed over frames.
    pub visible: u64,
    /// Those of them with a saturated pixel.
    pub saturated: u64,
    /// Light of all particles, summed over frames, in units of a particle of brightness 1.
    pub light: f64,
    /// Rows of displacements.csv.
    pub displacements: u64,
    /// Largest displacement of a visible particle in the image plane, px.
    pub max_displacement_px: f64,
}

impl Totals {
    /// Those of a frame.
    pub(crate) fn of(truth: &FrameTruth) -> Self {
        let farthest = |longest: f64, row: &DisplacementRow| {
            // Not hypot: this number is part of the manifest, and std maths differs between machines.
            let length_px = (row.dx_px * row.dx_px + row.dy_px * row.dy_px).sqrt();
            if row.visible_a { longest.max(length_px) } else { longest }
        };
        Totals {
            frames: 1,
            visible: truth.frame.n_visible,
            saturated: truth.tracks.iter().filter(|row| row.visible && row.saturated).count() as u64,
            light: truth.light,
            displacements: truth.displacements.len() as u64,
            max_displacement_px: truth.displacements.iter().fold(0.0, farthest),
        }
    }

    /// Adds those of further frames.
    pub(crate) fn add(&mut self, more: &Totals) {
        self.frames += more.frames;
        self.visible += more.visible;
        self.saturated += more.saturated;
        self.light += more.light;
        self.displacements += more.displacements;
        self.max_displacement_px = self.max_displacement_px.max(more.max_displacement_px);
    }
}

/// Number of tracers whose rows one task computes.
const TRACERS_PER_TASK: usize = 256;

/// Computes the truth of single frames, independently of the others.
pub struct Truth<'a> {
    scenario: &'a Scenario,
    viewer: Viewer<'a>,
    scene: Option<Scene<'a>>,
    noise_free: NoiseFree,
    sensor: Sensor,
    /// Buffers for the light of all particles of a frame.
    totals: BufferPool<Vec<f64>>,
}

/// The truth of a frame.
#[derive(Debug)]
pub struct FrameTruth {
    /// The rows of its data file.
    pub particles: Vec<Particle>,
    /// Its row of frames.csv.
    pub frame: FrameRow,
    /// Its rows of tracks.csv.
    pub tracks: Vec<TrackRow>,
    /// Its rows of displacements.csv.
    pub displacements: Vec<DisplacementRow>,
    /// Its rows of boxes.csv; empty if the scenario has no boxes.
    pub boxes: Vec<BoxRow>,
    /// Light of all particles, in units of a particle of brightness 1.
    pub light: f64,
}

impl<'a> Truth<'a> {
    /// The truth of a scenario rendered by `renderer`.
    pub fn new(scenario: &'a Scenario, renderer: &'a Renderer) -> Result<Self> {
        Ok(Truth {
            scenario,
            viewer: Viewer { scenario, renderer },
            scene: scenario.field().map(|field| scenario.scene(field)).transpose()?,
            noise_free: scenario.noise_free(),
            sensor: scenario.sensor()?,
            totals: BufferPool::default(),
        })
    }

    /// Makes the tables of the images of these frames, once for all of them.
    pub fn prepare(&self, frames: &[Frame]) {
        if self.noise_free.needs_tables() {
            let rows: Vec<Vec<Particle>> = frames.iter().map(|frame| self.viewer.rendered(frame)).collect();
            self.noise_free.prepare(&rows.iter().map(Vec::as_slice).collect::<Vec<_>>());
        }
    }

    /// The scenario.
    pub fn scenario(&self) -> &'a Scenario {
        self.scenario
    }

    /// Number of tables that images of this frame need and that are not made yet.
    pub fn missing_tables(&self, frame: &Frame) -> usize {
        self.noise_free.missing_tables(&self.viewer.rendered(frame))
    }

    /// The truth of a frame, with displacements from the previous frame if the two are linked.
    pub fn frame(&self, frame: &Frame, before: Option<&Frame>) -> Result<FrameTruth> {
        let scenario = self.scenario;
        let View { energy, seen_tracers, rendered } = self.viewer.view(frame);
        let size_px = (scenario.settings.pixel_dim_x, scenario.settings.pixel_dim_y);
        let rows: Vec<_> = seen_tracers.iter().map(|seen_tracer| seen_tracer.rows.clone()).collect();
        let mut total = self.totals.get();
        let wanted = &scenario.spec.truth;
        let share = wanted.boxes.then_some(wanted.box_share);
        let seen = visibility(&self.noise_free, &self.sensor, size_px, &rendered, &rows, share, &mut total);
        drop(total);
        let next_s = self.next_s(frame);
        let seen_by = seen_tracers.par_iter().zip(&seen).with_min_len(TRACERS_PER_TASK);
        let tracks = seen_by.clone().map(|(seen_tracer, seen)| {
            let midway = self.midway(seen_tracer.tracer, frame, next_s)?;
            Ok(self.track(frame, seen_tracer, midway, &seen.visibility))
        });
        let tracks = tracks.collect::<Result<_>>()?;
        let boxes = seen_by.filter_map(|(seen_tracer, seen)| {
            Some(box_row(scenario, frame, seen_tracer, seen.outline.as_ref()?))
        });
        let shining = seen_tracers.iter().filter(|seen_tracer| !seen_tracer.rows.is_empty()).count();
        let visible = seen_tracers.iter().filter(|seen_tracer| seen_tracer.visible).count();
        let displacements = match (before, scenario.recordings.link_to(frame.index)) {
            (Some(before), Some(pair)) => self.displacements(pair, before, frame),
            _ => Vec::new(),
        };
        Ok(FrameTruth {
            frame: self.summary(frame, energy, (shining, visible)),
            tracks,
            displacements,
            boxes: if wanted.boxes { boxes.collect() } else { Vec::new() },
            light: seen_tracers.iter().map(|seen_tracer| seen_tracer.light).sum(),
            particles: rendered,
        })
    }

    fn summary(&self, frame: &Frame, energy: f64, (shining, visible): (usize, usize)) -> FrameRow {
        let recordings = &self.scenario.recordings;
        let [particles, image] = frame_paths(recordings, frame.index);
        FrameRow {
            frame: frame.index,
            pair: recordings.pair(frame.index).map(|(pair, _)| pair),
            role: recordings.role(frame.index).map(String::from).unwrap_or_default(),
            t_s: frame.t_s,
            image,
            particles,
            n_rendered: shining as u64,
            n_visible: visible as u64,
            energy,
        }
    }

    fn track(
        &self,
        frame: &Frame,
        seen_tracer: &SeenTracer,
        midway: Option<DVec3>,
        seen: &Visibility,
    ) -> TrackRow {
        let SeenTracer { tracer, particle, visible, ref rows, light } = *seen_tracer;
        let shape = particle.spheroid.unwrap_or(Spheroid { e_p: 1.0, alpha_rad: 0.0, beta_rad: 0.0 });
        let at = tracer.position;
        // NaN for a recorded track that is in this frame only.
        let velocity = tracer.velocity.unwrap_or(DVec3::NAN);
        let midway = midway.unwrap_or(DVec3::NAN);
        let field = self.scenario.field().filter(|_| self.scenario.spec.truth.gradient);
        // A column of the matrix is a derivative of the velocity.
        let gradient = field.map_or(DMat3::NAN, |field| field.gradient(at, frame.t_s));
        let [by_x, by_y, by_z] = [gradient.x_axis, gradient.y_axis, gradient.z_axis];
        let [dx_px, dy_px, dz_um] = self.by_optics(tracer, &particle);
        TrackRow {
            frame: frame.index,
            t_s: frame.t_s,
            track: tracer.id,
            x_px: particle.x_px,
            y_px: particle.y_px,
            z_um: at.z,
            x_um: at.x,
            y_um: at.y,
            d_um: particle.d_um,
            e_p: shape.e_p,
            alpha_rad: shape.alpha_rad,
            beta_rad: shape.beta_rad,
            c_int: particle.c_int,
            u_um_s: velocity.x,
            v_um_s: velocity.y,
            w_um_s: velocity.z,
            visible,
            rendered: !rows.is_empty(),
            light,
            u_mid_um_s: midway.x,
            v_mid_um_s: midway.y,
            w_mid_um_s: midway.z,
            peak_counts: seen.peak_counts,
            snr: seen.snr,
            overlap: seen.overlap,
            saturated: seen.saturated,
            optics_dx_px: dx_px,
            optics_dy_px: dy_px,
            optics_dz_um: dz_um,
            du_dx_1_s: by_x.x,
            du_dy_1_s: by_y.x,
            du_dz_1_s: by_z.x,
            dv_dx_1_s: by_x.y,
            dv_dy_1_s: by_y.y,
            dv_dz_1_s: by_z.y,
            dw_dx_1_s: by_x.z,
            dw_dy_1_s: by_y.z,
            dw_dz_1_s: by_z.z,
        }
    }

    /// What the optics at a particle's place of the field add to its position in the image (px) and its
    /// physical depth (um).
    fn by_optics(&self, tracer: &Tracer, particle: &Particle) -> [f64; 3] {
        let Scenario { spec, settings, .. } = self.scenario;
        let field = spec.optics.field.unwrap_or_default();
        let [dx_px, dy_px, dz_um] = field.displacement(settings, particle);
        [dx_px, dy_px, self.scenario.depth_factor() * (dz_um + self.viewer.focus_scatter_um(tracer))]
    }

    /// Time of the next frame, s, if the truth links the two.
    fn next_s(&self, frame: &Frame) -> Option<f64> {
        let (recordings, next) = (&self.scenario.recordings, frame.index + 1);
        let is_linked = next % recordings.frames_each() != 0 && recordings.link_to(next).is_some();
        is_linked.then(|| recordings.time_s(next, self.scenario.streams))
    }

    /// The velocity halfway in time to the next linked frame, um/s; none without such a frame, or for
    /// recorded tracks.
    fn midway(&self, tracer: &Tracer, frame: &Frame, next_s: Option<f64>) -> Result<Option<DVec3>> {
        let (Some(scene), Some(next_s)) = (&self.scene, next_s) else { return Ok(None) };
        Ok(Some(scene.velocity_at_mid_time(tracer, frame.t_s, next_s)?))
    }

    fn displacements(&self, pair: u32, a: &Frame, b: &Frame) -> Vec<DisplacementRow> {
        let links: Vec<_> = a.links(b).collect();
        let links = links.into_par_iter().with_min_len(TRACERS_PER_TASK);
        links.map(|(from, to)| self.displacement((pair, a.index, b.index), from, to)).collect()
    }

    fn displacement(
        &self,
        (pair, frame_a, frame_b): (u32, u32, u32),
        from: &Tracer,
        to: &Tracer,
    ) -> DisplacementRow {
        let scale = &self.scenario.scale;
        let (start, end) = (self.viewer.particle(from), self.viewer.particle(to));
        // The tracer's own displacement is continuous across a periodic boundary, where its position jumps.
        let moved = to.step.map_or(to.position - from.position, |step| step.actual);
        let drift = to.step.map_or(moved, |step| step.drift);
        let (d, d_drift) = (scale.displacement_to_image(moved), scale.displacement_to_image(drift));
        DisplacementRow {
            pair,
            frame_a,
            frame_b,
            track: from.id,
            x_px: start.x_px,
            y_px: start.y_px,
            z_um: from.position.z,
            dx_px: d.dx_px,
            dy_px: d.dy_px,
            dz_um: moved.z,
            drift_dx_px: d_drift.dx_px,
            drift_dy_px: d_drift.dy_px,
            drift_dz_um: drift.z,
            visible_a: self.viewer.is_visible(&start),
            visible_b: self.viewer.is_visible(&end),
        }
    }
}

/// The row of boxes.csv of a particle image.
fn box_row(scenario: &Scenario, frame: &Frame, seen_tracer: &SeenTracer, outline: &Outline) -> BoxRow {
    let settings = &scenario.settings;
    let pixels = settings.pixel_dim_x as usize * settings.pixel_dim_y as usize;
    // Pixels are counted from 1; a box of one pixel has its middle in that pixel.
    let middle = |first: usize, size: usize| first as f64 + 0.5 * (size as f64 + 1.0);
    let ((left, top), (width, height)) = (outline.corner, outline.size);
    BoxRow {
        frame: frame.index,
        track: seen_tracer.tracer.id,
        x_px: middle(left, width),
        y_px: middle(top, height),
        w_px: width as u32,
        h_px: height as u32,
        area_px: outline.area as u32,
        z_um: seen_tracer.tracer.position.z,
        class: size_class(scenario, seen_tracer.particle.d_um) as u32,
        hidden: outline.hidden,
        visible: seen_tracer.visible,
        mask: outline.mask.text(pixels),
    }
}

/// The number of a diameter in the list of diameters of a scenario, otherwise 0.
pub(crate) fn size_class(scenario: &Scenario, d_um: f64) -> usize {
    match &scenario.spec.particles.diameter_um {
        Some(Diameter::List(list)) => list.iter().position(|(d, _)| *d == d_um).unwrap_or(0),
        _ => 0,
    }
}

/// Number of rows that one task writes.
const ROWS_PER_TASK: usize = 1024;

/// The rows of a frame as CSV, and its totals.
pub(crate) struct FrameText {
    frame: String,
    tracks: Vec<String>,
    displacements: Vec<String>,
    boxes: Vec<String>,
    totals: Totals,
}

impl FrameText {
    /// The text of a frame's truth.
    pub(crate) fn of(scenario: &Scenario, truth: &FrameTruth) -> Self {
        let FrameTruth { frame, tracks, displacements, boxes, .. } = truth;
        FrameText {
            frame: FrameRow::table(&[]).text(std::slice::from_ref(frame)),
            tracks: texts(&self::tracks(scenario), tracks),
            displacements: texts(&DisplacementRow::table(&[]), displacements),
            boxes: texts(&BoxRow::table(&[]), boxes),
            totals: Totals::of(truth),
        }
    }

    /// Number of visible particles.
    pub(crate) fn visible(&self) -> u64 {
        self.totals.visible
    }
}

fn texts<R: Row + Sync>(table: &Table, rows: &[R]) -> Vec<String> {
    rows.par_chunks(ROWS_PER_TASK).map(|rows| table.text(rows)).collect()
}

/// Writes the tables of the truth, frame after frame.
pub(crate) struct TruthWriter {
    frames: TableWriter,
    tracks: TableWriter,
    displacements: TableWriter,
    boxes: Option<TableWriter>,
    totals: Totals,
}

impl TruthWriter {
    /// Starts the tables in a dataset's folder.
    pub(crate) fn create(folder: &OutputFolder, scenario: &Scenario) -> Result<Self> {
        let start = |table: &Table| TableWriter::create(folder, table);
        Ok(TruthWriter {
            frames: start(&FrameRow::table(&[]))?,
            tracks: start(&tracks(scenario))?,
            displacements: start(&DisplacementRow::table(&[]))?,
            boxes: scenario.spec.truth.boxes.then(|| start(&BoxRow::table(&[]))).transpose()?,
            totals: Totals::default(),
        })
    }

    /// Writes the next frame.
    pub(crate) fn add(&mut self, text: &FrameText) -> Result<()> {
        self.frames.append(&text.frame)?;
        text.tracks.iter().try_for_each(|rows| self.tracks.append(rows))?;
        text.displacements.iter().try_for_each(|rows| self.displacements.append(rows))?;
        if let Some(boxes) = &mut self.boxes {
            text.boxes.iter().try_for_each(|rows| boxes.append(rows))?;
        }
        self.totals.add(&text.totals);
        Ok(())
    }

    /// Finishes the tables and adds them to the hashes.
    pub(crate) fn finish(self, hashes: &mut FileHashes) -> Result<Totals> {
        hashes.others.insert(FrameRow::PATH, self.frames.seal()?);
        hashes.others.insert(TrackRow::PATH, self.tracks.seal()?);
        hashes.others.insert(DisplacementRow::PATH, self.displacements.seal()?);
        if let Some(boxes) = self.boxes {
            hashes.others.insert(BoxRow::PATH, boxes.seal()?);
        }
        Ok(self.totals)
    }
}
