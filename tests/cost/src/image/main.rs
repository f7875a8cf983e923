//! Counts the instructions of every case, on QEMU's `mps2-an386` (a Cortex-M4) under `-icount`.
//! `.ci/cost` builds it, runs it and makes a table of what it says.
//!
//! It writes one line a case, `NAME TICKS CALLS UNITS`: ticks of the machine's 25 MHz timer for so
//! many calls, each of which does so many units of work. With `-icount shift=6` an instruction
//! takes 64 ns, whatever it is, and the time of the machine is nothing but instructions.
#![no_std]
#![no_main]

mod latency;
mod line;
mod live;
mod machine;
mod span;

use core::hint::black_box;
use core::panic::PanicInfo;

use cortex_m_semihosting::debug::{self, EXIT_FAILURE, EXIT_SUCCESS};
use cortex_m_semihosting::hprintln;
use cost::Meter;
use embassy_executor::{InterruptExecutor, SpawnError, SpawnToken};
use machine::Interrupt;

/// Calls in a batch.
const CALLS: u32 = 1000;

struct Counter {
    /// What a batch of calls costs that do nothing.
    empty: u32,
}

impl Counter {
    fn new() -> Self {
        Self { empty: ticks(&mut || black_box(())) }
    }
}

impl Meter for Counter {
    fn case(&mut self, name: &str, units: usize, mut work: impl FnMut()) {
        let ticks = ticks(&mut work) - self.empty;
        hprintln!("{} {} {} {}", name, ticks, CALLS, units);
    }
}

/// The ticks of a batch. Not inlined: what surrounds it must not change it.
#[inline(never)]
fn ticks(work: &mut impl FnMut()) -> u32 {
    let start = machine::ticks();
    for _ in 0..CALLS {
        work();
    }
    machine::ticks().wrapping_sub(start)
}

static CONTROL: InterruptExecutor = InterruptExecutor::new();
static LINK: InterruptExecutor = InterruptExecutor::new();

unsafe extern "C" fn on_control() {
    // SAFETY: this is the interrupt that CONTROL was started with.
    unsafe { CONTROL.on_interrupt() }
}

unsafe extern "C" fn on_link() {
    // SAFETY: this is the interrupt that LINK was started with.
    unsafe { LINK.on_interrupt() }
}

fn token<S>(token: Result<SpawnToken<S>, SpawnError>) -> SpawnToken<S> {
    token.unwrap_or_else(|_| panic!("a task is spawned twice"))
}

#[inline(never)] // the FPU is off before
fn main() -> ! {
    cost::all(&mut Counter::new());
    let (control, link) = (CONTROL.start(Interrupt::Control), LINK.start(Interrupt::Link));
    latency::cases(link);
    live::cases(control, link);
    leave(EXIT_SUCCESS)
}

fn leave(status: debug::ExitStatus) -> ! {
    loop {
        debug::exit(status);
    }
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    hprintln!("{}", info);
    leave(EXIT_FAILURE)
}
