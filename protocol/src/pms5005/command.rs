//! What a host asks for: DID and DATA of Table II.1, typed, both directions.
//!
//! A command that [`Command::parse`] answers is well formed throughout: channels exist, values
//! are in the range that the wire allows. What it does not know is the state of the board (which
//! sensor a channel uses, say); such questions are the controller's.

use super::did;
use super::frame::{Frame, RID_PMS5005};
use super::motion::Move;
use super::parameter::Parameters;
use crate::data::{Data, EncodeError, append};
use crate::extension::{Request, Verdict};
use crate::repeat::Repeat;

/// DC motor channels, and servo channels: there are six of each.
pub const CHANNELS: usize = 6;

/// DC motor or servo channel, 0 to 5. The manual's "motor 1" is channel 0.
///
/// Six names rather than a number: an array of [`CHANNELS`] has each, and the compiler knows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
#[expect(missing_docs, reason = "the names say it")]
pub enum Channel {
    Channel0,
    Channel1,
    Channel2,
    Channel3,
    Channel4,
    Channel5,
}

impl Channel {
    /// All channels, in order.
    pub const ALL: [Self; CHANNELS] = [
        Self::Channel0,
        Self::Channel1,
        Self::Channel2,
        Self::Channel3,
        Self::Channel4,
        Self::Channel5,
    ];

    /// Channel `number`, if it is one of 0 to 5.
    pub fn new(number: u8) -> Option<Self> {
        Self::ALL.get(usize::from(number)).copied()
    }

    /// 0 to 5, as on the wire.
    pub const fn number(self) -> u8 {
        self as u8
    }

    /// 0 to 5, for arrays of [`CHANNELS`].
    pub const fn index(self) -> usize {
        self as usize
    }
}

/// Why a frame that arrived intact is not carried out. The board acknowledges it all the same:
/// the wire has no other answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Refusal {
    /// A DID that Table II.1 does not list. Counted apart from the others.
    #[error("DID {0} is not in Table II.1")]
    UnknownDid(u8),
    /// DATA of this many bytes fits no form of this DID.
    #[error("{len} bytes of DATA fit no form of DID {did}")]
    Length {
        /// The DID.
        did: u8,
        /// Bytes of DATA.
        len: usize,
    },
    /// A channel that does not exist.
    #[error("channel {0} does not exist")]
    NoSuchChannel(u8),
    /// A channel that is listed twice.
    #[error("channel {0} is listed twice")]
    RepeatedChannel(u8),
    /// A value out of the range of its field.
    #[error("{value} is out of range in DID {did}")]
    Value {
        /// The DID.
        did: u8,
        /// The value, as sent.
        value: u16,
    },
    /// A sub-command of DID 7 that Table II.1 does not list, or a gain other than 1 to 3.
    #[error("sub-command {0:#04x} is not in Table II.1")]
    UnknownSubCommand(u8),
    /// A request of the [`extension`](crate::extension); the outcome tells the host why.
    #[error("a request of the extension: {0}")]
    Extension(Verdict),
}

/// A sixteenth of the LCD's image (DID 23).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LcdFrame<'a> {
    /// 0 to 15: even numbers are the left half, odd ones the right, from the top.
    pub number: u8,
    /// 64 columns of 8 pixels, the least significant bit on top.
    pub columns: &'a [u8; LcdFrame::COLUMNS],
}

impl LcdFrame<'_> {
    /// Columns of one frame, one byte each.
    pub const COLUMNS: usize = 64;
    /// Frames of one image of 128 x 64 pixels.
    pub const FRAMES: u8 = 16;
}

/// Whom DID 30 suspends or resumes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Scope {
    /// All DC motors and all servos.
    All,
    /// One DC motor: 0 to 5 on the wire.
    Motor(Channel),
    /// One servo: 6 to 11 on the wire.
    Servo(Channel),
}

/// The number of the first servo in DID 30.
const FIRST_SERVO: u8 = 6;

/// Which telemetry a request is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Reports {
    /// Motor control signals (DID 123).
    Motors = did::MOTORS,
    /// Custom GPIO and A/D (DID 124).
    CustomIo = did::CUSTOM_IO,
    /// Sensors (DID 125).
    Sensors = did::SENSORS,
    /// All three of them (DID 127).
    All = did::ALL_REPORTS,
}

impl Reports {
    const ALL: [Self; 4] = [Self::Motors, Self::CustomIo, Self::Sensors, Self::All];
}

