//! A board's tasks, kept and woken on a computer.

use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Wake, Waker};

use embassy_time::Instant;

use crate::tasks;

/// Tasks, joined to one that never ends.
pub struct Running {
    task: Pin<Box<dyn Future<Output = ()>>>,
    woken: Arc<Woken>,
    waker: Waker,
}

struct Woken(AtomicBool);

impl Wake for Woken {
    fn wake(self: Arc<Self>) {
        self.0.store(true, Ordering::Relaxed);
    }
}

impl Running {
    /// They run from the next call on.
    pub fn new(task: impl Future<Output = ()> + 'static) -> Self {
        let woken = Arc::new(Woken(AtomicBool::new(true)));
        let waker = Waker::from(woken.clone());
        Self { task: Box::pin(task), woken, waker }
    }

    /// Runs until `time`.
    pub fn run_until(&mut self, time: Instant) {
        tasks::run_until(self.task.as_mut(), &self.waker, &self.woken.0, time);
    }
}
