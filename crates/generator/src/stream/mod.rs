//! Samples for training: an endless sequence in which a sample depends only on scenario, seed and index.
//!
//! Sample `i` consists of the first frames of the first recording of its own scenario: the given scenario
//! with another seed and newly drawn values of the keys that vary. [`SampleStream::scenario`] returns this
//! scenario; the dataset generated from it has exactly the sample's images. Samples therefore do not depend
//! on threads, batches or earlier samples, and can be computed in any order.
//!
//! Seeds of samples are a permutation of (2 i + split): no two samples of a stream, in either split, have the
//! same seed.

mod batch;
mod distribution;
mod labels;
mod sampler;
mod window;

use std::path::PathBuf;
use std::sync::Arc;

pub use batch::Batch;
pub use distribution::{Distribution, Drawn};
pub use labels::{Flow, LabelOptions, PARTICLE_COLUMNS, Sample};
use microsig_core::problem::{Place, Problem, Source};
use microsig_core::render::Context;
use microsig_core::sensor::ImageFormat;
use sampler::{Key, MAX_OPTICS, Sampler};
use scenario::{Assignment, Parsed, Scenario};
use storage::error::{Error, Result};
pub use window::Window;

/// The two disjoint parts of the samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Split {
    /// For training.
    Train,
    /// For validation.
    Validation,
}

/// Options of a stream.
#[derive(Debug, Clone)]
pub struct StreamOptions {
    /// Text of the scenario.
    pub text: String,
    /// Name of the scenario in messages.
    pub name: String,
    /// Folder that paths in the scenario are relative to.
    pub folder: PathBuf,
    /// Values that are the same in all samples.
    pub assignments: Vec<Assignment>,
    /// The keys that vary and their distributions.
    pub vary: Vec<(String, Distribution)>,
    /// Seed of the stream.
    pub seed: u64,
    /// The part of the samples.
    pub split: Split,
    /// Number of frames in a sample.
    pub frames: u32,
    /// Labels of a sample.
    pub labels: LabelOptions,
    /// Minimum number of rows for particles in a batch.
    pub rows: usize,
    /// Columns and rows of a window of the images, drawn at random for each sample.
    pub window: Option<(u32, u32)>,
}

/// An endless sequence of samples.
#[derive(Debug)]
pub struct SampleStream {
    options: StreamOptions,
    parsed: Parsed,
    context: Context,
    sampler: Sampler,
    warning: Option<String>,
    image_px: (u32, u32),
    size_px: (u32, u32),
    /// Memory of a sample in a batch, bytes.
    sample_bytes: u64,
}

impl SampleStream {
    /// Creates a stream; checks the scenario at both ends of every varied range. Errors: an invalid scenario;
    /// a value that is not allowed; labels that the scenario does not have.
    pub fn new(options: StreamOptions) -> Result<Self> {
        if options.frames == 0 {
            return Err(Error::input("frames = 0: expected at least 1"));
        }
        let mut paths: Vec<&str> = options.vary.iter().map(|(path, _)| path.as_str()).collect();
        paths.sort_unstable();
        if let Some(twice) = paths.windows(2).find(|two| two[0] == two[1]) {
            return Err(Error::input(format!("vary {}: given twice", twice[0])));
        }
        for (path, distribution) in &options.vary {
            distribution.check(path)?;
            if path == "seed" {
                return Err(Error::input("vary seed: every sample already has its own seed"));
            }
        }
        let mut stream = SampleStream {
            parsed: Parsed::new(&options.text, (&options.name, &options.folder))?,
            options,
            context: Context::default(),
            warning: None,
            sampler: Sampler::default(),
            image_px: (0, 0),
            size_px: (0, 0),
            sample_bytes: 0,
        };
        let base = stream.scenario(0)?;
        stream.image_px = (base.settings.pixel_dim_x, base.settings.pixel_dim_y);
        stream.size_px = stream.options.window.unwrap_or(stream.image_px);
        let ((width, height), (most_x, most_y)) = (stream.size_px, stream.image_px);
        if !(1..=most_x).contains(&width) || !(1..=most_y).contains(&height) {
            return Err(Error::input(format!(
                "crop = ({height}, {width}): expected at least a pixel, and at most {most_y} rows and {most_x} columns"
            )));
        }
        if base.spec.image_format() == ImageFormat::Float32 {
            return Err(Error::input(
                "image_format = float32: expected integer, because samples have whole counts; the label `clean` has unrounded \
                 ones without noise",
            ));
        }
        let there = base.recordings.frames_each();
        if stream.options.frames > there {
            let asked = stream.options.frames;
            return Err(Error::input(format!(
                "frames = {asked}: a recording of this scenario has {there}; see timing.{}",
                base.recordings.timing().mode()
            )));
        }
        stream.options.labels.check(&base, stream.options.frames)?;
        let mut optics_keys: Vec<&str> = Vec::new();
        for (path, distribution) in &stream.options.vary {
            let mut optics = Vec::new();
            for end in distribution.ends() {
                let found = stream.with(0, Some((path, &end)))?;
                optics.push(Key::of(&found));
                let size_px = (found.settings.pixel_dim_x, found.settings.pixel_dim_y);
                if size_px != stream.image_px {
                    return Err(Error::input(format!(
                        "vary {path}: all samples of a stream must have images of the same size"
                    )));
                }
            }
            let differ = optics.iter().any(|end_optics| *end_optics != optics[0]);
            if differ && distribution.count() > MAX_OPTICS as u64 {
                optics_keys.push(path);
            }
        }
        if !optics_keys.is_empty() && stream.options.labels.needs_tables(&base)? {
            stream.warning = Some(format!(
                "vary {}: each sample needs new tables of images, which takes most of its time; `render.images: single` \
                 computes its images one by one instead",
                optics_keys.join(", ")
            ));
        }
        // Computes the tables of optics that all samples share.
        stream.sample_bytes = stream.sample(0)?.bytes(stream.options.rows);
        Ok(stream)
    }

