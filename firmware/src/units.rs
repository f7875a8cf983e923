//! Quantities of the control core, each with its unit in its type.
//!
//! Fixed point throughout, so that the same inputs give the same bits on every machine.

use fixed::types::{I18F14, I24F8};

/// One control period in milliseconds: the controller runs at 1 kHz, and the times that hosts put
/// on the wire are numbers of these.
pub const CONTROL_PERIOD_MS: u32 = 1;

/// Control periods in a second.
pub const PERIODS_PER_SECOND: i32 = 1000;

/// A position, or a difference of positions, in counts of the sensor in use.
pub type Counts = I24F8;

/// A velocity in counts of the sensor in use per second. Saturates at 8.3 million.
pub type CountsPerSecond = I24F8;

/// Drive before it is limited, in parts of full drive. Its last bit is that of a [`Duty`].
pub type Drive = I18F14;

/// Drive of a bridge: -16384 (full reverse) to 16384 (full forward), 0 is neutral.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Duty(i16);

impl Duty {
    /// No drive: both ends of the motor at the same potential.
    pub const NEUTRAL: Self = Self(0);
    /// The number that stands for full forward drive.
    pub const FULL: i16 = 16384;

    /// A duty in 1/16384 of full drive, limited to full drive.
    pub const fn from_raw(raw: i32) -> Self {
        const FULL: i32 = Duty::FULL as i32;
        Self(if raw > FULL {
            Self::FULL
        } else if raw < -FULL {
            -Self::FULL
        } else {
            raw as i16 // within -16384..=16384 by the branches above
        })
    }

    /// In 1/16384 of full drive.
    pub const fn raw(self) -> i16 {
        self.0
    }
}

/// Width of a servo pulse in 1/2250 ms, the protocol's resolution: 500 to 7000.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ServoPulse(u16);

impl ServoPulse {
    /// Counts in a millisecond.
    pub const PER_MS: u16 = 2250;

    /// A pulse of `raw` counts, limited to 500 to 7000 (0.22 to 3.11 ms).
    pub const fn from_raw(raw: i32) -> Self {
        Self(if raw > 7000 {
            7000
        } else if raw < 500 {
            500
        } else {
            raw as u16 // within 500..=7000 by the branches above
        })
    }

    /// In 1/2250 ms.
    pub const fn raw(self) -> u16 {
        self.0
    }
}
