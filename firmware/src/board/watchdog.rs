//! The independent watchdog: whom nobody feeds in time, it resets.
//!
//! It counts at the LSI's 32 kHz (17 to 47 kHz, so nothing here is exact), and nothing but a reset
//! stops it (RM0090 section 21). From its start until it is fed, and for an erase, its period is
//! [`ERASE_PERIOD`]. embassy's driver cannot change the period of one that runs.
//!
//! While a debugger halts the core it stands still only if nothing is driven: a halted core leaves
//! the bridges as they are.

use embassy_stm32::Peri;
use embassy_stm32::pac::iwdg::vals::{Key, Pr};
use embassy_stm32::pac::{DBGMCU, IWDG};
use embassy_stm32::peripherals;
use embassy_time::Duration;

use crate::liveness::ERASE_PERIOD;

/// The LSI's cycles that make one of the counter's.
const PRESCALER: Pr = Pr::DIVIDE_BY8;
const COUNTS_PER_SECOND: u64 = 32_000 / 8;

/// What the counter begins with. It takes 12 bits.
const fn reload(period: Duration) -> u16 {
    let counts = period.as_micros() * COUNTS_PER_SECOND / 1_000_000;
    assert!(counts >= 1 && counts <= 1 << 12); // when it is compiled, or at the first boot
    (counts - 1) as u16
}

const ERASING: u16 = reload(ERASE_PERIOD);

/// Looks at whether a new period has been taken over, until when another one is ignored. That takes
/// five of the counter's cycles, 2.4 ms of the slowest LSI, and a look 20 cycles of the core. There
/// are more, but they end: an LSI that stands still bites nobody.
const LOOKS: u32 = 50_000;

/// The watchdog that runs. All handles are to the same one; one of them feeds.
#[derive(Clone, Copy)]
pub struct Watchdog {
    /// What the counter begins with when no erase is under way.
    usual: u16,
    /// Whether a halted core stops it.
    is_debuggable: bool,
}

impl Watchdog {
    /// Starts it, for whoever feeds it once in `period`.
    pub(super) fn start(_iwdg: Peri<'static, peripherals::IWDG>, period: Duration) -> Self {
        DBGMCU.apb1fzr().modify(|w| w.set_iwdg(true));
        IWDG.kr().write(|w| w.set_key(Key::START));
        IWDG.kr().write(|w| w.set_key(Key::ENABLE));
        IWDG.pr().write(|w| w.set_pr(PRESCALER));
        let watchdog = Self { usual: reload(period), is_debuggable: true };
        watchdog.feed_for_erase();
        watchdog
    }

    /// Feeds it, and is told whether anything is driven. After an erase its period is the usual one
    /// again from the second time on: a register that is changed is not to be relied on at once.
    pub fn feed(&mut self, is_driven: bool) {
        IWDG.kr().write(|w| w.set_key(Key::RESET));
        if IWDG.rlr().read().rl() != self.usual {
            set_reload(self.usual);
        }
        if self.is_debuggable == is_driven {
            self.is_debuggable = !is_driven;
            DBGMCU.apb1fzr().modify(|w| w.set_iwdg(self.is_debuggable));
        }
    }

    /// Feeds it for an erase.
    pub(super) fn feed_for_erase(&self) {
        wait(); // for the one that an erase just before has given back
        set_reload(ERASING);
        wait();
        IWDG.kr().write(|w| w.set_key(Key::RESET));
    }
}

/// Until what was written before is in force.
fn wait() {
    for _ in 0..LOOKS {
        let status = IWDG.sr().read();
        if !status.pvu() && !status.rvu() {
            break;
        }
    }
}

/// What the counter will begin with when it is next fed.
fn set_reload(counts: u16) {
    IWDG.kr().write(|w| w.set_key(Key::ENABLE));
    IWDG.rlr().write(|w| w.set_rl(counts));
}
