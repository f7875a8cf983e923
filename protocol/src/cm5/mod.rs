//! The link between a PC and a CM-5 that bridges it to a bus of AX-12 servos: **our
//! reconstruction**.
//!
//! One page tells of this protocol ("Communication protocol between PC and CM5"); the figure that
//! showed the packet is lost. What the page proves and what we had to choose:
//!
//! | item | evidence | our choice |
//! |---|---|---|
//! | packet | fields LenH, LenL, Param1..N, Checksum; Len is the number of parameters; Checksum is the low byte of NOT(LenH + LenL + Param1 + ... + ParamN) | `FF FF` in front, as on the servo bus |
//! | byte order | LenH, then LenL | registers are little-endian, as in the servo |
//! | hello, CM-5 to PC | the number of servos and the list of their IDs, once a second until answered | count, then the IDs in rising order; after the first answer again when the table of servos has changed, and between reports every 10 s while the PC is silent |
//! | answer, PC to CM-5 | the return delay and the limits of the servos' positions | return delay, then CW and CCW limit (2 + 2 bytes) of each servo in the hello's order; or 5 bytes, return delay and one pair for all |
//! | goals, PC to CM-5 | torque enable, LED, margins, slopes, goal position, moving speed, torque limit, lock, punch of each servo | 15 bytes a servo in this order, CW before CCW: the registers 24 to 35 and 47 to 49 |
//! | report, CM-5 to PC | present position, speed, load, voltage, temperature of each servo, by reading 8 bytes | the registers 36 to 43 as they are; a servo that did not answer has 8 x `FF`; the first report when every servo has been read, whether the PC speaks or not |
//!
//! Nothing in a packet says which of the four it is: its direction, its length, and the number of
//! servos agreed on do. So whoever reads one tells how many servos there are. Two lengths can
//! coincide while a list that has grown is being agreed on again:
//! - a hello of 8n - 1 servos is as long as a report of n;
//! - an answer for m servos is as long as goals for n if 4m + 1 = 15n (11 and 3 at the least). Next
//!   to nothing is both, since goals have slopes, which are mostly 32, where an answer has the high
//!   byte of a limit, which is at most 3. What is both is an answer while a
//!   hello has not been answered.
//!
//! The 5-byte answer is never ambiguous. But since it is good for any number of servos, a late one
//! counts as the answer to the newest hello, also if it was meant for one with fewer servos.
//!
//! The checksum has a hole: when noise makes Len greater by one or two, the `FF` or `FF FF` that
//! begins the next packet completes a sum that is right. What came of it has a length that fits
//! nothing, and is refused; the next packet is lost unless there was silence before it.
//!
//! [`Receiver`] finds packets, [`params_of`] takes one apart; what they say is in [`Hello`],
//! [`HelloAnswer`], [`Goals`] and [`Report`].

mod message;
mod packet;

pub use crate::dynamixel::EncodeError;
pub use message::{Feedback, Goals, Hello, HelloAnswer, Limits, Refusal, Report, ServoGoal};
pub use packet::{Cm5, MAX_PACKET, OVERHEAD, Receiver, encode, params_of};

/// The most servos that a packet is made for. Their goals are 1505 bytes: 15 ms at 1 Mbaud and
/// 0.26 s at 57,600 baud, so that even then a PC is heard several times in the second after which
/// a bridge takes it for dead.
pub const MAX_SERVOS: usize = 100;
