//! Follows the frames in what one client sends, so that those of several do not mix on the line, and
//! says in the log what is wrong with what is none.
//!
//! The board itself sees the line, and counts; here are the bytes.

use std::fmt::Write;
use std::ops::Range;

use protocol::deframe::{Deframer, Framing};

/// Bytes of a frame that are shown.
const SHOWN: usize = 48;

/// Tells frames apart, whatever they look like.
pub trait Follower {
    /// Takes what a client has sent, and answers what can go onto the line: all but the beginning of
    /// a frame whose rest has not come.
    fn follow(&mut self, bytes: &[u8]) -> Vec<u8>;

    /// Whether there is such a beginning.
    fn is_waiting(&self) -> bool;

    /// Waits no longer for the rest, and answers the beginning.
    fn give_up(&mut self) -> Vec<u8>;

    /// The frames of a fresh stream, if it holds one at least and nothing else.
    fn whole(&mut self, bytes: &[u8]) -> Option<Vec<Vec<u8>>>;
}

/// What is to be known of a format beyond its framing.
#[derive(Clone, Copy)]
pub struct Format {
    /// The same frame as it should end; `None` if it cannot be told.
    pub sealed: fn(&[u8]) -> Option<Vec<u8>>,
    /// Where the checksum is, counted from the frame's end: its first byte and behind its last.
    pub checksum: (usize, usize),
    /// What is worth a warning though the frame is intact.
    pub remark: fn(&[u8]) -> Option<String>,
}

/// A client's frames of one format.
pub struct Frames<F, const N: usize> {
    deframer: Deframer<F, N>,
    format: Format,
    /// What has not been passed on.
    held: Vec<u8>,
}

impl<F: Framing, const N: usize> Frames<F, N> {
    pub fn new(format: Format) -> Self {
        Self { deframer: Deframer::new(), format, held: Vec::new() }
    }

    /// Hands over what has come since the last time, frame by frame.
    fn take(&mut self, mut bytes: &[u8], mut frame_is: impl FnMut(&[u8])) {
        let skipped = self.deframer.reception().bytes_skipped;
        self.held.extend(bytes);
        while let Some(frame) = self.deframer.receive(&mut bytes) {
            if let Some(remark) = (self.format.remark)(frame) {
                log::warn!("{remark}: {}", hex(frame));
            }
            frame_is(frame);
        }
        if self.deframer.reception().bytes_skipped != skipped {
            self.complain();
        }
    }

    /// Says what is wrong with what was skipped.
    fn complain(&self) {
        let end = self.held.len().saturating_sub(self.deframer.pending());
        let (mut at, mut stray) = (0, 0..0);
        while at < end {
            let rest = &self.held[at..];
            let header = rest.get(..F::HEADER).filter(|header| header.starts_with(&F::START));
            let length =
                header.and_then(F::length).filter(|&length| (F::HEADER..=N).contains(&length));
            let Some(frame) = length.and_then(|length| rest.get(..length)) else {
                at += 1;
                stray.end = at;
                continue;
            };
            self.complain_of_stray(stray);
            if !F::is_intact(frame) {
                log::warn!("{}", self.complaint(frame));
            }
            at += frame.len();
            stray = at..at;
        }
        self.complain_of_stray(stray);
    }

    fn complain_of_stray(&self, place: Range<usize>) {
        if !place.is_empty() {
            log::warn!("no frame: {}", hex(&self.held[place]));
        }
    }

    fn complaint(&self, frame: &[u8]) -> String {
        let (first, end) = self.format.checksum;
        let checksum = |frame: &[u8]| hex(&frame[frame.len() - first..frame.len() - end]);
        let is_as_long = |sealed: &Vec<u8>| sealed.len() == frame.len() && first <= frame.len();
        match (self.format.sealed)(frame).filter(is_as_long) {
            Some(sealed) if checksum(&sealed) != checksum(frame) => format!(
                "bad checksum: {} came, {} is right, in {}",
                checksum(frame),
                checksum(&sealed),
                hex(frame)
            ),
            _ => format!("no frame, though it begins like one: {}", hex(frame)),
        }
    }
}

impl<F: Framing, const N: usize> Follower for Frames<F, N> {
    fn follow(&mut self, bytes: &[u8]) -> Vec<u8> {
        self.take(bytes, |_| ());
        let complete = self.held.len().saturating_sub(self.deframer.pending());
        self.held.drain(..complete).collect()
    }

    fn is_waiting(&self) -> bool {
        !self.held.is_empty()
    }

    fn give_up(&mut self) -> Vec<u8> {
        log::warn!("the rest of a frame does not come: {}", hex(&self.held));
        self.deframer = Deframer::new();
        std::mem::take(&mut self.held)
    }

    fn whole(&mut self, bytes: &[u8]) -> Option<Vec<Vec<u8>>> {
        let mut frames = Vec::new();
        self.take(bytes, |frame| frames.push(frame.to_vec()));
        let is_whole = self.deframer.pending() == 0 && self.deframer.reception().bytes_skipped == 0;
        (is_whole && !frames.is_empty()).then_some(frames)
    }
}

/// Bytes for a person.
fn hex(bytes: &[u8]) -> String {
    let mut text = String::new();
    for byte in bytes.iter().take(SHOWN) {
        let space = if text.is_empty() { "" } else { " " };
        let _ = write!(text, "{space}{byte:02x}");
    }
    if bytes.len() > SHOWN {
        let _ = write!(text, " ... ({} bytes)", bytes.len());
    }
    text
}
