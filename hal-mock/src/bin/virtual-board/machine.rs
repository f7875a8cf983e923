//! What the program asks of a board, whatever its personality: [`Machine`], one file each beside
//! this one. Links, inspector and status know nothing else.

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

    /// Something that tells the frames of one client on that line apart.
    fn follower(&self) -> Box<dyn Follower>;

    /// Runs until `time`.
    fn run_until(&mut self, time: Instant);

    /// How it is, in a line that stays the same for as long as nothing happens.
    fn status(&self) -> String;

    /// What is wrong with it, by name.
    fn faults(&self) -> Vec<String>;

    /// The simulated truth.
    fn state(&self) -> Value;

    /// What can be [`set`](Self::set).
    fn settable(&self) -> &'static [&'static str];

    /// What of it is not as the simulation would have it, as it would be set.
    fn overridden(&self) -> Map<String, Value>;

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

    /// The frames of a fresh stream, if it holds one at least and nothing else.
    fn whole(&mut self, bytes: &[u8]) -> Option<Vec<Vec<u8>>>;
}

impl<F: Framing, const N: usize> Follower for Deframer<F, N> {
    fn follow(&mut self, mut bytes: &[u8]) -> usize {
        while self.receive(&mut bytes).is_some() {}
        self.pending()
    }

    fn forget(&mut self) {
        *self = Self::new();
    }

    fn whole(&mut self, mut bytes: &[u8]) -> Option<Vec<Vec<u8>>> {
        self.forget();
        let mut frames = Vec::new();
        while let Some(frame) = self.receive(&mut bytes) {
            frames.push(frame.to_vec());
        }
        let is_whole = self.pending() == 0 && self.reception().bytes_skipped == 0;
        (is_whole && !frames.is_empty()).then_some(frames)
    }
}
