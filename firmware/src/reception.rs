//! What everyone who listens to a line shares, above all a receiver that knows the time: it gives up
//! on frames whose rest does not come.
//!
//! Noise that looks like the beginning of a frame holds up the good frames behind it until its
//! bytes are there. They are given [`LONGEST_PAUSE`] between two arrivals and [`LONGEST_FRAME`] in
//! all. After a pause everything held is searched for frames; on a line that is busy only the
//! candidate that had its time is rejected.

use embassy_time::{Duration, Instant};
use protocol::deframe::{Deframer, Framing, Reception};

/// Bytes taken from the line at once. 64 bytes take 5.6 ms at 115200 baud.
pub(crate) const CHUNK: usize = 64;
/// How long a line that failed is left alone.
pub(crate) const LINE_DOWN: Duration = Duration::from_millis(1);
/// How long a frame's bytes may pause.
pub(crate) const LONGEST_PAUSE: Duration = Duration::from_millis(100);
/// How long a frame may take in all. The longest of the PMS5005, 264 bytes, takes 23 ms at 115200
/// baud and 275 ms at 9600.
const LONGEST_FRAME: Duration = Duration::from_millis(500);

/// A [`Deframer`] for frames of at most `N` bytes that gives up in time.
pub(crate) struct TimedReceiver<F, const N: usize> {
    deframer: Deframer<F, N>,
    /// When the pending candidate's first byte came, and when its last.
    candidate: Option<(Instant, Instant)>,
}

impl<F: Framing, const N: usize> TimedReceiver<F, N> {
    /// An empty receiver.
    pub const fn new() -> Self {
        Self { deframer: Deframer::new(), candidate: None }
    }

    /// The counters.
    pub fn reception(&self) -> Reception {
        self.deframer.reception()
    }

    /// When bytes that are pending by now will have paused or lasted too long.
    pub fn gives_up_at(&self) -> Option<Instant> {
        self.candidate.map(|(first, last)| {
            last.saturating_add(LONGEST_PAUSE).min(first.saturating_add(LONGEST_FRAME))
        })
    }

    /// Takes bytes from the front of `bytes` until a frame is complete; when none are left, gives
    /// up on what has had its time.
    ///
    /// Call it until it returns `None`; the frame is valid until the next call.
    pub fn receive(&mut self, bytes: &mut &[u8], now: Instant) -> Option<&[u8]> {
        self.find(bytes, now).then(|| self.deframer.frame())
    }

    /// Whether there is a frame.
    fn find(&mut self, bytes: &mut &[u8], now: Instant) -> bool {
        let anything_new = !bytes.is_empty();
        let skipped = self.reception().bytes_skipped;
        if self.deframer.receive(bytes).is_some() {
            // Without anything new, what was given up on goes on being searched: its times stand.
            if anything_new {
                self.candidate = None;
            }
            return true;
        }
        // After a skip, what is pending is another candidate than before.
        let same = self.reception().bytes_skipped == skipped;
        let (mut first, last) = match self.candidate {
            Some(times) if !anything_new => times,
            Some((first, _)) if same => (first, now),
            _ => (now, now),
        };
        let found = if now >= last.saturating_add(LONGEST_PAUSE) {
            self.deframer.give_up().is_some()
        } else if now >= first.saturating_add(LONGEST_FRAME) {
            first = now; // what is pending now has its own time
            self.deframer.give_up_front().is_some()
        } else {
            false
        };
        self.candidate = (self.deframer.pending() > 0).then_some((first, last));
        found
    }
}

/// Counters wrap.
pub(crate) fn count(counter: &mut u32, more: u32) {
    *counter = counter.wrapping_add(more);
}
