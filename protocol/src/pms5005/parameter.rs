//! System parameters: the sub-commands of DID 7 (Table II.1).
//!
//! One frame may carry several sub-commands, and one gain sub-command several gains:
//! `07 ch 01 KpL KpH 02 KdL KdH 03 M N` is what hosts send. [`Parameters`] is DATA that has been
//! read through once and found well formed; it yields one [`Parameter`] after the other.

use super::command::{Channel, Refusal, flag};
use super::did;
use crate::data::{Data, EncodeError, append, codes};

/// Sub-command numbers (Table II.1).
mod sub {
    pub const POLARITY: u8 = 0x06;
    pub const POSITION_GAINS: u8 = super::Loop::Position.number();
    pub const VELOCITY_GAINS: u8 = super::Loop::Velocity.number();
    pub const SENSOR: u8 = 0x0D;
    pub const METHOD: u8 = 0x0E;
    pub const COLLISION: u8 = 0x13;
}

/// Gain numbers within sub-commands 07 and 08 (Table II.1).
mod gain {
    pub const PROPORTIONAL: u8 = 1;
    pub const DERIVATIVE: u8 = 2;
    pub const INTEGRAL: u8 = 3;
}

codes! {
    /// Whether the sensor's value rises when the PWM is above 50 % (sub-command 06).
    Polarity {
        /// It rises.
        Positive = 1,
        /// It falls.
        Negative = 0xFF,
    }
}

codes! {
    /// The control loop that gains belong to (sub-commands 07 and 08).
    Loop {
        /// That of positions.
        Position = 0x07,
        /// That of velocities.
        Velocity = 0x08,
    }
}

/// A gain as it stands on the wire. What it multiplies is the controller's business.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Gain {
    /// Kp, 0 to 65535 (gain 1).
    Proportional(u16),
    /// Kd, 0 to 65535 (gain 2).
    Derivative(u16),
    /// Ki: integer part M and fraction part N (gain 3). Hosts disagree on what N counts, so the
    /// two bytes stand here as they came.
    Integral {
        /// M, the first byte.
        integer: u8,
        /// N, the second byte.
        fraction: u8,
    },
}

codes! {
    /// The sensor of a channel's control loop (sub-command 0D).
    Sensor {
        /// One potentiometer, 0 to 4095.
        SinglePotentiometer = 0,
        /// Two potentiometers half a turn apart, 0 to 4427 and round again.
        DualPotentiometer = 1,
        /// A quadrature encoder, 0 to 32767 and round again.
        Encoder = 2,
    }
}

codes! {
    /// How a channel is controlled (sub-command 0E).
    Method {
        /// Open loop: the PWM is the command.
        Pwm = 0,
        /// Closed loop on position.
        Position = 1,
        /// Closed loop on velocity.
        Velocity = 2,
    }
}

/// One parameter of one channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Parameter {
    /// Sub-command 06.
    Polarity(Channel, Polarity),
    /// Sub-commands 07 and 08, one gain.
    Gain(Channel, Loop, Gain),
    /// Sub-command 0D.
    Sensor(Channel, Sensor),
    /// Sub-command 0E.
    Method(Channel, Method),
    /// Sub-command 13.
    CollisionProtection(bool),
}

impl Parameter {
    /// Appends the sub-command to DATA; [`Parameters::parse`] makes a command of it.
    ///
    /// # Errors
    /// [`EncodeError::TooLong`] when DATA is full.
    pub fn emit(&self, data: &mut Data) -> Result<(), EncodeError> {
        match *self {
            Self::Polarity(channel, polarity) => {
                append(data, &[sub::POLARITY, channel.number(), polarity.number()])
            }
            Self::Gain(channel, control_loop, gain) => {
                let (number, [first, second]) = match gain {
                    Gain::Proportional(kp) => (gain::PROPORTIONAL, kp.to_le_bytes()),
                    Gain::Derivative(kd) => (gain::DERIVATIVE, kd.to_le_bytes()),
                    Gain::Integral { integer, fraction } => (gain::INTEGRAL, [integer, fraction]),
                };
                append(data, &[control_loop.number(), channel.number(), number, first, second])
            }
            Self::Sensor(channel, sensor) => {
                append(data, &[sub::SENSOR, channel.number(), sensor.number()])
            }
            Self::Method(channel, method) => {
                append(data, &[sub::METHOD, channel.number(), method.number()])
            }
            Self::CollisionProtection(on) => append(data, &[sub::COLLISION, u8::from(on)]),
        }
    }
}

/// DATA of a well-formed DID 7, to be iterated over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Parameters<'a> {
    bytes: &'a [u8],
}

