//! What an owner may choose, with the defaults that suit a correctly wired original.
//!
//! - [`Settings`]: the choices, as the code uses them;
//! - [`table`]: all facts of each, with its number, as hosts and the flash know it, and `numbered`:
//!   what is done with the numbers;
//! - [`store`]: where they survive.

mod numbered;
pub mod store;
pub mod table;

use protocol::arcos::JointInfo;
use protocol::pms5005::{CHANNELS, Method, Polarity, Sensor};

use crate::command::ENCODERS;
use crate::control::pid::HostGains;
use crate::control::potentiometer;
use crate::units::{Duty, ServoPulse};

pub use numbered::SettingRefused;
pub use table::{
    ArmSettings, BoardFaultSettings, ChannelFaultSettings, CollisionSettings, ControlSettings,
    LinkSettings,
};

/// How the two bytes of Ki are read; hosts disagree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum KiReading {
    /// M + N/100: the manual's "integer part, fraction part" in decimal.
    Hundredths,
    /// M + N/256: the manual's table taken as fixed point.
    Fraction256,
    /// A 16-bit number, low byte first, divided by 100: what public hosts send.
    WordHundredths,
}

impl KiReading {
    /// Ki in hundredths from its two bytes.
    pub(crate) fn hundredths(self, [integer, fraction]: [u8; 2]) -> u16 {
        let whole = u16::from(integer) * 100;
        match self {
            Self::Hundredths => whole + u16::from(fraction),
            Self::Fraction256 => whole + ((u16::from(fraction) * 100) >> 8),
            Self::WordHundredths => u16::from_le_bytes([integer, fraction]),
        }
    }
}

/// The least and the greatest position that a channel may be driven to, in counts of its sensor.
/// Two equal ones set none, the default.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SoftLimits {
    /// 0 or more.
    pub low: i16,
    /// Up to the sensor's last count.
    pub high: i16,
}

impl SoftLimits {
    /// No limits.
    pub const NONE: Self = Self { low: 0, high: 0 };

    /// Whether there are any.
    pub fn are_set(&self) -> bool {
        self.low < self.high
    }
}

/// A DC channel: how it is wired and controlled, and what its drive and set-point are held to. None of
/// the latter lengthens a stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ChannelSettings {
    /// The gains of the position loop.
    pub position: HostGains,
    /// The gains of the velocity loop.
    pub velocity: HostGains,
    /// What measures the shaft; `None` leaves it to the motion commands.
    pub sensor: Option<Sensor>,
    /// What set-points mean; `None` leaves it to the motion commands.
    pub method: Option<Method>,
    /// Which way the bridge is wired.
    pub polarity: Polarity,
    /// Milliseconds from no drive to full drive; 0 is at once.
    pub slew_ms: u16,
    /// Counts per second and second of a closed loop's set-point; 0 is any.
    pub acceleration: u32,
    /// The highest duty either way, 1 to 16384.
    pub highest_duty: u16,
    /// The highest share of the drive that is the integral's, 0 to 16384.
    pub integral_share: u16,
}

impl ChannelSettings {
    /// As the original is at boot, held to nothing.
    pub const DEFAULT: Self = Self {
        position: HostGains::DEFAULT,
        velocity: HostGains::DEFAULT,
        sensor: None,
        method: None,
        polarity: Polarity::Positive,
        slew_ms: 0,
        acceleration: 0,
        highest_duty: Duty::FULL.unsigned_abs(),
        integral_share: Duty::FULL.unsigned_abs(),
    };
}

/// Whether a channel has such a sensor: only channels 0 and 1 have encoders, only channels 0 to 2 pairs
/// of potentiometers.
pub(crate) fn has_sensor(channel: usize, sensor: Sensor) -> bool {
    let channels = match sensor {
        Sensor::SinglePotentiometer => CHANNELS,
        Sensor::DualPotentiometer => potentiometer::PAIRS.len(),
        Sensor::Encoder => ENCODERS,
    };
    channel < channels
}

impl ControlSettings {
    /// Counts per second at full drive, by the sensor that counts; 0 is not known.
    pub fn full_speed(&self, sensor: Sensor) -> u32 {
        match sensor {
            Sensor::Encoder => self.full_speed_encoder,
            Sensor::SinglePotentiometer | Sensor::DualPotentiometer => {
                self.full_speed_potentiometer
            }
        }
    }

    /// The same where a number is needed: the default if none is known.
    pub fn known_full_speed(&self, sensor: Sensor) -> u32 {
        match self.full_speed(sensor) {
            0 => Self::DEFAULT.full_speed(sensor),
            known => known,
        }
    }
}

/// The pulse of a joint at a position, in 1/2250 ms: 1.5 ms at its centre, and 1 ms more or less 90
/// degrees from there.
pub(crate) fn joint_pulse(joint: &JointInfo, ticks: u8) -> i32 {
    const MS: i32 = ServoPulse::PER_MS as i32;
    let way = i32::from(ticks) - i32::from(joint.centre);
    MS * 3 / 2 + way * MS / i32::from(joint.ticks_per_90.max(1))
}

/// All settings of a board with motors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// The controller's.
    pub control: ControlSettings,
    /// The PMS5005's link's.
    pub link: LinkSettings,
    /// The Pioneer Arm's.
    pub arm: ArmSettings,
}

impl Settings {
    /// The defaults of the [`table`].
    pub const DEFAULT: Self = Self {
        control: ControlSettings::DEFAULT,
        link: LinkSettings::DEFAULT,
        arm: ArmSettings::DEFAULT,
    };
}
