//! A host at the other end of a virtual board's line, whatever the personality: it sends bytes,
//! collects what it receives, and lets virtual time pass. What a personality's host says besides
//! stands in `pms5005.rs`, `arm.rs` and `cm5.rs`.

use embassy_time::{Duration, Instant};
use hal_mock::wire::Line;
use protocol::cm5::MAX_PACKET;
use protocol::deframe::{Deframer, Framing};

/// A virtual board, and what its wire carries.
pub trait Board {
    /// What a frame of its wire looks like.
    type Framing: Framing;
    /// A frame that a host has received.
    type Received;

    /// The line to the host.
    fn line(&self) -> &Line;
    /// Runs for some time.
    fn run_for(&mut self, time: Duration);
    /// Takes a frame apart whose last stop bit came then.
    fn received(at: Instant, frame: &[u8]) -> Self::Received;
    /// Sends a command without effect, if the wire has one: a sign of life.
    fn say_alive(line: &Line);
}

/// A board and its host.
pub struct Host<B: Board> {
    /// The board.
    pub board: B,
    /// As long as the longest frame of any wire.
    receiver: Deframer<B::Framing, MAX_PACKET>,
}

impl<B: Board> Host<B> {
    /// The host of this board.
    pub fn of(board: B) -> Self {
        Self { board, receiver: Deframer::new() }
    }

    /// Sends bytes, good or bad.
    pub fn send_bytes(&mut self, bytes: &[u8]) {
        self.board.line().host_sends(bytes);
    }

    /// Lets time pass; the host is silent.
    pub fn run_ms(&mut self, ms: u64) {
        self.board.run_for(Duration::from_millis(ms));
    }

    /// The frames that have come since the last call, in order; nothing else may have come.
    pub fn received(&mut self) -> Vec<B::Received> {
        let mut frames = Vec::new();
        while let Some((at, bytes)) = self.board.line().host_receives() {
            let mut bytes = &bytes[..];
            while let Some(frame) = self.receiver.receive(&mut bytes) {
                frames.push(B::received(at, frame));
            }
        }
        let skipped = self.receiver.reception().bytes_skipped;
        assert_eq!((self.receiver.pending(), skipped), (0, 0), "whole frames, all intact");
        frames
    }
}
