use rayon::prelude::*;

use super::{PARTICLE_COLUMNS, Sample, SampleStream};
use storage::error::{Error, Result};
use storage::memory::{free_memory, size_text};

/// A batch of samples: the first axis of every array is the sample; arrays of particles are padded with
/// zeros.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Batch {
    /// Indices of the samples.
    pub indices: Vec<u64>,
    /// [`Sample::images`].
    pub images: Vec<u16>,
    /// [`Sample::clean`].
    pub clean: Vec<f32>,
    /// Number of rows for particles in every sample.
    pub rows: usize,
    /// [`Sample::particles`], shape (samples, rows, 8).
    pub particles: Vec<f32>,
    /// Whether a row is a particle, shape (samples, rows).
    pub mask: Vec<bool>,
    /// [`Sample::boxes`], shape (samples, rows, 6).
    pub boxes: Vec<f32>,
    /// [`Sample::shapes`], shape (samples, rows, 4).
    pub shapes: Vec<f32>,
    /// [`Sample::instances`].
    pub instances: Vec<i32>,
    /// [`Sample::depth`].
    pub depth: Vec<f32>,
    /// [`Sample::heatmap`].
    pub heatmap: Vec<f32>,
    /// [`Sample::flow`].
    pub flow: Vec<f32>,
}

impl Batch {
    /// Collects samples into a batch with at least `rows` rows for particles.
    pub fn of(samples: Vec<Sample>, rows: usize) -> Self {
        let most = samples.iter().map(|sample| sample.particles.len()).max().unwrap_or(0);
        let mut batch = Batch { rows: rows.max(most), ..Batch::default() };
        let room = samples.len();
        if let Some(first) = samples.first() {
            batch.images.reserve_exact(room * first.images.len());
            batch.clean.reserve_exact(room * first.clean.len());
            batch.flow.reserve_exact(room * first.flow.len());
            batch.particles.reserve_exact(room * batch.rows * 8);
        }
        for (number, sample) in samples.iter().enumerate() {
            batch.indices.push(sample.index);
            batch.images.extend_from_slice(&sample.images);
            batch.clean.extend_from_slice(&sample.clean);
            batch.instances.extend_from_slice(&sample.instances);
            batch.depth.extend_from_slice(&sample.depth);
            batch.heatmap.extend_from_slice(&sample.heatmap);
            batch.flow.extend_from_slice(&sample.flow);
            batch.particles.extend_from_slice(sample.particles.as_flattened());
            batch.particles.resize((number + 1) * batch.rows * 8, 0.0);
            batch.mask.resize(number * batch.rows + sample.particles.len(), true);
            batch.mask.resize((number + 1) * batch.rows, false);
            let before = number * batch.rows;
            add_rows(&mut batch.boxes, before, &sample.boxes);
            add_rows(&mut batch.shapes, before, &sample.shapes);
        }
        let all = room * batch.rows;
        add_rows::<6>(&mut batch.boxes, all, &[]);
        add_rows::<4>(&mut batch.shapes, all, &[]);
        batch
    }
}

/// Fills an array up to `before` rows and adds the rows of a sample; nothing if no sample has any.
fn add_rows<const N: usize>(all: &mut Vec<f32>, before: usize, rows: &[[f32; N]]) {
    if !rows.is_empty() || !all.is_empty() {
        all.resize(before * N, 0.0);
        all.extend_from_slice(rows.as_flattened());
    }
}

impl Sample {
    /// Memory in a batch with at least `rows` rows for particles (of which boxes and shapes are a part), bytes.
    pub(super) fn bytes(&self, rows: usize) -> u64 {
        let rows = rows.max(self.particles.len()) as u64;
        let values =
            self.clean.len() + self.instances.len() + self.depth.len() + self.heatmap.len() + self.flow.len();
        let row_bytes = 4 * PARTICLE_COLUMNS.len() + 4 * 6 + 4 * 4 + 1;
        rows.saturating_mul(row_bytes as u64).saturating_add((2 * self.images.len() + 4 * values) as u64)
    }
}

impl SampleStream {
    /// Checks that there is free memory for this number of batches of `n` samples; `what` names their
    /// arguments in the message. A batch that is being assembled counts twice: its samples are collected
    /// first. Errors: [`Error::Input`] with required and free bytes.
    pub fn check_memory(&self, what: &str, n: u64, batches: u64) -> Result<()> {
        let batch = self.sample_bytes.saturating_mul(n).saturating_add(size_of::<Batch>() as u64);
        let (needed, free) = (batch.saturating_mul(batches), free_memory().unwrap_or(isize::MAX as u64));
        if needed <= free {
            return Ok(());
        }
        let (needed, free) = (size_text(needed), size_text(free));
        Err(Error::input(format!(
            "{what}: expected less, because about {needed} of memory are needed and only {free} are free"
        )))
    }

    /// Computes the `n` samples from index `first` on, in parallel; `go_on` is called before each and can
    /// stop the work with an error. Errors: as for [`SampleStream::sample`]; errors of `go_on`.
    pub fn batch(&self, first: u64, n: usize, go_on: impl Fn() -> Result<()> + Sync) -> Result<Batch> {
        let samples: Result<Vec<Sample>> = (0..n as u64)
            .into_par_iter()
            .map(|k| {
                go_on()?;
                self.sample(first.wrapping_add(k))
            })
            .collect();
        Ok(Batch::of(samples?, self.options().rows))
    }
}
