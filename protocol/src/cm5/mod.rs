//! The link between a PC and a CM-5 that bridges it to a bus of AX-12 servos: **our
//! reconstruction**.
//!
//! One page tells of this protocol ("Communication protocol between PC and CM5"); the figure that
//! showed the packet is lost. The bytes, and
//! [what its page proves and what we chose](crate#what-its-page-proves-and-what-we-chose), stand on the
//! [page of the wire](crate#the-cm-5).
//!
//! Nothing in a packet says which of the four it is: its direction, its length, and the number of
//! servos agreed on do. So whoever reads one tells how many servos there are.
//!
//! Next to nothing can be read as goals and as an answer, since goals have slopes, which are mostly
//! 32, where an answer has the high byte of a limit, which is at most 3.
//!
//! The 5-byte answer is never ambiguous. But since it is good for any number of servos, a late one
//! counts as the answer to the newest hello, also if it was meant for one with fewer servos.
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
