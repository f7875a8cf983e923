//! Boards: what the ports are made of on an STM32F4. Target only.
//!
//! One file a board ([`f407`]: pins, timers, DMA streams and who owns them), over parts that any
//! board can use:
//!
//! | part | what it is |
//! |---|---|
//! | [`analog`] | 48 analogue inputs through three multiplexers, scanned without the CPU |
//! | [`line`] | the host's UART |
//! | [`sensing`] | ultrasonic rangers, infrared remote, the slow sensors' port |
//! | [`ssd1306`] | the display |
//! | `fault` | panic and hard fault: outputs safe first |
//! | `systick` | the clock under QEMU, whose timers cannot compare |
//!
//! Vocabulary: a *compare value* is what a timer compares its counter with: the length of the
//! high part of a PWM period, in timer ticks. A *stage* is how a bridge wants to be told its duty.
//!
//! Promise: whatever happens, [`f407::safe_state`] disables every bridge, ends every servo pulse
//! and lowers every output; it needs no stack to speak of and no initialisation.

mod dma;
mod fault;
#[cfg(feature = "qemu")]
mod systick;

pub mod analog;
pub mod f407;
pub mod line;
pub mod sensing;
pub mod ssd1306;

use crate::units::{Duty, ServoPulse};

/// How the bridges want their duty.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// One PWM line: high drives forward, low drives in reverse, half and half is stop, as on the
    /// original's driver boards. The direction lines stay low.
    LockedAntiPhase,
    /// A direction line (high is forward) and a PWM line that is the magnitude.
    SignMagnitude,
}

impl Stage {
    /// The compare value for a duty, of `period` timer ticks in a PWM period.
    pub const fn compare(self, duty: Duty, period: u32) -> u32 {
        const FULL: i32 = Duty::FULL as i32;
        let raw = duty.raw() as i32;
        // 32768 * 8400 fits 32 bits; a Duty is within -FULL..=FULL, so the sum is not negative.
        match self {
            Self::LockedAntiPhase => (FULL + raw) as u32 * period / (2 * FULL as u32),
            Self::SignMagnitude => raw.unsigned_abs() * period / FULL as u32,
        }
    }

    /// Level of the direction line.
    pub const fn forward(self, duty: Duty) -> bool {
        matches!(self, Self::SignMagnitude) && duty.raw() > 0
    }
}

/// Servo timers count at 3 MHz: a third finer than the protocol's 1/2250 ms, 4 ticks for 3 of its
/// counts, and 20 ms are 60000 ticks, which fit 16 bits.
pub const SERVO_TICK_HZ: u32 = 3_000_000;
/// Ticks in a servo's period of 20 ms.
pub const SERVO_PERIOD: u16 = 60_000;

/// The compare value for a servo's pulse; 0 is no pulse.
pub const fn servo_compare(pulse: Option<ServoPulse>) -> u16 {
    match pulse {
        Some(pulse) => (pulse.raw() as u32 * 4 / 3) as u16, // 7000 * 4 / 3 fits
        None => 0,
    }
}
