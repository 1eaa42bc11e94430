//! Streams of samples.

use std::mem::ManuallyDrop;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use generator::stream::{Batch, Distribution, Drawn, Flow, LabelOptions, SampleStream, Split, StreamOptions};
use microsig_core::cancel::Cancellation;
use numpy::{Element, PyArray1, PyArrayMethods};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::ThreadPool;
use scenario::Literal;
use storage::progress::Progress;

use crate::dataset::ScenarioText;
use crate::object::Object;
use crate::run::{OnInterrupt, defect, pool, raise, run};

/// Interval at which signals are checked.
const TICK: Duration = Duration::from_millis(50);

/// A distribution: its name, numbers, and values as written.
type DistributionParts = (String, Vec<f64>, Vec<String>);

/// Requested labels.
#[derive(Debug, Clone, FromPyObject)]
#[pyo3(from_item_all)]
struct Labels {
    boxes: bool,
    shapes: bool,
    instances: bool,
    depth: bool,
    heatmap: bool,
    flow: bool,
    flow_depth_um: Option<f64>,
    flow_z: bool,
    clean: bool,
    share: f64,
    heatmap_sigma_px: f64,
}

fn distribution((name, numbers, values): DistributionParts) -> storage::Result<Distribution> {
    Ok(match (name.as_str(), numbers.as_slice()) {
        ("uniform", &[low, high]) => Distribution::Uniform { low, high },
        ("log_uniform", &[low, high]) => Distribution::LogUniform { low, high },
        ("integers", &[low, high]) => Distribution::Integers { low: low as i64, high: high as i64 },
        ("choice", _) => Distribution::Choice(values),
        _ => return Err(storage::Error::input(format!("vary: {name} is not a distribution"))),
    })
}

/// A stream of samples.
#[pyclass(frozen, module = "microsig._microsig")]
pub(crate) struct Samples(Arc<SampleStream>);

#[pymethods]
impl Samples {
    #[new]
    #[expect(clippy::too_many_arguments, reason = "all that a stream is made from")]
    fn new(
        py: Python<'_>,
        text: ScenarioText,
        vary: Vec<(String, DistributionParts)>,
        seed: u64,
        validation: bool,
        frames: u32,
        labels: Labels,
        rows: usize,
        window: Option<(u32, u32)>,
    ) -> PyResult<Self> {
        let stream = run(py, false, OnInterrupt::Leave, move |_| {
            let flow = labels.flow_depth_um.map_or(Flow::Mean, Flow::At);
            SampleStream::new(StreamOptions {
                assignments: text.assignments(),
                text: text.text,
                name: text.name,
                folder: text.folder,
                vary: vary
                    .into_iter()
                    .map(|(path, parts)| Ok((path, distribution(parts)?)))
                    .collect::<storage::Result<_>>()?,
                seed,
                split: if validation { Split::Validation } else { Split::Train },
                frames,
                labels: LabelOptions {
                    boxes: labels.boxes,
                    shapes: labels.shapes,
                    instances: labels.instances,
                    depth: labels.depth,
                    heatmap: labels.heatmap,
                    flow: labels.flow.then_some(flow),
                    flow_z: labels.flow_z,
                    clean: labels.clean,
                    share: labels.share,
                    heatmap_sigma_px: labels.heatmap_sigma_px,
                },
                rows,
                window: window.map(|(height, width)| (width, height)),
            })
        })?;
        Ok(Samples(Arc::new(stream)))
    }

    /// What slows the stream down.
    fn warning(&self) -> Option<&str> {
        self.0.warning()
    }

    /// Rows and columns of the images.
    fn size(&self) -> (u32, u32) {
        let (width, height) = self.0.size_px();
        (height, width)
    }

    /// The seed of a sample.
    fn seed_of(&self, index: u64) -> u64 {
        self.0.seed_of(index)
    }

    /// The values of a sample that vary.
    fn values(&self, index: u64) -> Vec<(String, Object<Literal>)> {
        let given = |(path, drawn): (&str, Drawn)| (path.to_owned(), Object(Literal::of(&drawn.text)));
        self.0.values(index).into_iter().map(given).collect()
    }

    /// First row and column of the window of a sample, from 0.
    fn window(&self, index: u64) -> Option<(usize, usize)> {
        self.0.window(index).map(|window| (window.top, window.left))
    }

    /// The scenario of a sample as an object and as RON.
    fn scenario(&self, py: Python<'_>, index: u64) -> PyResult<(Object, String)> {
        let stream = Arc::clone(&self.0);
        run(py, false, OnInterrupt::Leave, move |_| crate::dataset::written(&stream.scenario(index)?))
    }

    /// Checks that there is free memory for this number of batches of `n` samples; `what` names their
    /// arguments.
    fn check_memory(&self, what: &str, n: u64, batches: u64) -> PyResult<()> {
        self.0.check_memory(what, n, batches).map_err(raise)
    }

