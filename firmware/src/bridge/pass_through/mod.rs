//! The CM-5 as a pass-through: the PC speaks Dynamixel 1.0 itself, through the board.
//!
//! ```text
//!            ┌───────────── PassThrough ─────────────┐
//!   PC ────> │ receive ── refuses baud ──────────────│ ────> bus
//!            │          Wheels         stop (2 s) ── │ ────> bus
//!   PC <──── │ transmit <────────── echo taken away  │ <──── bus
//!            └───────────────────────────────────────┘
//! ```
//!
//! A [`PassThrough`] has no I/O and no clock, as the bridge; [`tasks`] run it. Vocabulary: a servo with
//! both angle limits 0 is a *wheel* and turns endlessly (its maker's wheel mode), any other is a *joint*; the
//! *echo* is what the board itself sends, as the one wire gives it back.
//!
//! Rules:
//! - The PC's bytes go to the bus as they come, and what servos say goes to the PC as it comes: neither
//!   waits for the end of a packet.
//! - The bus stays at its baud. An instruction that writes another to register 4 has its last byte, the
//!   checksum, inverted: the servo that it names answers with the checksum error, and nobody obeys.
//! - [`SILENCE`] after the PC's last byte each servo that has been seen to be a wheel is sent moving speed 0, once.
//!   Nobody else is sent anything: for a joint speed 0 is full speed. What the PC has left unfinished is not mixed
//!   with that, since servos give up an instruction after 100 ms of silence on the bus, and so does the board.
//! - A PC that speaks while the board does waits for the packet's end: 140 us, since no more than
//!   [`STOPPED_AT_ONCE`] are stopped with one. The rest are left until it is silent again.
//! - An echo that is not what was sent, or does not come, is a *collision*: nothing is believed, and nothing goes to
//!   the PC, until the bus has been quiet for a servo's longest stall.
//! - Nor is an answer believed, though it goes to the PC, while one to an earlier instruction could still come.
//! - A PC that is faster than the bus waits where its line can make it wait; on a UART it has some 400 bytes in
//!   advance, and what it sends beyond is lost, an error of its line. Answers that a slower PC's line has no room
//!   for are dropped and counted.
//!
//! Instructions are followed as servos follow them, by their length, so that nobody obeys what was not looked
//! at.

pub mod tasks;
mod wheels;

use embassy_time::{Duration, Instant};
use heapless::Deque;
use protocol::deframe::Framing;
use protocol::dynamixel::{
    Dynamixel, Id, Instruction, InstructionReceiver, Packet, Register, StatusReceiver, SyncWriter,
};

use super::exchange::{BYTE, PATIENCE, QUIET};
use crate::reception::{LONGEST_PAUSE, count};
use wheels::Wheels;

/// So long after the PC's last byte wheels are stopped.
pub const SILENCE: Duration = Duration::from_secs(2);
/// So many are stopped with one packet, of 14 bytes: the PC waits for it, and its packet may come 0.2 ms late.
pub const STOPPED_AT_ONCE: usize = 2;
/// The longest packet of the board's own: 8 bytes, and 3 a servo.
pub const MAX_OWN_PACKET: usize = 8 + 3 * STOPPED_AT_ONCE;
/// Register 4 at the bus's 1 Mbaud.
const BAUD: u8 = 1;
/// What has been sent and not yet come back: the driver's room, a chunk that waits for it, and what is on the
/// wire, 210 bytes in all.
const ECHO: usize = 256;
/// Answers that wait for the PC's line: four of the longest.
const TO_PC: usize = 256;

/// What was counted. The counters wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PassThroughCounters {
    /// Instructions of the PC, intact or not.
    pub instructions: u32,
    /// Of these, such as would have changed a servo's baud.
    pub refused_bauds: u32,
    /// Servos that the board has stopped.
    pub stops: u32,
    /// Times that what came back was not what was sent.
    pub collisions: u32,
    /// Bytes that were heard in a collision and not passed on.
    pub collided_bytes: u32,
    /// Bytes of answers that there was no room for.
    pub lost_bytes: u32,
    /// Errors that the PC's line reported.
    pub pc_line_errors: u32,
    /// Errors that the bus's receiver or transmitter reported.
    pub bus_line_errors: u32,
}

