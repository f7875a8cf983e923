//! The external interrupt controller of RM0090 chapter 12, lines 0 to 15, and the choice of their
//! ports in SYSCFG (section 9.2).
//!
//! | register or section | behaviour | source | test |
//! |---|---|---|---|
//! | `IMR`, `PR` | a line that is pending and unmasked holds its vector's interrupt: lines 0 to 4 one each, 5 to 9 and 10 to 15 together | 12.3.1, 12.3.6, table 61 | `sensors.rs` |
//! | `RTSR`, `FTSR` | which edges of the selected pin set `PR` | 12.3.2, 12.3.3 | `sensors.rs` |
//! | `PR` | a written one clears (the part's bus says so) | 12.3.6 | `sensors.rs` |
//! | `SWIER` | a written one sets `PR` of an unmasked line | 12.3.5 | none here uses it |
//! | `EXTICR1` to `4` | the port of each line | 9.2.3 to 9.2.6 | `sensors.rs` |
//!
//! | left out | source | reason |
//! |---|---|---|
//! | lines 16 to 22, `EMR` | 12.2.5 | no image uses power, RTC or USB wake-ups, or events |
//! | `SWIER`'s own bit staying until `PR` is cleared | 12.3.5 | nobody reads it back |
//! | `MEMRMP`, `PMC`, `CMPCR` | 9.2.1, 9.2.2, 9.2.7 | stored only: nothing is remapped, and a jump to the loader finds its vectors where they are |

use rigless::device::{Device, DeviceContext, Level, RegisterFile, RequestChange};
use rigless::soc::stm32f427::generated::{exti, syscfg};

/// Ports A to K.
pub const PORTS: usize = 11;
/// Lines with a pin.
const LINES: usize = 16;

/// SYSCFG as far as `EXTICR`: tells [`Exti`] the port of each line, a request line a bit.
#[derive(Debug, Default)]
pub struct Syscfg;

impl Device for Syscfg {
    type Register = syscfg::Register;

    fn write(
        &mut self,
        register: Self::Register,
        value: u64,
        _: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        use syscfg::Register::{Exticr1, Exticr2, Exticr3, Exticr4};
        let place = [Exticr1, Exticr2, Exticr3, Exticr4].iter().position(|&r| r == register);
        if let Some(nth) = place {
            for bit in 0..LINES {
                context.request(LINES * nth + bit, Level::from(value >> bit & 1 != 0));
            }
        }
    }
}

/// The controller. It hears every pin of every port, and SYSCFG's choice, as requests.
#[derive(Debug, Default)]
pub struct Exti {
    /// The pins' levels, by port.
    pins: [u16; PORTS],
    /// `EXTICR1` to `4` in one.
    ports: u64,
    /// The lines' levels.
    lines: u16,
    /// Pins that the world wants to hear of, by port.
    watched: [u16; PORTS],
    /// What it has not been told yet: port, pin, level, and when.
    heard: Vec<(usize, u8, Level, u64)>,
}

impl Exti {
    /// The world wants to hear of a pin's edges.
    pub fn watch(&mut self, port: usize, pin: u8) {
        self.watched[port] |= 1 << pin;
    }

    /// The edges of watched pins since the last call: port, pin, level, and when in ns.
    pub fn heard(&mut self) -> Vec<(usize, u8, Level, u64)> {
        std::mem::take(&mut self.heard)
    }

    /// Which of the instance's interrupts a line is, by its place in the vendor's list.
    fn interrupt(line: usize) -> usize {
        match line {
            0..=4 => 1 + line,
            5..=9 => 6,
            _ => 7,
        }
    }

    fn refresh(registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        let up = registers.get(exti::Register::Pr) & registers.get(exti::Register::Imr);
        for interrupt in 1..=7 {
            let its = |line: &usize| Self::interrupt(*line) == interrupt;
            let is_up = (0..LINES).filter(its).any(|line| up >> line & 1 != 0);
            context.interrupt(interrupt, Level::from(is_up));
        }
    }

    fn look(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let mut now = 0;
        for line in 0..LINES {
            let port = (self.ports >> (4 * line) & 15) as usize;
            now |= self.pins.get(port).copied().unwrap_or(0) & 1 << line;
        }
        let rose = u64::from(now & !self.lines) & registers.get(exti::Register::Rtsr);
        let fell = u64::from(!now & self.lines) & registers.get(exti::Register::Ftsr);
        self.lines = now;
        if rose | fell != 0 {
            let pending = registers.get(exti::Register::Pr) | rose | fell;
            registers.set(exti::Register::Pr, pending);
            Self::refresh(registers, context);
        }
    }
}

impl Device for Exti {
    type Register = exti::Register;

    fn write(
        &mut self,
        register: Self::Register,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if register == exti::Register::Swier {
            let set = value & registers.get(exti::Register::Imr);
            registers.set(exti::Register::Pr, registers.get(exti::Register::Pr) | set);
        }
        Self::refresh(registers, context);
    }

    fn on_request(
        &mut self,
        change: RequestChange,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let is_high = change.level == Level::High;
        if change.instance == "SYSCFG" {
            let bit = 1 << change.request;
            self.ports = if is_high { self.ports | bit } else { self.ports & !bit };
        } else if let Some(port) = change.instance.strip_prefix("GPIO") {
            let port = usize::from(port.as_bytes()[0] - b'A');
            let bit = 1 << change.request;
            let pins = &mut self.pins[port];
            *pins = if is_high { *pins | bit } else { *pins & !bit };
            if self.watched[port] & bit != 0 {
                let now = context.now();
                self.heard.push((port, change.request as u8, change.level, now.0));
                context.schedule(now); // a stop, at which the world is asked
            }
        } else {
            return;
        }
        self.look(registers, context);
    }

    fn reset(&mut self) {
        *self = Self { watched: self.watched, ..Self::default() };
    }
}
