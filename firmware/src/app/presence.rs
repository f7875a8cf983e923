//! Who is alive: every loop of the bridge checks in now and then, and the watchdog is fed when all
//! have. And the times that a watchdog must bear.

use core::cell::Cell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::RawMutex;
use embassy_time::{Duration, Timer};

/// A task that waits for something checks in at least this often while it waits. Work between
/// two waits takes less: a picture 2 ms, a telemetry frame 4.3 ms, a ranger's turn 40 ms.
pub(super) const CHECK_IN_PERIOD: Duration = Duration::from_millis(50);
/// How long a watchdog must bear without food. It is fed every 50 ms at the least; the last time is
/// 91 ms after a task has hung at the latest, and the board is to start again within 500 ms.
pub const WATCHDOG_PERIOD: Duration = Duration::from_millis(400);
/// How long it must bear after [`before_erase`](crate::ports::SystemPort::before_erase), with
/// nothing driven. Erasing a sector of 16 KiB stalls the core of an STM32F4 for 500 ms at the most;
/// its watchdog's clock may run at 47 kHz in place of 32 kHz, and then a second is 680 ms.
pub const ERASE_PERIOD: Duration = Duration::from_millis(1000);

/// Who has checked in since the watchdog was last fed, one bit a task.
pub(super) struct Presence<M: RawMutex> {
    present: Mutex<M, Cell<u8>>,
    all: u8,
}

impl<M: RawMutex> Presence<M> {
    /// Nobody yet of `all`.
    pub(super) const fn new(all: u8) -> Self {
        Self { present: Mutex::new(Cell::new(0)), all }
    }

    pub(super) fn check_in(&self, task: u8) {
        self.present.lock(|present| present.set(present.get() | task));
    }

    /// Whether all are present; if so, all must check in again.
    fn take_if_all(&self) -> bool {
        self.present.lock(|present| {
            let all = present.get() == self.all;
            if all {
                present.set(0);
            }
            all
        })
    }

    /// Calls `feed` whenever every task has checked in since it was last called. A task that hangs,
    /// on whatever executor, lets the watchdog starve; it must bear [`WATCHDOG_PERIOD`].
    pub(super) async fn supervise(&self, mut feed: impl FnMut()) -> ! {
        loop {
            Timer::after(CHECK_IN_PERIOD).await;
            if self.take_if_all() {
                feed();
            }
        }
    }
}