    /// The options of the stream.
    pub fn options(&self) -> &StreamOptions {
        &self.options
    }

    /// What slows the stream down: keys whose variation makes each sample compute tables of its own.
    pub fn warning(&self) -> Option<&str> {
        self.warning.as_deref()
    }

    /// Width and height of the images, px.
    pub fn size_px(&self) -> (u32, u32) {
        self.size_px
    }

    /// The seed of a sample.
    pub fn seed_of(&self, index: u64) -> u64 {
        let split = match self.options.split {
            Split::Train => 0,
            Split::Validation => 1,
        };
        mix(mix(self.options.seed).wrapping_add(index.wrapping_mul(2).wrapping_add(split)))
    }

    /// The varied values of a sample, by path.
    pub fn values(&self, index: u64) -> Vec<(&str, Drawn)> {
        let seed = self.seed_of(index);
        self.options
            .vary
            .iter()
            .map(|(path, distribution)| (path.as_str(), distribution.draw(seed, path)))
            .collect()
    }

    /// The window of a sample in the images of its scenario; `None` if it covers them entirely.
    pub fn window(&self, index: u64) -> Option<Window> {
        self.options.window.map(|size| Window::draw(self.seed_of(index), size, self.image_px))
    }

    /// The scenario of a sample.
    pub fn scenario(&self, index: u64) -> Result<Scenario> {
        self.with(index, None)
    }

    /// The scenario of a sample, with one of the varied values replaced by `instead`.
    fn with(&self, index: u64, instead: Option<(&str, &Drawn)>) -> Result<Scenario> {
        let options = &self.options;
        let varied = self.values(index).into_iter().map(|(path, drawn)| {
            let value = instead.filter(|(other, _)| *other == path).map(|(_, value)| value.text.clone());
            Assignment { path: path.to_owned(), value: value.unwrap_or(drawn.text) }
        });
        let assignments: Vec<Assignment> = options.assignments.iter().cloned().chain(varied).collect();
        let resolved = self.parsed.resolve(&assignments, Some(self.seed_of(index)), &self.context);
        resolved.map_err(|error| match error {
            Error::Problems(problems) => {
                Error::Problems(problems.into_iter().map(|problem| self.named(index, problem)).collect())
            }
            other => other,
        })
    }

    /// A problem with a varied value as one of its key and its draw, which the user knows.
    fn named(&self, index: u64, problem: Problem) -> Problem {
        let source = problem.place.as_ref().map(|place| &place.source).filter(|source| !source.is_file);
        let varied = source.and_then(|source| {
            let is_own = |(path, _): &&(String, Distribution)| {
                source.name.strip_prefix(&**path).is_some_and(|rest| rest.starts_with('='))
            };
            Some((source, self.options.vary.iter().find(is_own)?))
        });
        let Some((source, (path, _))) = varied else { return problem };
        let drawn = &source.text[source.value_at..];
        let drawn = drawn.parse().map_or(drawn.to_owned(), |number: f64| format!("{number:.4}"));
        let name = format!("vary {path}, {drawn} in sample {index}");
        let source = Source { name, text: source.text.clone(), ..Source::assignment(path, "") };
        let place =
            problem.place.as_ref().map(|place| Place { source: Arc::new(source), span: place.span.clone() });
        Problem { place, ..problem }
    }

    /// Computes a sample. Errors: an invalid combination of values; a trajectory that cannot be integrated.
    pub fn sample(&self, index: u64) -> Result<Sample> {
        let values = self.values(index);
        let place = (index, self.seed_of(index));
        let mut sample = self.sampler.sample(&self.options, place, &values, || self.scenario(index))?;
        if let Some(window) = self.window(index) {
            window.cut(&mut sample, self.image_px);
        }
        Ok(sample)
    }
}

/// A permutation of all 64-bit numbers that decorrelates neighbors (the finalizer of SplitMix64; Steele, Lea
/// and Flood, OOPSLA 2014, 453).
fn mix(number: u64) -> u64 {
    let mut z = number.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests;
