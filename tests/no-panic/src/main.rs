//! That no panic can be reached, by link: the panic handler calls a function that is nowhere. If the
//! compiler cannot prove that a panic is never reached, `a_panic_can_be_reached` stays in the image, and it
//! is not linked. `.ci/no-panic` builds it, as the boards' images are built: overflows wrap, and what is
//! proved is what that compiler can prove.
//!
//! What is proved: the wire formats in both directions, the core (controller, safety, settings, recorder) and all
//! personalities, the CM-5's bridge and pass-through among them, fed with any bytes at any time.
//!
//! What is left out: the executor, the drivers under `board/`, and the tasks of `app`, which wait on
//! `RefCell`s that only they share; their asserts are the library's own. The flash's store is
//! `sequential-storage`'s.
#![no_std]
#![no_main]

mod bridge;
mod core_and_sessions;
mod wire;

use core::hint::black_box;
use core::panic::PanicInfo;
use core::task::Waker;

unsafe extern "C" {
    /// Nowhere.
    fn a_panic_can_be_reached() -> !;
}

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    // SAFETY: it is never linked, and so never called.
    unsafe { a_panic_can_be_reached() }
}

/// A clock that shows anything.
struct AnyTime;

impl embassy_time_driver::Driver for AnyTime {
    fn now(&self) -> u64 {
        any()
    }

    fn schedule_wake(&self, _at: u64, _waker: &Waker) {}
}

embassy_time_driver::time_driver_impl!(static CLOCK: AnyTime = AnyTime);

/// A value that the compiler knows nothing of.
fn any<T: Default>() -> T {
    black_box(T::default())
}

/// Calls everything.
// SAFETY: the name is nobody else's.
#[unsafe(no_mangle)]
extern "C" fn everything() {
    core_and_sessions::run();
    bridge::run();
    bridge::run_pass_through();
    wire::run();
}
