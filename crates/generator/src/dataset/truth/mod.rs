//! The truth of a dataset: position and motion of every particle, and the displacement field.

mod boxes;
pub mod depth;
pub mod field;
mod viewer;

use std::io::Write;
use std::path::Path;

use flows::Scene;
use flows::frame::{Frame, Tracer};
use glam::DVec3;
use microsig_core::pool::BufferPool;
use microsig_core::render::Renderer;
use microsig_core::sensor::Sensor;
use microsig_core::{Particle, Spheroid};
use rayon::prelude::*;

use super::{Ledger, Stem};
pub(crate) use boxes::size_class;
use depth::ParticleImage;
use scenario::Scenario;
use storage::error::Result;
use storage::tables::truth::{BOXES, DISPLACEMENTS, FRAMES, GRADIENT, TRACKS};
use storage::tables::{Rows, Table, TableFile, TableSink, TableWriter};
pub use viewer::rendered;
pub(crate) use viewer::{Sight, View, Viewer};
use visibility::{DepthScan, NoiseFree, TracerImage, Visibility, visibility};

/// The table of tracks with the columns of this scenario.
pub fn tracks(scenario: &Scenario) -> Table {
    TRACKS.clone().with(&GRADIENT, scenario.spec.truth.gradient)
}

/// Writes the tables that do not belong to single frames: depth and field. `scan`: noise-free images of a
/// sphere of the mean diameter.
///
/// # Errors
/// Settings that cannot be rendered; writing.
pub fn write(folder: &Path, scenario: &Scenario, scan: &DepthScan) -> Result<ParticleImage> {
    field::write(folder, scenario, scan)?;
    depth::write(folder, scenario, scan)
}

/// Totals over a dataset's frames, for the manifest.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Census {
    /// Frames written.
    pub frames: u32,
    /// Visible particles, summed over frames.
    pub visible: u64,
    /// Those of them with a saturated pixel.
    pub saturated: u64,
    /// Light of all particles, summed over frames, in that of a particle of brightness 1.
    pub light: f64,
    /// Rows of displacements.csv.
    pub displacements: u64,
    /// Largest displacement of a visible particle in the image plane, px.
    pub max_displacement_px: f64,
}

/// Number of tracers whose rows one task computes.
const TRACERS_PER_TASK: usize = 256;

/// Computes the truth of single frames, independently of the others.
pub struct Truth<'a> {
    scenario: &'a Scenario,
    viewer: Viewer<'a>,
    tracks: Table,
    scene: Option<Scene<'a>>,
    noise_free: NoiseFree,
    sensor: Sensor,
    /// Buffers for the light of all particles of a frame.
    totals: BufferPool<Vec<f64>>,
    /// Buffers for the text of rows.
    texts: BufferPool<String>,
}

/// The truth of a frame.
#[derive(Debug)]
pub struct FrameTruth {
    /// The rows of its data file.
    pub particles: Vec<Particle>,
    frame: Rows,
    tracks: Vec<Rows>,
    displacements: Vec<Rows>,
    /// Empty if the scenario has no boxes.
    boxes: Vec<Rows>,
    /// Number of visible particles.
    pub visible: u64,
    /// Those of them with a saturated pixel.
    pub saturated: u64,
    /// Light of all particles, in that of a particle of brightness 1.
    pub light: f64,
    moved: DisplacementTotals,
}

/// Totals over displacements.
#[derive(Debug, Clone, Copy, Default)]
struct DisplacementTotals {
    number: u64,
    /// Largest displacement of a visible particle in the image plane, px.
    farthest_px: f64,
}

