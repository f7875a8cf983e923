//! The independent watchdog, which bears [`WATCHDOG_PERIOD`] without food, or once
//! [`ERASE_PERIOD`].
//!
//! It counts at the LSI's 32 kHz (17 to 47 kHz, so nothing here is exact), and nothing but a reset
//! stops it (RM0090 section 21). embassy's driver cannot change the period of one that runs.

use embassy_stm32::Peri;
use embassy_stm32::pac::iwdg::vals::{Key, Pr};
use embassy_stm32::pac::{DBGMCU, IWDG};
use embassy_stm32::peripherals;
use embassy_time::Duration;

use crate::app::{ERASE_PERIOD, WATCHDOG_PERIOD};

/// The LSI's cycles that make one of the counter's.
const PRESCALER: Pr = Pr::DIVIDE_BY8;
const COUNTS_PER_SECOND: u64 = 32_000 / 8;

/// What the counter begins with. It takes 12 bits.
const fn reload(period: Duration) -> u16 {
    let counts = period.as_millis() * COUNTS_PER_SECOND / 1000;
    assert!(counts >= 1 && counts <= 1 << 12); // when it is compiled
    (counts - 1) as u16
}

const USUAL: u16 = reload(WATCHDOG_PERIOD);
const ERASING: u16 = reload(ERASE_PERIOD);

/// Looks at whether a new period has been taken over, until when another one is ignored. That takes
/// five of the counter's cycles, 2.4 ms of the slowest LSI, and a look 20 cycles of the core. There
/// are more, but they end: an LSI that stands still bites nobody.
const LOOKS: u32 = 50_000;

/// The watchdog that runs. All handles are to the same one.
#[derive(Clone, Copy)]
pub struct Watchdog(());

impl Watchdog {
    /// Starts it. It stands still while a debugger halts the core.
    pub(super) fn start(_iwdg: Peri<'static, peripherals::IWDG>) -> Self {
        DBGMCU.apb1fzr().modify(|w| w.set_iwdg(true));
        IWDG.kr().write(|w| w.set_key(Key::START));
        IWDG.kr().write(|w| w.set_key(Key::ENABLE));
        IWDG.pr().write(|w| w.set_pr(PRESCALER));
        let watchdog = Self(());
        watchdog.feed_for(USUAL);
        watchdog
    }

    /// Feeds it. After an erase its period is the usual one again from the second time on: a
    /// register that is changed is not to be relied on at once.
    pub fn feed(self) {
        IWDG.kr().write(|w| w.set_key(Key::RESET));
        if IWDG.rlr().read().rl() != USUAL {
            set_reload(USUAL);
        }
    }

    /// Feeds it for an erase.
    pub(super) fn feed_for_erase(self) {
        self.feed_for(ERASING);
    }

    fn feed_for(self, counts: u16) {
        wait(); // for the one that an erase just before has given back
        set_reload(counts);
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
