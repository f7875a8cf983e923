//! embassy's clock on SysTick, for QEMU, whose STM32 timers have no compare interrupts. It counts
//! milliseconds.

use core::cell::RefCell;
use core::sync::atomic::{AtomicU32, Ordering};
use core::task::Waker;

use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m_rt::exception;
use critical_section::Mutex;
use embassy_time_driver::Driver;
use embassy_time_queue_utils::Queue;

/// The processor clock of the machine, whatever the image asks of RCC.
const CLOCK_HZ: u32 = 168_000_000;

/// Starts the clock.
pub fn start(mut systick: SYST) {
    systick.set_clock_source(SystClkSource::Core);
    systick.set_reload(CLOCK_HZ / 1000 - 1);
    systick.clear_current();
    systick.enable_counter();
    systick.enable_interrupt();
}

struct Clock {
    milliseconds: AtomicU32,
    queue: Mutex<RefCell<Queue>>,
}

embassy_time_driver::time_driver_impl!(static CLOCK: Clock = Clock {
    milliseconds: AtomicU32::new(0),
    queue: Mutex::new(RefCell::new(Queue::new())),
});

impl Driver for Clock {
    fn now(&self) -> u64 {
        u64::from(self.milliseconds.load(Ordering::Relaxed)) * 1000
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        critical_section::with(|cs| self.queue.borrow_ref_mut(cs).schedule_wake(at, waker));
    }
}

#[exception]
fn SysTick() {
    CLOCK.milliseconds.fetch_add(1, Ordering::Relaxed);
    critical_section::with(|cs| {
        CLOCK.queue.borrow_ref_mut(cs).next_expiration(CLOCK.now());
    });
}
