//! How every board begins: the stack's guard, the clock tree, and why it was reset.
//!
//! All boards run at 168 MHz, which every STM32F405 to F479 can; the constants of the other parts
//! rely on it.

use super::fault;
use crate::ports::ResetCause;
use embassy_stm32::pac::timer::regs::SrGp16;
use embassy_stm32::rcc::{self, Hse};
use embassy_stm32::{Peripherals, pac};

/// The processor's clock in MHz, and that of the timers of APB2.
pub const CORE_MHZ: u32 = 168;
/// Timers of APB1 (TIM2 to TIM7, TIM12 to TIM14) count at 84 MHz.
pub const APB1_TIMER_HZ: u32 = 84_000_000;

/// Starts the clocks from a crystal or a clock of whole MHz: 168 MHz, APB1 42 MHz, APB2 84 MHz.
pub fn clocks(hse: Hse) -> Peripherals {
    fault::guard_stack();
    let mut config = embassy_stm32::Config::default();
    config.rcc.hse = Some(hse);
    config.rcc.pll_src = rcc::PllSource::HSE;
    config.rcc.pll = Some(rcc::Pll {
        prediv: rcc::PllPreDiv::from_bits((hse.freq.0 / 1_000_000) as u8), // to 1 MHz; 4 to 26
        mul: rcc::PllMul::MUL336,
        divp: Some(rcc::PllPDiv::DIV2),
        divq: Some(rcc::PllQDiv::DIV7),
        divr: None,
    });
    config.rcc.sys = rcc::Sysclk::PLL1_P;
    config.rcc.apb1_pre = rcc::APBPrescaler::DIV4;
    config.rcc.apb2_pre = rcc::APBPrescaler::DIV2;
    let peripherals = critical_section::with(|_| {
        let peripherals = embassy_stm32::init(config);
        forget_first_match();
        peripherals
    });
    speed_up_flash();
    // embassy's clock stands still with the core that a debugger halts: no period is missed then.
    pac::DBGMCU.apb1fzr().modify(|w| w.set_tim5(true));
    peripherals
}

/// Keeps embassy's clock, which has only begun and whose interrupt waits, from counting half a period too many:
/// it resets TIM5 (UG) while compare 1, its half period's, is still 0. Whether that is a match, RM0090 does not
/// say (sections 18.4.5, 18.4.6); where it is, the time would be 65 ms back at every half period's end until the
/// interrupt is served (embassy-stm32 0.6; embassy's issue 4883 has that from an STM32H757).
fn forget_first_match() {
    let mut all_but_it = SrGp16(u32::MAX); // a flag is cleared by writing 0, 1 leaves it
    all_but_it.set_ccif(0, false);
    pac::TIM5.sr().write_value(all_but_it);
}

/// Switches on prefetch and both caches, which embassy leaves off: at 168 MHz a fetch from flash
/// waits for five cycles (RM0090 section 3.5). Prefetch does not work on revision A of the F405 and
/// F407 (errata sheet ES0182), which calls itself an F2 (0x411).
fn speed_up_flash() {
    let id = pac::DBGMCU.idcode().read();
    let is_revision_a = matches!(id.dev_id(), 0x411 | 0x413) && id.rev_id() == 0x1000;
    pac::FLASH.acr().modify(|w| {
        w.set_prften(!is_revision_a);
        w.set_icen(true);
        w.set_dcen(true);
    });
}

/// Why the board has started. The chip forgets it, so that the next start knows its own.
pub fn reset_cause() -> ResetCause {
    let flags = pac::RCC.csr().read();
    // A watchdog's and a program's reset set PINRSTF too, a power-on PORRSTF and BORRSTF with it.
    let (cause, text) = if flags.wdgrstf() {
        (ResetCause::Watchdog, "watchdog")
    } else if flags.wwdgrstf() {
        (ResetCause::Watchdog, "window watchdog")
    } else if flags.lpwrrstf() {
        (ResetCause::Unknown, "low power")
    } else if flags.sftrstf() {
        (ResetCause::Software, "software")
    } else if flags.porrstf() {
        (ResetCause::Power, "power")
    } else if flags.borrstf() {
        (ResetCause::Power, "brown-out")
    } else if flags.padrstf() {
        (ResetCause::Pin, "reset pin")
    } else {
        (ResetCause::Unknown, "no reset")
    };
    pac::RCC.csr().modify(|w| w.set_rmvf(true));
    defmt::info!("started by: {=str} (CSR {=u32:#010x})", text, flags.0);
    cause
}
