//! Control's heartbeat, which an exception listens to that nothing of ours is above.
//!
//! Control beats every period, when it has driven its port, on an executor above everything else
//! that takes part in the roll call ([`Roll`](crate::app::Roll)): once it is in a loop without end,
//! none of them comes to notice. SysTick is above it, and looks every [`LOOK_PERIOD_MS`]. When it
//! misses the heart it panics, and so the outputs are safe, nothing else runs any more, and the
//! watchdog bites.
//!
//! Promise: the outputs are safe 60 to 80 ms after control has driven for the last time, wherever
//! it is but in a critical section. Those hold up SysTick, and embassy's interrupt handlers are as
//! high as it; a loop in one of these is ended by the watchdog alone.
//!
//! Nothing is missed before the first beat: until then nothing is driven. While a debugger halts
//! the core SysTick stands still, and so does embassy's clock, by which control beats.

use core::sync::atomic::{AtomicU8, Ordering};

use cortex_m::peripheral::SYST;

/// Time between two looks.
pub(super) const LOOK_PERIOD_MS: u32 = 20;
/// Looks that may follow one another without a beat between them.
const MOST_LOOKS: u8 = 3;
/// In place of their number before the first beat.
const NOT_BEGUN: u8 = u8::MAX;

/// Looks since the last beat.
static LOOKS: AtomicU8 = AtomicU8::new(NOT_BEGUN);

/// Control has driven its port.
pub(super) fn beat() {
    LOOKS.store(0, Ordering::Relaxed);
}

/// SysTick looks. Control cannot beat meanwhile, since it is below.
///
/// # Panics
/// When the heart has stopped, as the header says.
pub(super) fn look() {
    match LOOKS.load(Ordering::Relaxed) {
        NOT_BEGUN => {}
        MOST_LOOKS => panic!("control has stopped"),
        looks => LOOKS.store(looks + 1, Ordering::Relaxed),
    }
}

/// Does what stalls the core, and with it control, while nothing is driven: SysTick stands still.
pub(super) fn unheard<T>(stall: impl FnOnce() -> T) -> T {
    let mut systick = systick();
    systick.disable_counter();
    let result = stall();
    systick.enable_counter();
    result
}

fn systick() -> SYST {
    // SAFETY: nobody else uses SysTick but embassy's clock under QEMU, which lets it go once it
    // runs.
    unsafe { cortex_m::Peripherals::steal() }.SYST
}

#[cfg(not(feature = "qemu"))]
pub(super) use real::start;

/// Under QEMU SysTick is embassy's clock and looks besides.
#[cfg(not(feature = "qemu"))]
mod real {
    use cortex_m::peripheral::syst::SystClkSource;
    use cortex_m_rt::exception;
    use embassy_stm32::pac::DBGMCU;

    use super::super::boot::CORE_MHZ;
    use super::{LOOK_PERIOD_MS, look, systick};

    /// The core's cycles between two looks; SysTick counts 24 bits.
    const CYCLES: u32 = CORE_MHZ * 1000 * LOOK_PERIOD_MS;
    const _: () = assert!(CYCLES <= 1 << 24);

    /// Starts the looks. SysTick's priority is the highest, as a reset leaves it.
    pub fn start() {
        DBGMCU.apb1fzr().modify(|w| w.set_tim5(true));
        let mut systick = systick();
        systick.set_clock_source(SystClkSource::Core);
        systick.set_reload(CYCLES - 1);
        systick.clear_current();
        systick.enable_counter();
        systick.enable_interrupt();
    }

    #[exception]
    fn SysTick() {
        look();
    }
}
