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
//! - Work is done on slices: a frame that lies in one chunk is judged and handed out where it lies,
//!   any other is copied once. A byte with which nothing can be decided yet is copied and no more.
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
    /// Bytes held, from the front of the buffer, or behind the frame that was handed out.
    held: usize,
    /// With fewer bytes than this there is nothing to decide. 1 when none are held, or some that
    /// have not been looked at.
    needed: usize,
    /// Length of the frame handed out last, if it lies in the buffer; it leaves at the next call.
    handed_out: usize,
    reception: Reception,
    framing: PhantomData<F>,
}

/// Where a frame lies that [`Deframer::find`] has found.
#[derive(Clone, Copy)]
pub enum Found<'b> {
    /// As a whole in the chunk that it was given.
    InChunk(&'b [u8]),
    /// In its own buffer.
    Held,
}

/// What can be said of bytes from the first one on.
enum Verdict<'b> {
    /// They are a frame, and what is behind it.
    Frame(&'b [u8], &'b [u8]),
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
            needed: 1,
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
        self.held
    }

    /// Takes bytes from the front of `bytes` until a frame is complete or `bytes` is empty.
    ///
    /// Call it until it answers `None`; the frame handed out is valid until the next call. It is
    /// not copied when it lies in `bytes` as a whole.
    #[inline]
    pub fn receive<'r, 'b: 'r>(&'r mut self, bytes: &mut &'b [u8]) -> Option<&'r [u8]> {
        let found = self.find(bytes)?;
        Some(self.frame(found))
    }

    /// [`receive`](Self::receive) for those who have more to ask of the receiver before they look
    /// at the [`frame`](Self::frame).
    #[inline]
    pub fn find<'b>(&mut self, bytes: &mut &'b [u8]) -> Option<Found<'b>> {
        // The frequent case is short, and stands where it is needed.
        if let Some(end) = self.held.checked_add(bytes.len())
            && end < self.needed
            && let Some(room) = self.buffer.get_mut(self.held..end)
        {
            copy(bytes, room);
            self.held = end;
            *bytes = &[];
            return None;
        }
        self.look(bytes)
    }

    /// The frame that was found last.
    #[inline]
    pub fn frame<'r>(&'r self, found: Found<'r>) -> &'r [u8] {
        match found {
            Found::InChunk(frame) => frame,
            Found::Held => self.buffer.get(..self.handed_out).unwrap_or_default(),
        }
    }

    /// Gives up waiting for the rest of the candidate at the front: the line has been silent for
    /// so long that it will not come. Answers the good frames that it was holding up.
    ///
    /// Call it until it answers `None`; then nothing is pending.
    pub fn give_up(&mut self) -> Option<&[u8]> {
        self.find_held().then(|| self.frame(Found::Held))
    }

    /// [`give_up`](Self::give_up) as [`find`](Self::find) is to [`receive`](Self::receive).
    pub fn find_held(&mut self) -> bool {
        self.release();
        self.decide(0, true)
    }

    /// Rejects the candidate at the front, which has waited for its bytes too long on a line that
    /// is not silent, and answers whether a frame is found behind it.
    pub fn give_up_front(&mut self) -> bool {
        self.release();
        self.count_rejected(self.held);
        self.decide(self.next_candidate(0), false)
    }

    /// Takes bytes when there is something to decide.
    #[inline]
    fn look<'b>(&mut self, bytes: &mut &'b [u8]) -> Option<Found<'b>> {
        loop {
            if self.held == 0 {
                return self.search(bytes).map(Found::InChunk);
            }
            let mut rest = *bytes;
            let is_found = self.complete(&mut rest);
            *bytes = rest;
            if is_found {
                return Some(Found::Held);
            }
            if bytes.is_empty() {
                return None;
            }
        }
    }

    /// Looks for a frame where the bytes lie, nothing being held. Takes it and all before it; or
    /// all bytes, and holds those of a candidate that is incomplete at their end.
    #[inline]
    fn search<'b>(&mut self, bytes: &mut &'b [u8]) -> Option<&'b [u8]> {
        while !bytes.is_empty() {
            match Self::judge(bytes) {
                Verdict::Frame(frame, behind) => {
                    *bytes = behind;
                    self.count_frame();
                    return Some(frame);
                }
                Verdict::Needs(count) => {
                    self.handed_out = 0;
                    self.needed = count;
                    self.hold(bytes);
                    *bytes = &[];
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

    /// Takes as many bytes as the next decision needs about what is held, and decides: whether a
    /// frame is found.
    #[inline(never)]
    fn complete(&mut self, bytes: &mut &[u8]) -> bool {
        self.release();
        let missing = self.needed.saturating_sub(self.held);
        let Some((taken, rest)) = bytes.split_at_checked(missing) else {
            self.hold(bytes);
            *bytes = &[];
            return false;
        };
        self.hold(taken);
        *bytes = rest;
        let held = self.buffer.get(..self.held).unwrap_or_default();
        match Self::judge(held) {
            Verdict::Frame(frame, _) => {
                self.hand_out(frame.len());
                return true;
            }
            Verdict::Needs(count) => {
                self.needed = count;
                return false;
            }
            Verdict::Noise => {}
            Verdict::Rejected => self.count_bad_frame(),
        }
        self.decide(self.next_candidate(0), false)
    }

    /// Puts a chunk behind what is held; there is room, as no frame is longer than the buffer.
    #[inline]
    fn hold(&mut self, chunk: &[u8]) {
        let room = self.buffer.get_mut(self.held..).unwrap_or_default();
        if let Some(room) = room.get_mut(..chunk.len()) {
            copy(chunk, room);
            self.held = self.held.saturating_add(chunk.len());
        }
    }

    /// Lets go of the frame that was handed out last.
    #[inline]
    fn release(&mut self) {
        if self.handed_out > 0 {
            self.close_up(self.handed_out);
            self.handed_out = 0;
        }
    }

    /// Passes over the front byte and all behind it up to the next that a frame could begin with.
    fn pass_over(&mut self, bytes: &mut &[u8]) {
        let rest = bytes.get(1..).unwrap_or_default();
        let noise = place_of(F::START[0], rest);
        self.skipped(noise.saturating_add(1));
        *bytes = rest.get(noise..).unwrap_or_default();
    }

    /// Judges candidates from this place on until one is a frame, or more bytes are needed: whether
    /// a frame is found. With `silent`, a candidate that needs more bytes is rejected.
    ///
    /// What is held moves once, however many are rejected: a false start may hold one at every
    /// byte.
    #[cold]
    fn decide(&mut self, mut front: usize, silent: bool) -> bool {
        let (mut found, mut needed) = (0, 1);
        while front < self.held {
            let rest = self.buffer.get(front..self.held).unwrap_or_default();
            let length = rest.len();
            match Self::judge(rest) {
                Verdict::Frame(frame, _) => {
                    found = frame.len();
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
        self.skip_to(front);
        self.needed = needed;
        if found > 0 {
            self.hand_out(found);
        }
        found > 0
    }

    /// Hands out the frame that the bytes held begin with.
    #[inline]
    fn hand_out(&mut self, length: usize) {
        self.handed_out = length;
        self.held = self.held.saturating_sub(length);
        self.needed = 1;
        self.count_frame();
    }

    #[inline]
    fn judge(bytes: &[u8]) -> Verdict<'_> {
        let Some(header) = bytes.get(..F::HEADER) else {
            return match bytes {
                _ if !begins_like(F::START, bytes) => Verdict::Noise,
                [_] => Verdict::Needs(F::START.len()),
                _ => Verdict::Needs(F::HEADER),
            };
        };
        if !header.starts_with(&F::START) {
            return Verdict::Noise;
        }
        match F::length(header) {
            Some(length) if length <= N && length >= F::HEADER => {
                match bytes.split_at_checked(length) {
                    None => Verdict::Needs(length),
                    Some((frame, behind)) if F::is_intact(frame) => Verdict::Frame(frame, behind),
                    Some(_) => Verdict::Rejected,
                }
            }
            _ => Verdict::Rejected,
        }
    }

    fn count_frame(&mut self) {
        self.reception.frames_ok = self.reception.frames_ok.wrapping_add(1);
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
    fn next_candidate(&self, front: usize) -> usize {
        let held = self.buffer.get(..self.held).unwrap_or_default();
        (front.saturating_add(1)..held.len())
            .find(|&at| begins_like(F::START, held.get(at..).unwrap_or_default()))
            .unwrap_or(held.len())
    }

    /// Drops what is held in front of this place.
    fn skip_to(&mut self, place: usize) {
        self.skipped(place);
        self.held = self.held.saturating_sub(place);
        self.close_up(place);
    }

    /// Moves what is held from this place to the front.
    #[inline]
    fn close_up(&mut self, place: usize) {
        // Rarely any: not worth the kilobyte of `copy_within`.
        let bytes = Cell::from_mut(self.buffer.as_mut_slice()).as_slice_of_cells();
        for (to, from) in bytes.iter().zip(bytes.iter().skip(place)).take(self.held) {
            to.set(from.get());
        }
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

/// Copies a chunk to a place of the same length. Most are short, and all are unaligned: `memcpy`
/// takes 5 to 10 instructions a word, and more to tell cases apart. Here it is two loads and stores
/// that may overlap, for longer ones in pieces of 16 bytes.
#[inline]
fn copy(chunk: &[u8], to: &mut [u8]) {
    let length = chunk.len();
    if length == 1 {
        copy_ends::<1>(chunk, to);
    } else if length < 4 {
        copy_ends::<2>(chunk, to);
    } else if length < 8 {
        copy_ends::<4>(chunk, to);
    } else if length <= 16 {
        copy_ends::<8>(chunk, to);
    } else {
        copy_pieces(chunk, to);
    }
}

/// Copies 16 bytes and more.
#[inline(never)]
fn copy_pieces(chunk: &[u8], to: &mut [u8]) {
    for (piece, place) in chunk.as_chunks::<16>().0.iter().zip(to.as_chunks_mut::<16>().0) {
        copy_ends::<8>(piece, place);
    }
    if let (Some(last), Some(place)) = (chunk.last_chunk::<16>(), to.last_chunk_mut::<16>()) {
        copy_ends::<8>(last, place);
    }
}

/// Copies the first and the last `K` bytes.
#[inline]
fn copy_ends<const K: usize>(from: &[u8], to: &mut [u8]) {
    if let (Some(first), Some(to)) = (from.first_chunk::<K>(), to.first_chunk_mut()) {
        *to = *first;
    }
    if let (Some(last), Some(to)) = (from.last_chunk::<K>(), to.last_chunk_mut()) {
        *to = *last;
    }
}

/// Where `byte` first stands in `bytes`, or how many bytes there are when it is not among them.
fn place_of(byte: u8, bytes: &[u8]) -> usize {
    bytes.iter().position(|&b| b == byte).unwrap_or(bytes.len())
}
