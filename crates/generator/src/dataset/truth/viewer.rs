//! Converts the tracers of a frame to particles for the renderer, with illumination and streaks.

use std::ops::Range;

use flows::frame::{Frame, Streak, Tracer};
use glam::DVec3;
use microsig_core::random::normal;
use microsig_core::render::Renderer;
use microsig_core::stream::Purpose;
use microsig_core::{Particle, Spheroid};

use scenario::Scenario;

/// Scenario and renderer that determine what the camera images.
#[derive(Clone, Copy)]
pub(crate) struct Viewer<'a> {
    pub scenario: &'a Scenario,
    pub renderer: &'a Renderer,
}

/// The particles of a frame.
pub(crate) struct View<'a> {
    /// Factor on the light of the frame: pulse energy and bleaching.
    pub energy: f64,
    /// All tracers, in the order of the frame.
    pub(crate) seen_tracers: Vec<SeenTracer<'a>>,
    /// The rows of the data file.
    pub rendered: Vec<Particle>,
}

/// A tracer and its particle in image coordinates.
pub(crate) struct SeenTracer<'a> {
    pub tracer: &'a Tracer,
    pub particle: Particle,
    pub visible: bool,
    /// Its rows in the data file.
    pub rows: Range<usize>,
    /// Factor on its brightness: illumination at its position times the frame's pulse energy.
    pub light: f64,
}

/// The particles that are drawn of a frame: the rows of its data file.
pub fn rendered(scenario: &Scenario, renderer: &Renderer, frame: &Frame) -> Vec<Particle> {
    Viewer { scenario, renderer }.rendered(frame)
}

impl Viewer<'_> {
    pub(crate) fn view<'f>(&self, frame: &'f Frame) -> View<'f> {
        let mut seen_tracers = Vec::with_capacity(frame.tracers.len());
        let (energy, rendered) = self.each(frame, |seen_tracer| seen_tracers.push(seen_tracer));
        View { energy, seen_tracers, rendered }
    }

    /// The rows of a frame's data file.
    pub(crate) fn rendered(&self, frame: &Frame) -> Vec<Particle> {
        self.each(frame, |_| ()).1
    }

    /// Calls `take` with each tracer of a frame; returns the factor on the light of the frame, and the rows
    /// of its data file.
    fn each<'f>(&self, frame: &'f Frame, mut take: impl FnMut(SeenTracer<'f>)) -> (f64, Vec<Particle>) {
        let energy = self.energy(frame);
        let mut rendered = Vec::with_capacity(frame.tracers.len());
        for (i, tracer) in frame.tracers.iter().enumerate() {
            let (first, particle) = (rendered.len(), self.particle(tracer));
            let light = energy * self.rows(tracer, particle, frame.streaks.get(i), energy, &mut rendered);
            let (visible, rows) = (self.is_visible(&particle), first..rendered.len());
            take(SeenTracer { tracer, particle, visible, rows, light });
        }
        (energy, rendered)
    }

    /// The particle of a tracer at the depth that its image shows. If the dataset has spheroids, those of aspect ratio 1 are also treated as
    /// spheroids, as the laws of emission differ.
    pub(crate) fn particle(&self, tracer: &Tracer) -> Particle {
        let at = self.scenario.scale.to_image(tracer.position);
        let z_um = at.z_um + self.focus_scatter_um(tracer);
        let spheroid = || Spheroid::from_axis(tracer.aspect, tracer.axis.to_array());
        let particle = Particle {
            spheroid: self.scenario.layout.spheroids.then(spheroid),
            ..Particle::sphere(at.x_px, at.y_px, z_um, tracer.d_um)
        };
        Particle { c_int: self.scenario.cloud.c_int(tracer.c_int, &particle), ..particle }
    }

    /// How much deeper a tracer appears by its image, um, as in data files.
    pub(crate) fn focus_scatter_um(&self, tracer: &Tracer) -> f64 {
        match self.scenario.spec.optics.field.map_or(0.0, |field| field.focus.scatter_um) {
            0.0 => 0.0,
            sd => sd * normal(&mut self.scenario.streams.stream(Purpose::FocusScatter, 0, tracer.id as u32)),
        }
    }

    /// Whether a particle's center is on the sensor.
    pub(crate) fn is_visible(&self, particle: &Particle) -> bool {
        self.scenario.settings.is_on_sensor(particle.x_px, particle.y_px)
    }

    /// Factor on the light of a frame. Bleaching starts with the first frame of each recording.
    fn energy(&self, frame: &Frame) -> f64 {
        let (recordings, streams) = (&self.scenario.recordings, self.scenario.streams);
        let number = frame.index % recordings.frames_each();
        let began_s = recordings.time_s(frame.index - number, streams);
        self.scenario.illumination.energy(frame.index, number, frame.t_s - began_s, streams)
    }

    /// Adds a particle's rows of the data file, one for each point of its streak, if their light may reach
    /// the sensor. Returns the illumination at the particle.
    fn rows(
        &self,
        tracer: &Tracer,
        whole: Particle,
        streak: Option<&Streak>,
        energy: f64,
        rows: &mut Vec<Particle>,
    ) -> f64 {
        let light = |x: DVec3| self.scenario.illumination.at(x);
        let mut add = |row: Particle| {
            if row.c_int > 0.0 && self.renderer.reaches_sensor(&row) {
                rows.push(row);
            }
        };
        let here = light(tracer.position);
        match streak {
            None => add(Particle { c_int: whole.c_int * energy * here, ..whole }),
            Some(streak) => {
                for point in &streak.points {
                    let moved = Tracer { position: point.position, axis: point.axis, ..*tracer };
                    let part = self.particle(&moved);
                    let share = energy * light(point.position) * streak.share;
                    add(Particle { c_int: part.c_int * share, ..part });
                }
            }
        }
        here
    }
}
