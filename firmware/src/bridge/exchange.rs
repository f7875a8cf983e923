//! One instruction on the servo bus, and its answer.
//!
//! The bus is one wire: what we send comes back first, as an *echo*, and only what follows it can
//! be an answer. An echo that is not what we sent means that somebody else was talking, a
//! *collision*: nobody has understood the instruction, and nothing on the line is believed until it
//! has been quiet. Bytes that nobody was asked for are *strays*: counted and dropped.
//!
//! The echo also tells when the last stop bit has left; an answer's time begins there.
//!
//! An answer is checked here and nowhere else: start, ID, length and sum by the receiver, then who
//! sent it, and how much. What goes on is a [`Status`].

use embassy_time::{Duration, Instant};
use protocol::cm5::Feedback;
use protocol::dynamixel::{Errors, Id, OVERHEAD, Packet, StatusReceiver};

use crate::reception::count;

/// A byte at 1 Mbaud.
pub const BYTE: Duration = Duration::from_micros(10);
/// Servos pause for up to 150 us in the middle of a packet (facts).
const STALL: Duration = Duration::from_micros(150);
/// The next byte of an answer comes within a stall and its own time; some more for a board that
/// tells of bytes late.
const NEXT_BYTE: Duration = Duration::from_micros(180);
/// After a collision the line must have been quiet for a stall and a byte.
pub const QUIET: Duration = NEXT_BYTE;
/// How much later than it should an echo may be complete: boards hand over bytes in pieces.
const ECHO_SLACK: Duration = Duration::from_millis(2);
/// However the line babbles, an exchange ends. An answer of 14 bytes with a stall after each of
/// them takes 2.3 ms.
const LONGEST_ANSWER: Duration = Duration::from_millis(3);

/// The longest instruction. An AX-12 has a receive buffer of 143 bytes.
pub const MAX_INSTRUCTION: usize = 143;
/// The most that we ask for.
const MAX_DATA: usize = Feedback::BYTES;

/// How long an answer may let us wait, counted from the instruction's last stop bit, besides its own
/// time: the return delay may be the longest, register 5 at 254, and there may be a stall.
pub const PATIENCE: Duration = Duration::from_micros(508 + 150);
/// 60 us instead of a stall, for whoever will ask again anyway.
pub const BRIEF_PATIENCE: Duration = Duration::from_micros(508 + 60);

/// With a return delay (2 us) that is known.
pub fn patience_with(return_delay: u8) -> Duration {
    Duration::from_micros(2 * u64::from(return_delay)) + STALL + BYTE
}

/// How an exchange ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// The instruction has left, and nobody answers to such a one.
    Sent,
    /// The servo answered as it should.
    Answered(Status),
    /// The servo answered, but not with what was asked for.
    Refused(Errors),
    /// Something came, but no intact answer.
    Damaged,
    /// Nothing came.
    TimedOut,
    /// What was on the line was not our instruction.
    Collided,
}

/// A servo's answer that was found good.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Status {
    /// Its error bits.
    pub errors: Errors,
    /// The registers read, from the front.
    pub data: [u8; MAX_DATA],
    /// From the instruction's last stop bit to the answer's.
    pub latency: Duration,
}

/// Who is to answer, and with how much.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Expected {
    /// Who.
    pub id: Id,
    /// So many bytes.
    pub data: usize,
    /// How long it may let us wait.
    pub patience: Duration,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Idle,
    /// So many bytes have come back.
    Echo(usize),
    /// The instruction was complete then.
    Answer(Expected, Instant),
    Collision,
}

/// What the bus has counted. The counters wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BusCounters {
    /// Instructions sent.
    pub instructions: u32,
    /// Instructions during which somebody else was talking, or whose echo did not come back.
    pub collisions: u32,
    /// Bytes that nobody was asked for: garbage, second answers, late ones.
    pub stray_bytes: u32,
    /// Errors that the board's receiver reported.
    pub line_errors: u32,
}

/// The exchange on the bus, one at the most.
pub struct Exchange {
    instruction: heapless::Vec<u8, MAX_INSTRUCTION>,
    expected: Option<Expected>,
    phase: Phase,
    /// When the phase is over for want of bytes, and when in spite of them.
    deadline: Instant,
    limit: Instant,
    receiver: StatusReceiver,
    /// Whether anything has come since the instruction was complete.
    heard: bool,
    /// Strays are counted from the receiver too.
    counters: BusCounters,
}

impl Exchange {
    pub fn new() -> Self {
        Self {
            instruction: heapless::Vec::new(),
            expected: None,
            phase: Phase::Idle,
            deadline: Instant::MAX,
            limit: Instant::MAX,
            receiver: StatusReceiver::new(),
            heard: false,
            counters: BusCounters::default(),
        }
    }

    pub fn counters(&self) -> BusCounters {
        let skipped = self.receiver.reception().bytes_skipped;
        BusCounters {
            stray_bytes: self.counters.stray_bytes.wrapping_add(skipped),
            ..self.counters
        }
    }