/// The pass-through. See the [module](self). The time that it is told never runs backwards.
pub struct PassThrough {
    instructions: InstructionReceiver,
    /// When the PC's last byte leaves for the bus, where servos measure its pauses.
    left: Instant,
    /// When wheels are to be stopped, unless all of them have been.
    stops_at: Option<Instant>,
    /// From this ID on they are still to be stopped.
    unstopped: u8,
    wheels: Wheels,
    /// Until when a servo may begin to answer what it was told.
    answered_by: Instant,
    answers: StatusReceiver,
    echo: Deque<u8, ECHO>,
    /// Until when the bus is busy with what was sent, or with a collision.
    busy_until: Instant,
    has_collided: bool,
    to_pc: Deque<u8, TO_PC>,
    counters: PassThroughCounters,
}

impl PassThrough {
    /// One that has heard nothing yet.
    pub const fn new() -> Self {
        Self {
            instructions: InstructionReceiver::new(),
            left: Instant::MIN,
            stops_at: None,
            unstopped: 0,
            wheels: Wheels::new(),
            answered_by: Instant::MIN,
            answers: StatusReceiver::new(),
            echo: Deque::new(),
            busy_until: Instant::MIN,
            has_collided: false,
            to_pc: Deque::new(),
            counters: PassThroughCounters {
                instructions: 0,
                refused_bauds: 0,
                stops: 0,
                collisions: 0,
                collided_bytes: 0,
                lost_bytes: 0,
                pc_line_errors: 0,
                bus_line_errors: 0,
            },
        }
    }

    /// Everything counted so far.
    pub fn counters(&self) -> PassThroughCounters {
        self.counters
    }

    /// The IDs, 0 to 253, of the servos that have been seen to be wheels.
    pub fn wheels(&self) -> impl Iterator<Item = u8> {
        self.wheels.from(0).map(|id| id.number())
    }

    /// Takes bytes of the PC, and makes of them what is to be sent on the bus at once, in their place.
    pub fn receive(&mut self, bytes: &mut [u8], now: Instant) {
        self.settle(now);
        if now > self.left.saturating_add(LONGEST_PAUSE) {
            self.instructions = InstructionReceiver::new();
        }
        self.occupy(bytes.len(), now);
        self.left = self.busy_until;
        self.stops_at = Some(now.saturating_add(SILENCE));
        self.unstopped = 0;
        let mut unread = &*bytes;
        while self.instructions.receive(&mut unread).is_some() {
            let end = bytes.len().saturating_sub(unread.len());
            if self.is_to_be_refused(now) {
                count(&mut self.counters.refused_bauds, 1);
                if let Some(checksum) = bytes.get_mut(..end).and_then(|sent| sent.last_mut()) {
                    *checksum = !*checksum;
                }
            }
            unread = bytes.get(end..).unwrap_or_default();
        }
        self.expect_echo(bytes);
    }

    /// Follows the instruction that has just become complete; whether nobody may obey it.
    fn is_to_be_refused(&mut self, now: Instant) -> bool {
        count(&mut self.counters.instructions, 1);
        self.believe_nothing();
        let packet = self.instructions.frame();
        let Some(fields) = Packet::received(packet) else { return false };
        let instruction = Instruction::parse(fields).filter(|_| Dynamixel::is_intact(packet));
        // A PC that does not wait could take the answer to its last instruction for that to this one.
        let is_hasty = now < self.answered_by;
        if fields.id != Id::BROADCAST || instruction == Some(Instruction::Ping) {
            self.answered_by = self.left.saturating_add(PATIENCE);
        }
        match instruction {
            Some(instruction) if changes_baud(&instruction) => true,
            Some(instruction) => {
                self.wheels.follow(fields.id, &instruction);
                if is_hasty {
                    self.wheels.nobody_is_asked();
                }
                false
            }
            None => false,
        }
    }

    /// Whatever is answered from now on, or has been in part, proves nothing.
    fn believe_nothing(&mut self) {
        self.answers = StatusReceiver::new();
        self.wheels.nobody_is_asked();
    }

    /// Counts an error that the PC's line reported.
    pub fn pc_failed(&mut self) {
        count(&mut self.counters.pc_line_errors, 1);
    }

    /// When [`stop`](Self::stop) has something to do, if the PC says nothing until then; it may be past.
    pub fn stops_at(&self) -> Option<Instant> {
        self.stops_at
    }

