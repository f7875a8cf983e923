//! Dynamixel protocol 1.0 and the AX-12: the bus that the CM-5 is the master of.
//!
//! - [`Packet`] is what travels, `FF FF ID LEN CODE P... CHK`; [`InstructionReceiver`] and
//!   [`StatusReceiver`] find it in a stream;
//! - [`Instruction`] is what a master asks for; [`SyncWriter`] streams a SYNC_WRITE into a buffer;
//! - [`Errors`] are what a servo answers with: its packet's CODE; what was read is its parameters;
//! - [`Register`] is the AX-12's control table.
//!
//! A *master* asks, *servos* answer, one at a time: the line is one wire, so a master hears its own
//! instructions too, and instructions and answers look alike. Words are little-endian.
//!
//! Source: the AX-12 manual (Robotis, 2006); where it is silent the text says so.

mod errors;
mod instruction;
mod packet;
mod register;

pub use crate::data::EncodeError;
pub use errors::Errors;
pub use instruction::{Instruction, SyncWrite, SyncWriter};
pub use packet::{
    Dynamixel, Id, InstructionReceiver, MAX_PACKET, MAX_PARAMS, MAX_STATUS, OVERHEAD, Packet,
    StatusReceiver,
};
pub(crate) use packet::{Writer, sums_up};
pub use register::{Access, REGISTER_BYTES, Register};
