//! What an owner may choose, with the defaults that suit a correctly wired original.
//!
//! - [`Settings`]: the choices, as the code uses them;
//! - [`table`]: all facts of each, with its number, as hosts and the flash know it, and `numbered`:
//!   what is done with the numbers;
//! - [`store`]: where they survive.

mod numbered;
pub mod store;
pub mod table;

use crate::channel::{CHANNELS, Channel, ENCODERS, Method, PAIRS, Polarity, Sensor};
use crate::units::{Duty, ServoPulse};

pub use numbered::{Setting, SettingRefused};
pub use table::{
    ArmSettings, BoardFaultSettings, ChannelFaultSettings, CollisionSettings, ControlSettings,
    LinkSettings, Unit,
};

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

/// Gains as the original numbers them, for one loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct HostGains {
    /// Kp, 0 to 65535.
    pub kp: u16,
    /// Kd, 0 to 65535.
    pub kd: u16,
    /// Ki in hundredths, 0 to 65535.
    pub ki_hundredths: u16,
}

impl HostGains {
    /// The original's defaults.
    pub const DEFAULT: Self = Self { kp: 50, kd: 5, ki_hundredths: 0 };
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
    /// Counts per second at full drive; 0 is what its sensor's kind has.
    pub full_speed: u32,
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
        full_speed: 0,
    };
}

/// Whether a channel has such a sensor: only channels 0 and 1 have encoders, only channels 0 to 2 pairs
/// of potentiometers.
pub(crate) fn has_sensor(channel: usize, sensor: Sensor) -> bool {
    let channels = match sensor {
        Sensor::SinglePotentiometer => CHANNELS,
        Sensor::DualPotentiometer => PAIRS,
        Sensor::Encoder => ENCODERS,
    };
    channel < channels
}

impl ControlSettings {
    /// Counts per second of a channel at full drive: its own setting, or that of the sensor that counts; 0
    /// is not known.
    pub fn full_speed(&self, channel: Channel, sensor: Sensor) -> u32 {
        match (self.channels[channel.index()].full_speed, sensor) {
            (0, Sensor::Encoder) => self.full_speed_encoder,
            (0, Sensor::SinglePotentiometer | Sensor::DualPotentiometer) => {
                self.full_speed_potentiometer
            }
            (own, _) => own,
        }
    }

    /// The same where a number is needed: the default if none is known.
    pub fn known_full_speed(&self, channel: Channel, sensor: Sensor) -> u32 {
        match self.full_speed(channel, sensor) {
            0 => Self::DEFAULT.full_speed(channel, sensor),
            known => known,
        }
    }
}

/// An arm's joint on its servo. Positions are in ticks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct JointSettings {
    /// The speed at boot, in ms a tick.
    pub ms_per_tick: u8,
    /// The home position.
    pub home: u8,
    /// The lowest position.
    pub min: u8,
    /// The position of 0 degrees.
    pub centre: u8,
    /// The highest position.
    pub max: u8,
    /// Ticks of 90 degrees.
    pub ticks_per_90: u8,
}

impl JointSettings {
    /// A whole byte of ticks is 0.59 to 2.41 ms of pulse.
    pub const DEFAULT: Self =
        Self { ms_per_tick: 20, home: 127, min: 0, centre: 127, max: 255, ticks_per_90: 140 };

    /// The pulse at a position, in 1/2250 ms: 1.5 ms at the centre, and 1 ms more or less 90 degrees
    /// from there.
    pub(crate) fn pulse(&self, ticks: u8) -> i32 {
        const MS: i32 = ServoPulse::PER_MS as i32;
        let way = i32::from(ticks) - i32::from(self.centre);
        MS * 3 / 2 + way * MS / i32::from(self.ticks_per_90.max(1))
    }
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
