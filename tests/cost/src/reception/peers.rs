//! Other ways to receive.

use postcard::accumulator::{CobsAccumulator, FeedResult};
use protocol::pms5005::{ETX, MAX_FRAME, STX};
use serde::{Deserialize, Serialize};

use super::{Fields, LONGEST, Receive};

/// The checksum of Figure II.1, bit by bit as the manual prints it.
pub fn figure_ii_1(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |register, &byte| {
        (0..8).fold(register, |register: u8, bit| {
            let feedback = (register ^ (byte >> bit)) & 1;
            (register >> 1) ^ (feedback * 0x8C)
        })
    })
}

/// The table of the checksum: one look-up a byte, which is what a state machine needs.
static TABLE: [u8; 256] = {
    let mut table = [0; 256];
    let mut i = 0;
    while i < table.len() {
        let mut register = i as u8; // 0 to 255
        let mut bit = 0;
        while bit < 8 {
            register = (register >> 1) ^ ((register & 1) * 0x8C);
            bit += 1;
        }
        table[i] = register;
        i += 1;
    }
    table
};

/// The state machine of the textbooks: a byte at a time, the checksum on the way. It does less than
/// ours: what it has taken for a damaged frame it throws away, and a good frame within with it; it
/// counts nothing.
struct Machine {
    state: State,
    checksum: u8,
    held: usize,
    buffer: [u8; MAX_FRAME],
}

#[derive(Clone, Copy)]
enum State {
    Start,
    Start2,
    Rid,
    Res,
    Did,
    Length,
    Data,
    Checksum,
    End,
    End2,
}

/// Where the fields stand in the machine's buffer.
const RID: usize = 0;
const RES: usize = 1;
const DID: usize = 2;
const LEN: usize = 3;
const DATA: usize = 4;

impl Default for Machine {
    fn default() -> Self {
        Self { state: State::Start, checksum: 0, held: 0, buffer: [0; MAX_FRAME] }
    }
}

impl Machine {
    #[inline(always)]
    fn keep(&mut self, byte: u8) {
        if let Some(place) = self.buffer.get_mut(self.held) {
            *place = byte;
            self.held += 1;
        }
        self.checksum = TABLE[usize::from(self.checksum ^ byte)];
    }

    /// One byte; whether it completes a frame.
    #[inline(always)]
    fn feed(&mut self, byte: u8) -> bool {
        self.state = match self.state {
            State::Start => match byte == STX[0] {
                true => State::Start2,
                false => State::Start,
            },
            State::Start2 if byte == STX[1] => {
                self.held = 0;
                self.checksum = 0;
                State::Rid
            }
            State::Start2 if byte == STX[0] => State::Start2,
            State::Start2 => State::Start,
            State::Rid => {
                self.keep(byte);
                State::Res
            }
            State::Res => {
                self.keep(byte);
                State::Did
            }
            State::Did => {
                self.keep(byte);
                State::Length
            }
            State::Length => {
                self.keep(byte);
                if byte == 0 { State::Checksum } else { State::Data }
            }
            State::Data => {
                self.keep(byte);
                match self.held < DATA + usize::from(self.buffer[LEN]) {
                    true => State::Data,
                    false => State::Checksum,
                }
            }
            State::Checksum if byte == self.checksum => State::End,
            State::Checksum => State::Start,
            State::End if byte == ETX[0] => State::End2,
            State::End => State::Start,
            State::End2 => {
                self.state = State::Start;
                return byte == ETX[1];
            }
        };
        false
    }

    fn fields(&self) -> Fields<'_> {
        Fields {
            rid: self.buffer[RID],
            res: self.buffer[RES],
            did: self.buffer[DID],
            data: &self.buffer[DATA..self.held],
        }
    }
}

/// The state machine, a call for every byte, as from an interrupt.
#[derive(Default)]
pub struct Called(Machine);

impl Called {
    #[inline(never)]
    fn feed(&mut self, byte: u8) -> bool {
        self.0.feed(byte)
    }
}

