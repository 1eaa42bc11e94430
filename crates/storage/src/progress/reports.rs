//! Progress where bars cannot be drawn: lines for the readers of logs, JSON for programs, the task under way
//! for a thread that asks.

use std::fmt;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{HumanDuration, ProgressBar};
use serde::Serialize;
use serde_json::json;

/// How tasks are reported.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    /// One line on all running tasks, with the time left.
    Lines,
    /// One JSON object per task and line, also when a task begins and when it ends.
    Json,
    /// Nothing is written: another thread calls [`Reports::now`].
    Polled,
}

/// Why a task is reported as JSON.
#[derive(Debug, Clone, Copy, Serialize)]
#[serde(rename_all = "lowercase")]
enum Event {
    Begin,
    Progress,
    End,
}

/// The running tasks, reported again and again from a thread that ends with the last reference, or when
/// another thread asks.
pub struct Reports {
    form: Form,
    write: Box<dyn Fn(&str) + Send + Sync>,
    /// The running tasks in the order of their beginnings; the last one is kept when it has ended.
    tasks: Mutex<Vec<Arc<Task>>>,
}

/// A task under way.
#[derive(Debug)]
pub(super) struct Task {
    what: &'static str,
    since: Instant,
    bar: ProgressBar,
}

impl fmt::Debug for Reports {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Reports").field("form", &self.form).finish_non_exhaustive()
    }
}

impl Reports {
    /// Reports to `write`, line by line; `period`: between reports that are not asked for.
    pub(super) fn start(
        form: Form,
        period: Option<Duration>,
        write: impl Fn(&str) + Send + Sync + 'static,
    ) -> Arc<Self> {
        let reports = Arc::new(Reports { form, write: Box::new(write), tasks: Mutex::default() });
        let Some(period) = period else { return reports };
        let again = Arc::downgrade(&reports);
        // Without the thread, only JSON of beginnings and ends is written.
        let _ = std::thread::Builder::new().name("progress".to_owned()).spawn(move || {
            loop {
                std::thread::sleep(period);
                match again.upgrade() {
                    Some(reports) => reports.all(),
                    None => return,
                }
            }
        });
        reports
    }

    /// Begins a task; it ends when it is dropped.
    pub(super) fn task(self: &Arc<Self>, what: &'static str, bar: ProgressBar) -> Reported {
        let task = Arc::new(Task { what, since: Instant::now(), bar });
        self.tasks().push(Arc::clone(&task));
        self.tell(Event::Begin, &task);
        Reported { reports: Arc::clone(self), task }
    }

    /// Reports a task as JSON.
    fn tell(&self, event: Event, task: &Task) {
        if self.form == Form::Json {
            (self.write)(&task.json(event));
        }
    }

    /// The list of tasks, without those that have ended before the last one began.
    fn tasks(&self) -> MutexGuard<'_, Vec<Arc<Task>>> {
        let mut tasks = self.tasks.lock().unwrap_or_else(PoisonError::into_inner);
        let last = tasks.pop();
        tasks.retain(|task| task.is_running());
        tasks.extend(last);
        tasks
    }

    /// What is being made, how many are done, and how many there are (0 if that is unknown): of the task that
    /// began last and still runs, or of the last of all.
    pub fn now(&self) -> Option<(&'static str, u64, u64)> {
        let tasks = self.tasks();
        let task = tasks.iter().rfind(|task| task.is_running()).or(tasks.last())?;
        Some((task.what, task.bar.position(), task.total().unwrap_or(0)))
    }

    /// Whether another thread asks for the task under way.
    pub(super) fn are_polled(&self) -> bool {
        self.form == Form::Polled
    }

    /// Reports all running tasks.
    fn all(&self) {
        let mut running = self.tasks().clone();
        running.retain(|task| task.is_running());
        running.iter().for_each(|task| self.tell(Event::Progress, task));
        if self.form == Form::Lines {
            line(&running).iter().for_each(|line| (self.write)(line));
        }
    }
}

/// A task that is reported until it is dropped.
#[derive(Debug)]
pub(super) struct Reported {
    reports: Arc<Reports>,
    task: Arc<Task>,
}

impl Drop for Reported {
    fn drop(&mut self) {
        self.reports.tell(Event::End, &self.task);
        self.task.bar.abandon();
    }
}

impl Task {
    fn is_running(&self) -> bool {
        !self.bar.is_finished()
    }

    /// The number of parts; `None` if it is unknown.
    fn total(&self) -> Option<u64> {
        self.bar.length().filter(|total| *total > 0)
    }

    /// The completed fraction, including the part under way; `None` if it is unknown.
    fn fraction(&self, part_done: f64) -> Option<f64> {
        Some(((self.bar.position() as f64 + part_done) / self.total()? as f64).min(1.0))
    }

    /// The time left at the mean speed so far; `None` if it is unknown.
    fn left(&self, part_done: f64) -> Option<Duration> {
        let fraction = self.fraction(part_done).filter(|fraction| *fraction > 0.0)?;
        Duration::try_from_secs_f64(self.since.elapsed().as_secs_f64() * (1.0 / fraction - 1.0)).ok()
    }

    fn json(&self, event: Event) -> String {
        let message = Some(self.bar.message()).filter(|message| !message.is_empty());
        let whole = json!({
            "event": event,
            "task": self.what,
            "message": message,
            "done": self.bar.position(),
            "total": self.total(),
            "seconds": self.since.elapsed().as_secs_f64(),
            "seconds_left": self.left(0.0).map(|left| left.as_secs_f64()),
        });
        whole.to_string()
    }
}

