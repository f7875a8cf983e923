//! ARCOS packets, as far as the Pioneer Arm needs them.
//!
//! - [`Receiver`] finds packets in a stream, [`Packet`] takes one apart and puts one together,
//!   [`Argument`] is what a host's command carries;
//! - [`SYNC`], [`Names`] and [`Standard`] are the session;
//! - [`ArmCommand`] is what a host asks of the arm, [`ArmStatus`] and [`ArmInfo`] are what the arm
//!   tells;
//! - [`extension`] is what the original never had: settings, health, faults.
//!
//! # Where the documents are silent or contradict each other, and what we do
//! | question | what this implementation does |
//! |---|---|
//! | ARMINFOpac's count, n+53 in Table 3 | n+39: six joints of six bytes end there, and hosts parse in order. |
//! | ARMpac's status bytes | The manual and one host family have power and connection first, ARIA has motion first: a [`Dialect`]. |
//! | ARIA's "good" | The arm is connected and no fault keeps its servos off. |
//! | motion bit of joint 1 | Bit 1; in the manual's dialect bit 0 can be chosen ([`MotionBits`]). |
//! | a type byte with no value behind it | No argument. |
//! | an unknown type, a value cut short, bytes behind it | Refused where the command takes an argument. |
//! | an argument that a command does not take | Not looked at. |
//! | a negative integer or a text for an arm command that takes a number | Refused. |
//! | HOME with a number above 6 | All joints (7 and 255 are in use); 0 is refused. |
//! | STOP with 7 to 254 | Refused: only 255 is all joints. |
//! | what 2 s without a packet end | The motion of the joints, which hold. The session and the standard packets go on: a host may send nothing for minutes and wait for the next one. |
//! | a 0 after these 2 s, PULSE or SYNC0 | Echoed, and the session goes on; only a SYNC1 behind it begins a new one. |

mod arm;
pub mod extension;
mod packet;
mod report;
mod session;

pub use crate::data::EncodeError;
pub use arm::{ArmCommand, JOINTS, JointNumber, Joints, Refusal, StatusRequest};
pub use packet::{
    Arcos, Argument, BadArgument, MAX_DATA, MAX_RECEIVED, MAX_SENT, OVERHEAD, Packet, Receiver,
    START, encode_command,
};
pub use report::{ArmInfo, ArmStatus, Dialect, JointInfo, MotionBits};
pub use session::{Names, SYNC, Standard};

/// Numbers of commands (facts, "Session" and "Commands"). Before a session 0, 1 and 2 are SYNC0,
/// SYNC1 and SYNC2.
pub mod command {
    /// Nothing but a sign of life.
    pub const PULSE: u8 = 0;
    /// Opens the session: with the integer 1, or with no argument.
    pub const OPEN: u8 = 1;
    /// Ends the session.
    pub const CLOSE: u8 = 2;
    /// Ask for ARMINFOpac.
    pub const INFO: u8 = 70;
    /// Ask for ARMpac.
    pub const STATUS: u8 = 71;
    /// Warm reset.
    pub const INIT: u8 = 72;
    /// Probe the arm.
    pub const CHECK: u8 = 73;
    /// Servo power.
    pub const POWER: u8 = 74;
    /// Joints to their home positions.
    pub const HOME: u8 = 75;
    /// All joints home, then power off.
    pub const PARK: u8 = 76;
    /// A joint to a position.
    pub const POS: u8 = 77;
    /// A joint's speed.
    pub const SPEED: u8 = 78;
    /// Joints stop where they are.
    pub const STOP: u8 = 79;
    /// Idle time until PARK.
    pub const AUTOPARK: u8 = 80;
    /// Time until a closed gripper goes home.
    pub const GRIPPARK: u8 = 81;
}
