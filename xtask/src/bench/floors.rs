//! Lower limits of run times on this machine: copying memory, generating random numbers, writing files.
//!
//! Each runs as a separate process, like the workloads, and is timed in the same way.

use std::hint::black_box;
use std::io::Write;
use std::path::Path;

use clap::ValueEnum;
use microsig_core::stream::{Purpose, Streams};

/// A lower limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum LowerLimit {
    /// Copies a 16-bit image of 752 x 366 px.
    Memcpy,
    /// Generates a 32-bit random number by Philox4x32-10 for every pixel of such an image, row by row.
    Philox,
    /// Writes a 16-bit image of 752 x 366 px to a file.
    Write,
    /// Does nothing: the cost of starting a process.
    Nothing,
}

const WIDTH: usize = 752;
const HEIGHT: usize = 366;
const PIXELS: usize = WIDTH * HEIGHT;

impl LowerLimit {
    pub(super) const ALL: [LowerLimit; 4] =
        [LowerLimit::Memcpy, LowerLimit::Philox, LowerLimit::Write, LowerLimit::Nothing];

    /// Number of images, large enough for timing.
    pub(super) fn images(self) -> usize {
        match self {
            LowerLimit::Memcpy => 10_000,
            LowerLimit::Philox => 500,
            LowerLimit::Write => 400,
            LowerLimit::Nothing => 1,
        }
    }

    /// Runs it; files are written below `folder`.
    pub(crate) fn run(self, folder: &Path) -> anyhow::Result<()> {
        let image = vec![1u8; 2 * PIXELS];
        match self {
            LowerLimit::Memcpy => {
                let mut copy = vec![0u8; image.len()];
                for _ in 0..self.images() {
                    copy.copy_from_slice(black_box(&image));
                    black_box(&copy);
                }
            }
            LowerLimit::Philox => {
                let streams = Streams::new(1);
                let mut words = vec![0; WIDTH];
                for (frame, row) in (0..self.images()).flat_map(|k| (0..HEIGHT).map(move |row| (k, row))) {
                    let mut stream = streams.stream(Purpose::BackgroundNoise, frame as u32, row as u32);
                    stream.fill(&mut words);
                    black_box(&words);
                }
            }
            LowerLimit::Write => {
                for k in 0..self.images() {
                    std::fs::File::create(folder.join(format!("{k:05}.raw")))?.write_all(&image)?;
                }
            }
            LowerLimit::Nothing => {}
        }
        Ok(())
    }
}
