//! Work that can be cancelled: whoever previews an image no longer wants it once a setting has changed.
//!
//! Renderers and trajectories call [`checkpoint`] every few milliseconds of work. Where nobody cancels, it
//! does nothing.

use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

thread_local! {
    /// What cancels the work of this thread.
    static CANCELLATION: RefCell<Option<Cancellation>> = const { RefCell::new(None) };
}

/// Stack of the threads that work, bytes: as for a program's first thread.
const STACK: usize = 8 << 20;

/// With this the stack is unwound; no message is printed.
struct Cancelled;

/// A sign that work is no longer wanted; clones are the same sign.
#[derive(Debug, Clone, Default)]
pub struct Cancellation(Arc<AtomicBool>);

impl Cancellation {
    /// Cancels the work; it ends at its next checkpoints.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::SeqCst);
    }

    /// Whether the work is cancelled.
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::SeqCst)
    }

    /// Runs work on `threads` threads of its own (0: one for each core); `None` if it was cancelled before
    /// its end. What the work was about to change is left as after a panic, so it should own what it changes.
    pub fn run<T: Send>(&self, threads: usize, work: impl FnOnce() -> T + Send) -> Option<T> {
        let sign = self.clone();
        let threads = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .stack_size(STACK)
            .start_handler(move |_| CANCELLATION.set(Some(sign.clone())))
            .build();
        let done = match threads {
            Ok(threads) => catch_unwind(AssertUnwindSafe(|| threads.install(work))),
            // No threads are to be had: this one must do, and the work runs to its end.
            Err(_) => return Some(work()),
        };
        match done {
            Ok(done) => Some(done),
            Err(cause) if cause.is::<Cancelled>() => None,
            Err(cause) => resume_unwind(cause),
        }
    }
}

/// Ends the work of [`Cancellation::run`] on this thread if it was cancelled.
#[inline]
pub fn checkpoint() {
    let is_cancelled = CANCELLATION.with_borrow(|sign| sign.as_ref().is_some_and(Cancellation::is_cancelled));
    if is_cancelled {
        resume_unwind(Box::new(Cancelled));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::{ExpectedRenderer, RayRenderer, Render};
    use crate::stream::{Purpose, Streams};
    use crate::{Particle, Settings, emission::SpheroidLaw};
    use rayon::prelude::*;
    use std::time::Duration;

    #[test]
    fn work_ends_with_its_result_its_cancellation_or_its_panic() {
        let sign = Cancellation::default();
        assert_eq!(sign.run(0, || (0..100).into_par_iter().inspect(|_| checkpoint()).sum()), Some(4950));
        let seen = std::sync::atomic::AtomicUsize::new(0);
        let cancelled = sign.run(0, || {
            (0..100_000).into_par_iter().for_each(|k| {
                checkpoint();
                seen.fetch_add(1, Ordering::Relaxed);
                if k == 3 {
                    sign.cancel();
                }
            });
        });
        assert!(cancelled.is_none() && sign.is_cancelled());
        assert!(seen.into_inner() < 100_000);
        // Other work goes on: on this thread, and under another sign.
        checkpoint();
        assert_eq!(Cancellation::default().run(0, checkpoint), Some(()));
        let other = Cancellation::default();
        assert!(catch_unwind(AssertUnwindSafe(|| other.run(0, || resume_unwind(Box::new(7))))).is_err());
    }

    /// Checks that a renderer does not finish an image that is cancelled meanwhile.
    fn is_cancelled(renderer: &dyn Render, particles: &[Particle]) {
        let sign = Cancellation::default();
        let cancel = sign.clone();
        let cancelling = std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(30));
            cancel.cancel();
        });
        let light = sign.run(0, || renderer.light(particles, &Streams::new(1), Purpose::Rays, 0));
        cancelling.join().unwrap();
        assert!(light.is_none(), "{} was finished", renderer.traits().name);
    }

    #[test]
    fn images_are_cancelled_before_their_end() {
        let settings = Settings { pixel_dim_x: 512, pixel_dim_y: 512, ..Settings::setting1() };
        let sphere = |k: u32| Particle::sphere(f64::from(k % 512), f64::from(k / 512 % 512), -70.0, 2.0);
        let many: Vec<Particle> = (0..40_000).map(sphere).collect();
        let rays = RayRenderer::new(&settings, SpheroidLaw::Original).unwrap();
        is_cancelled(&rays, &many);
        // A table of many depths: the sign comes while it is made, and the next image makes it anew.
        let expected = ExpectedRenderer::new(&settings, SpheroidLaw::Original, 1e-4).unwrap();
        let sizes: Vec<Particle> =
            (0..200).map(|k| Particle::sphere(256.0, 256.0, -80.0 + 0.5 * f64::from(k), 2.0)).collect();
        is_cancelled(&expected, &sizes);
        let light = expected.draw(&sizes[..1]);
        let fresh = ExpectedRenderer::new(&settings, SpheroidLaw::Original, 1e-4).unwrap();
        assert!(light == fresh.draw(&sizes[..1]));
    }
}