    pub fn line_failed(&mut self) {
        count(&mut self.counters.line_errors, 1);
    }

    /// Until when the exchange waits for bytes; `None` if there is none.
    pub fn waits_until(&self) -> Option<Instant> {
        (self.phase != Phase::Idle).then_some(self.deadline.min(self.limit))
    }

    /// Begins an exchange with this packet; without `expected` nobody answers it. Returns what is to
    /// be sent.
    pub fn send<'b>(
        &mut self,
        packet: &'b [u8],
        expected: Option<Expected>,
        now: Instant,
    ) -> Option<&'b [u8]> {
        self.instruction.clear(); // in place: to make and to move another takes 1 us
        self.instruction.extend_from_slice(packet).ok()?;
        self.expected = expected;
        self.phase = Phase::Echo(0);
        let packet_takes = BYTE * packet.len() as u32; // up to 143
        self.deadline = now.saturating_add(packet_takes).saturating_add(ECHO_SLACK);
        self.limit = Instant::MAX;
        count(&mut self.counters.instructions, 1);
        Some(packet)
    }

    /// Takes bytes from the bus until the exchange has ended; call it until all are taken.
    pub fn receive(&mut self, bytes: &mut &[u8], now: Instant) -> Option<Ending> {
        while !bytes.is_empty() {
            match self.phase {
                Phase::Echo(echoed) => {
                    let expected = self.instruction.get(echoed..).unwrap_or_default();
                    let same = expected.iter().zip(*bytes).take_while(|(a, b)| a == b).count();
                    *bytes = bytes.get(same..).unwrap_or_default(); // no more than there are
                    if same == expected.len() {
                        if let Some(ending) = self.sent(now) {
                            return Some(ending);
                        }
                    } else if bytes.is_empty() {
                        self.phase = Phase::Echo(echoed + same);
                    } else {
                        self.collided(now);
                    }
                }
                Phase::Answer(expected, since) => {
                    self.heard = true;
                    self.deadline = self.deadline.max(now.saturating_add(NEXT_BYTE));
                    while let Some(packet) = self.receiver.receive(bytes) {
                        let ending = expected.judge(packet, now.saturating_duration_since(since));
                        if ending.is_some() {
                            self.phase = Phase::Idle;
                            return ending;
                        }
                        count(&mut self.counters.stray_bytes, packet.len() as u32); // 56 at the most
                    }
                }
                Phase::Idle | Phase::Collision => {
                    count(&mut self.counters.stray_bytes, bytes.len() as u32); // far fewer than 2^32
                    self.deadline = now.saturating_add(QUIET);
                    *bytes = &[];
                }
            }
        }
        None
    }

    /// Ends the exchange if its time is over.
    pub fn expire(&mut self, now: Instant) -> Option<Ending> {
        if self.waits_until().is_none_or(|until| now < until) {
            return None;
        }
        match core::mem::replace(&mut self.phase, Phase::Idle) {
            Phase::Idle => None,
            Phase::Answer(..) if self.heard => Some(Ending::Damaged),
            Phase::Answer(..) => Some(Ending::TimedOut),
            Phase::Echo(_) => {
                count(&mut self.counters.collisions, 1);
                Some(Ending::Collided)
            }
            Phase::Collision => Some(Ending::Collided),
        }
    }

    /// The echo is complete.
    fn sent(&mut self, now: Instant) -> Option<Ending> {
        // What is pending there was part of no answer.
        while let Some(packet) = self.receiver.give_up() {
            count(&mut self.counters.stray_bytes, packet.len() as u32); // 56 at the most
        }
        self.heard = false;
        let Some(expected) = self.expected else {
            self.phase = Phase::Idle;
            return Some(Ending::Sent);
        };
        self.phase = Phase::Answer(expected, now);
        // Boards may tell of an answer's bytes only when it is complete, so its own time counts.
        let packet = BYTE * (OVERHEAD + expected.data) as u32; // 14 at most
        self.deadline = now.saturating_add(packet).saturating_add(expected.patience);
        self.limit = self.deadline.saturating_add(LONGEST_ANSWER);
        None
    }

    fn collided(&mut self, now: Instant) {
        count(&mut self.counters.collisions, 1);
        self.phase = Phase::Collision;
        self.deadline = now.saturating_add(QUIET);
        self.limit = now.saturating_add(LONGEST_ANSWER);
    }
}

impl Expected {
    /// What a packet that was found intact means; `None` if it is somebody else's.
    fn judge(&self, packet: &[u8], latency: Duration) -> Option<Ending> {
        let Packet { code, params, .. } = Packet::received(packet).filter(|p| p.id == self.id)?;
        let errors = Errors::from_bits(code);
        let mut data = [0; MAX_DATA];
        match data.get_mut(..self.data) {
            Some(read) if read.len() == params.len() => read.copy_from_slice(params),
            _ => return Some(Ending::Refused(errors)),
        }
        Some(Ending::Answered(Status { errors, data, latency }))
    }
}