/// The running tasks as a line: the first contains the others. `None` without tasks.
fn line(running: &[Arc<Task>]) -> Option<String> {
    let (first, within) = running.split_first()?;
    let described = running.iter().map(|task| {
        let count = task.total().map(|total| format!("{} of {total} ", task.bar.position()));
        let message = Some(task.bar.message()).filter(|message| !message.is_empty() && message != task.what);
        let message = message.map(|message| format!(" ({message})"));
        format!("{}{}{}", count.unwrap_or_default(), task.what, message.unwrap_or_default())
    });
    let described: Vec<String> = described.collect();
    let part_done = within.first().and_then(|task| task.fraction(0.0)).filter(|part| *part < 1.0);
    let left =
        first.left(part_done.unwrap_or_default()).map(|left| format!("about {} left", HumanDuration(left)));
    let left = left.or_else(|| {
        let (what, left) = within.iter().find_map(|task| Some((task.what, task.left(0.0)?)))?;
        Some(format!("about {} left for {what}", HumanDuration(left)))
    });
    let left = left.unwrap_or_else(|| "time left unknown".to_owned());
    Some(format!("{}; {} so far, {left}", described.join(", "), HumanDuration(first.since.elapsed())))
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use indicatif::ProgressDrawTarget;

    use super::*;

    fn bar(n: u64, done: u64) -> ProgressBar {
        let bar = ProgressBar::with_draw_target(Some(n), ProgressDrawTarget::hidden());
        bar.set_position(done);
        bar
    }

    #[test]
    fn lines_state_what_is_done_and_how_long_the_rest_takes() {
        let minutes = |m: u64| Instant::now().checked_sub(Duration::from_secs(60 * m)).unwrap();
        let cases = Task { what: "cases", since: minutes(10), bar: bar(20, 4) };
        cases.bar.set_message("case_00004");
        let images = Task { what: "images", since: minutes(1), bar: bar(8, 4) };
        let tasks = [Arc::new(cases), Arc::new(images)];
        // 4.5 of 20 cases in 10 minutes leave 34.4 minutes.
        let expected = "4 of 20 cases (case_00004), 4 of 8 images; 10 minutes so far, about 34 minutes left";
        assert_eq!(line(&tasks).unwrap(), expected);
        let fit = Task { what: "fit", since: minutes(2), bar: bar(0, 0) };
        assert_eq!(line(&[Arc::new(fit)]).unwrap(), "fit; 2 minutes so far, time left unknown");
        let fit = Task { what: "% of the fit", since: minutes(6), bar: bar(100, 40) };
        fit.bar.set_message("particle 7 of 11");
        let expected = "40 of 100 % of the fit (particle 7 of 11); 6 minutes so far, about 9 minutes left";
        assert_eq!(line(&[Arc::new(fit)]).unwrap(), expected);
        // Of the whole, nothing is known.
        let twin = Task { what: "twin", since: minutes(7), bar: bar(0, 0) };
        twin.bar.set_message("mle on the recording");
        let tables = Task { what: "image tables", since: minutes(6), bar: bar(8, 2) };
        let expected = "twin (mle on the recording), 2 of 8 image tables; 7 minutes so far, about 18 minutes left for image tables";
        assert_eq!(line(&[Arc::new(twin), Arc::new(tables)]).unwrap(), expected);
        assert_eq!(line(&[]), None);
    }

    #[test]
    fn tasks_are_reported_periodically_until_they_end() {
        let (sender, lines) = mpsc::channel();
        let sender = Mutex::new(sender);
        let write = move |line: &str| sender.lock().unwrap().send(line.to_owned()).unwrap_or_default();
        let reports = Reports::start(Form::Lines, Some(Duration::from_millis(5)), write);
        let images = bar(8, 0);
        let task = reports.task("images", images.clone());
        images.set_position(2);
        let wait = Duration::from_secs(20);
        while !lines.recv_timeout(wait).unwrap().starts_with("2 of 8 images; ") {}
        drop(task);
        drop(reports);
        // The thread ends, and with it the sender.
        while lines.recv_timeout(wait).is_ok() {}
        assert_eq!(lines.recv_timeout(wait), Err(mpsc::RecvTimeoutError::Disconnected));
    }

    #[test]
    fn whoever_asks_gets_the_task_that_began_last() {
        let reports = Reports::start(Form::Polled, None, |_| ());
        assert_eq!(reports.now(), None);
        let cases = reports.task("cases", bar(3, 1));
        let images = reports.task("images", bar(8, 2));
        assert_eq!(reports.now(), Some(("images", 2, 8)));
        drop(images);
        assert_eq!(reports.now(), Some(("cases", 1, 3)));
        cases.task.bar.set_position(3);
        drop(cases);
        // Of all that have ended, the last one.
        assert_eq!(reports.now(), Some(("images", 2, 8)));
        drop(reports.task("frames", bar(5, 5)));
        assert_eq!(reports.now(), Some(("frames", 5, 5)));
    }

    #[test]
    fn json_has_the_beginning_and_the_end_of_every_task() {
        let lines: Arc<Mutex<Vec<serde_json::Value>>> = Arc::default();
        let kept = Arc::clone(&lines);
        let write = move |line: &str| kept.lock().unwrap().push(serde_json::from_str(line).unwrap());
        let reports = Reports::start(Form::Json, Some(Duration::from_secs(3600)), write);
        let images = bar(8, 0);
        let task = reports.task("images", images.clone());
        images.set_position(8);
        drop(task);
        let lines = lines.lock().unwrap();
        let of = |key: &str| lines.iter().map(|line| line[key].clone()).collect::<Vec<_>>();
        assert_eq!((of("event"), of("task")), (vec![json!("begin"), json!("end")], vec![json!("images"); 2]));
        assert_eq!((of("done"), of("total")), (vec![json!(0), json!(8)], vec![json!(8), json!(8)]));
        assert_eq!(of("seconds_left"), [json!(null), json!(0.0)]);
    }
}