impl<'a> Truth<'a> {
    /// The truth of a scenario rendered by `renderer`.
    ///
    /// # Errors
    /// Settings that cannot be rendered.
    pub fn new(scenario: &'a Scenario, renderer: &'a Renderer) -> Result<Self> {
        Ok(Truth {
            scenario,
            viewer: Viewer { scenario, renderer },
            tracks: tracks(scenario),
            scene: scenario.field().map(|field| scenario.scene(field)).transpose()?,
            noise_free: scenario.noise_free(),
            sensor: scenario.sensor()?,
            totals: BufferPool::default(),
            texts: BufferPool::default(),
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
    ///
    /// # Errors
    /// A trajectory that cannot be integrated.
    pub fn frame(&self, frame: &Frame, before: Option<&Frame>) -> Result<FrameTruth> {
        let scenario = self.scenario;
        let View { energy, sights, rendered } = self.viewer.view(frame);
        let size_px = (scenario.settings.pixel_dim_x, scenario.settings.pixel_dim_y);
        let rows: Vec<_> = sights.iter().map(|sight| sight.rows.clone()).collect();
        let mut total = self.totals.get();
        let wanted = &scenario.spec.truth;
        let share = wanted.boxes.then_some(wanted.box_share);
        let seen = visibility(&self.noise_free, &self.sensor, size_px, &rendered, &rows, share, &mut total);
        drop(total);
        let next_s = self.next_s(frame);
        let tracks = sights.par_chunks(TRACERS_PER_TASK).zip(seen.par_chunks(TRACERS_PER_TASK));
        let tracks = tracks.map(|(sights, seen)| {
            let mut rows = Rows::on(&self.tracks, self.texts.take());
            for (sight, seen) in sights.iter().zip(seen) {
                let midway = self.midway(sight.tracer, frame, next_s)?;
                self.track(&mut rows, frame, sight, midway, &seen.visibility)?;
            }
            Ok(rows)
        });
        let tracks = tracks.collect::<Result<_>>()?;
        let boxes = if wanted.boxes { self.boxes(frame, &sights, &seen)? } else { Vec::new() };
        let shining = sights.iter().filter(|sight| !sight.rows.is_empty()).count();
        let visible = sights.iter().filter(|sight| sight.visible).count();
        let saturated =
            sights.iter().zip(&seen).filter(|(sight, seen)| sight.visible && seen.visibility.saturated);
        let saturated = saturated.count();
        let (displacements, moved) = match (before, scenario.recordings.link_to(frame.index)) {
            (Some(before), Some(pair)) => self.displacements(pair, before, frame)?,
            _ => Default::default(),
        };
        Ok(FrameTruth {
            particles: rendered,
            frame: self.summary(frame, energy, (shining, visible))?,
            tracks,
            displacements,
            boxes,
            visible: visible as u64,
            saturated: saturated as u64,
            light: sights.iter().map(|sight| sight.light).sum(),
            moved,
        })
    }

    /// Takes back the truth of a written frame to reuse its memory.
    pub fn put(&self, truth: FrameTruth) {
        let rows = truth.tracks.into_iter().chain(truth.displacements).chain(truth.boxes);
        rows.for_each(|rows| self.texts.put(rows.into_text()));
    }

    /// The rows of boxes.csv.
    fn boxes(&self, frame: &Frame, sights: &[Sight], seen: &[TracerImage]) -> Result<Vec<Rows>> {
        let parts = sights.par_chunks(TRACERS_PER_TASK).zip(seen.par_chunks(TRACERS_PER_TASK));
        let parts = parts.map(|(sights, seen)| {
            let mut rows = Rows::on(&BOXES, self.texts.take());
            for (sight, seen) in sights.iter().zip(seen) {
                if let Some(outline) = &seen.outline {
                    boxes::row(&mut rows, self.scenario, frame, sight, outline)?;
                }
            }
            Ok(rows)
        });
        parts.collect()
    }

    /// The row of frames.csv.
    fn summary(&self, frame: &Frame, energy: f64, (shining, visible): (usize, usize)) -> Result<Rows> {
        let recordings = &self.scenario.recordings;
        let (stem, mut row) = (Stem::of(recordings, frame.index), Rows::of(&FRAMES));
        row.cells(&[
            &frame.index,
            &recordings.pair(frame.index).map(|(pair, _)| pair.to_string()).unwrap_or_default(),
            &recordings.role(frame.index).map(String::from).unwrap_or_default(),
            &frame.t_s,
            &stem.image(),
            &stem.particles(),
            &shining,
            &visible,
            &energy,
        ]);
        row.end_row()?;
        Ok(row)
    }

    /// Writes a row of tracks.csv.
    fn track(
        &self,
        row: &mut Rows,
        frame: &Frame,
        sight: &Sight,
        midway: Option<DVec3>,
        seen: &Visibility,
    ) -> Result<()> {
        let Sight { tracer, particle, visible, ref rows, light } = *sight;
        let shape = particle.spheroid.unwrap_or(Spheroid { e_p: 1.0, alpha_rad: 0.0, beta_rad: 0.0 });
        let at = tracer.position;
        row.whole_numbers(&[u64::from(frame.index)]);
        row.numbers(&[frame.t_s]);
        row.whole_numbers(&[tracer.id]);
        row.numbers(&[particle.x_px, particle.y_px, at.z, at.x, at.y, particle.d_um]);
        row.numbers(&[shape.e_p, shape.alpha_rad, shape.beta_rad, particle.c_int]);
        // NaN for a recorded track that is in this frame only.
        row.numbers(&tracer.velocity.unwrap_or(DVec3::NAN).to_array());
        row.whole_numbers(&[u64::from(visible), u64::from(!rows.is_empty())]);
        row.numbers(&[light]);
        row.numbers(&midway.unwrap_or(DVec3::NAN).to_array());
        row.numbers(&[seen.peak_counts, seen.snr, seen.overlap]);
        row.whole_numbers(&[u64::from(seen.saturated)]);
        if let Some(field) = self.scenario.field().filter(|_| self.scenario.spec.truth.gradient) {
            // glam stores columns; a row of the gradient is that of one velocity.
            row.numbers(&field.gradient(at, frame.t_s).transpose().to_cols_array());
        }
        row.end_row()
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

    /// The rows of displacements.csv.
    fn displacements(&self, pair: u32, a: &Frame, b: &Frame) -> Result<(Vec<Rows>, DisplacementTotals)> {
        let links: Vec<_> = a.links(b).collect();
        let parts = links.par_chunks(TRACERS_PER_TASK).map(|links| {
            let (mut rows, mut moved) =
                (Rows::on(&DISPLACEMENTS, self.texts.take()), DisplacementTotals::default());
            for (from, to) in links {
                self.displacement(&mut rows, &mut moved, (pair, a.index, b.index), from, to)?;
            }
            Ok((rows, moved))
        });
        let parts: Vec<(Rows, DisplacementTotals)> = parts.collect::<Result<_>>()?;
        let all = parts.iter().fold(DisplacementTotals::default(), |all, (_, part)| all.and(*part));
        Ok((parts.into_iter().map(|(rows, _)| rows).collect(), all))
    }

    fn displacement(
        &self,
        row: &mut Rows,
        so_far: &mut DisplacementTotals,
        (pair, a, b): (u32, u32, u32),
        from: &Tracer,
        to: &Tracer,
    ) -> Result<()> {
        let scale = &self.scenario.scale;
        let (start, end) = (self.viewer.particle(from), self.viewer.particle(to));
        // The tracer's own displacement is continuous across a periodic boundary, where its position jumps.
        let moved = to.step.map_or(to.position - from.position, |step| step.actual);
        let drift = to.step.map_or(moved, |step| step.drift);
        let (d, d_drift) = (scale.displacement_to_image(moved), scale.displacement_to_image(drift));
        let (visible_a, visible_b) = (self.viewer.is_visible(&start), self.viewer.is_visible(&end));
        row.whole_numbers(&[u64::from(pair), u64::from(a), u64::from(b), from.id]);
        row.numbers(&[start.x_px, start.y_px, from.position.z]);
        row.numbers(&[d.dx_px, d.dy_px, moved.z, d_drift.dx_px, d_drift.dy_px, drift.z]);
        row.whole_numbers(&[u64::from(visible_a), u64::from(visible_b)]);
        // Not hypot: this number is part of the manifest, and std maths differs between machines.
        let length_px = (d.dx_px * d.dx_px + d.dy_px * d.dy_px).sqrt();
        *so_far = so_far
            .and(DisplacementTotals { number: 1, farthest_px: if visible_a { length_px } else { 0.0 } });
        row.end_row()
    }
}

impl DisplacementTotals {
    fn and(self, other: Self) -> Self {
        DisplacementTotals {
            number: self.number + other.number,
            farthest_px: self.farthest_px.max(other.farthest_px),
        }
    }
}

/// Writes the tables of the truth, frame after frame.
pub struct TruthWriter<W: Write> {
    frames: TableWriter<W>,
    tracks: TableWriter<W>,
    displacements: TableWriter<W>,
    boxes: Option<TableWriter<W>>,
    census: Census,
}

impl<W: Write> TruthWriter<W> {
    /// Starts the tables; `writer` returns the writer of a table.
    ///
    /// # Errors
    /// Writing.
    pub fn new(
        scenario: &Scenario,
        mut writer: impl FnMut(&Table) -> Result<TableWriter<W>>,
    ) -> Result<Self> {
        Ok(TruthWriter {
            frames: writer(&FRAMES)?,
            tracks: writer(&tracks(scenario))?,
            displacements: writer(&DISPLACEMENTS)?,
            boxes: scenario.spec.truth.boxes.then(|| writer(&BOXES)).transpose()?,
            census: Census::default(),
        })
    }

    /// Writes the next frame.
    ///
    /// # Errors
    /// Writing.
    pub fn add(&mut self, truth: &FrameTruth) -> Result<()> {
        self.frames.append(&truth.frame)?;
        truth.tracks.iter().try_for_each(|rows| self.tracks.append(rows))?;
        truth.displacements.iter().try_for_each(|rows| self.displacements.append(rows))?;
        if let Some(boxes) = &mut self.boxes {
            truth.boxes.iter().try_for_each(|rows| boxes.append(rows))?;
        }
        let (census, DisplacementTotals { number, farthest_px }) = (&mut self.census, truth.moved);
        census.frames += 1;
        census.visible += truth.visible;
        census.saturated += truth.saturated;
        census.light += truth.light;
        census.displacements += number;
        census.max_displacement_px = census.max_displacement_px.max(farthest_px);
        Ok(())
    }
}

impl TruthWriter<TableSink> {
    /// Starts the tables in a dataset's folder.
    ///
    /// # Errors
    /// Writing.
    pub fn create(folder: &Path, scenario: &Scenario) -> Result<Self> {
        TruthWriter::new(scenario, |table| TableFile::create(folder, table))
    }

    /// Finishes the tables and adds them to the ledger.
    ///
    /// # Errors
    /// Writing.
    pub(crate) fn finish(self, ledger: &mut Ledger) -> Result<Census> {
        ledger.add(FRAMES.path, self.frames.seal()?);
        ledger.add(TRACKS.path, self.tracks.seal()?);
        ledger.add(DISPLACEMENTS.path, self.displacements.seal()?);
        if let Some(boxes) = self.boxes {
            ledger.add(BOXES.path, boxes.seal()?);
        }
        Ok(self.census)
    }
}

impl TruthWriter<Vec<u8>> {
    /// The tables of these frames as CSV.
    ///
    /// # Errors
    /// None for frames of this scenario.
    pub fn in_memory<'f>(
        scenario: &Scenario,
        frames: impl Iterator<Item = &'f FrameTruth>,
    ) -> Result<Vec<(Table, Vec<u8>)>> {
        let mut writer = TruthWriter::new(scenario, |table| TableWriter::new(table, Vec::new()))?;
        for frame in frames {
            writer.add(frame)?;
        }
        let mut tables = vec![
            (FRAMES.clone(), writer.frames.into_writer()?),
            (tracks(scenario), writer.tracks.into_writer()?),
            (DISPLACEMENTS.clone(), writer.displacements.into_writer()?),
        ];
        if let Some(boxes) = writer.boxes {
            tables.push((BOXES.clone(), boxes.into_writer()?));
        }
        Ok(tables)
    }
}
