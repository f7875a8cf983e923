//! The WiRobot PMS5005, protocol version 2.0.2 (March 2008).
//!
//! - [`Receiver`] finds frames in a stream, [`Frame`] takes one apart and puts one together;
//! - [`Command`] is what a host asks for (Table II.1);
//! - [`Report`] is what the board tells (Tables II.2 to II.4);
//! - [`ACK`] and [`PING`] are the two short frames that the board sends besides;
//! - [`encode_answer`] puts an answer of the [`extension`](crate::extension) into a frame; its requests
//!   are [`Command::Extension`].
//!
//! Bytes, units and examples stand on the [page of the wire](crate), and so does
//! [what the manual proves and what we chose](crate#what-the-manual-proves-and-what-we-chose).

mod command;
mod frame;
mod motion;
mod parameter;
mod report;

use crate::extension::Answer;

pub use crate::data::{Data, EncodeError};
pub use crate::repeat::Repeat;
pub use command::{CHANNELS, Channel, Command, LcdFrame, Refusal, Reports, Scope};
pub use frame::{
    ETX, Frame, MAX_DATA, MAX_FRAME, OVERHEAD, Pms5005, RES_NO_ACK, RID_HOST, RID_PMS5005,
    Receiver, STX,
};
pub use motion::{Addressing, Move, Quantity};
pub use parameter::{Gain, Loop, Method, Parameter, Parameters, Polarity, Sensor};
pub use report::{CustomIoReport, Encoder, MotorReport, Report, SensorReport};

/// Data IDs (Table II.1).
pub mod did {
    /// Move listed DC motors to positions.
    pub const POSITION: u8 = 3;
    /// Move all DC motors to positions.
    pub const POSITION_ALL: u8 = 4;
    /// Drive listed DC motors with a PWM.
    pub const PWM: u8 = 5;
    /// Drive all DC motors with a PWM.
    pub const PWM_ALL: u8 = 6;
    /// System parameters.
    pub const PARAMETERS: u8 = 7;
    /// Custom GPIO outputs.
    pub const GPIO: u8 = 22;
    /// One sixteenth of the LCD's image.
    pub const LCD: u8 = 23;
    /// Run listed DC motors at velocities.
    pub const VELOCITY: u8 = 26;
    /// Run all DC motors at velocities.
    pub const VELOCITY_ALL: u8 = 27;
    /// Move listed servos.
    pub const SERVO: u8 = 28;
    /// Move all servos.
    pub const SERVO_ALL: u8 = 29;
    /// Suspend and resume.
    pub const RUN: u8 = 30;
    /// Motor control signals (Table II.2).
    pub const MOTORS: u8 = 123;
    /// Custom GPIO and A/D (Table II.3).
    pub const CUSTOM_IO: u8 = 124;
    /// Sensors (Table II.4).
    pub const SENSORS: u8 = 125;
    /// All three of them.
    pub const ALL_REPORTS: u8 = 127;
    /// Ping and acknowledgement.
    pub const SETUP: u8 = 255;
}

/// The acknowledgement of section III, as it stands on the wire: RID 0, RES 0, DID 255, data 1, and
/// the checksum that is printed there.
pub const ACK: [u8; 10] = [STX[0], STX[1], RID_HOST, 0, did::SETUP, 1, 1, 72, ETX[0], ETX[1]];

/// "PMS5005 ping PC periodically" (Table II.1): RID 0, RES 0, DID 255, data 0.
pub const PING: Frame<'static> = Frame { rid: RID_HOST, res: 0, did: did::SETUP, data: &[0] };

/// Bytes of the longest frame with an answer of the [`extension`](crate::extension).
pub const MAX_ANSWER: usize = OVERHEAD + Answer::MAX_DATA;

/// Writes the whole frame of an answer of the [`extension`](crate::extension) (RID 0, RES 255) into
/// `out` and returns the part it took. [`Answer::parse`] reads it, from DID and DATA.
///
/// # Errors
/// [`EncodeError::BufferTooShort`]; [`EncodeError::NotRepresentable`] where
/// [`Answer::emit`] says so.
pub fn encode_answer<'b>(
    answer: &Answer<'_>,
    out: &'b mut [u8],
) -> Result<&'b mut [u8], EncodeError> {
    let mut data = Data::new();
    answer.emit(&mut data)?;
    Frame { rid: RID_HOST, res: RES_NO_ACK, did: answer.did(), data: &data }.encode(out)
}
