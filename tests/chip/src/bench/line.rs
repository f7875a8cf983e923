//! The host's end of its line: what it sends, when, and what it has heard.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

use rigless::chip::{Timeline, uart::Peer};
use rigless::snapshot::Store;
use rigless::time::VirtualNanos;

/// A byte and when it was on the wire, in ns: the end of its stop bit, of one that is sent the beginning of
/// its start bit.
pub type Timed = (u64, u8);

#[derive(Debug, Default)]
struct Wire {
    out: VecDeque<Timed>,
    heard: Vec<Timed>,
    left: Vec<Timed>,
}

/// The line. Handles are to the same one.
#[derive(Clone, Debug, Default)]
pub struct Line(Arc<Mutex<Wire>>);

impl Line {
    /// Sends bytes one behind the other, not before `at`.
    pub fn send_at(&self, at_ns: u64, bytes: &[u8]) {
        self.0.lock().unwrap().out.extend(bytes.iter().map(|&byte| (at_ns, byte)));
    }

    /// Sends bytes as soon as the line is free.
    pub fn send(&self, bytes: &[u8]) {
        self.send_at(0, bytes);
    }

    /// Whether all that was to be sent has begun to leave.
    pub fn is_idle(&self) -> bool {
        self.0.lock().unwrap().out.is_empty()
    }

    /// Bytes that have not begun to leave.
    pub fn pending(&self) -> usize {
        self.0.lock().unwrap().out.len()
    }

    /// What has left since the last call, and when each byte's start bit did.
    pub fn left(&self) -> Vec<Timed> {
        std::mem::take(&mut self.0.lock().unwrap().left)
    }

    /// What was heard since the last call.
    pub fn heard(&self) -> Vec<Timed> {
        std::mem::take(&mut self.0.lock().unwrap().heard)
    }
}

impl Store for Line {}

impl Peer for Line {
    fn receive(&mut self, word: u16, context: &mut Timeline<'_, '_>) {
        self.0.lock().unwrap().heard.push((context.now().0, word as u8)); // 8 data bits
    }

    fn transmit(&mut self, now: VirtualNanos) -> Option<u16> {
        let mut wire = self.0.lock().unwrap();
        wire.out.pop_front_if(|&mut (at, _)| at <= now.0).map(|(_, byte)| {
            wire.left.push((now.0, byte));
            byte.into()
        })
    }
}
