//! The controller's vocabulary: what a personality may ask of it, and why it may refuse.

use protocol::pms5005::extension::Fault;
use protocol::pms5005::{
    CHANNELS, Channel, Gain, Loop, Method, Parameter, Polarity, Scope, Sensor,
};

use crate::control::axis::AxisRefusal;
use crate::control::pid::HostGains;
use crate::control::potentiometer;
use crate::settings::{ControlSettings, KiReading};

/// Channels 0 and 1 have encoders.
pub const ENCODERS: usize = 2;

/// What a personality asks of the controller. A command takes effect whole, in one control period.
/// Aligned, and so copied word by word: interrupts are off meanwhile, and control waits.
#[repr(align(4))]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Drive DC channels. Targets are in the method's unit: sensor counts, counts per second, or
    /// raw [`Duty`](crate::units::Duty).
    Drive {
        /// What the targets are.
        method: Method,
        /// `None` leaves a channel alone.
        targets: [Option<i16>; CHANNELS],
        /// Control periods until the set-point is there; 0 is at once.
        periods: u16,
    },
    /// Move servos; targets in 1/2250 ms.
    MoveServos {
        /// `None` leaves a servo alone.
        targets: [Option<i16>; CHANNELS],
        /// Control periods until the pulse width is there; 0 is at once.
        periods: u16,
    },
    /// Put the [`SetUp`] that waits beside the commands into force.
    SetUp,
    /// Suspend (`run` false) or resume.
    Run {
        /// Whom.
        scope: Scope,
        /// Which.
        run: bool,
    },
    /// Set the output port.
    Gpio(u8),
    /// Clear latched faults: all of them, or one DC channel's own.
    ClearFaults(Scope),
    /// Show the record of the latched fault at this place in the
    /// [`Snapshot`](crate::controller::Snapshot), from now on.
    ShowFault(u8),
    /// Keep on record what only somebody else can see.
    Record(Fault),
}

const _: () = assert!(size_of::<Command>() <= 36);

/// What is too large to be queued with the commands. One at a time waits beside them, and
/// [`Command::SetUp`] stands in its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SetUp {
    /// Change parameters of DC channels, and the collision protection.
    Parameters(Configuration),
    /// Go by these settings from now on.
    Settings(ControlSettings),
}

/// The new parameters of a frame; `None` leaves one as it is. Of two values for the same the later
/// counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Configuration {
    /// Those of each DC channel.
    pub channels: [ChannelConfiguration; CHANNELS],
    /// Whether the collision protection is on.
    pub collision_protection: Option<bool>,
}

/// Those of one DC channel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ChannelConfiguration {
    /// Which way the bridge is wired.
    pub polarity: Option<Polarity>,
    /// What it is measured by: one that the channel has, as [`Configuration::add`] sees to.
    pub sensor: Option<Sensor>,
    /// What its set-point means.
    pub method: Option<Method>,
    pub(crate) position: GainChanges,
    pub(crate) velocity: GainChanges,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct GainChanges {
    /// The words as on the wire.
    kp: Option<[u8; 2]>,
    kd: Option<[u8; 2]>,
    ki: Option<[u8; 2]>,
}

impl GainChanges {
    /// The gains with these changes.
    pub(crate) fn apply(&self, gains: HostGains, reading: KiReading) -> HostGains {
        HostGains {
            kp: self.kp.map_or(gains.kp, u16::from_le_bytes),
            kd: self.kd.map_or(gains.kd, u16::from_le_bytes),
            ki_hundredths: self.ki.map_or(gains.ki_hundredths, |ki| reading.hundredths(ki)),
        }
    }
}

impl Configuration {
    /// Adds one parameter.
    ///
    /// # Errors
    /// [`Refused::NoSuchSensor`] when the channel has no such sensor: only channels 0 and 1 have
    /// encoders, only channels 0 to 2 pairs of potentiometers.
    pub fn add(&mut self, parameter: Parameter) -> Result<(), Refused> {
        match parameter {
            Parameter::CollisionProtection(on) => self.collision_protection = Some(on),
            Parameter::Polarity(channel, polarity) => self.of(channel).polarity = Some(polarity),
            Parameter::Method(channel, method) => self.of(channel).method = Some(method),
            Parameter::Sensor(channel, sensor) => {
                let channels = match sensor {
                    Sensor::SinglePotentiometer => CHANNELS,
                    Sensor::DualPotentiometer => potentiometer::PAIRS.len(),
                    Sensor::Encoder => ENCODERS,
                };
                if channel.index() >= channels {
                    return Err(Refused::NoSuchSensor(channel));
                }
                self.of(channel).sensor = Some(sensor);
            }
            Parameter::Gain(channel, control_loop, gain) => {
                let gains = match control_loop {
                    Loop::Position => &mut self.of(channel).position,
                    Loop::Velocity => &mut self.of(channel).velocity,
                };
                match gain {
                    Gain::Proportional(kp) => gains.kp = Some(kp.to_le_bytes()),
                    Gain::Derivative(kd) => gains.kd = Some(kd.to_le_bytes()),
                    Gain::Integral { integer, fraction } => gains.ki = Some([integer, fraction]),
                }
            }
        }
        Ok(())
    }

    fn of(&mut self, channel: Channel) -> &mut ChannelConfiguration {
        &mut self.channels[channel.index()]
    }
}

/// Why a command was not carried out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Refused {
    /// A channel does not take this target.
    Axis(Channel, AxisRefusal),
    /// This channel has no such sensor.
    NoSuchSensor(Channel),
}

impl core::fmt::Display for Refused {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let (channel, why) = match self {
            Self::Axis(channel, AxisRefusal::BeyondScale) => {
                (channel, "the target lies beyond the sensor's scale")
            }
            Self::Axis(channel, AxisRefusal::OtherMethod) => {
                (channel, "it was set to another method (sub-command 0E)")
            }
            Self::NoSuchSensor(channel) => (channel, "it has no such sensor"),
        };
        write!(f, "channel {}: {why}", channel.number())
    }
}
