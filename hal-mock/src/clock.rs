//! Virtual time, moved by hand.
//!
//! This is the time driver of every program that links this crate. Time stands still until
//! [`advance_to`] moves it, so every event has its exact microsecond. On a computer every thread
//! has a clock of its own: tests in different threads do not disturb each other, and an hour
//! passes as fast as it can be computed. An image has one.
//!
//! A clock is made for one task (see [`tasks`](crate::tasks)): it keeps the earliest alarm, and a
//! task that is woken looks again at all that it waits for.

use core::cell::{Cell, RefCell};
use core::task::Waker;

use embassy_sync::waitqueue::WakerRegistration;
use embassy_time::Instant;
use embassy_time_driver::Driver;

/// An alarm that never comes.
const NEVER: u64 = u64::MAX;

/// Times in ticks.
struct Clock {
    now: Cell<u64>,
    alarm: Cell<u64>,
    task: RefCell<WakerRegistration>,
}

impl Clock {
    const fn new() -> Self {
        Self {
            now: Cell::new(0),
            alarm: Cell::new(NEVER),
            task: RefCell::new(WakerRegistration::new()),
        }
    }
}

#[cfg(feature = "std")]
fn with<T>(act: impl FnOnce(&Clock) -> T) -> T {
    std::thread_local! {
        static CLOCK: Clock = const { Clock::new() };
    }
    CLOCK.with(act)
}

#[cfg(not(feature = "std"))]
fn with<T>(act: impl FnOnce(&Clock) -> T) -> T {
    use critical_section::Mutex;
    static CLOCK: Mutex<Clock> = Mutex::new(Clock::new());
    critical_section::with(|cs| act(CLOCK.borrow(cs)))
}

struct VirtualTime;

impl Driver for VirtualTime {
    fn now(&self) -> u64 {
        with(|clock| clock.now.get())
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        with(|clock| {
            clock.alarm.set(at.min(clock.alarm.get()));
            clock.task.borrow_mut().register(waker);
        });
    }
}

embassy_time_driver::time_driver_impl!(static DRIVER: VirtualTime = VirtualTime);

/// Sets this clock to zero and forgets its alarm.
pub fn reset() {
    with(|clock| {
        clock.now.set(0);
        clock.alarm.set(NEVER);
        *clock.task.borrow_mut() = WakerRegistration::new();
    });
}

/// When this clock's alarm is due.
pub fn next_alarm() -> Option<Instant> {
    let at = with(|clock| clock.alarm.get());
    (at != NEVER).then(|| Instant::from_ticks(at))
}

/// Moves this clock forward, and wakes its task if the alarm's time has come.
pub fn advance_to(time: Instant) {
    with(|clock| {
        clock.now.set(clock.now.get().max(time.as_ticks()));
        if clock.alarm.get() <= clock.now.get() {
            clock.alarm.set(NEVER);
            clock.task.borrow_mut().wake();
        }
    });
}