impl<'a> Parameters<'a> {
    /// Reads DATA through.
    ///
    /// # Errors
    /// [`Refusal`] names the first thing that is wrong.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, Refusal> {
        if bytes.is_empty() {
            return Err(Refusal::Length { did: did::PARAMETERS, len: 0 });
        }
        let mut walk = Walk::new(bytes);
        while walk.next_parameter()?.is_some() {}
        Ok(Self { bytes })
    }

    /// The DATA they stand in.
    pub fn as_bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// The parameters, in the order of the wire.
    pub fn iter(&self) -> impl Iterator<Item = Parameter> + 'a {
        let mut walk = Walk::new(self.bytes);
        // DATA was read through by `parse`: there is no error left to lose.
        core::iter::from_fn(move || walk.next_parameter().ok().flatten())
    }
}

/// The walk through DATA.
struct Walk<'a> {
    rest: &'a [u8],
    /// Bytes of DATA, for refusals.
    len: usize,
    /// Within sub-command 07 or 08: whose gains these are.
    gains_of: Option<(Loop, Channel)>,
}

impl<'a> Walk<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes, len: bytes.len(), gains_of: None }
    }

    fn next_parameter(&mut self) -> Result<Option<Parameter>, Refusal> {
        if let Some((control_loop, channel)) = self.gains_of
            && let Some(gain) = self.next_gain()?
        {
            return Ok(Some(Parameter::Gain(channel, control_loop, gain)));
        }
        let (parameter, rest) = match *self.rest {
            [] => return Ok(None),
            [sub::POLARITY, channel, value, ref rest @ ..] => {
                let polarity = Polarity::from_number(value).ok_or(bad_value(value))?;
                (Parameter::Polarity(existing(channel)?, polarity), rest)
            }
            [sub @ (sub::POSITION_GAINS | sub::VELOCITY_GAINS), channel, ref rest @ ..] => {
                let control_loop =
                    if sub == sub::POSITION_GAINS { Loop::Position } else { Loop::Velocity };
                let channel = existing(channel)?;
                self.rest = rest;
                self.gains_of = Some((control_loop, channel));
                let gain = self.next_gain()?.ok_or(match rest {
                    [] => self.cut_short(),
                    [unknown, ..] => Refusal::UnknownSubCommand(*unknown),
                })?;
                return Ok(Some(Parameter::Gain(channel, control_loop, gain)));
            }
            [sub::SENSOR, channel, value, ref rest @ ..] => {
                let sensor = Sensor::from_number(value).ok_or(bad_value(value))?;
                (Parameter::Sensor(existing(channel)?, sensor), rest)
            }
            [sub::METHOD, channel, value, ref rest @ ..] => {
                let method = Method::from_number(value).ok_or(bad_value(value))?;
                (Parameter::Method(existing(channel)?, method), rest)
            }
            [sub::COLLISION, value, ref rest @ ..] => {
                (Parameter::CollisionProtection(flag(did::PARAMETERS, value)?), rest)
            }
            [
                sub::POLARITY
                | sub::POSITION_GAINS
                | sub::VELOCITY_GAINS
                | sub::SENSOR
                | sub::METHOD
                | sub::COLLISION,
                ..,
            ] => return Err(self.cut_short()),
            [unknown, ..] => return Err(Refusal::UnknownSubCommand(unknown)),
        };
        self.rest = rest;
        self.gains_of = None;
        Ok(Some(parameter))
    }

    /// The next gain of the open gain sub-command, `None` where something else begins.
    fn next_gain(&mut self) -> Result<Option<Gain>, Refusal> {
        let (gain, rest) = match *self.rest {
            [gain::PROPORTIONAL, low, high, ref rest @ ..] => {
                (Gain::Proportional(u16::from_le_bytes([low, high])), rest)
            }
            [gain::DERIVATIVE, low, high, ref rest @ ..] => {
                (Gain::Derivative(u16::from_le_bytes([low, high])), rest)
            }
            [gain::INTEGRAL, integer, fraction, ref rest @ ..] => {
                (Gain::Integral { integer, fraction }, rest)
            }
            [gain::PROPORTIONAL..=gain::INTEGRAL, ..] => return Err(self.cut_short()),
            _ => return Ok(None),
        };
        self.rest = rest;
        Ok(Some(gain))
    }

    /// The refusal of DATA that ends within a sub-command.
    fn cut_short(&self) -> Refusal {
        Refusal::Length { did: did::PARAMETERS, len: self.len }
    }
}

fn existing(channel: u8) -> Result<Channel, Refusal> {
    Channel::new(channel).ok_or(Refusal::NoSuchChannel(channel))
}

fn bad_value(value: u8) -> Refusal {
    Refusal::Value { did: did::PARAMETERS, value: value.into() }
}
