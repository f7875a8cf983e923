//! The resynchronising receiver: bytes in, whole frames out.
//!
//! Vocabulary: a *candidate* is a place in the stream that begins like a frame. Its header tells
//! how long the frame would be; once that many bytes are there the framing judges it, and it is
//! either a *frame* or *rejected*. After a rejection the receiver goes on one byte behind the
//! candidate's first, inside the bytes it already holds, so that a good frame which began within
//! a bad one is found.
//!
//! Promises:
//! - The frames found do not depend on how the stream was cut into chunks.
//! - Every byte is accounted for: it was part of a frame, was skipped and counted, or is pending.
//! - Work is done on slices: a byte is copied once, and judged with its whole frame.
//!
//! A candidate that noise has made (`5E 02` with a large length, say) holds up what follows until
//! its bytes are there. Only time can tell that they will not come: whoever has a clock calls
//! [`Deframer::give_up`] when the line has been silent too long.

use core::cell::Cell;
use core::marker::PhantomData;

/// What the receiver must know of a format. All that we speak begin with two fixed bytes and
/// carry their length in a header.
pub trait Framing {
    /// The two bytes that begin every frame.
    const START: [u8; 2];
    /// How many bytes, counted from the start, tell the length of the frame. At least 2.
    const HEADER: usize;
    /// The length of the whole frame in bytes, or `None` when no frame has such a header.
    /// `header` is at least [`Self::HEADER`] bytes long and begins with [`Self::START`].
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
    /// Bytes held, from the front of the buffer.
    held: usize,
    /// No decision is possible before this many bytes are held.
    needed: usize,
    /// Length of the frame last handed out; it leaves the buffer at the next call.
    handed_out: usize,
    reception: Reception,
    framing: PhantomData<F>,
}

/// What can be said of bytes from the first one on.
enum Verdict {
    /// They are a frame of this length.
    Frame(usize),
    /// Nothing before this many bytes are there.
    Needs(usize),
    /// Not the beginning of a frame: noise.
    Noise,
    /// A complete header, but not a frame.
    Rejected,
}

