//! Virtual time: one clock a thread, moved by hand.
//!
//! This is the time driver of every program that links this crate. Time stands still until
//! [`advance_to`] moves it, so a test sees every event at its exact microsecond, tests in
//! different threads do not disturb each other, and an hour passes as fast as it can be computed.

use std::cell::{Cell, RefCell};
use std::task::Waker;

use embassy_time::Instant;
use embassy_time_driver::Driver;

thread_local! {
    static NOW: Cell<u64> = const { Cell::new(0) };
    static ALARMS: RefCell<Vec<(u64, Waker)>> = const { RefCell::new(Vec::new()) };
}

struct ThreadClock;

impl Driver for ThreadClock {
    fn now(&self) -> u64 {
        NOW.get()
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        if at == u64::MAX {
            return; // "never"
        }
        ALARMS.with_borrow_mut(|alarms| {
            // A task that is woken early looks again at all that it waits for.
            match alarms.iter_mut().find(|(_, known)| known.will_wake(waker)) {
                Some((earliest, _)) => *earliest = at.min(*earliest),
                None => alarms.push((at, waker.clone())),
            }
        });
    }
}

embassy_time_driver::time_driver_impl!(static CLOCK: ThreadClock = ThreadClock);

/// Sets this thread's clock to zero and forgets its alarms.
pub fn reset() {
    NOW.set(0);
    ALARMS.with_borrow_mut(Vec::clear);
}

/// When the next alarm of this thread is due.
pub fn next_alarm() -> Option<Instant> {
    ALARMS.with_borrow(|alarms| alarms.iter().map(|(at, _)| *at).min()).map(Instant::from_ticks)
}

/// Moves this thread's clock forward and wakes whose time has come.
pub fn advance_to(time: Instant) {
    NOW.set(NOW.get().max(time.as_ticks()));
    ALARMS.with_borrow_mut(|alarms| {
        let mut i = 0;
        while let Some((at, _)) = alarms.get(i) {
            if *at <= NOW.get() {
                alarms.swap_remove(i).1.wake();
            } else {
                i += 1;
            }
        }
    });
}
