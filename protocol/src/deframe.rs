//! The resynchronising receiver: bytes in, whole frames out.
//!
//! Vocabulary: a *candidate* is a place in the stream that begins like a frame. Its header tells
//! how long the frame would be. Once that many bytes are there, it is either a *frame* or
//! *rejected*. After a rejection the search goes on at the candidate's second byte, so that a good
//! frame inside a bad one is found. Bytes that wait for a decision are *pending*.
//!
//! Promises:
//! - The frames found do not depend on how the stream was cut into chunks.
//! - Every byte taken is accounted for: it was part of a frame, was skipped and counted, or is pending.
//! - Bytes behind a frame are not taken: they stay in the caller's slice. The exception are those that
//!   a candidate rejected earlier had taken already.
//! - A candidate's checksum is computed once, when the candidate is complete.
//!
//! A candidate that noise has made (the two start bytes by chance, and a large length) holds up what follows until
//! its bytes are there. Only time can tell that they will not come: whoever has a clock calls
//! [`Deframer::give_up`] when the line has been silent for too long.

use core::marker::PhantomData;

/// What the receiver must know of a format. All formats here begin with two fixed bytes and
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
    /// Candidates rejected after their header was complete: an impossible length, a bad checksum, or
    /// given up.
    pub bad_frames: u32,
    /// Bytes that were part of no frame.
    pub bytes_skipped: u32,
}

/// A receiver for frames of at most `N` bytes; a header that announces more is rejected. See the [module](self) for what it promises.
pub struct Deframer<F, const N: usize> {
    /// What is held stands at the front: the frame that was returned last, if any, and the pending
    /// bytes.
    buffer: [u8; N],
    held: usize,
    /// Length of the frame that was returned last; 0 when there is none.
    returned: usize,
    /// Length of the candidate at the front; 0 until its header is there and makes sense.
    length: usize,
    reception: Reception,
    framing: PhantomData<F>,
}

impl<F: Framing, const N: usize> Deframer<F, N> {
    /// An empty receiver.
    pub const fn new() -> Self {
        const { assert!(F::HEADER >= F::START.len() && N >= F::HEADER) };
        Self {
            buffer: [0; N],
            held: 0,
            returned: 0,
            length: 0,
            reception: Reception { frames_ok: 0, bad_frames: 0, bytes_skipped: 0 },
            framing: PhantomData,
        }
    }

    /// The counters.
    pub fn reception(&self) -> Reception {
        self.reception
    }

    /// How many bytes are pending.
    pub fn pending(&self) -> usize {
        self.held.saturating_sub(self.returned)
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
    /// Only after [`receive`](Self::receive) has returned `None`: what it has not looked at yet would be
    /// rejected too. More may be complete then: go on with `receive`.
    pub fn give_up_front(&mut self) -> Option<&[u8]> {
        self.release();
        self.reject();
        self.find(&mut &[][..], false)
    }

    /// The frame that the last call returned, again, for callers that could not keep the borrow; empty
    /// if it returned `None`.
    pub fn frame(&self) -> &[u8] {
        self.buffer.get(..self.returned).unwrap_or_default()
    }

    /// Takes as many bytes as the next decision needs, and decides, until a frame is complete or
    /// `bytes` are used up. Then a candidate that needs more is rejected if the line is `silent`, and
    /// else waited for.
    fn find(&mut self, bytes: &mut &[u8], silent: bool) -> Option<&[u8]> {
        self.release();
        loop {
            let needed = if self.length > 0 { self.length } else { F::HEADER };
            self.take(bytes, needed);
            let Some(front) = self.buffer.get(..self.held).and_then(|held| held.get(..needed))
            else {
                let may_become_a_frame = self.length > 0 || self.begins_like_a_frame();
                if self.held == 0 || (may_become_a_frame && !silent) {
                    return None;
                }
                self.reject();
                continue;
            };
            if self.length == 0 {
                match F::length(front).filter(|_| front.starts_with(&F::START)) {
                    Some(length) if (F::HEADER..=N).contains(&length) => self.length = length,
                    _ => self.reject(),
                }
            } else if F::is_intact(front) {
                self.reception.frames_ok = self.reception.frames_ok.wrapping_add(1);
                (self.returned, self.length) = (needed, 0);
                return Some(self.frame());
            } else {
                self.reject();
            }
        }
    }

    /// Takes bytes from the front of `bytes` until `needed` are held or there are no more.
    fn take(&mut self, bytes: &mut &[u8], needed: usize) {
        let missing = needed.saturating_sub(self.held).min(bytes.len());
        let taken = bytes.split_off(..missing).unwrap_or_default();
        let room = self.buffer.get_mut(self.held..).unwrap_or_default();
        for (place, byte) in room.iter_mut().zip(taken) {
            *place = *byte;
        }
        self.held = self.held.saturating_add(missing);
    }

    /// Whether what is held, were it a single byte, agrees with [`Framing::START`].
    fn begins_like_a_frame(&self) -> bool {
        self.buffer.iter().take(self.held).zip(F::START).all(|(byte, start)| *byte == start)
    }

    /// Skips the first pending byte, and what follows up to the next that could begin a frame.
    fn reject(&mut self) {
        let held = self.buffer.get(..self.held).unwrap_or_default();
        let is_bad_frame = held.len() >= F::HEADER && held.starts_with(&F::START);
        let next = (1..).zip(held.iter().skip(1)).find(|(_, byte)| **byte == F::START[0]);
        let skipped = next.map_or(held.len(), |(place, _)| place);
        let Reception { bad_frames, bytes_skipped, .. } = &mut self.reception;
        *bad_frames = bad_frames.wrapping_add(u32::from(is_bad_frame));
        *bytes_skipped = bytes_skipped.wrapping_add(u32::try_from(skipped).unwrap_or(u32::MAX));
        self.drop_front(skipped);
        self.length = 0;
    }

    /// Lets go of the frame that was returned.
    fn release(&mut self) {
        if self.returned > 0 {
            self.drop_front(self.returned);
            self.returned = 0;
        }
    }

    /// Drops the first `count` of the bytes held.
    fn drop_front(&mut self, count: usize) {
        if let Some(held) = self.buffer.get_mut(..self.held)
            && count < held.len()
        {
            held.copy_within(count.., 0);
        }
        self.held = self.held.saturating_sub(count);
    }
}

impl<F: Framing, const N: usize> Default for Deframer<F, N> {
    fn default() -> Self {
        Self::new()
    }
}
