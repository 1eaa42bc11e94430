//! Iterates over all frames of a dataset: tracers of its recordings, seeded and advected or read from tracks.

use microsig_core::formats::data_file;

use flows::{Frame, RecordedTracks, RecordingStart, Scene, Sequence};

use scenario::spec::Number;
use scenario::{MotionSource, Scenario};
use storage::error::{Error, Result};

/// The source of the recordings' tracers.
enum Subject<'a> {
    Scene(Box<Scene<'a>>),
    Tracks(&'a RecordedTracks),
}

enum Recording<'a> {
    OfScene(Box<Sequence<'a>>),
    OfTracks(Box<dyn Iterator<Item = Frame> + Send + 'a>),
}

/// The frames of a scenario in order. The iterator ends after an `Err`.
pub struct Frames<'a> {
    scenario: &'a Scenario,
    subject: Subject<'a>,
    number: u32,
    first_id: u64,
    recording: Option<Recording<'a>>,
    velocities: bool,
}

impl<'a> Frames<'a> {
    /// An iterator that starts with the first frame.
    pub fn new(scenario: &'a Scenario) -> Result<Self> {
        let subject = match &scenario.motion {
            MotionSource::Field(field) => Subject::Scene(Box::new(scenario.scene(field.as_ref())?)),
            MotionSource::Tracks(tracks) => Subject::Tracks(tracks),
        };
        Ok(Frames { scenario, subject, number: 0, first_id: 0, recording: None, velocities: true })
    }

    /// The same frames with tracers whose velocities are only computed if they make streaks.
    pub fn without_velocities(self) -> Self {
        Frames { velocities: false, ..self }
    }

    fn begin(&self) -> Result<Recording<'a>> {
        let (scenario, streams) = (self.scenario, self.scenario.streams);
        let first_frame = self.number * scenario.recordings.frames_each();
        let start = RecordingStart { recording: self.number, first_frame, first_id: self.first_id };
        let times_s = scenario.recordings.times_s(self.number, streams);
        Ok(match &self.subject {
            Subject::Scene(scene) => {
                let sequence = scene.record(&times_s, streams, start)?;
                let sequence = if self.velocities { sequence } else { sequence.without_velocities() };
                Recording::OfScene(Box::new(sequence))
            }
            Subject::Tracks(tracks) => {
                let next_s = scenario.recordings.next_s(streams);
                let frames = tracks.record(
                    times_s,
                    next_s,
                    scenario.particle_defaults(),
                    scenario.shutter,
                    streams,
                    start,
                );
                Recording::OfTracks(Box::new(frames))
            }
        })
    }

    fn advance(&mut self) -> Result<Option<Frame>> {
        while self.number < self.scenario.recordings.count() {
            let recording = match &mut self.recording {
                Some(recording) => recording,
                None => self.recording.insert(self.begin()?),
            };
            let frame = match recording {
                Recording::OfScene(sequence) => sequence.next().transpose()?,
                Recording::OfTracks(frames) => frames.next(),
            };
            if frame.is_some() {
                return Ok(frame);
            }
            if let Some(Recording::OfScene(sequence)) = self.recording.take() {
                self.first_id = sequence.next_id();
            }
            self.number += 1;
        }
        Ok(None)
    }
}

/// An error of a listed particle with file and line; any other error unchanged.
fn with_line(error: Error, scenario: &Scenario) -> Error {
    let (Error::Flow(flows::Error::Place { index, at_um, allowed }), Some(Number::File(file))) =
        (&error, &scenario.spec.particles.number)
    else {
        return error;
    };
    let input = scenario.inputs.iter().find(|input| input.path == *file);
    let Some((input, line)) = input.and_then(|of| Some((of, data_file::line_of(&of.bytes, *index)?))) else {
        return error;
    };
    let at = scenario.scale.to_image(*at_um);
    // As written in the file: the conversion to um and back is inexact.
    let written = |value: f64| (value * 1e6).round() / 1e6;
    Error::input(format!(
        "{}:{line}: x = {} px, y = {} px, z = {} um: expected {allowed}; see particles.number.file, boundaries and motion",
        input.source.display(),
        written(at.x_px),
        written(at.y_px),
        written(at.z_um)
    ))
}

impl Iterator for Frames<'_> {
    type Item = Result<Frame>;

    fn next(&mut self) -> Option<Self::Item> {
        let frame = self.advance().map_err(|e| with_line(e, self.scenario)).transpose();
        if matches!(frame, Some(Err(_))) {
            self.number = self.scenario.recordings.count();
        }
        frame
    }
}
