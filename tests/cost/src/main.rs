//! What the board costs: counts instructions on QEMU's `mps2-an386` (a Cortex-M4) under `-icount`, of
//! the board at work, and of the PID and the reception of frames beside their peers. `.ci/cost`
//! builds it, runs it and prints a table.
//!
//! A *case* is one piece of work, named `subject/who`; a *peer* is another way to do the same work.
//! Where a peer does less than ours, its documentation says so. That it does the work is checked
//! before it is measured.
//!
//! It writes one line a figure, `NAME TICKS DIVISOR`: ticks of the machine's 25 MHz timer for so
//! many units of work. With `-icount shift=6` an instruction takes 64 ns, whatever it is, and the
//! time of the machine is nothing but instructions.
#![no_std]
#![no_main]

mod board;
mod machine;
mod pid;
mod reception;

use core::hint::black_box;
use core::panic::PanicInfo;

use cortex_m_semihosting::debug::{self, EXIT_FAILURE, EXIT_SUCCESS};
use cortex_m_semihosting::hprintln;
use embassy_executor::InterruptExecutor;
use machine::Interrupt;

/// Calls in a batch.
const CALLS: u32 = 1000;

/// Prints what `work` takes, of which a call does so many units: channels or bytes.
fn case(name: &str, units: usize, mut work: impl FnMut()) {
    let empty = ticks(&mut || black_box(()));
    let ticks = ticks(&mut work) - empty;
    hprintln!("{} {} {}", name, ticks, CALLS * units as u32);
}

/// The ticks of a batch of calls. Not inlined: what surrounds it must not change it.
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

#[inline(never)] // the FPU is off before
fn main() -> ! {
    pid::cases();
    reception::cases();
    board::measure(CONTROL.start(Interrupt::Control), LINK.start(Interrupt::Link));
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
