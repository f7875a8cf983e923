//! What a test may do while the bench's time stands still: look at the part and the world, press reset, take
//! the supply away, halt the core.

use rigless::emulator::Host;
use rigless::mcu::Mcu;
use rigless::session::Session;
use rigless::soc::stm32f427::generated::{dbg, rcc};
use rigless::soc::{Bus, Width};
use rigless::time::VirtualNanos;

use super::{Rig, SETTINGS};

/// A stop, at which the test may look at everything and change it.
pub struct Stand<'a> {
    /// rigless' session: its reports, and the rig as [`rig`](Self::rig) gives it.
    pub session: &'a mut Session<Rig>,
    /// The core's memory.
    pub host: &'a mut dyn Host,
    /// When the watchdog was fed, in ns.
    pub feeds: &'a mut Vec<u64>,
    /// Whether a probe has halted the core (`probe`).
    pub(super) is_halted: &'a mut bool,
    /// Now.
    pub now: VirtualNanos,
}

impl Stand<'_> {
    /// The part and the world.
    pub fn rig(&mut self) -> &mut Rig {
        self.session.board_mut()
    }

    /// Somebody presses the reset button.
    pub fn reset(&mut self) {
        self.session.reset_by_pin(self.now, 0, self.host);
    }

    /// A probe halts the core, or lets it go on.
    pub fn halt(&mut self, is_halted: bool) {
        if *self.is_halted != is_halted {
            *self.is_halted = is_halted;
            let now = self.now;
            self.rig().chip.halt(now, is_halted);
        }
    }

    /// The supply dips below the brown-out's level and comes back at once: a reset that only `BORRSTF`
    /// and `PINRSTF` tell of, with RAM as it was.
    pub fn brown_out(&mut self) {
        self.without_supply(rcc::csr::BORRSTF.mask());
    }

    /// The supply goes and comes back, with this in the settings' sectors and anything in RAM.
    pub fn power_cycle(&mut self, settings: &[u8]) {
        for (at, bytes) in (SETTINGS..).step_by(4).zip(settings.as_chunks().0) {
            let word = u64::from(u32::from_le_bytes(*bytes));
            if self.host.read(at, Width::W32).expect("it is flash") != word {
                self.host.program(at, Width::W32, word).expect("it is flash");
            }
        }
        let mut anything = self.now.0 | 1;
        for at in (0x2000_0000..0x2002_0000).step_by(4) {
            anything = anything.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            self.host.write(at, Width::W32, anything >> 32).expect("it is RAM");
        }
        self.rig().chip.flash.journal.clear();
        self.without_supply(rcc::csr::PORRSTF.mask() | rcc::csr::BORRSTF.mask());
    }

    /// A reset that these flags tell of, and that keeps nothing: rigless' part knows none.
    fn without_supply(&mut self, flags: u64) {
        use dbg::Register::{DbgmcuApb1Fz, DbgmcuApb2Fz, DbgmcuCr};
        let bus = self.rig().chip.bus_mut();
        let slot = |bus: &Bus, name| bus.slot_of(name).expect("the part has it");
        let (clocks, debug) = (slot(bus, "RCC"), slot(bus, "DBG"));
        bus.slot_mut(clocks).registers_mut().set(rcc::Register::Csr, flags);
        for register in [DbgmcuCr, DbgmcuApb1Fz, DbgmcuApb2Fz] {
            bus.slot_mut(debug).registers_mut().set(register, 0);
        }
        self.reset(); // which keeps what stands in these
    }
}
