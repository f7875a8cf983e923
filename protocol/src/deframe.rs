//! The resynchronising receiver: bytes in, whole frames out.
//!
//! Vocabulary: a *candidate* is a place in the stream that begins like a frame. Its header tells
//! how long the frame would be. Once that many bytes are there, it is either a *frame* or
//! *rejected*. After a rejection the search goes on one byte behind the candidate's first, so that
//! a good frame inside a bad one is found. Bytes that wait for a decision are *pending*.
//!
//! Promises:
//! - The frames found do not depend on how the stream was cut into chunks.
//! - Every byte is accounted for: it was part of a frame, was skipped and counted, or is pending.
//! - What follows a frame is left to the caller, unless a rejected candidate reached beyond it.
//! - A candidate is judged as a whole once. What is held moves only to make room for more.
//!
//! A candidate that noise has made (`5E 02` with a large length, say) holds up what follows until
//! its bytes are there. Only time can tell that they will not come: whoever has a clock calls
//! [`Deframer::give_up`] when the line has been silent for too long.

use core::marker::PhantomData;
use core::ops::Range;

/// What the receiver must know of a format. All that we speak begin with two fixed bytes and
/// carry their length in a header.
pub trait Framing {
    /// The two bytes that begin every frame.
    const START: [u8; 2];
    /// How many bytes, counted from the start, tell the length of the frame. At least 2.
    const HEADER: usize;
    /// The length of the whole frame in bytes, or `None` when no frame has such a header.
    /// `header` is [`Self::HEADER`] bytes long and begins with [`Self::START`].
    fn length(header: &[u8]) -> Option<usize>;
    /// Whether a candidate of the right length is a frame: checksum, end marks.
    fn is_intact(candidate: &[u8]) -> bool;
}

/// What a receiver has counted since it was made. The counters wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Reception {
    /// Intact frames, whoever they were for.
    pub frames_ok: u32,
    /// Candidates with a complete header that turned out not to be frames.
    pub bad_frames: u32,
    /// Bytes that were part of no frame.
    pub bytes_skipped: u32,
}

/// A receiver for frames of at most `N` bytes. See the [module](self) for what it promises.
pub struct Deframer<F, const N: usize> {
    buffer: [u8; N],
    /// The pending bytes are those from `front` to `end`.
    front: usize,
    end: usize,
    /// With fewer pending bytes than this there is nothing to decide.
    needed: usize,
    /// Where the frame lies that was found last.
    frame: Range<usize>,
    reception: Reception,
    framing: PhantomData<F>,
}

/// What can be said of the pending bytes.
enum Verdict {
    /// They begin with a frame of this length.
    Frame(usize),
    /// Nothing before this many bytes are there.
    Needs(usize),
    /// No frame begins with the first of them.
    Rejected,
}

impl<F: Framing, const N: usize> Deframer<F, N> {
    /// An empty receiver.
    pub const fn new() -> Self {
        const { assert!(F::HEADER >= F::START.len() && N >= F::HEADER) };
        Self {
            buffer: [0; N],
            front: 0,
            end: 0,
            needed: 1,
            frame: 0..0,
            reception: Reception { frames_ok: 0, bad_frames: 0, bytes_skipped: 0 },
            framing: PhantomData,
        }
    }

    /// The counters.
    pub fn reception(&self) -> Reception {
        self.reception
    }

    /// How many bytes wait for the rest of their frame.
    pub fn pending(&self) -> usize {
        self.end.saturating_sub(self.front)
    }

    /// Takes bytes from the front of `bytes` until a frame is complete or `bytes` is empty.
    ///
    /// Call it until it returns `None`; the frame is valid until the next call.
    pub fn receive(&mut self, bytes: &mut &[u8]) -> Option<&[u8]> {
        self.find(bytes, false)
    }

    /// Rejects every candidate that waits for more bytes: the line has been silent for so long
    /// that they will not come. Returns the good frames that they were holding up.
    ///
    /// Call it until it returns `None`; then nothing is pending.
    pub fn give_up(&mut self) -> Option<&[u8]> {
        self.find(&mut &[][..], true)
    }

    /// Rejects the candidate at the front alone, which has waited for too long on a line that is
    /// not silent, and returns the frame behind it if one is complete.
    ///
    /// More may be complete: go on with [`receive`](Self::receive).
    pub fn give_up_front(&mut self) -> Option<&[u8]> {
        self.reject();
        self.find(&mut &[][..], false)
    }

