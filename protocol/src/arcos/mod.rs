//! ARCOS packets, as far as the Pioneer Arm needs them.
//!
//! - [`Receiver`] finds packets in a stream, [`Packet`] takes one apart and puts one together,
//!   [`Argument`] is what a host's command carries;
//! - [`SYNC`], [`Names`], [`command`] and [`Standard`] are the session;
//! - [`ArmCommand`] is what a host asks of the arm, [`ArmStatus`] and [`ArmInfo`] are what the arm
//!   tells.
//!
//! # Where the documents are silent or contradict each other, and what we do
//! | question | what this implementation does |
//! |---|---|
//! | ARMINFOpac's count, n+53 in Table 3 | n+39: six joints of six bytes end there, and hosts parse in order. |
//! | ARMpac's status bytes | The manual and one host family have power and connection first, ARIA has motion first: a [`Dialect`]. |
//! | motion bit of joint 1 | Bit 1; in the manual's dialect bit 0 can be chosen ([`MotionBits`]). |
//! | a type byte with no value behind it | No argument. |
//! | an unknown type, a value cut short, bytes behind it | Refused where the command takes an argument. |
//! | an argument that a command does not take | Not looked at. |
//! | a negative integer or a text for an arm command that takes a number | Refused. |
//! | HOME with a number above 6 | All joints (7 and 255 are in use); 0 is refused. |
//! | STOP with 7 to 254 | Refused: only 255 is all joints. |

mod arm;
mod packet;
mod report;
mod session;

pub use arm::{ArmCommand, JOINTS, Joint, Joints, Refusal, StatusRequest, number};
pub use packet::{
    Arcos, Argument, BadArgument, EncodeError, MAX_DATA, MAX_RECEIVED, MAX_SENT, OVERHEAD, Packet,
    Receiver, START, encode_command,
};
pub use report::{ArmInfo, ArmStatus, Dialect, JointInfo, MotionBits};
pub use session::{Names, SYNC, Standard, command};
