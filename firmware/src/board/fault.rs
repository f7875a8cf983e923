//! Panic and hard fault: the outputs first, then a word to the log, then the watchdog.
//!
//! Neither returns. The watchdog is fed no more, resets the board within 100 ms, and the boot log names
//! it as the cause.
//!
//! A stack that runs out is a fault ([`guard_stack`]). MemManage is left disabled, and so becomes a hard
//! fault, which does not ask the MPU.

use core::arch::global_asm;
use core::panic::PanicInfo;

use cortex_m::asm;
use cortex_m::peripheral::{MPU, SCB};

use super::safe_state;

/// What is forbidden: 32 KiB, up to the start of SRAM, where the stack ends (memory.x). The longest frame
/// has 7.1 KiB, so none reaches beyond it. A region begins at a multiple of its length (ARM DDI 0403,
/// B3.5), and in this one are the option bytes, which no image reads.
const GUARD: u32 = 0x1FFF_8000;
/// Of 2^(14 + 1) bytes, never executed, no access for anybody, enabled.
const GUARD_ATTRIBUTES: u32 = 1 << 28 | 14 << 1 | 1;
/// In RBAR: the address, for region 0.
const REGION_0: u32 = 1 << 4;
/// In CTRL: everything else is as without the MPU, which is enabled.
const PRIVDEFENA_AND_ENABLE: u32 = 1 << 2 | 1;

/// Makes an overflow of the stack a fault for certain: what lies below SRAM is system memory, and
/// nobody says what a write there does.
pub fn guard_stack() {
    // SAFETY: the MPU is always there, nobody else uses it, and nothing is used that it forbids.
    unsafe {
        let mpu = &*MPU::PTR;
        mpu.rbar.write(GUARD | REGION_0);
        mpu.rasr.write(GUARD_ATTRIBUTES);
        mpu.ctrl.write(PRIVDEFENA_AND_ENABLE);
    }
    asm::dsb();
    asm::isb();
}

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
    defmt::error!("hard fault, CFSR {=u32:#010x} (stack overflow: bit 1, 4 or 5)", status);
    halt()
}

fn halt() -> ! {
    loop {
        asm::nop();
    }
}
