//! What the program asks of a board, whatever its personality: [`Machine`], one file each beside
//! this one. Links, inspector and status know nothing else.

use embassy_time::Instant;
use hal_mock::wire::Line;
use serde_json::{Map, Value};

use crate::follow::Follower;

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
