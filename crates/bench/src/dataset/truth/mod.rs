//! The truth of a dataset: where every particle is, and how it moves.

pub mod depth;
pub mod field;
mod tables;

pub use tables::{DISPLACEMENTS, FRAMES, TRACKS};

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use flows::Scene;
use flows::exposure::Streak;
use flows::sequence::{Frame, Tracer};
use glam::DVec3;
use microsig_core::render::Renderer;
use microsig_core::sensor::Sensor;
use microsig_core::{Particle, Spheroid};
use rayon::prelude::*;

use super::Stem;
use super::table::Table;
use super::table::TableWriter;
use crate::error::Result;
use crate::light::{NoiseFree, Seen, look};
use crate::scenario::Scenario;

/// The table of tracks with the columns that this scenario asks for.
pub fn tracks(scenario: &Scenario) -> Table {
    TRACKS.clone().with(&tables::GRADIENT, scenario.spec.truth.gradient)
}

/// A tracer as the optics see it. Where there are spheroids, one of aspect ratio 1 is a spheroid too: the laws of emission
/// differ.
fn particle(tracer: &Tracer, scenario: &Scenario) -> Particle {
    let at = scenario.scale.to_image(tracer.position);
    Particle {
        spheroid: scenario
            .layout
            .spheroids
            .then(|| Spheroid::from_axis(tracer.aspect, tracer.axis.to_array())),
        c_int: tracer.c_int,
        ..Particle::sphere(at.x_px, at.y_px, at.z_um, tracer.d_um)
    }
}

/// Counts of a dataset's frames that the manifest tells.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Census {
    /// Frames written.
    pub frames: u32,
    /// Visible particles, summed over frames.
    pub visible: u64,
    /// Rows of displacements.csv.
    pub displacements: u64,
    /// Visible particles of each frame.
    pub visible_each: Vec<u64>,
    /// Largest displacement of a visible particle in the image plane, px.
    pub max_displacement_px: f64,
}

/// Fewest tracers that are worth a thread.
const TRACERS_PER_TASK: usize = 64;

/// Writes the tables of the truth, frame after frame.
pub struct TruthWriter<'a> {
    scenario: &'a Scenario,
    renderer: &'a Renderer,
    frames: TableWriter<BufWriter<File>>,
    tracks: TableWriter<BufWriter<File>>,
    displacements: TableWriter<BufWriter<File>>,
    census: Census,
    scene: Option<Scene<'a>>,
    noise_free: NoiseFree,
    sensor: Sensor,
    /// Times of the frames of the recording, s.
    times_s: Vec<f64>,
    began_s: f64,
}

impl<'a> TruthWriter<'a> {
    /// Begins the tables in a dataset's folder.
    pub fn new(folder: &Path, scenario: &'a Scenario, renderer: &'a Renderer) -> Result<Self> {
        Ok(TruthWriter {
            scenario,
            renderer,
            frames: TableWriter::create(folder, &FRAMES)?,
            tracks: TableWriter::create(folder, &tracks(scenario))?,
            displacements: TableWriter::create(folder, &DISPLACEMENTS)?,
            census: Census::default(),
            scene: scenario.field().map(|field| scenario.scene(field)).transpose()?,
            noise_free: scenario.noise_free()?,
            sensor: scenario.sensor()?,
            times_s: Vec::new(),
            began_s: 0.0,
        })
    }