impl Receive for Called {
    fn receive(&mut self, chunk: &[u8], mut found: impl FnMut(Fields<'_>)) {
        for &byte in chunk {
            if self.feed(byte) {
                found(self.0.fields());
            }
        }
    }
}

/// The state machine in a loop over the chunk.
#[derive(Default)]
pub struct Inlined(Machine);

impl Receive for Inlined {
    fn receive(&mut self, chunk: &[u8], mut found: impl FnMut(Fields<'_>)) {
        for &byte in chunk {
            if self.0.feed(byte) {
                found(self.0.fields());
            }
        }
    }
}

/// The least that a byte costs which comes alone: it is put behind the others. It does nothing
/// else: no start is looked for, nothing is checked, and that a frame has ended it knows from its
/// length.
pub struct Append {
    buffer: [u8; MAX_FRAME],
    held: usize,
    frame: usize,
}

impl Append {
    /// For frames of this length.
    pub fn new(frame: usize) -> Self {
        Self { buffer: [0; MAX_FRAME], held: 0, frame }
    }
}

impl Receive for Append {
    fn receive(&mut self, chunk: &[u8], mut found: impl FnMut(Fields<'_>)) {
        for &byte in chunk {
            if let Some(place) = self.buffer.get_mut(self.held) {
                *place = byte;
                self.held += 1;
            }
            if self.held == self.frame {
                self.held = 0;
                found(Fields { rid: 0, res: 0, did: 0, data: &self.buffer });
            }
        }
    }
}

/// Looks for start marks and judges what stands there. It does less than all others: a frame must
/// lie in one chunk, whole.
pub struct Scan;

impl Receive for Scan {
    fn receive(&mut self, mut chunk: &[u8], mut found: impl FnMut(Fields<'_>)) {
        use crc::{CRC_8_MAXIM_DOW, Crc, Table};
        const CRC: Crc<u8, Table<16>> = Crc::<u8, Table<16>>::new(&CRC_8_MAXIM_DOW);
        while let Some(at) = chunk.iter().position(|&byte| byte == STX[0]) {
            chunk = &chunk[at..];
            let Some(&[_, start, rid, res, did, len]) = chunk.first_chunk() else { return };
            let len = usize::from(len);
            if start == STX[1]
                && let Some(&[crc, end, end2]) = chunk.get(6 + len..9 + len)
                && [end, end2] == ETX
                && CRC.checksum(&chunk[2..6 + len]) == crc
            {
                found(Fields { rid, res, did, data: &chunk[6..6 + len] });
                chunk = &chunk[9 + len..];
            } else {
                chunk = &chunk[1..];
            }
        }
    }
}

/// The fields as postcard sends them.
#[derive(Serialize, Deserialize)]
struct Message<'a> {
    rid: u8,
    res: u8,
    did: u8,
    data: &'a [u8],
}

/// Postcard's message with this DATA in its COBS frame: its own bytes, as the host would send them.
pub fn cobs<'b>(data: &[u8], out: &'b mut [u8; 2 * LONGEST]) -> &'b [u8] {
    let did = if data.len() > 3 { 23 } else { 28 };
    postcard::to_slice_cobs(&Message { rid: 1, res: 0, did, data }, out).map_or(&[], |frame| frame)
}

/// Postcard with COBS, through its accumulator. It does less than ours: there is no checksum.
#[derive(Default)]
pub struct Postcard(CobsAccumulator<MAX_FRAME>);

impl Receive for Postcard {
    fn receive(&mut self, mut chunk: &[u8], mut found: impl FnMut(Fields<'_>)) {
        while !chunk.is_empty() {
            chunk = match self.0.feed_ref::<Message<'_>>(chunk) {
                FeedResult::Consumed => return,
                FeedResult::OverFull(rest) | FeedResult::DeserError(rest) => rest,
                FeedResult::Success { data: Message { rid, res, did, data }, remaining } => {
                    found(Fields { rid, res, did, data });
                    remaining
                }
            };
        }
    }
}
