//! ARCOS packets, as far as the Pioneer Arm needs them.
//!
//! - [`Receiver`] finds packets in a stream, [`Packet`] takes one apart and puts one together,
//!   [`Argument`] is what a host's command carries;
//! - [`SYNC`], [`Names`] and [`Standard`] are the session;
//! - [`ArmCommand`] is what a host asks of the arm, [`ArmStatus`] and [`ArmInfo`] are what the arm
//!   tells;
//! - [`extension`] is what the original never had: settings, health, faults.
//!
//! Bytes, commands and examples stand on the [page of the wire](crate#arcos-and-the-pioneer-arm), and so
//! does [what its documents prove and what we chose](crate#what-its-documents-prove-and-what-we-chose).

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
