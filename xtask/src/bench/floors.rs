//! What no program can be faster than on this machine: copying memory, making random numbers, writing files.
//!
//! Each runs as a process of its own, like the workloads, so that its time is taken the same way.

use std::hint::black_box;
use std::io::Write;
use std::path::Path;

use clap::ValueEnum;
use microsig_core::stream::{Purpose, Streams};

/// One of the floors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Floor {
    /// Copies an image of 752 x 366 px in 16 bit.
    Memcpy,
    /// Makes a 32-bit random number by Philox4x32-10 for every pixel of such an image, row by row.
    Philox,
    /// Writes an image of 752 x 366 px in 16 bit into a file of its own.
    Write,
    /// Does nothing: what a process costs.
    Nothing,
}

const WIDTH: usize = 752;
const HEIGHT: usize = 366;
const PIXELS: usize = WIDTH * HEIGHT;

impl Floor {
    pub(super) const ALL: [Floor; 4] = [Floor::Memcpy, Floor::Philox, Floor::Write, Floor::Nothing];

    /// Images' worth of it that take long enough to be timed.
    pub(super) fn images(self) -> usize {
        match self {
            Floor::Memcpy => 10_000,
            Floor::Philox => 500,
            Floor::Write => 400,
            Floor::Nothing => 1,
        }
    }

    /// Does it.
    pub(crate) fn run(self, folder: &Path) -> anyhow::Result<()> {
        let image = vec![1u8; 2 * PIXELS];
        match self {
            Floor::Memcpy => {
                let mut copy = vec![0u8; image.len()];
                for _ in 0..self.images() {
                    copy.copy_from_slice(black_box(&image));
                    black_box(&copy);
                }
            }
            Floor::Philox => {
                let streams = Streams::new(1);
                let mut words = vec![0; WIDTH];
                for (frame, row) in (0..self.images()).flat_map(|k| (0..HEIGHT).map(move |row| (k, row))) {
                    let mut stream = streams.stream(Purpose::BackgroundNoise, frame as u32, row as u32);
                    stream.fill(&mut words);
                    black_box(&words);
                }
            }
            Floor::Write => {
                for k in 0..self.images() {
                    std::fs::File::create(folder.join(format!("{k:05}.raw")))?.write_all(&image)?;
                }
            }
            Floor::Nothing => {}
        }
        Ok(())
    }
}
