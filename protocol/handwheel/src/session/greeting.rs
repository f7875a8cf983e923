//! What is said to a line on which nobody has spoken yet, and when: nothing that moves something or keeps it
//! running.

use std::time::Duration;

use protocol::arcos::SYNC;
use protocol::extension::Request;
use protocol::pms5005::{Command, MAX_FRAME};

/// A board says something at least once a second, and a CM-5's hello comes once a second.
pub const HEAR: Duration = Duration::from_millis(2500);
/// When a board that is silent is first spoken to, and how often.
const SPEAK: Duration = Duration::from_millis(300);

/// A UDP peer says nothing before it is spoken to, nor does a robot that waits for SYNC0.
pub struct Greeting {
    is_udp: bool,
    due: Duration,
    is_sync: bool,
}

impl Greeting {
    /// For a link that was opened at `now`.
    pub fn new(is_udp: bool, now: Duration) -> Self {
        Self { is_udp, due: if is_udp { now } else { now + SPEAK }, is_sync: false }
    }

    /// What is to be said now, if anything.
    pub fn say(&mut self, now: Duration) -> Option<Vec<u8>> {
        if now < self.due {
            return None;
        }
        self.due = now + SPEAK;
        let mut buffer = [0; MAX_FRAME];
        let said = if self.is_sync {
            SYNC[0].encode(&mut buffer)
        } else {
            Command::Extension(Request::Identity).encode(0, &mut buffer)
        };
        self.is_sync = !self.is_sync && !self.is_udp;
        said.ok().map(|frame| frame.to_vec())
    }
}