    /// The frame that the last call returned, for callers whose own borrow ended in between.
    pub fn frame(&self) -> &[u8] {
        self.buffer.get(self.frame.clone()).unwrap_or_default()
    }

    /// Looks for a frame in what is pending and in `bytes`. When these are used up, a candidate that
    /// needs more is rejected if the line is `silent`, and else waited for.
    fn find(&mut self, bytes: &mut &[u8], silent: bool) -> Option<&[u8]> {
        let chunk = *bytes;
        loop {
            self.fill(bytes);
            if self.pending() >= self.needed {
                match self.judge() {
                    Verdict::Frame(length) => {
                        self.frame = self.front..self.front.saturating_add(length);
                        self.front = self.frame.end;
                        self.needed = 1;
                        self.reception.frames_ok = self.reception.frames_ok.wrapping_add(1);
                        self.give_back(chunk, bytes);
                        return Some(self.frame());
                    }
                    Verdict::Needs(count) => self.needed = count,
                    Verdict::Rejected => self.reject(),
                }
            } else if silent && self.pending() > 0 {
                self.reject();
            } else {
                return None;
            }
        }
    }

    fn judge(&self) -> Verdict {
        let held = self.held();
        if held.iter().zip(F::START).any(|(byte, start)| *byte != start) {
            return Verdict::Rejected;
        }
        let Some(header) = held.get(..F::HEADER) else {
            let is_begun = held.len() >= F::START.len();
            return Verdict::Needs(if is_begun { F::HEADER } else { F::START.len() });
        };
        match F::length(header) {
            Some(length) if (F::HEADER..=N).contains(&length) => match held.get(..length) {
                None => Verdict::Needs(length),
                Some(candidate) if F::is_intact(candidate) => Verdict::Frame(length),
                Some(_) => Verdict::Rejected,
            },
            _ => Verdict::Rejected,
        }
    }

    /// Takes as many bytes as the buffer has room for: enough for a decision, since no frame is
    /// longer.
    fn fill(&mut self, bytes: &mut &[u8]) {
        if bytes.is_empty() {
            return;
        }
        if self.front > 0 {
            self.buffer.copy_within(self.front..self.end, 0);
            self.end = self.pending();
            self.front = 0;
        }
        let room = self.buffer.get_mut(self.end..).unwrap_or_default();
        let taken = bytes.split_off(..room.len().min(bytes.len())).unwrap_or_default();
        for (place, byte) in room.iter_mut().zip(taken) {
            *place = *byte;
        }
        self.end = self.end.saturating_add(taken.len());
    }

    /// Gives back those of the pending bytes that were taken from `chunk`, of which `bytes` is the
    /// rest.
    fn give_back<'b>(&mut self, chunk: &'b [u8], bytes: &mut &'b [u8]) {
        let taken = chunk.len().saturating_sub(bytes.len());
        let count = self.pending().min(taken);
        *bytes = chunk.get(taken.saturating_sub(count)..).unwrap_or_default();
        self.end = self.end.saturating_sub(count);
        if self.pending() == 0 {
            (self.front, self.end) = (0, 0);
        }
    }

    /// Skips the first pending byte, and what follows up to the next that could begin a frame.
    fn reject(&mut self) {
        let held = self.held();
        let is_bad_frame = held.len() >= F::HEADER && held.starts_with(&F::START);
        let next = (1..).zip(held.iter().skip(1)).find(|(_, byte)| **byte == F::START[0]);
        let skipped = next.map_or(held.len(), |(place, _)| place);
        let Reception { bad_frames, bytes_skipped, .. } = &mut self.reception;
        *bad_frames = bad_frames.wrapping_add(u32::from(is_bad_frame));
        *bytes_skipped = bytes_skipped.wrapping_add(u32::try_from(skipped).unwrap_or(u32::MAX));
        self.front = self.front.saturating_add(skipped);
        self.needed = 1;
    }

    /// The pending bytes.
    fn held(&self) -> &[u8] {
        self.buffer.get(self.front..self.end).unwrap_or_default()
    }
}

impl<F: Framing, const N: usize> Default for Deframer<F, N> {
    fn default() -> Self {
        Self::new()
    }
}
