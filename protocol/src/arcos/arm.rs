//! The Pioneer Arm's twelve commands. Source: facts, "Commands", and the manual's page.
//!
//! A command that [`ArmCommand::parse`] answers is well formed: its joint exists. Whether its
//! position can be reached, and whether the arm may move at all, is the arm's business.

use super::command;
use super::packet::{Argument, BadArgument, encode_command};
use crate::data::{EncodeError, codes};

/// Joints of the arm, and servos: there are six.
pub const JOINTS: usize = 6;

/// A joint, 1 to 6; 6 is the gripper.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct JointNumber(u8);

impl JointNumber {
    /// All joints, in order.
    pub const ALL: [Self; JOINTS] = [Self(1), Self(2), Self(3), Self(4), Self(5), Self(6)];
    /// The gripper.
    pub const GRIPPER: Self = Self(6);

    /// JointNumber `number`, if it is one of 1 to 6.
    pub const fn new(number: u8) -> Option<Self> {
        if matches!(number, 1..=6) { Some(Self(number)) } else { None }
    }

    /// 1 to 6, as on the wire.
    pub const fn number(self) -> u8 {
        self.0
    }

    /// 0 to 5, for arrays of [`JOINTS`].
    pub fn index(self) -> usize {
        usize::from(self.0).saturating_sub(1)
    }
}

/// Whom HOME and STOP are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Joints {
    /// One of them.
    One(JointNumber),
    /// All of them.
    All,
}

impl Joints {
    /// The number that means all of them in HOME and STOP.
    const ALL: u16 = 255;

    fn number(self) -> u16 {
        match self {
            Self::One(joint) => joint.number().into(),
            Self::All => Self::ALL,
        }
    }

    /// Whether a joint is meant.
    pub fn include(self, joint: JointNumber) -> bool {
        self == Self::All || self == Self::One(joint)
    }
}

codes! {
    /// How often ARMpac is asked for.
    StatusRequest {
        /// No more.
        Stop = 0,
        /// Once.
        Once = 1,
        /// One a cycle of the standard information packet, until further notice.
        Stream = 2,
    }
}

/// Why a packet that arrived intact is not carried out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Refusal {
    /// A command that is not the arm's. Counted apart from the others.
    #[error("command {0} is not the arm's")]
    NotForTheArm(u8),
    /// The command needs an argument and has none.
    #[error("command {0} needs an argument")]
    MissingArgument(u8),
    /// The argument is no whole argument, or not of the type that the command takes.
    #[error("command {0} takes a positive integer")]
    WrongArgument(u8),
    /// A joint that does not exist.
    #[error("joint {0} does not exist")]
    NoSuchJoint(u16),
    /// A value out of the range of its command.
    #[error("{value} is out of range in command {number}")]
    Value {
        /// The command.
        number: u8,
        /// The value, as sent.
        value: u16,
    },
}

/// A host's command to the arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ArmCommand {
    /// One ARMINFOpac, please (70).
    Info,
    /// ARMpac, please (71).
    Status(StatusRequest),
    /// Warm reset (72).
    Init,
    /// Probe the arm (73).
    Check,
    /// Servo power on or off (74).
    Power(bool),
    /// To the home positions (75). On the wire any number above 6 is all of them.
    Home(Joints),
    /// All home, then power off (76).
    Park,
    /// To a position (77).
    Position {
        /// Which joint.
        joint: JointNumber,
        /// Where to, in ticks; the joint may reach less.
        ticks: u8,
    },
    /// How fast (78).
    Speed {
        /// Which joint.
        joint: JointNumber,
        /// Milliseconds a step of one tick: 1 to 127, but other values are sent too.
        ms_per_tick: u8,
    },
    /// Stop here (79).
    Stop(Joints),
    /// Idle seconds until PARK, 0 is never (80).
    AutoPark(u16),
    /// Seconds until a closed gripper goes home, 0 is never (81).
    GripPark(u16),
}

impl ArmCommand {
    /// Reads an intact packet's id and data. Commands without an argument take no notice of one.
    ///
    /// # Errors
    /// [`Refusal`] names what is wrong.
    pub fn parse(number: u8, data: &[u8]) -> Result<Self, Refusal> {
        let integer = || match Argument::parse(data) {
            Ok(Some(Argument::Positive(value))) => Ok(value),
            Ok(None) => Err(Refusal::MissingArgument(number)),
            Ok(Some(Argument::Negative(_) | Argument::Text(_))) | Err(BadArgument) => {
                Err(Refusal::WrongArgument(number))
            }
        };
        Ok(match number {
            command::INFO => Self::Info,
            command::STATUS => {
                let value = integer()?;
                let request = u8::try_from(value).ok().and_then(StatusRequest::from_number);
                Self::Status(request.ok_or(Refusal::Value { number, value })?)
            }
            command::INIT => Self::Init,
            command::CHECK => Self::Check,
            command::POWER => Self::Power(match integer()? {
                0 => false,
                1 => true,
                value => return Err(Refusal::Value { number, value }),
            }),
            command::HOME => match integer()? {
                7.. => Self::Home(Joints::All),
                joint => Self::Home(Joints::One(existing(joint)?)),
            },
            command::PARK => Self::Park,
            command::POS => {
                let [ticks, joint] = integer()?.to_le_bytes();
                Self::Position { joint: existing(joint.into())?, ticks }
            }
            command::SPEED => {
                let [ms_per_tick, joint] = integer()?.to_le_bytes();
                Self::Speed { joint: existing(joint.into())?, ms_per_tick }
            }
            command::STOP => match integer()? {
                Joints::ALL => Self::Stop(Joints::All),
                joint => Self::Stop(Joints::One(existing(joint)?)),
            },
            command::AUTOPARK => Self::AutoPark(integer()?),
            command::GRIPPARK => Self::GripPark(integer()?),
            _ => return Err(Refusal::NotForTheArm(number)),
        })
    }

    /// Its number on the wire, and its argument.
    fn on_the_wire(&self) -> (u8, Option<u16>) {
        match *self {
            Self::Info => (command::INFO, None),
            Self::Status(request) => (command::STATUS, Some(request.number().into())),
            Self::Init => (command::INIT, None),
            Self::Check => (command::CHECK, None),
            Self::Power(on) => (command::POWER, Some(on.into())),
            Self::Home(joints) => (command::HOME, Some(joints.number())),
            Self::Park => (command::PARK, None),
            Self::Position { joint, ticks } => {
                (command::POS, Some(u16::from_le_bytes([ticks, joint.number()])))
            }
            Self::Speed { joint, ms_per_tick } => {
                (command::SPEED, Some(u16::from_le_bytes([ms_per_tick, joint.number()])))
            }
            Self::Stop(joints) => (command::STOP, Some(joints.number())),
            Self::AutoPark(seconds) => (command::AUTOPARK, Some(seconds)),
            Self::GripPark(seconds) => (command::GRIPPARK, Some(seconds)),
        }
    }

    /// Writes the whole packet into `out` and answers the part it took: 9 bytes at the most.
    ///
    /// # Errors
    /// [`EncodeError::BufferTooShort`].
    pub fn encode<'b>(&self, out: &'b mut [u8]) -> Result<&'b mut [u8], EncodeError> {
        let (number, argument) = self.on_the_wire();
        encode_command(number, argument.map(Argument::Positive), out)
    }
}

fn existing(joint: u16) -> Result<JointNumber, Refusal> {
    u8::try_from(joint).ok().and_then(JointNumber::new).ok_or(Refusal::NoSuchJoint(joint))
}