    /// Writes a frame, and its displacements from the frame before it if truth links the two. Gives the rows of its data
    /// file.
    pub fn frame(&mut self, frame: &Frame, before: Option<&Frame>) -> Result<Vec<Particle>> {
        let scenario = self.scenario;
        let (recordings, stem) = (&scenario.recordings, Stem::of(&scenario.recordings, frame.index));
        let energy = self.energy(frame);
        let mut rendered = Vec::new();
        let mut lights = Vec::with_capacity(frame.tracers.len());
        let mut rows = Vec::with_capacity(frame.tracers.len());
        for (i, tracer) in frame.tracers.iter().enumerate() {
            let first = rendered.len();
            lights.push(energy * self.rows(tracer, frame.streaks.get(i), energy, &mut rendered));
            rows.push(first..rendered.len());
        }
        let size_px = (scenario.settings.pixel_dim_x, scenario.settings.pixel_dim_y);
        let seen = look(&self.noise_free, &self.sensor, size_px, &rendered, &rows);
        let midway = self.midway(frame)?;
        let (mut n_rendered, mut n_visible) = (0u32, 0);
        for (i, tracer) in frame.tracers.iter().enumerate() {
            let (particle, shines) = (particle(tracer, scenario), !rows[i].is_empty());
            let visible = self.visible(&particle);
            n_rendered += u32::from(shines);
            n_visible += u64::from(visible);
            self.track(frame, tracer, &particle, (visible, shines, lights[i]), midway[i], seen[i])?;
        }
        self.frames.row(&[
            &frame.index,
            &recordings.pair(frame.index).map(|(pair, _)| pair.to_string()).unwrap_or_default(),
            &recordings.role(frame.index).map(String::from).unwrap_or_default(),
            &frame.t_s,
            &stem.image(),
            &stem.particles(),
            &n_rendered,
            &n_visible,
            &energy,
        ])?;
        self.census.frames += 1;
        self.census.visible += n_visible;
        self.census.visible_each.push(n_visible);
        if let (Some(before), Some(pair)) = (before, recordings.link_to(frame.index)) {
            self.displacements(pair, before, frame)?;
        }
        Ok(rendered)
    }

    /// Writes a row of tracks.csv.
    fn track(
        &mut self,
        frame: &Frame,
        tracer: &Tracer,
        particle: &Particle,
        (visible, shines, light): (bool, bool, f64),
        midway: Option<DVec3>,
        seen: Seen,
    ) -> Result<()> {
        let shape = particle.spheroid.unwrap_or(Spheroid { e_p: 1.0, alpha_rad: 0.0, beta_rad: 0.0 });
        let at = tracer.position;
        self.tracks.cells(&[&frame.index])?;
        self.tracks.numbers(&[frame.t_s])?;
        self.tracks.cells(&[&tracer.id])?;
        self.tracks.numbers(&[particle.x_px, particle.y_px, at.z, at.x, at.y, particle.d_um])?;
        self.tracks.numbers(&[shape.e_p, shape.alpha_rad, shape.beta_rad, particle.c_int])?;
        // Unknown for a recorded track that is in this frame only.
        self.tracks.numbers(&tracer.velocity.unwrap_or(DVec3::NAN).to_array())?;
        self.tracks.cells(&[&u8::from(visible), &u8::from(shines)])?;
        self.tracks.numbers(&[light])?;
        self.tracks.numbers(&midway.unwrap_or(DVec3::NAN).to_array())?;
        self.tracks.numbers(&[seen.peak_counts, seen.snr, seen.overlap])?;
        self.tracks.cells(&[&u8::from(seen.saturated)])?;
        if let Some(field) = self.scenario.field().filter(|_| self.scenario.spec.truth.gradient) {
            // glam stores columns; a row of the gradient is that of one velocity.
            self.tracks.numbers(&field.gradient(at, frame.t_s).transpose().to_cols_array())?;
        }
        self.tracks.end_row()
    }

    /// Velocities half-way to the next frame of the pair; none in the last frame, or for recorded tracks.
    fn midway(&mut self, frame: &Frame) -> Result<Vec<Option<DVec3>>> {
        let (recordings, streams) = (&self.scenario.recordings, self.scenario.streams);
        let number = frame.index % recordings.frames_each();
        if number == 0 {
            self.times_s = recordings.times_s(frame.index / recordings.frames_each(), streams);
        }
        let next_s =
            self.times_s.get(number as usize + 1).filter(|_| recordings.link_to(frame.index + 1).is_some());
        let (Some(scene), Some(&next_s)) = (&self.scene, next_s) else {
            return Ok(vec![None; frame.tracers.len()]);
        };
        let found: flows::Result<Vec<_>> = frame
            .tracers
            .par_iter()
            .with_min_len(TRACERS_PER_TASK)
            .map(|tracer| scene.velocity_midway(tracer, frame.t_s, next_s).map(Some))
            .collect();
        Ok(found?)
    }

