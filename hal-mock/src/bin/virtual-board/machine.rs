//! What the program asks of a board beyond what every [`Machine`] is: how its line is served.

use hal_mock::machine::Machine;

use crate::follow::Follower;

/// A board that is served.
pub trait Served: Machine {
    /// Bytes that may wait in a TCP client's socket for it to read them. What finds no room is left
    /// out, in whole frames. 16 KiB lose nothing of a full line to a client that reads ten times a
    /// second.
    fn send_buffer(&self) -> usize {
        16 << 10
    }

    /// Something that tells the frames of one client on that line apart.
    fn follower(&self) -> Box<dyn Follower>;
}
