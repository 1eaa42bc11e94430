//! Samples for training: an endless series in which a sample is a function of (scenario, seed, number) alone.
//!
//! Sample `i` is the beginning of the first recording of a scenario of its own: the given one with a seed of
//! its own, and with the values that vary drawn anew. [`SampleStream::scenario`] gives that scenario; a
//! dataset made of it has the sample's images, to the last bit. So samples do not depend on threads, batches
//! or what was drawn before, and any of them can be had at any time.
//!
//! Seeds of samples are a permutation of (2 i + split): no two samples of a stream, nor any of its two
//! splits, share one.

mod batch;
mod labels;
mod law;
mod sampler;

use std::path::PathBuf;

pub use batch::Batch;
pub use labels::{Flow, LabelOptions, PARTICLE_COLUMNS, Sample};
pub use law::{Drawn, Law};
use sampler::Sampler;
use scenario::{Scenario, load_text};
use storage::error::{Error, Result};

/// Which part of the samples: the two have none in common.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Split {
    /// For training.
    Train,
    /// For validation.
    Validation,
}

/// What samples are.
#[derive(Debug, Clone)]
pub struct StreamOptions {
    /// The scenario's text, its name in messages, and the folder of the files that it names.
    pub text: String,
    /// What messages call it.
    pub name: String,
    /// Where files that it names are found.
    pub folder: PathBuf,
    /// Values that are the same in all samples, `path=value`.
    pub assignments: Vec<String>,
    /// What varies, by path.
    pub vary: Vec<(String, Law)>,
    /// Seed of the stream.
    pub seed: u64,
    /// Which of the two parts.
    pub split: Split,
    /// Frames of a sample.
    pub frames: u32,
    /// What is told of a sample besides its images.
    pub labels: LabelOptions,
    /// Rows for particles in a batch, at least.
    pub rows: usize,
}

/// An endless series of samples.
#[derive(Debug)]
pub struct SampleStream {
    options: StreamOptions,
    sampler: Sampler,
    size_px: (u32, u32),
}

impl SampleStream {
    /// The stream; both ends of all that varies are tried.
    ///
    /// # Errors
    /// A scenario that cannot be used; a value that is not allowed; labels that it does not have.
    pub fn new(options: StreamOptions) -> Result<Self> {
        if options.frames == 0 {
            return Err(Error::input("frames = 0: expected at least 1"));
        }
        let mut paths: Vec<&str> = options.vary.iter().map(|(path, _)| path.as_str()).collect();
        paths.sort_unstable();
        if let Some(twice) = paths.windows(2).find(|two| two[0] == two[1]) {
            return Err(Error::input(format!("vary {}: is given twice", twice[0])));
        }
        let mut stream = SampleStream { options, sampler: Sampler::default(), size_px: (0, 0) };
        let base = stream.scenario(0)?;
        stream.size_px = (base.settings.pixel_dim_x, base.settings.pixel_dim_y);
        let there = base.recordings.frames_each();
        if stream.options.frames > there {
            let asked = stream.options.frames;
            return Err(Error::input(format!(
                "frames = {asked}: a recording of this scenario has {there}; see timing.{}",
                base.recordings.timing().mode()
            )));
        }
        stream.options.labels.check(&base, stream.options.frames)?;
        for (path, law) in &stream.options.vary {
            law.check(path)?;
            if path == "seed" {
                return Err(Error::input("vary seed: every sample has a seed of its own"));
            }
            for end in law.ends() {
                let found = stream.with(0, Some((path, &end)))?;
                let size_px = (found.settings.pixel_dim_x, found.settings.pixel_dim_y);
                if size_px != stream.size_px {
                    return Err(Error::input(format!(
                        "vary {path}: samples of a stream have images of one size"
                    )));
                }
            }
        }
        // Tables of the optics that all samples share are made here, once.
        stream.sample(0)?;
        Ok(stream)
    }

    /// What its samples are.
    pub fn options(&self) -> &StreamOptions {
        &self.options
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

    /// The values of a sample that vary, by path.
    pub fn values(&self, index: u64) -> Vec<(&str, Drawn)> {
        let seed = self.seed_of(index);
        self.options.vary.iter().map(|(path, law)| (path.as_str(), law.draw(seed, path))).collect()
    }

    /// The scenario of a sample.
    ///
    /// # Errors
    /// Values that do not go together.
    pub fn scenario(&self, index: u64) -> Result<Scenario> {
        self.with(index, None)
    }

    /// The scenario of a sample, a value that varies replaced.
    fn with(&self, index: u64, instead: Option<(&str, &Drawn)>) -> Result<Scenario> {
        let options = &self.options;
        let value = |(path, drawn): &(&str, Drawn)| match instead {
            Some((other, value)) if other == *path => format!("{path}={}", value.text),
            _ => format!("{path}={}", drawn.text),
        };
        let varied = self.values(index);
        let assignments: Vec<String> =
            options.assignments.iter().cloned().chain(varied.iter().map(value)).collect();
        load_text(&options.text, (&options.name, &options.folder), &assignments, Some(self.seed_of(index)))
    }

    /// Draws a sample.
    ///
    /// # Errors
    /// Values that do not go together; a trajectory that cannot be followed.
    pub fn sample(&self, index: u64) -> Result<Sample> {
        let values = self.values(index);
        self.sampler.sample(&self.options, (index, self.seed_of(index)), &values, || self.scenario(index))
    }
}

/// A permutation of all numbers of 64 bit in which neighbors are far apart (the finalizer of SplitMix64;
/// Steele, Lea and Flood, OOPSLA 2014, 453).
fn mix(number: u64) -> u64 {
    let mut z = number.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