    /// `n` samples from a number on.
    fn batch<'py>(&self, py: Python<'py>, first: u64, n: usize) -> PyResult<Bound<'py, PyDict>> {
        let stream = Arc::clone(&self.0);
        let batch =
            run(py, false, OnInterrupt::Leave, move |progress| stream.batch(first, n, || progress.check()))?;
        arrays(py, &self.0, batch)
    }

    /// Computes batches of `n` samples ahead, `ahead` of them: the first one starts at `first`, each further
    /// one `step` samples after the previous one.
    fn ahead(&self, py: Python<'_>, first: u64, n: usize, step: u64, ahead: usize) -> PyResult<Ahead> {
        let (sender, receiver) = sync_channel(ahead.max(1) - 1);
        let (stream, pool, stop) = (Arc::clone(&self.0), pool(py)?, Cancellation::default());
        let (work, threads) = (Arc::clone(&stream), Arc::clone(&pool));
        let progress = Progress::default().stopped_by(&stop);
        let draw = move || {
            let go_on = || progress.check();
            let mut at = first;
            loop {
                let batch = catch_unwind(AssertUnwindSafe(|| threads.install(|| work.batch(at, n, go_on))));
                let is_last = !matches!(batch, Ok(Ok(_)));
                // Without a receiver, no more batches are needed.
                if go_on().is_err() || sender.send(batch).is_err() || is_last {
                    return;
                }
                at = at.wrapping_add(step);
            }
        };
        std::thread::Builder::new().name("microsig-ahead".to_owned()).spawn(draw)?;
        let parts = ManuallyDrop::new(Parts { receiver: Mutex::new(receiver), _pool: pool });
        Ok(Ahead { process: std::process::id(), stream, stop, parts })
    }
}

/// Objects that a forked process must not touch: threads of its parent may hold their locks.
struct Parts {
    receiver: Mutex<Receiver<std::thread::Result<storage::Result<Batch>>>>,
    _pool: Arc<ThreadPool>,
}

/// Batches that are computed ahead.
#[pyclass(frozen, module = "microsig._microsig")]
pub(crate) struct Ahead {
    process: u32,
    stream: Arc<SampleStream>,
    stop: Cancellation,
    parts: ManuallyDrop<Parts>,
}

impl Drop for Ahead {
    fn drop(&mut self) {
        self.stop.cancel();
        if self.process == std::process::id() {
            // SAFETY: dropped only here, and not used afterwards.
            unsafe { ManuallyDrop::drop(&mut self.parts) }
        }
    }
}

#[pymethods]
impl Ahead {
    /// The next batch.
    fn next<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        if self.process != std::process::id() {
            return Err(PyRuntimeError::new_err("batches computed ahead belong to the parent process"));
        }
        let receiver = &self.parts.receiver;
        loop {
            let next = || receiver.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(TICK);
            match py.detach(next) {
                Ok(Ok(Ok(batch))) => return arrays(py, &self.stream, batch),
                Ok(Ok(Err(error))) => return Err(raise(error)),
                Ok(Err(panic)) => return Err(defect(panic.as_ref())),
                Err(RecvTimeoutError::Timeout) => py.check_signals()?,
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(PyRuntimeError::new_err("no more batches: an error was raised before"));
                }
            }
        }
    }
}

/// A batch as arrays by name; labels that were not requested are omitted.
fn arrays<'py>(py: Python<'py>, stream: &SampleStream, batch: Batch) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    let (n, rows) = (batch.indices.len(), batch.rows);
    let (width, height) = stream.size_px();
    let (height, width, frames) = (height as usize, width as usize, stream.options().frames as usize);
    let labels = &stream.options().labels;
    fn put<T: Element>(
        dict: &Bound<'_, PyDict>,
        name: &str,
        values: Vec<T>,
        shape: &[usize],
    ) -> PyResult<()> {
        let array = PyArray1::from_vec(dict.py(), values)
            .reshape_with_order(shape.to_vec(), numpy::npyffi::NPY_ORDER::NPY_CORDER)?;
        dict.set_item(name, array)
    }
    put(&dict, "index", batch.indices, &[n])?;
    put(&dict, "image", batch.images, &[n, frames, height, width])?;
    put(&dict, "particles", batch.particles, &[n, rows, 8])?;
    put(&dict, "mask", batch.mask, &[n, rows])?;
    for (wanted, name, values, columns) in
        [(labels.boxes, "boxes", batch.boxes, 6), (labels.shapes, "shapes", batch.shapes, 4)]
    {
        if wanted {
            let values = if values.is_empty() { vec![0.0; n * rows * columns] } else { values };
            put(&dict, name, values, &[n, rows, columns])?;
        }
    }
    if labels.instances {
        put(&dict, "instances", batch.instances, &[n, height, width])?;
    }
    if labels.depth {
        put(&dict, "depth", batch.depth, &[n, height, width])?;
    }
    if labels.heatmap {
        put(&dict, "heatmap", batch.heatmap, &[n, height, width])?;
    }
    if labels.flow.is_some() {
        let axes = if labels.flow_z { 3 } else { 2 };
        put(&dict, "flow", batch.flow, &[n, axes, height, width])?;
    }
    if labels.clean {
        put(&dict, "clean", batch.clean, &[n, frames, height, width])?;
    }
    Ok(dict)
}
