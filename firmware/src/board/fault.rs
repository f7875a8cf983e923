//! Panic and hard fault: the outputs first, then a word to the log, then the watchdog.
//!
//! Neither returns. The watchdog is fed no more, resets the board within 100 ms, and the boot log names
//! it as the cause.

use core::arch::global_asm;
use core::panic::PanicInfo;

use cortex_m::peripheral::SCB;

use super::safe_state;

// Inlined, the compiler sees that nobody looks at messages and leaves out what makes them: 1.5 KB.
#[allow(unused_attributes, reason = "rustc says that it ignores the next line; the image says not")]
#[inline(always)]
#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    cortex_m::interrupt::disable();
    safe_state();
    match info.location() {
        Some(place) => defmt::error!("panic at {=str}:{=u32}", place.file(), place.line()),
        None => defmt::error!("panic"),
    }
    halt()
}

// The vector. A fault may have come from a stack that has run out (memory.x), on which ordinary
// code would fault again and lock up; nothing that is on it is needed any more.
global_asm!(
    ".section .HardFault.user,\"ax\",%progbits",
    ".global HardFault",
    ".type HardFault,%function",
    ".thumb_func",
    "HardFault:",
    "ldr r0, =_stack_start",
    "mov sp, r0",
    "b {fault}",
    fault = sym fault,
);

extern "C" fn fault() -> ! {
    cortex_m::interrupt::disable();
    safe_state();
    // SAFETY: the system control block is always there, and CFSR is only read.
    let status = unsafe { (*SCB::PTR).cfsr.read() };
    defmt::error!("hard fault, CFSR {=u32:#010x} (stack overflow: bit 9 or 12)", status);
    halt()
}

fn halt() -> ! {
    loop {
        cortex_m::asm::nop();
    }
}
