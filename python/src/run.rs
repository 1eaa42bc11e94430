//! Long work: on threads of its own, without the interpreter's lock, ended by Ctrl-C; errors as exceptions.

use std::any::Any;
use std::io::IsTerminal;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::time::Duration;

use bench::cli::printable;
use microsig_core::cancel::Cancellation;
use pyo3::exceptions::{
    PyFileExistsError, PyFileNotFoundError, PyKeyboardInterrupt, PyOSError, PyRuntimeError, PyValueError,
};
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use storage::Error;
use storage::progress::{Progress, Reports};

/// How often signals are looked for.
const TICK: Duration = Duration::from_millis(50);

/// Stack of the threads that work, bytes: as for a program's first thread.
const STACK: usize = 8 << 20;

/// The threads, and the process that they belong to: a forked process has none of its parent's.
static POOL: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);

fn build(threads: usize) -> PyResult<Arc<ThreadPool>> {
    let name = |k| format!("microsig-{k}");
    let pool = ThreadPoolBuilder::new().num_threads(threads).stack_size(STACK).thread_name(name).build();
    pool.map(Arc::new).map_err(|e| PyRuntimeError::new_err(format!("threads: {e}")))
}

/// The threads of this process. The interpreter's lock is held while the mutex is, so no fork happens
/// meanwhile.
pub(crate) fn pool(_: Python<'_>) -> PyResult<Arc<ThreadPool>> {
    let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    let own = std::process::id();
    match &*pool {
        Some((of, threads)) if *of == own => Ok(Arc::clone(threads)),
        _ => {
            let threads = build(0)?;
            // Threads of the parent cannot be joined here.
            std::mem::forget(pool.replace((own, Arc::clone(&threads))));
            Ok(threads)
        }
    }
}

/// Sets the number of threads of all calls that follow; 0: one for every core.
#[pyfunction]
pub(crate) fn set_threads(threads: usize) -> PyResult<()> {
    let threads = build(threads)?;
    let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((of, before)) = pool.replace((std::process::id(), threads))
        && of != std::process::id()
    {
        std::mem::forget(before);
    }
    Ok(())
}

/// What happens to work that is interrupted.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum OnInterrupt {
    /// It is left to end by itself: it touches nothing but memory.
    Leave,
    /// It is cancelled at its next step and waited for, so that it has cleaned up. It has threads of its own.
    Wait,
}

/// Receiver of progress reports.
#[derive(FromPyObject)]
pub(crate) enum Show<'py> {
    /// Bars on standard error if it is a terminal, or none.
    Terminal(bool),
    /// A callable of what is made (text), how many are done, and how many there are (0: unknown).
    Callable(Bound<'py, PyAny>),
}

impl From<bool> for Show<'_> {
    fn from(show: bool) -> Self {
        Show::Terminal(show)
    }
}

impl Show<'_> {
    /// Calls the callable if the progress changed.
    fn report(&self, reports: &Reports, last: &mut Option<(&'static str, u64, u64)>) -> PyResult<()> {
        let Show::Callable(callable) = self else { return Ok(()) };
        let now = reports.now();
        if let Some(now) = now.filter(|now| Some(*now) != *last) {
            *last = Some(now);
            callable.call1(now)?;
        }
        Ok(())
    }
}

/// Does some work while signals are handled, and reports its progress to `show`.
pub(crate) fn run<'s, T: Send + 'static>(
    py: Python<'_>,
    show: impl Into<Show<'s>>,
    on_interrupt: OnInterrupt,
    work: impl FnOnce(&Progress) -> storage::Result<T> + Send + 'static,
) -> PyResult<T> {
    let (pool, cancellation) = (pool(py)?, Cancellation::default());
    let (show, (asked, reports), mut reported) = (show.into(), Progress::asked(), None);
    let shown = match &show {
        Show::Terminal(true) if std::io::stderr().is_terminal() => Progress::bars(),
        Show::Terminal(_) | Show::Callable(_) => asked,
    };
    let progress = shown.stopped_by(&cancellation);
    let (sender, receiver) = mpsc::channel();
    let cancelled = cancellation.clone();
    let job = move || {
        let result = catch_unwind(AssertUnwindSafe(|| match on_interrupt {
            OnInterrupt::Leave => pool.install(|| work(&progress)),
            OnInterrupt::Wait => cancelled
                .run(pool.current_num_threads(), || work(&progress))
                .unwrap_or(Err(Error::Interrupted)),
        }));
        // Nobody may be waiting any more.
        let _ = sender.send(result);
    };
    std::thread::Builder::new().name("microsig".to_owned()).stack_size(STACK).spawn(job)?;
    let receiver = Mutex::new(receiver);
    let next = |patience: Duration| {
        py.detach(|| receiver.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(patience))
    };
    loop {
        match next(TICK) {
            Ok(Ok(result)) => {
                show.report(&reports, &mut reported)?;
                return result.map_err(raise);
            }
            Ok(Err(panic)) => return Err(defect(panic.as_ref())),
            Err(mpsc::RecvTimeoutError::Disconnected) => {
                return Err(PyRuntimeError::new_err("the thread that worked has ended"));
            }
            Err(mpsc::RecvTimeoutError::Timeout) => {
                let heard = py.check_signals().and_then(|()| show.report(&reports, &mut reported));
                if let Err(signal) = heard {
                    cancellation.cancel();
                    while on_interrupt == OnInterrupt::Wait
                        && matches!(next(TICK), Err(mpsc::RecvTimeoutError::Timeout))
                    {}
                    return Err(signal);
                }
            }
        }
    }
}

/// A defect of the program as an exception.
pub(crate) fn defect(panic: &(dyn Any + Send)) -> PyErr {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("unknown");
    PyRuntimeError::new_err(format!("a defect of microsig, please report it: {text}"))
}

/// The exception of an error, with its message.
pub(crate) fn raise(error: Error) -> PyErr {
    let text = match &error {
        Error::Options(all) => all.iter().map(|advice| advice.python.as_str()).collect::<Vec<_>>().join("\n"),
        Error::Exists { path, hint } => format!("{}: {}", path.display(), hint.python),
        error => error.messages().join("\n"),
    };
    let text = printable(&text);
    match error {
        Error::Interrupted => PyKeyboardInterrupt::new_err(text),
        Error::Exists { .. } => PyFileExistsError::new_err(text),
        Error::Read { source, .. } if source.kind() == std::io::ErrorKind::NotFound => {
            PyFileNotFoundError::new_err(text)
        }
        Error::Read { .. } | Error::Write { .. } | Error::Busy { .. } => PyOSError::new_err(text),
        Error::Optics(microsig_core::Error::Io { .. }) => PyOSError::new_err(text),
        _ => PyValueError::new_err(text),
    }
}