/// A host's command (Table II.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Command<'a> {
    /// Move DC motors or servos (DIDs 3 to 6 and 26 to 29).
    Move(Move),
    /// Set system parameters (DID 7).
    Parameters(Parameters<'a>),
    /// Set the eight GPIO outputs; bit 0 is GPIO0 (DID 22).
    GpioOutputs(u8),
    /// Show a sixteenth of an image (DID 23).
    Lcd(LcdFrame<'a>),
    /// Suspend or resume (DID 30).
    Run {
        /// Who is meant.
        scope: Scope,
        /// `true` resumes, `false` suspends.
        run: bool,
    },
    /// Ask for telemetry (DIDs 123, 124, 125, 127).
    Telemetry {
        /// Which.
        reports: Reports,
        /// How often.
        repeat: Repeat,
    },
    /// A ping, or a host's acknowledgement: nothing on the wire tells one from the other
    /// (DID 255, data 1).
    PingOrAck,
    /// The ping that Table II.1 gives the board; some hosts send it too (DID 255, data 0).
    Ping,
    /// What the manual does not know (DID 7 from sub-command 0x80, DIDs 96 to 111).
    Extension(Request<'a>),
}

impl<'a> Command<'a> {
    /// Reads DID and DATA of an intact frame.
    ///
    /// # Errors
    /// [`Refusal`] names the first thing that is wrong. Nothing of such a frame may be used.
    pub fn parse(did: u8, data: &'a [u8]) -> Result<Self, Refusal> {
        let bad_length = Refusal::Length { did, len: data.len() };
        if let Some(command) = Move::parse(did, data) {
            return command.map(Self::Move);
        }
        if let Some(request) = Request::parse(did, data) {
            return request.map(Self::Extension).map_err(Refusal::Extension);
        }
        if let Some(reports) = Reports::ALL.into_iter().find(|reports| *reports as u8 == did) {
            return match data {
                [] | [_] => Ok(Self::Telemetry { reports, repeat: Repeat::parse(data.first()) }),
                _ => Err(bad_length),
            };
        }
        match (did, data) {
            (did::PARAMETERS, _) => Parameters::parse(data).map(Self::Parameters),
            (did::GPIO, &[outputs]) => Ok(Self::GpioOutputs(outputs)),
            (did::LCD, &[number, ref columns @ ..]) => {
                let columns = columns.try_into().map_err(|_| bad_length)?;
                if number >= LcdFrame::FRAMES {
                    return Err(Refusal::Value { did, value: number.into() });
                }
                Ok(Self::Lcd(LcdFrame { number, columns }))
            }
            (did::RUN, &[mode]) => Ok(Self::Run { scope: Scope::All, run: flag(did, mode)? }),
            (did::RUN, &[mode, number]) => {
                let scope = match number.checked_sub(FIRST_SERVO) {
                    None => Channel::new(number).map(Scope::Motor),
                    Some(servo) => Channel::new(servo).map(Scope::Servo),
                };
                let scope = scope.ok_or(Refusal::NoSuchChannel(number))?;
                Ok(Self::Run { scope, run: flag(did, mode)? })
            }
            (did::SETUP, &[kind]) => {
                Ok(if flag(did, kind)? { Self::PingOrAck } else { Self::Ping })
            }
            (did::GPIO | did::LCD | did::RUN | did::SETUP, _) => Err(bad_length),
            _ => Err(Refusal::UnknownDid(did)),
        }
    }

    /// The DID that this command has on the wire.
    pub fn did(&self) -> u8 {
        match self {
            Self::Move(command) => command.did(),
            Self::Parameters(_) => did::PARAMETERS,
            Self::GpioOutputs(_) => did::GPIO,
            Self::Lcd(_) => did::LCD,
            Self::Run { .. } => did::RUN,
            Self::Telemetry { reports, .. } => *reports as u8,
            Self::PingOrAck | Self::Ping => did::SETUP,
            Self::Extension(request) => request.did(),
        }
    }

    /// Writes a whole frame to the PMS5005 into `out`, with `res` in the reserved byte, and
    /// answers the part it took.
    ///
    /// # Errors
    /// [`EncodeError::NotRepresentable`] for a [`Move`] whose targets are out of range, or whose
    /// list is empty; the errors of [`Frame::encode`].
    pub fn encode<'b>(&self, res: u8, out: &'b mut [u8]) -> Result<&'b mut [u8], EncodeError> {
        let mut data = Data::new();
        self.emit(&mut data)?;
        Frame { rid: RID_PMS5005, res, did: self.did(), data: &data }.encode(out)
    }

    fn emit(&self, data: &mut Data) -> Result<(), EncodeError> {
        match self {
            Self::Move(command) => command.emit(data),
            Self::Parameters(parameters) => append(data, parameters.as_bytes()),
            Self::GpioOutputs(outputs) => append(data, &[*outputs]),
            Self::Lcd(frame) => {
                if frame.number >= LcdFrame::FRAMES {
                    return Err(EncodeError::NotRepresentable);
                }
                append(data, &[frame.number])?;
                append(data, frame.columns)
            }
            Self::Run { scope, run } => {
                append(data, &[u8::from(*run)])?;
                match scope {
                    Scope::All => Ok(()),
                    Scope::Motor(channel) => append(data, &[channel.number()]),
                    Scope::Servo(channel) => {
                        append(data, &[channel.number().saturating_add(FIRST_SERVO)])
                    }
                }
            }
            Self::Telemetry { repeat, .. } => repeat.emit(data),
            Self::PingOrAck => append(data, &[1]),
            Self::Ping => append(data, &[0]),
            Self::Extension(request) => request.emit(data),
        }
    }
}

/// 0 or 1.
pub(super) fn flag(did: u8, byte: u8) -> Result<bool, Refusal> {
    match byte {
        0 => Ok(false),
        1 => Ok(true),
        _ => Err(Refusal::Value { did, value: byte.into() }),
    }
}
