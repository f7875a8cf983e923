//! What we use of the machine: reset, vectors, and two CMSDK timers (ARM DDI 0479, section 4.4),
//! which count down at 25 MHz: timer 0 is the clock, timer 1 wakes embassy's timers exactly when
//! they are due, as a compare channel does on the board.

use core::cell::RefCell;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use core::task::Waker;

use cortex_m::interrupt::InterruptNumber;
use cortex_m::peripheral::NVIC;
use cortex_m_semihosting::hprintln;
use critical_section::{CriticalSection, Mutex};
use embassy_time_driver::Driver;
use embassy_time_queue_utils::Queue;

use crate::{on_control, on_link};

/// The timers' registers CTRL, VALUE, RELOAD, INTSTATUS.
const TIMER_0: *mut u32 = 0x4000_0000 as *mut u32;
const TIMER_1: *mut u32 = 0x4000_1000 as *mut u32;
const VALUE: usize = 1;
const RELOAD: usize = 2;
const INTSTATUS: usize = 3;
const ENABLE: u32 = 1 << 0;
const INTERRUPT: u32 = 1 << 3;

/// Ticks in a microsecond.
pub const TICKS_PER_US: u32 = 25;

/// Coprocessor access control (ARMv7-M, B3.2.20), and full access to the FPU.
const CPACR: *mut u32 = 0xE000_ED88 as *mut u32;
const FPU_ACCESS: u32 = 0xF << 20;

/// Interrupts: timer 1's own, and two that nobody else uses.
#[derive(Clone, Copy)]
#[repr(u16)]
pub enum Interrupt {
    Alarm = 9,
    Control = 20,
    Link = 21,
}

// SAFETY: the numbers are those of the vectors below.
unsafe impl InterruptNumber for Interrupt {
    fn number(self) -> u16 {
        self as u16
    }
}

type Vector = unsafe extern "C" fn();

/// The vectors behind the initial stack pointer, which the linker script sets: reset, the
/// exceptions, 32 interrupts.
#[unsafe(link_section = ".vectors")]
#[used]
static VECTORS: [Vector; 15 + 32] = {
    let mut vectors: [Vector; 15 + 32] = [unexpected; 15 + 32];
    vectors[0] = reset;
    vectors[15 + Interrupt::Alarm as usize] = alarm;
    vectors[15 + Interrupt::Control as usize] = on_control;
    vectors[15 + Interrupt::Link as usize] = on_link;
    vectors
};

/// Where everything begins: FPU, clock, interrupts, [`main`](super::main).
#[unsafe(no_mangle)]
unsafe extern "C" fn reset() {
    // SAFETY: the registers named above, which nobody else uses; priorities before anything is
    // enabled.
    unsafe {
        CPACR.write_volatile(CPACR.read_volatile() | FPU_ACCESS);
        cortex_m::asm::dsb();
        cortex_m::asm::isb();
        for timer in [TIMER_0, TIMER_1] {
            timer.add(RELOAD).write_volatile(u32::MAX);
            timer.add(VALUE).write_volatile(u32::MAX);
        }
        TIMER_0.write_volatile(ENABLE);
        let mut core = cortex_m::Peripherals::steal();
        for (interrupt, priority) in
            [(Interrupt::Alarm, 0x00), (Interrupt::Control, 0x40), (Interrupt::Link, 0x80)]
        {
            core.NVIC.set_priority(interrupt, priority);
            NVIC::unmask(interrupt);
        }
    }
    super::main()
}

unsafe extern "C" fn unexpected() {
    hprintln!("a fault, or an interrupt that nobody has enabled");
    super::leave(cortex_m_semihosting::debug::EXIT_FAILURE)
}

/// 25 MHz ticks, wrapping after 171 s.
pub fn ticks() -> u32 {
    // SAFETY: as above; reading has no effect.
    unsafe { !TIMER_0.add(VALUE).read_volatile() }
}

struct Clock {
    queue: Mutex<RefCell<Queue>>,
}

embassy_time_driver::time_driver_impl!(static CLOCK: Clock = Clock {
    queue: Mutex::new(RefCell::new(Queue::new())),
});

impl Driver for Clock {
    /// The image is done before the ticks wrap.
    fn now(&self) -> u64 {
        (ticks() / TICKS_PER_US).into()
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        critical_section::with(|cs| {
            if self.queue.borrow_ref_mut(cs).schedule_wake(at, waker) {
                self.arm(cs);
            }
        });
    }
}

impl Clock {
    /// Wakes what is due, and sets timer 1 for what comes next.
    fn arm(&self, cs: CriticalSection<'_>) {
        let mut queue = self.queue.borrow_ref_mut(cs);
        loop {
            let next = queue.next_expiration(self.now());
            let at = u32::try_from(next).unwrap_or(u32::MAX).saturating_mul(TICKS_PER_US);
            let left = at.saturating_sub(ticks());
            if left > 0 {
                // SAFETY: as above, in a critical section.
                unsafe {
                    TIMER_1.add(VALUE).write_volatile(left);
                    TIMER_1.write_volatile(ENABLE | INTERRUPT);
                }
                return;
            }
        }
    }
}

/// The longest run of [`alarm`] so far, in ticks: the interrupt above control.
pub static LONGEST_ALARM: AtomicU32 = AtomicU32::new(0);

unsafe extern "C" fn alarm() {
    let began = ticks();
    // SAFETY: as above.
    unsafe { TIMER_1.add(INTSTATUS).write_volatile(1) };
    critical_section::with(|cs| CLOCK.arm(cs));
    LONGEST_ALARM.fetch_max(ticks().wrapping_sub(began), Relaxed);
}
