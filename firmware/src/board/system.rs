//! The processor as upkeep wants it: restarts, the ROM's loader, and how deep its stack has been.
//!
//! The ROM's loader (AN2606) expects the chip as a reset leaves it. So an order is left in RAM, the
//! chip resets, and the next start, before it touches a clock, follows the order instead of going
//! on. An order is followed once, and only by a start that a program has caused: whatever happens
//! to the loader, the next reset starts the firmware. The watchdog is stopped by the reset, unless
//! the option byte WDG_SW says otherwise.

use core::mem::MaybeUninit;

use cortex_m::asm;
use cortex_m::peripheral::SCB;
use cortex_m::register::msp;
use embassy_stm32::pac::{RCC, SYSCFG};

use super::selected::LOADER_IS_SAFE;
use super::watchdog::Watchdog;
use crate::ports::{Program, SystemPort};

/// What stands in [`ORDER`] when the loader is to be started.
const START_LOADER: u32 = 0xDF0B_007E;
/// The loader's vectors: system memory, at the same place on all of the family (AN2606).
const LOADER: *const u32 = 0x1FFF_0000 as *const u32;

/// What the stack is painted with before it is used.
const PAINT: u32 = 0x5AFE_57AC;
/// Bytes below the stack's pointer that are left unpainted, for what the painter itself might call.
const BRUSH: usize = 256;

/// For the next start. RAM keeps its content over a reset, and nobody clears this part of it.
#[unsafe(link_section = ".uninit.order")]
static mut ORDER: MaybeUninit<u32> = MaybeUninit::uninit();

unsafe extern "C" {
    /// The stack's lowest word (memory.x).
    static _stack_end: u32;
    /// Behind its highest one.
    static _stack_start: u32;
}

/// The first thing that a board with motors does.
pub fn begin() {
    follow_order();
    paint_stack();
}

/// Starts the loader if that has been ordered.
fn follow_order() {
    let order = (&raw mut ORDER).cast::<u32>();
    // SAFETY: a word of RAM that only this function and `start` use, neither in an interrupt.
    // Volatile, because its value is older than the program.
    let is_ordered = unsafe { order.read_volatile() } == START_LOADER;
    // SAFETY: as above.
    unsafe { order.write_volatile(0) };
    if is_ordered && RCC.csr().read().sftrstf() {
        // What a reset with BOOT0 high does in hardware: the loader's vectors at address 0.
        RCC.apb2enr().modify(|w| w.set_syscfgen(true));
        RCC.apb2enr().read(); // a peripheral's clock takes two cycles to come
        SYSCFG.memrm().write(|w| w.set_mem_mode(1));
        // SAFETY: no exception is enabled. cortex-m-rt has set it to the firmware's table, and the
        // loader's own interrupts would end there.
        unsafe { (*SCB::PTR).vtor.write(LOADER as u32) };
        asm::dsb();
        asm::isb();
        // SAFETY: the ROM's stack pointer and entry; no interrupt is enabled, nothing is needed
        // any more.
        unsafe { asm::bootload(LOADER) };
    }
}

/// Paints what is not in use of the stack.
fn paint_stack() {
    let (mut at, end) = (stack().0, msp::read() as usize - BRUSH);
    while at < end {
        // SAFETY: a word of the stack below all that is in use; nothing interrupts yet.
        unsafe { (at as *mut u32).write_volatile(PAINT) };
        at += size_of::<u32>();
    }
}

/// The most of the stack that was ever used, in bytes. It takes some 0.2 ms of the thread's time.
pub fn stack_used() -> u16 {
    let (mut at, end) = stack();
    // SAFETY: a word of the stack, which the loop's own frame may be in: its value is not used for
    // anything but this comparison.
    while at < end && unsafe { (at as *const u32).read_volatile() } == PAINT {
        at += size_of::<u32>();
    }
    (end - at) as u16 // 16 KiB at the most
}

/// Where the stack begins and ends.
fn stack() -> (usize, usize) {
    ((&raw const _stack_end) as usize, (&raw const _stack_start) as usize)
}

/// The processor.
pub struct System(pub(super) Watchdog);

impl SystemPort for System {
    fn before_erase(&mut self) {
        self.0.feed_for_erase();
    }

    fn can_start(&self, program: Program) -> bool {
        match program {
            Program::Firmware => true,
            Program::DfuLoader => LOADER_IS_SAFE,
        }
    }

    fn start(&mut self, program: Program) {
        if program == Program::DfuLoader {
            // SAFETY: as in `follow_order`.
            unsafe { (&raw mut ORDER).cast::<u32>().write_volatile(START_LOADER) };
        }
        SCB::sys_reset()
    }
}
