//! The truth of a dataset: where every particle is, and how it moves.

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use flows::exposure::Streak;
use flows::sequence::{Frame, Tracer};
use glam::DVec3;
use microsig_core::render::Renderer;
use microsig_core::{Particle, Spheroid};

use super::Stem;
use super::table::{Column, Table, TableWriter, column};
use crate::error::{Error, Result};
use crate::scenario::Scenario;

/// One row per frame.
pub const FRAMES: Table = Table {
    path: "truth/frames.csv",
    description: "One row per frame.",
    columns: &[
        FRAME,
        column("pair", "integer", "", "pair of a pair recording, else empty"),
        column("role", "string", "", "a or b of a pair recording, a to d of a burst of four, else empty"),
        T_S,
        column("image", "string", "", "path of the image"),
        column("particles", "string", "", "path of the MicroSIG data file"),
        column("n_rendered", "integer", "", "particles in the data file"),
        column("n_visible", "integer", "", "particles whose centre is on the sensor"),
        column(
            "energy",
            "number",
            "",
            "factor on the light of this frame: energy of its pulse and bleaching",
        ),
    ],
};

/// One row per particle and frame.
pub const TRACKS: Table = Table {
    path: "truth/tracks.csv",
    description: "One row per particle and frame, also of particles that are not on the sensor.",
    columns: &[
        FRAME,
        T_S,
        TRACK,
        column("x_px", "number", "px", "column of the centre; the first pixel's centre is 1"),
        column("y_px", "number", "px", "row of the centre, downward; the first pixel's centre is 1"),
        column("z_um", "number", "um", "physical depth of the centre, growing away from the lens"),
        column("x_um", "number", "um", "centre in object space, from the middle of the image"),
        column("y_um", "number", "um", "centre in object space, from the middle of the image, downward"),
        column("d_um", "number", "um", "diameter; of a spheroid the equatorial one"),
        column("e_p", "number", "", "aspect ratio; 1 for a sphere"),
        column("alpha_rad", "number", "rad", "orientation as in MicroSIG's data file"),
        column("beta_rad", "number", "rad", "orientation as in MicroSIG's data file"),
        column(
            "c_int",
            "number",
            "",
            "factor on the particle's brightness, that of the illumination left out",
        ),
        column(
            "u_um_s",
            "number",
            "um/s",
            "velocity of the particle along x at this place and time, or its mean over the exposure",
        ),
        column("v_um_s", "number", "um/s", "velocity along y"),
        column("w_um_s", "number", "um/s", "velocity along z"),
        column("visible", "integer", "", "1 if the centre is on the sensor"),
        column(
            "rendered",
            "integer",
            "",
            "1 if the particle is in the data file: some of its light may reach the sensor",
        ),
        column(
            "light",
            "number",
            "",
            "factor of the illumination and of this frame's pulse; the data file has c_int times this",
        ),
    ],
};

/// One row per particle that is there in both frames of a pair.
pub const DISPLACEMENTS: Table = Table {
    path: "truth/displacements.csv",
    description: "One row per particle that is in both frames of a pair; in a sequence pair k is frames k and k + 1.",
    columns: &[
        column("pair", "integer", "", "number of the pair"),
        column("frame_a", "integer", "", "first frame"),
        column("frame_b", "integer", "", "second frame"),
        TRACK,
        column("x_px", "number", "px", "column of the centre in the first frame"),
        column("y_px", "number", "px", "row of the centre in the first frame"),
        column("z_um", "number", "um", "depth of the centre in the first frame"),
        column("dx_px", "number", "px", "displacement along x from the first to the second frame"),
        column("dy_px", "number", "px", "displacement along y"),
        column("dz_um", "number", "um", "displacement along z"),
        column("drift_dx_px", "number", "px", "its part without random motion, along x"),
        column("drift_dy_px", "number", "px", "its part without random motion, along y"),
        column("drift_dz_um", "number", "um", "its part without random motion, along z"),
        column("visible_a", "integer", "", "1 if the centre is on the sensor in the first frame"),
        column("visible_b", "integer", "", "1 if the centre is on the sensor in the second frame"),
    ],
};

const FRAME: Column = column("frame", "integer", "", "number of the frame, from 0");
const T_S: Column = column("t_s", "number", "s", "time");
const TRACK: Column = column("track", "integer", "", "number of the particle; never reused");

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
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Census {
    /// Frames written.
    pub frames: u32,
    /// Visible particles, summed over frames.
    pub visible: u64,
    /// Rows of displacements.csv.
    pub displacements: u64,
    /// Largest displacement of a visible particle in the image plane, px.
    pub max_displacement_px: f64,
}

/// Writes the tables of the truth, frame after frame.
pub struct TruthWriter<'a> {
    scenario: &'a Scenario,
    renderer: &'a Renderer,
    frames: TableWriter<BufWriter<File>>,
    tracks: TableWriter<BufWriter<File>>,
    displacements: TableWriter<BufWriter<File>>,
    census: Census,
    began_s: f64,
}

impl<'a> TruthWriter<'a> {
    /// Begins the tables in a dataset's folder.
    pub fn new(folder: &Path, scenario: &'a Scenario, renderer: &'a Renderer) -> Result<Self> {
        let begin = |table: &'static Table| {
            let path = folder.join(table.path);
            TableWriter::new(table, BufWriter::new(File::create(&path).map_err(Error::write(&path))?))
        };
        Ok(TruthWriter {
            scenario,
            renderer,
            frames: begin(&FRAMES)?,
            tracks: begin(&TRACKS)?,
            displacements: begin(&DISPLACEMENTS)?,
            census: Census::default(),
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
        let (mut n_rendered, mut n_visible) = (0u32, 0);
        for (i, tracer) in frame.tracers.iter().enumerate() {
            let particle = particle(tracer, scenario);
            let visible = self.visible(&particle);
            let shape = particle.spheroid.unwrap_or(Spheroid { e_p: 1.0, alpha_rad: 0.0, beta_rad: 0.0 });
            let first_row = rendered.len();
            let light = energy * self.rows(tracer, frame.streaks.get(i), energy, &mut rendered);
            let shines = rendered.len() > first_row;
            n_rendered += u32::from(shines);
            n_visible += u64::from(visible);
            // Unknown for a recorded track that is in this frame only.
            let velocity = |axis: usize| tracer.velocity.map(|v| v[axis].to_string()).unwrap_or_default();
            self.tracks.row(&[
                &frame.index,
                &frame.t_s,
                &tracer.id,
                &particle.x_px,
                &particle.y_px,
                &tracer.position.z,
                &tracer.position.x,
                &tracer.position.y,
                &particle.d_um,
                &shape.e_p,
                &shape.alpha_rad,
                &shape.beta_rad,
                &particle.c_int,
                &velocity(0),
                &velocity(1),
                &velocity(2),
                &u8::from(visible),
                &u8::from(shines),
                &light,
            ])?;
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
        if let (Some(before), Some(pair)) = (before, recordings.link_to(frame.index)) {
            self.displacements(pair, before, frame)?;
        }
        Ok(rendered)
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
            self.displacements.row(&[
                &pair,
                &a.index,
                &b.index,
                &from.id,
                &start.x_px,
                &start.y_px,
                &from.position.z,
                &d.dx_px,
                &d.dy_px,
                &moved.z,
                &d_drift.dx_px,
                &d_drift.dy_px,
                &drift.z,
                &u8::from(visible_a),
                &u8::from(visible_b),
            ])?;
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