    /// The board's own next packet, to be sent on the bus at once, written into `out`, of [`MAX_OWN_PACKET`]
    /// bytes at least; `None` if there is none now.
    pub fn stop<'b>(&mut self, now: Instant, out: &'b mut [u8]) -> Option<&'b [u8]> {
        if self.stops_at.is_none_or(|at| now < at) {
            return None;
        }
        let speed = Register::MOVING_SPEED;
        let mut packet = SyncWriter::new(out, speed.address, speed.size).ok()?;
        let mut stopped = 0;
        for id in self.wheels.from(self.unstopped).take(STOPPED_AT_ONCE) {
            packet.servo(id).ok()?.fill(0);
            self.unstopped = id.number().saturating_add(1);
            stopped += 1;
        }
        if stopped == 0 {
            self.stops_at = None;
            return None;
        }
        let packet = packet.finish().ok()?;
        count(&mut self.counters.stops, stopped);
        self.settle(now);
        self.occupy(packet.len(), now);
        self.expect_echo(packet);
        Some(packet)
    }

    /// So many bytes are handed to the bus now.
    fn occupy(&mut self, bytes: usize, now: Instant) {
        self.busy_until = self.busy_until.max(now).saturating_add(BYTE * bytes as u32); // 64 at most
    }

    /// These bytes will be heard.
    fn expect_echo(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            if !self.has_collided && self.echo.push_back(byte).is_err() {
                self.collide(); // there is room for all that can be under way
            }
        }
    }

    /// Takes bytes that were heard on the bus: the echo of what was sent, and what servos say.
    pub fn bus_hears(&mut self, bytes: &[u8], now: Instant) {
        self.settle(now);
        for &byte in bytes {
            match self.echo.front() {
                Some(&sent) if sent == byte => {
                    self.echo.pop_front();
                }
                Some(_) => {
                    self.collide();
                    count(&mut self.counters.collided_bytes, 1);
                }
                None if self.has_collided => count(&mut self.counters.collided_bytes, 1),
                None => self.answer(byte),
            }
        }
        // A PC whose clock is faster than the board's is ahead of the bus, and ever more so.
        let echo_takes = BYTE * self.echo.len() as u32; // 256 at most
        self.busy_until = self.busy_until.max(now.saturating_add(echo_takes));
    }

    /// What has not come back when the bus has been quiet never will.
    fn settle(&mut self, now: Instant) {
        if now > self.busy_until.saturating_add(QUIET) {
            if !self.echo.is_empty() {
                self.collide();
            }
            self.has_collided = false;
        }
    }

    fn collide(&mut self) {
        count(&mut self.counters.collisions, 1);
        self.has_collided = true;
        self.echo.clear();
        self.believe_nothing();
    }

    /// A byte that a servo says.
    fn answer(&mut self, byte: u8) {
        if self.to_pc.push_back(byte).is_err() {
            count(&mut self.counters.lost_bytes, 1);
        }
        if let Some(packet) = self.answers.receive(&mut &[byte][..])
            && let Some(status) = Packet::received(packet)
            && self.wheels.hear(status)
        {
            self.answered_by = Instant::MIN;
        }
    }

    /// Counts an error that the bus's receiver or transmitter reported. What was heard before it is gone, and
    /// with it echo; the bus is used again `now`.
    pub fn bus_failed(&mut self, now: Instant) {
        count(&mut self.counters.bus_line_errors, 1);
        self.collide();
        self.busy_until = self.busy_until.max(now);
    }

    /// Whether [`transmit`](Self::transmit) has something to say.
    pub fn has_answers(&self) -> bool {
        !self.to_pc.is_empty()
    }

    /// The next bytes for the PC, written into `out`; `None` if there are none. Call it whenever its line is
    /// free.
    pub fn transmit<'b>(&mut self, out: &'b mut [u8]) -> Option<&'b [u8]> {
        let mut length = 0;
        for place in out.iter_mut() {
            let Some(byte) = self.to_pc.pop_front() else { break };
            *place = byte;
            length += 1;
        }
        out.get(..length).filter(|bytes| !bytes.is_empty())
    }
}

impl Default for PassThrough {
    fn default() -> Self {
        Self::new()
    }
}

/// Whether a servo that obeys would no longer be heard.
fn changes_baud(instruction: &Instruction<'_>) -> bool {
    let is_another = |address: u8, data: &[u8]| {
        let place = Register::BAUD_RATE.address.checked_sub(address);
        place.and_then(|place| data.get(usize::from(place))).is_some_and(|&value| value != BAUD)
    };
    match *instruction {
        Instruction::Write { address, data } | Instruction::RegWrite { address, data } => {
            is_another(address, data)
        }
        Instruction::SyncWrite(list) => {
            list.servos().any(|(_, data)| is_another(list.address(), data))
        }
        _ => false,
    }
}
