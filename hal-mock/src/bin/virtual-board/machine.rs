//! What the program asks of a board, whatever its personality: [`Machine`], one file each beside
//! this one. Links, inspector and display know nothing else.

use embassy_time::Instant;
use hal_mock::wire::Line;
use protocol::deframe::{Deframer, Framing};
use serde_json::{Map, Value};

/// A simulated board on virtual time, with a line to its host.
pub trait Machine {
    /// What it is, for the user.
    fn name(&self) -> &'static str;

    /// The line to its host.
    fn line(&self) -> &Line;

    /// Bytes that may wait in a TCP client's socket for it to read them. What finds no room is left
    /// out, in whole frames. 16 KiB lose nothing of a full line to a client that reads ten times a
    /// second.
    fn send_buffer(&self) -> usize {
        16 << 10
    }

    /// Something that tells the frames of one client on that line apart.
    fn follower(&self) -> Box<dyn Follower>;

    /// Runs until `time`.
    fn run_until(&mut self, time: Instant);

    /// How it is, in a line.
    fn status(&self) -> String;

    /// How it is, in some lines for a terminal.
    fn panel(&self) -> String;

    /// The simulated truth.
    fn state(&self) -> Value;

    /// Changes the simulated world; an error names the key, and nothing is changed.
    fn set(&mut self, changes: &Map<String, Value>) -> Result<(), String>;
}

/// Tells frames apart, so that those of several clients do not mix on the line.
pub trait Follower {
    /// Takes what a client has sent; how many bytes at the end belong to a frame whose rest has
    /// not come yet.
    fn follow(&mut self, bytes: &[u8]) -> usize;

    /// Forgets the frame whose rest has not come.
    fn forget(&mut self);
}

impl<F: Framing, const N: usize> Follower for Deframer<F, N> {
    fn follow(&mut self, mut bytes: &[u8]) -> usize {
        while self.receive(&mut bytes).is_some() {}
        self.pending()
    }

    fn forget(&mut self) {
        *self = Self::new();
    }
}