impl<F: Framing, const N: usize> Deframer<F, N> {
    /// An empty receiver.
    pub const fn new() -> Self {
        const { assert!(F::HEADER >= F::START.len() && N >= F::HEADER) };
        Self {
            buffer: [0; N],
            held: 0,
            needed: 2,
            handed_out: 0,
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
        self.held.saturating_sub(self.handed_out)
    }

    /// The frame that was handed out last, until the next call that receives or gives up.
    pub fn frame(&self) -> Option<&[u8]> {
        self.buffer.get(..self.handed_out).filter(|frame| !frame.is_empty())
    }

    /// Takes bytes from the front of `bytes` until a frame is complete or `bytes` is empty.
    ///
    /// Call it until it answers `None`; the frame handed out is valid until the next call.
    #[inline]
    pub fn receive(&mut self, bytes: &mut &[u8]) -> Option<&[u8]> {
        self.release();
        while !bytes.is_empty() || self.held >= self.needed {
            let found = if self.held == 0 {
                self.search(bytes)
            } else {
                self.take(bytes);
                if self.held < self.needed { None } else { self.decide(false) }
            };
            if let Some(length) = found {
                return self.hand_out(length);
            }
        }
        None
    }

    /// Gives up waiting for the rest of the candidate at the front: the line has been silent for
    /// so long that it will not come. Answers the good frames that it was holding up.
    ///
    /// Call it until it answers `None`; then nothing is pending.
    pub fn give_up(&mut self) -> Option<&[u8]> {
        self.release();
        let length = self.decide(true)?;
        self.hand_out(length)
    }

    /// Rejects the candidate at the front, which has waited for its bytes too long on a line that
    /// is not silent. What is held behind it is judged at the next [`receive`](Self::receive).
    pub fn give_up_front(&mut self) {
        self.release();
        if self.held > 0 {
            self.count_rejected(self.held);
            self.skip_to(self.next_candidate(0));
        }
    }

    /// Lets go of the frame that was handed out last.
    #[inline]
    fn release(&mut self) {
        if self.handed_out > 0 {
            self.drop_front(self.handed_out);
            self.handed_out = 0;
        }
    }

    /// Looks for a frame where the bytes lie, nothing being held, and takes the first one (its
    /// length), or else the candidate that is incomplete at their end (`None`).
    #[inline]
    fn search(&mut self, bytes: &mut &[u8]) -> Option<usize> {
        while !bytes.is_empty() {
            match Self::judge(bytes) {
                Verdict::Frame(length) => {
                    self.needed = length;
                    self.take(bytes);
                    return Some(length);
                }
                Verdict::Needs(count) => {
                    self.needed = count;
                    self.take(bytes);
                }
                Verdict::Noise => self.pass_over(bytes),
                Verdict::Rejected => {
                    self.count_bad_frame();
                    self.pass_over(bytes);
                }
            }
        }
        None
    }

    /// Passes over the front byte and all behind it up to the next that a frame could begin with.
    fn pass_over(&mut self, bytes: &mut &[u8]) {
        let rest = bytes.get(1..).unwrap_or_default();
        let noise = find(F::START[0], rest);
        self.skipped(noise.saturating_add(1));
        *bytes = rest.get(noise..).unwrap_or_default();
    }

    /// Moves as many bytes as the next decision needs from `bytes` into the buffer.
    #[inline]
    fn take(&mut self, bytes: &mut &[u8]) {
        let wanted = self.needed.saturating_sub(self.held).min(bytes.len());
        let free = self.buffer.get_mut(self.held..).unwrap_or_default();
        if let Some((taken, rest)) = bytes.split_at_checked(wanted)
            && let Some(free) = free.get_mut(..wanted)
        {
            free.copy_from_slice(taken);
            self.held = self.held.saturating_add(wanted);
            *bytes = rest;
        }
    }

    /// Judges candidates until one is a frame (its length) or more bytes are needed (`None`).
    /// With `silent`, a candidate that needs more bytes is rejected.
    ///
    /// What is held moves once, however many are rejected: a false start may hold one at every byte.
    fn decide(&mut self, silent: bool) -> Option<usize> {
        let (mut front, mut found, mut needed) = (0_usize, None, F::START.len());
        while front < self.held {
            let rest = self.buffer.get(front..self.held).unwrap_or_default();
            let (verdict, length) = (Self::judge(rest), rest.len());
            match verdict {
                Verdict::Frame(length) => {
                    found = Some(length);
                    break;
                }
                Verdict::Needs(count) if !silent => {
                    needed = count;
                    break;
                }
                Verdict::Noise => {}
                Verdict::Rejected | Verdict::Needs(_) => self.count_rejected(length),
            }
            front = self.next_candidate(front);
        }
        if front > 0 {
            self.skip_to(front);
        }
        self.needed = needed;
        found
    }

    #[inline]
    fn judge(bytes: &[u8]) -> Verdict {
        if !begins_like(F::START, bytes) {
            return Verdict::Noise;
        }
        if bytes.len() < F::START.len() {
            return Verdict::Needs(F::START.len());
        }
        if bytes.len() < F::HEADER {
            return Verdict::Needs(F::HEADER);
        }
        match F::length(bytes) {
            Some(length) if length <= N && length >= F::HEADER => match bytes.get(..length) {
                None => Verdict::Needs(length),
                Some(candidate) if F::is_intact(candidate) => Verdict::Frame(length),
                Some(_) => Verdict::Rejected,
            },
            _ => Verdict::Rejected,
        }
    }

    /// A candidate of so many bytes counts as a bad frame if its header was there.
    fn count_rejected(&mut self, held: usize) {
        if held >= F::HEADER {
            self.count_bad_frame();
        }
    }

    fn count_bad_frame(&mut self) {
        self.reception.bad_frames = self.reception.bad_frames.wrapping_add(1);
    }

    /// The next place behind `front` that begins like a frame, or where the bytes held end.
    #[cold]
    fn next_candidate(&self, front: usize) -> usize {
        let held = self.buffer.get(..self.held).unwrap_or_default();
        (front.saturating_add(1)..held.len())
            .find(|&at| begins_like(F::START, held.get(at..).unwrap_or_default()))
            .unwrap_or(held.len())
    }

    /// Drops what is in front of this place.
    #[cold]
    fn skip_to(&mut self, place: usize) {
        self.skipped(place);
        self.drop_front(place);
    }

    fn drop_front(&mut self, count: usize) {
        if let Some(rest) = self.held.checked_sub(count) {
            // Rarely any: not worth the kilobyte of `copy_within`.
            let bytes = Cell::from_mut(self.buffer.as_mut_slice()).as_slice_of_cells();
            for (to, from) in bytes.iter().zip(bytes.iter().skip(count)).take(rest) {
                to.set(from.get());
            }
            self.held = rest;
            // What is left is judged from its beginning.
            self.needed = F::START.len();
        }
    }

    fn hand_out(&mut self, length: usize) -> Option<&[u8]> {
        self.handed_out = length;
        self.reception.frames_ok = self.reception.frames_ok.wrapping_add(1);
        self.frame()
    }

    fn skipped(&mut self, count: usize) {
        let count = u32::try_from(count).unwrap_or(u32::MAX);
        self.reception.bytes_skipped = self.reception.bytes_skipped.wrapping_add(count);
    }
}

impl<F: Framing, const N: usize> Default for Deframer<F, N> {
    fn default() -> Self {
        Self::new()
    }
}

/// Whether `bytes` begin with `start`, or could once another byte is there.
fn begins_like(start: [u8; 2], bytes: &[u8]) -> bool {
    match bytes {
        [] => false,
        [first] => *first == start[0],
        [first, second, ..] => [*first, *second] == start,
    }
}

/// Where `byte` first stands in `bytes`, or how many bytes there are when it is not among them.
fn find(byte: u8, bytes: &[u8]) -> usize {
    bytes.iter().position(|&b| b == byte).unwrap_or(bytes.len())
}
