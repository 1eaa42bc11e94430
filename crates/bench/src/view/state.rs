//! State shared by requests: the subject, open datasets and results, open pages.

use std::collections::VecDeque;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use microsig_core::cancel::Cancellation;
use tokio::sync::Notify;

use super::dataset::OpenDataset;
use super::result::OpenResult;
use super::subject::Subject;
use storage::error::{Error, Result};

/// Maximum number of open datasets.
const OPEN_DATASETS: usize = 3;

/// Maximum number of results in memory.
const OPEN_RESULTS: usize = 6;

/// Time without an open page after which the program ends.
const ALONE: Duration = Duration::from_secs(5);

/// State shared by requests.
#[derive(Debug)]
pub(super) struct App {
    pub(super) subject: Subject,
    pub(super) token: String,
    pub(super) port: u16,
    datasets: Cache<usize, OpenDataset>,
    results: Cache<(usize, usize), OpenResult>,
    /// Locked while a result is scored: scoring may need much memory.
    scoring: Mutex<()>,
    /// Cancels the running preview.
    preview: Mutex<Cancellation>,
    /// Locked by the running preview.
    pub(super) previewing: Arc<Mutex<()>>,
    viewers: AtomicU64,
    /// Whether a page has ever been open.
    seen: AtomicBool,
    ended: AtomicBool,
    end: Notify,
}

/// A cache of open values, ordered by last use.
#[derive(Debug)]
struct Cache<K, V> {
    most: usize,
    all: Mutex<VecDeque<(K, Arc<V>)>>,
}

impl<K: PartialEq + Copy, V> Cache<K, V> {
    fn at_most(most: usize) -> Self {
        Cache { most, all: Mutex::new(VecDeque::new()) }
    }

    fn find(&self, key: K) -> Option<Arc<V>> {
        let mut all = locked(&self.all);
        let at = all.iter().position(|(of, _)| *of == key)?;
        let found = all.remove(at)?;
        let value = Arc::clone(&found.1);
        all.push_back(found);
        Some(value)
    }

    fn keep(&self, key: K, value: V) -> Arc<V> {
        let (value, mut all) = (Arc::new(value), locked(&self.all));
        // Two requests may have opened the same value.
        all.retain(|(of, _)| *of != key);
        all.push_back((key, Arc::clone(&value)));
        while all.len() > self.most {
            all.pop_front();
        }
        value
    }
}

/// Locks a mutex, ignoring poisoning: guarded values stay consistent even if a holder panics.
pub(super) fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// An open page; dropped when the page is closed.
#[derive(Debug)]
pub(super) struct Viewer(Arc<App>);

impl Drop for Viewer {
    fn drop(&mut self) {
        self.0.viewers.fetch_sub(1, Ordering::SeqCst);
    }
}

impl App {
    pub(super) fn new(subject: Subject, port: u16) -> Result<Self> {
        let mut random = [0; 16];
        getrandom::fill(&mut random).map_err(|e| Error::input(format!("random token: {e}")))?;
        Ok(App {
            subject,
            token: random.iter().map(|byte| format!("{byte:02x}")).collect(),
            port,
            datasets: Cache::at_most(OPEN_DATASETS),
            results: Cache::at_most(OPEN_RESULTS),
            scoring: Mutex::default(),
            preview: Mutex::default(),
            previewing: Arc::default(),
            viewers: AtomicU64::new(0),
            seen: AtomicBool::new(false),
            ended: AtomicBool::new(false),
            end: Notify::new(),
        })
    }

    /// The page's address.
    pub(super) fn address(&self) -> String {
        format!("http://127.0.0.1:{}/{}/", self.port, self.token)
    }

    /// Title: what the page shows.
    pub(super) fn title(&self) -> String {
        let shown = |path: &Path| path.display().to_string();
        match (&self.subject.sweep, &self.subject.scenario, self.subject.datasets.first()) {
            (Some(sweep), ..) => shown(sweep),
            (_, Some(scenario), _) => shown(scenario),
            (_, _, Some(dataset)) => shown(&dataset.folder),
            _ => "a new scenario".to_owned(),
        }
    }

    /// The dataset with an index; `None` if it does not exist.
    pub(super) fn dataset(&self, number: usize) -> Result<Option<Arc<OpenDataset>>> {
        let Some(entry) = self.subject.datasets.get(number) else { return Ok(None) };
        if let Some(open) = self.datasets.find(number) {
            return Ok(Some(open));
        }
        Ok(Some(self.datasets.keep(number, OpenDataset::open(&entry.folder, &self.subject.context)?)))
    }

    /// The result of a tracker for a dataset; `None` if it does not exist.
    pub(super) fn result(&self, dataset: usize, tracker: usize) -> Result<Option<Arc<OpenResult>>> {
        let Some(entry) = self.subject.datasets.get(dataset) else { return Ok(None) };
        let path =
            self.subject.trackers.get(tracker).and_then(|tracker| tracker.results.get(dataset)?.as_ref());
        let Some(path) = path else { return Ok(None) };
        if let Some(open) = self.results.find((dataset, tracker)) {
            return Ok(Some(open));
        }
        let _one_at_a_time = locked(&self.scoring);
        // Another request may have scored it meanwhile.
        if let Some(open) = self.results.find((dataset, tracker)) {
            return Ok(Some(open));
        }
        Ok(Some(self.results.keep((dataset, tracker), OpenResult::open(&entry.folder, path)?)))
    }

    /// Cancels the running preview; returns the cancellation of the next one.
    pub(super) fn next_preview(&self) -> Cancellation {
        let next = Cancellation::default();
        std::mem::replace(&mut *locked(&self.preview), next.clone()).cancel();
        next
    }

    /// Registers a page that has just been opened.
    pub(super) fn viewer(self: &Arc<Self>) -> Viewer {
        self.viewers.fetch_add(1, Ordering::SeqCst);
        self.seen.store(true, Ordering::SeqCst);
        Viewer(Arc::clone(self))
    }

    /// Tells the program to end.
    pub(super) fn end(&self) {
        self.ended.store(true, Ordering::SeqCst);
        self.next_preview();
        self.end.notify_waiters();
    }

    /// Returns when the program is to end.
    pub(super) async fn ended(&self) {
        let mut end = std::pin::pin!(self.end.notified());
        end.as_mut().enable();
        if !self.ended.load(Ordering::SeqCst) {
            end.await;
        }
    }

    /// Returns when the program is to end, or when no page has been open for a while.
    pub(super) async fn ended_or_left(&self) {
        const STEP: Duration = Duration::from_millis(250);
        let mut alone_since = Instant::now();
        while tokio::time::timeout(STEP, self.ended()).await.is_err() {
            let is_alone = self.seen.load(Ordering::SeqCst) && self.viewers.load(Ordering::SeqCst) == 0;
            if !is_alone {
                alone_since = Instant::now();
            } else if alone_since.elapsed() > ALONE {
                return;
            }
        }
    }
}