    /// The factor on the light of a frame. Bleaching begins with the first frame of each recording.
    fn energy(&mut self, frame: &Frame) -> f64 {
        let number = frame.index % self.scenario.recordings.frames_each();
        if number == 0 {
            self.began_s = frame.t_s;
        }
        let (light, streams) = (&self.scenario.illumination, self.scenario.streams);
        light.energy(frame.index, number, frame.t_s - self.began_s, streams)
    }

    /// Adds a particle's rows of the data file, one for every point of its streak, as far as their light may reach the
    /// sensor. Gives the factor of the illumination at the particle.
    fn rows(&self, tracer: &Tracer, streak: Option<&Streak>, energy: f64, rows: &mut Vec<Particle>) -> f64 {
        let light = |x: DVec3| self.scenario.illumination.at(x);
        let mut add = |row: Particle| {
            if row.c_int > 0.0 && self.renderer.reaches_sensor(&row) {
                rows.push(row);
            }
        };
        match streak {
            None => {
                let whole = particle(tracer, self.scenario);
                add(Particle { c_int: whole.c_int * energy * light(tracer.position), ..whole });
            }
            Some(streak) => {
                for point in &streak.points {
                    let moved = Tracer { position: point.position, axis: point.axis, ..*tracer };
                    let part = particle(&moved, self.scenario);
                    let share = energy * light(point.position) * streak.share;
                    add(Particle { c_int: part.c_int * share, ..part });
                }
            }
        }
        light(tracer.position)
    }

    fn displacements(&mut self, pair: u32, a: &Frame, b: &Frame) -> Result<()> {
        let scale = &self.scenario.scale;
        for (from, to) in a.links(b) {
            let (start, end) = (particle(from, self.scenario), particle(to, self.scenario));
            // The tracer's own account of its way: through a periodic face it goes on where positions jump.
            let moved = to.step.map_or(to.position - from.position, |step| step.actual);
            let drift = to.step.map_or(moved, |step| step.drift);
            let (d, d_drift) = (scale.displacement_to_image(moved), scale.displacement_to_image(drift));
            let (visible_a, visible_b) = (self.visible(&start), self.visible(&end));
            self.displacements.cells(&[&pair, &a.index, &b.index, &from.id])?;
            self.displacements.numbers(&[start.x_px, start.y_px, from.position.z])?;
            self.displacements.numbers(&[
                d.dx_px,
                d.dy_px,
                moved.z,
                d_drift.dx_px,
                d_drift.dy_px,
                drift.z,
            ])?;
            self.displacements.cells(&[&u8::from(visible_a), &u8::from(visible_b)])?;
            self.displacements.end_row()?;
            self.census.displacements += 1;
            if visible_a {
                // Not hypot: this number is part of the manifest, and std maths differs between machines.
                let length = (d.dx_px * d.dx_px + d.dy_px * d.dy_px).sqrt();
                self.census.max_displacement_px = self.census.max_displacement_px.max(length);
            }
        }
        Ok(())
    }

    fn visible(&self, particle: &Particle) -> bool {
        let on = |x: f64, size: u32| x >= 0.5 && x < f64::from(size) + 0.5;
        let settings = &self.scenario.settings;
        on(particle.x_px, settings.pixel_dim_x) && on(particle.y_px, settings.pixel_dim_y)
    }

    /// Ends the tables.
    pub fn finish(self) -> Result<Census> {
        self.frames.finish()?;
        self.tracks.finish()?;
        self.displacements.finish()?;
        Ok(self.census)
    }
}
