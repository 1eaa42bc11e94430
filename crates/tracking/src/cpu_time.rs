//! CPU time, which other programs do not lengthen as they lengthen wall-clock time; on systems that do not
//! report it, wall-clock time.

/// Whose time is measured.
#[derive(Debug, Clone, Copy)]
pub(super) enum Consumer {
    Thread,
    Process,
}

impl Consumer {
    /// CPU time consumed so far, s; only differences have a meaning.
    #[cfg(unix)]
    pub(super) fn seconds(self) -> f64 {
        use rustix::time::{ClockId, clock_gettime};
        let clock = match self {
            Consumer::Thread => ClockId::ThreadCPUTime,
            Consumer::Process => ClockId::ProcessCPUTime,
        };
        let time = clock_gettime(clock);
        time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
    }

    #[cfg(not(unix))]
    pub(super) fn seconds(self) -> f64 {
        static START: std::sync::OnceLock<std::time::Instant> = std::sync::OnceLock::new();
        START.get_or_init(std::time::Instant::now).elapsed().as_secs_f64()
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    /// Waiting consumes no CPU time; work of another thread counts for the process, not for this thread.
    #[test]
    fn time_is_that_of_work() {
        let before = [Consumer::Thread, Consumer::Process].map(Consumer::seconds);
        let work = || while Consumer::Thread.seconds() < 0.05 {};
        std::thread::spawn(work).join().unwrap();
        let [own, all] = [Consumer::Thread, Consumer::Process].map(Consumer::seconds);
        assert!(own - before[0] < 0.04, "{}", own - before[0]);
        assert!(all - before[1] > 0.049, "{}", all - before[1]);
    }
}
