//! Frames found in a stream of bytes, in the chunks that the board's line brings.
//!
//! The stream is one of each kind that hosts send: a ping, a command for one channel, gains, a timed
//! command for six channels, a picture (10 to 74 bytes). A stream of the command for one channel alone
//! (12 bytes) is recorded besides.

use core::hint::black_box;

use protocol::pms5005::{ETX, Frame, MAX_FRAME, Receiver, STX};

use crate::case;

/// A way to find frames.
trait Receive {
    /// Takes a chunk of the stream, and calls `found` with DID and DATA of every complete frame.
    fn receive(&mut self, chunk: &[u8], found: impl FnMut(u8, &[u8]));
}

/// All cases; the unit is a byte on the line.
pub fn cases() {
    let kinds: &[(u8, &[u8])] =
        &[(255, &[1]), (28, &[0x5A; 3]), (7, &[0x5A; 11]), (26, &[0x5A; 21]), (23, &[0x5A; 65])];
    measure("receive/ours", kinds, Ours(Receiver::new()));
    measure("receive/state-machine", kinds, StateMachine::new());
    let shortest = &kinds[1..2];
    measure("receive-12/ours", shortest, Ours(Receiver::new()));
    measure("receive-12/state-machine", shortest, StateMachine::new());
}

/// What the board's look into its ring finds every millisecond at 115200 baud: 11 or 12 bytes.
fn looks(stream: &[u8]) -> impl Iterator<Item = &[u8]> {
    let at = |look: usize| (look * 11_520 / 1000).min(stream.len());
    (0..).map(move |look| &stream[at(look)..at(look + 1)]).take_while(|chunk| !chunk.is_empty())
}

fn measure(name: &str, kinds: &[(u8, &[u8])], mut receiver: impl Receive) {
    let (mut stream, mut end, mut sent) = ([0; 576], 0, 0); // what 50 looks bring
    for &(did, data) in kinds.iter().cycle() {
        let Ok(frame) = (Frame { rid: 1, res: 0, did, data }).encode(&mut stream[end..]) else {
            break;
        };
        (end, sent) = (end + frame.len(), sent + 1);
    }
    let stream = &stream[..end];
    let mut frames = 0;
    for chunk in looks(stream) {
        receiver.receive(chunk, |did, data| frames += usize::from(kinds.contains(&(did, data))));
    }
    assert_eq!(frames, sent, "{name}");
    case(name, stream.len(), || {
        for chunk in looks(black_box(stream)) {
            receiver.receive(chunk, |did, data| _ = black_box((did, data)));
        }
    });
}

/// Ours.
struct Ours(Receiver);

impl Receive for Ours {
    fn receive(&mut self, mut chunk: &[u8], mut found: impl FnMut(u8, &[u8])) {
        while let Some(frame) = self.0.receive(&mut chunk) {
            if let Some(Frame { did, data, .. }) = Frame::parse(frame) {
                found(did, data);
            }
        }
    }
}

/// The state machine of the textbooks: a byte at a time, the checksum on the way. It does less than
/// ours: it does not resynchronise (what it has taken for a damaged frame it throws away, and a good
/// frame within with it), and it counts nothing.
struct StateMachine {
    state: State,
    checksum: u8,
    held: usize,
    /// From RID to DATA.
    buffer: [u8; MAX_FRAME],
}

#[derive(Clone, Copy)]
enum State {
    Start,
    Start2,
    Header,
    Data,
    Checksum,
    End,
    End2,
}

/// Where the fields stand in the buffer, behind RID and RES.
const DID: usize = 2;
const LEN: usize = 3;
const DATA: usize = 4;

/// The checksum of one byte.
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

impl StateMachine {
    fn new() -> Self {
        Self { state: State::Start, checksum: 0, held: 0, buffer: [0; MAX_FRAME] }
    }

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
            State::Start if byte == STX[0] => State::Start2,
            State::Start => State::Start,
            State::Start2 if byte == STX[1] => {
                (self.held, self.checksum) = (0, 0);
                State::Header
            }
            State::Start2 if byte == STX[0] => State::Start2,
            State::Start2 => State::Start,
            State::Header => {
                self.keep(byte);
                match self.held {
                    DATA if byte == 0 => State::Checksum,
                    DATA => State::Data,
                    _ => State::Header,
                }
            }
            State::Data => {
                self.keep(byte);
                match self.held < DATA + usize::from(self.buffer[LEN]) {
                    true => State::Data,
                    false => State::Checksum,
                }
            }
            State::Checksum if byte == self.checksum => State::End,
            State::End if byte == ETX[0] => State::End2,
            State::Checksum | State::End => State::Start,
            State::End2 => {
                self.state = State::Start;
                return byte == ETX[1];
            }
        };
        false
    }
}

impl Receive for StateMachine {
    fn receive(&mut self, chunk: &[u8], mut found: impl FnMut(u8, &[u8])) {
        for &byte in chunk {
            if self.feed(byte) {
                found(self.buffer[DID], &self.buffer[DATA..self.held]);
            }
        }
    }
}
