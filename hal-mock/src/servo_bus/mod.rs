//! A bus of simulated AX-12 servos: one wire, one master, half duplex.
//!
//! ```text
//!  master ── bytes with their times ──> ServoBus ──> Ax12, Ax12, ...
//!  master <── bytes with their times ──    (air: what is on the wire, collisions, faults)
//! ```
//!
//! [`ServoBus`] is a plain machine without a clock of its own: bytes and the time go in, bytes and
//! their times come out. [`MasterEnd`] puts it on virtual time, as `embedded_io_async` ports.
//!
//! Times are nanoseconds since the beginning; a byte stands for its last stop bit. What happens on
//! the wire:
//! - A byte takes ten bit times. The master's own bytes are its *echo*: it hears them too.
//! - A servo answers when its return delay (register 5, in 2 us) and its own latency are over.
//! - Whoever talks is deaf. Two bytes that overlap *collide*: the earlier one is heard as something
//!   else, the later one not at all.
//! - After a write to EEPROM, and its answer, a servo is deaf and mute for some 6 ms a byte.
//! - 100 ms without a byte end an instruction that is not complete.
//!
//! Of all broadcasts only a PING is answered, by every servo at once. An instruction whose checksum
//! is wrong is answered with that error by the servo that it names. Servos hear only the master
//! here: a real one hears the others' answers too, and skips them.

mod end;

use std::collections::VecDeque;

use protocol::deframe::Framing;
use protocol::dynamixel::{
    Dynamixel, Errors, Id, Instruction, InstructionReceiver, MAX_PACKET, Packet, Register,
};

use crate::plant::Ax12;
pub use end::{MasterEnd, MasterRx, MasterTx};

/// How long a servo is busy with a byte of EEPROM (facts: about 6 ms).
const EEPROM_BYTE_NS: u64 = 6_000_000;
/// The silence that ends an incomplete instruction. The facts do not say; 100 ms is what the maker
/// is known to have stated.
const BYTE_TIMEOUT_NS: u64 = 100_000_000;
/// The longest stall within an answer (facts).
const LONGEST_STALL_NS: u64 = 150_000;
/// What a collision does to a byte: nothing that begins a packet is left of it.
const COLLISION: u8 = 0x55;

/// What can go wrong, in parts of a million of the bytes between master and servos. The echo is not
/// among them: it does not leave the master's pin.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults {
    /// Bytes that are not heard.
    pub dropped_ppm: u32,
    /// Bytes of which one bit is heard wrong.
    pub flipped_ppm: u32,
    /// Bytes of an answer before which its servo stalls, for up to 150 us.
    pub stalled_ppm: u32,
}

/// What a bus is made of.
#[derive(Clone, Copy, Debug)]
pub struct Make {
    /// Bits a second, not 0. Servos adapt to it: their baud rate register changes nothing.
    pub baud: u32,
    /// The servos' own latency before an answer, besides their return delay.
    pub latency_us: u32,
    /// Whether the master hears itself, as on one wire; an adapter may keep that away from it.
    pub echo: bool,
    /// What goes wrong.
    pub faults: Faults,
    /// Seed of what goes wrong.
    pub seed: u64,
}

impl Default for Make {
    /// 1,000,000 baud, the latency of a real AX-12, echo, no faults.
    fn default() -> Self {
        Self { baud: 1_000_000, latency_us: 22, echo: true, faults: Faults::default(), seed: 1 }
    }
}

/// The bus. See the [module](self).
pub struct ServoBus {
    make: Make,
    byte_ns: u64,
    /// Until when it has run.
    now_ns: u64,
    master: VecDeque<Byte>,
    master_busy_ns: u64,
    sockets: Vec<Socket>,
    received: VecDeque<(u64, u8)>,
    rng: fastrand::Rng,
}

/// A byte on the wire, or soon to be.
#[derive(Clone, Copy)]
struct Byte {
    start_ns: u64,
    end_ns: u64,
    value: u8,
    collided: bool,
    /// Another byte was already on the wire: receivers did not see this one begin.
    unheard: bool,
}

/// A place for a servo.
struct Socket {
    servo: Ax12,
    plugged: bool,
    receiver: InstructionReceiver,
    last_byte_ns: u64,
    /// Until when it is deaf: it prepares an answer, sends it, or is busy with its EEPROM.
    busy_ns: u64,
    answer: VecDeque<Byte>,
}

impl ServoBus {
    /// A bus with these servos, all plugged in.
    pub fn new(make: Make, servos: impl IntoIterator<Item = Ax12>) -> Self {
        let sockets = servos.into_iter().map(|servo| Socket {
            servo,
            plugged: true,
            receiver: InstructionReceiver::new(),
            last_byte_ns: 0,
            busy_ns: 0,
            answer: VecDeque::new(),
        });
        Self {
            make,
            byte_ns: 10_000_000_000 / u64::from(make.baud),
            now_ns: 0,
            master: VecDeque::new(),
            master_busy_ns: 0,
            sockets: sockets.collect(),
            received: VecDeque::new(),
            rng: fastrand::Rng::with_seed(make.seed),
        }
    }

    /// The servos in their order, and whether they are plugged in.
    pub fn servos(&self) -> impl Iterator<Item = (&Ax12, bool)> {
        self.sockets.iter().map(|socket| (&socket.servo, socket.plugged))
    }

    /// One of the servos, plugged in or not.
    pub fn servo(&mut self, index: usize) -> &mut Ax12 {
        &mut self.sockets[index].servo
    }

    /// Changes what goes wrong from now on.
    pub fn set_faults(&mut self, faults: Faults) {
        self.make.faults = faults;
    }

    /// Pulls a servo's plug: from now on it says nothing. Its RAM is lost, see
    /// [`plug`](Self::plug).
    pub fn unplug(&mut self, index: usize) {
        let socket = &mut self.sockets[index];
        socket.plugged = false;
        socket.answer.clear();
    }

    /// Whether the master hears itself.
    pub fn has_echo(&self) -> bool {
        self.make.echo
    }

    /// Whether a servo has something to say, or is saying it.
    pub fn is_talking(&self, index: usize) -> bool {
        !self.sockets[index].answer.is_empty()
    }

    /// Plugs a servo in again: it has just been switched on.
    pub fn plug(&mut self, index: usize) {
        let socket = &mut self.sockets[index];
        if !socket.plugged {
            socket.plugged = true;
            socket.receiver = InstructionReceiver::new();
            socket.busy_ns = self.now_ns;
            socket.servo.power_on();
        }
    }

    /// The master sends: from `now_ns` on, or behind what it is still sending. Answers when the
    /// last stop bit has left.
    pub fn send(&mut self, now_ns: u64, bytes: &[u8]) -> u64 {
        self.master_busy_ns = self.master_busy_ns.max(now_ns);
        for &value in bytes {
            self.master.push_back(Byte::new(self.master_busy_ns, self.byte_ns, value));
            self.master_busy_ns += self.byte_ns;
        }
        self.master_busy_ns
    }

    /// How long a byte takes, in ns.
    pub fn byte_ns(&self) -> u64 {
        self.byte_ns
    }

    /// Until when the master is sending what it has been given so far.
    pub fn sending_until_ns(&self) -> u64 {
        self.master_busy_ns
    }

    /// The next byte that the master has heard, and when its last stop bit came.
    pub fn receive(&mut self) -> Option<(u64, u8)> {
        self.received.pop_front()
    }

    /// When the next byte that is already known of will have passed.
    pub fn next_ns(&self) -> Option<u64> {
        self.talkers().filter_map(VecDeque::front).map(|byte| byte.end_ns).min()
    }

    /// Lets time pass.
    pub fn advance_to(&mut self, now_ns: u64) {
        while let Some((talker, byte)) = self.pass_next(now_ns) {
            match talker {
                None => self.master_was_heard(byte),
                Some(_) => {
                    if let Some(value) = self.over_the_wire(byte) {
                        self.received.push_back((byte.end_ns, value));
                    }
                }
            }
        }
        self.now_ns = self.now_ns.max(now_ns);
        for socket in self.sockets.iter_mut().filter(|socket| socket.plugged) {
            socket.servo.advance_to(now_ns / 1_000_000);
        }
    }

    /// What everyone on the wire sends: the master, then the servos.
    fn talkers(&self) -> impl Iterator<Item = &VecDeque<Byte>> {
        std::iter::once(&self.master).chain(self.sockets.iter().map(|socket| &socket.answer))
    }

    /// Takes the byte that ends next, if it does until `now_ns`, and lets it collide with all that
    /// begin before. They end later, so each of them is still the first of its talker.
    fn pass_next(&mut self, now_ns: u64) -> Option<(Option<usize>, Byte)> {
        let ends = |talker: &VecDeque<Byte>| talker.front().map(|byte| byte.end_ns);
        let ends = self.talkers().map(ends).enumerate();
        let (end_ns, next) = ends.filter_map(|(talker, end)| Some((end?, talker))).min()?;
        if end_ns > now_ns {
            return None;
        }
        let answers = self.sockets.iter_mut().map(|socket| &mut socket.answer);
        let mut talkers: Vec<_> = std::iter::once(&mut self.master).chain(answers).collect();
        let mut byte = talkers[next].pop_front()?;
        for (talker, queue) in talkers.iter_mut().enumerate() {
            if let Some(other) = queue.front_mut()
                && talker != next
                && other.start_ns < byte.end_ns
            {
                byte.collided = true;
                other.collided = true;
                other.unheard |= !byte.unheard;
            }
        }
        Some((next.checked_sub(1), byte))
    }

    /// What is heard of a byte at the wire's other end.
    fn over_the_wire(&mut self, byte: Byte) -> Option<u8> {
        let faults = self.make.faults;
        let value = byte.heard()?;
        if self.strikes(faults.dropped_ppm) {
            return None;
        }
        let flipped = if self.strikes(faults.flipped_ppm) { 1 << self.rng.u8(..8) } else { 0 };
        Some(value ^ flipped)
    }

    /// Whether a fault of this rate strikes now.
    fn strikes(&mut self, ppm: u32) -> bool {
        ppm > 0 && self.rng.u32(..1_000_000) < ppm
    }

    /// A byte of the master has passed.
    fn master_was_heard(&mut self, byte: Byte) {
        if self.make.echo
            && let Some(value) = byte.heard()
        {
            self.received.push_back((byte.end_ns, value));
        }
        let Some(value) = self.over_the_wire(byte) else { return };
        for index in 0..self.sockets.len() {
            let socket = &mut self.sockets[index];
            if let Some(answer) = socket.hear(byte, value) {
                self.schedule(index, byte.end_ns, &answer);
            }
        }
    }

    /// Puts an answer on the wire, when the servo is ready for it.
    fn schedule(&mut self, index: usize, heard_ns: u64, packet: &[u8]) {
        let return_delay_us = 2 * u64::from(self.sockets[index].servo.get(Register::RETURN_DELAY));
        let mut at = heard_ns + 1000 * (return_delay_us + u64::from(self.make.latency_us));
        for &value in packet {
            if self.strikes(self.make.faults.stalled_ppm) {
                at += self.rng.u64(1..=LONGEST_STALL_NS);
            }
            self.sockets[index].answer.push_back(Byte::new(at, self.byte_ns, value));
            at += self.byte_ns;
        }
        let busy_ns = &mut self.sockets[index].busy_ns;
        *busy_ns = at.max(*busy_ns);
    }
}

impl Byte {
    fn new(start_ns: u64, byte_ns: u64, value: u8) -> Self {
        Self { start_ns, end_ns: start_ns + byte_ns, value, collided: false, unheard: false }
    }

    /// What receivers make of it.
    fn heard(&self) -> Option<u8> {
        let value = if self.collided { self.value ^ COLLISION } else { self.value };
        (!self.unheard).then_some(value)
    }
}

impl Socket {
    /// A byte of the master: `value` is what came of it. Answers the packet that the servo will
    /// send.
    fn hear(&mut self, byte: Byte, value: u8) -> Option<Vec<u8>> {
        if !self.plugged || byte.start_ns < self.busy_ns {
            self.receiver = InstructionReceiver::new();
            return None;
        }
        if byte.end_ns - self.last_byte_ns > BYTE_TIMEOUT_NS {
            self.receiver = InstructionReceiver::new();
        }
        self.last_byte_ns = byte.end_ns;
        let packet = self.receiver.receive(&mut &[value][..])?.to_vec();
        self.servo.advance_to(byte.end_ns / 1_000_000);
        self.execute(&packet, byte.end_ns)
    }

    /// Does what a packet says, and answers the servo's own packet.
    fn execute(&mut self, packet: &[u8], now_ns: u64) -> Option<Vec<u8>> {
        let own = Id::new(self.servo.id())?;
        let for_me = |id| id == own || id == Id::BROADCAST;
        let fields = Packet::parse(packet).filter(|packet| for_me(packet.id))?;
        let instruction = match Instruction::parse(fields) {
            _ if !Dynamixel::is_intact(packet) => Err(Errors::CHECKSUM),
            instruction => instruction.ok_or(Errors::INSTRUCTION),
        };
        // From what status return level on this is answered.
        let from_level = match instruction {
            Ok(Instruction::Ping) => 0,
            Ok(Instruction::Read { .. }) => 1,
            _ => 2,
        };
        let answered = from_level <= self.servo.get(Register::STATUS_RETURN_LEVEL)
            && (fields.id == own || instruction == Ok(Instruction::Ping));
        let mut params = vec![];
        let done = instruction.and_then(|instruction| match instruction {
            Instruction::Ping => Ok(0),
            Instruction::Read { address, count } => {
                self.servo.read(address, count).map(|bytes| params.extend(bytes)).map(|()| 0)
            }
            Instruction::Write { address, data } => self.servo.write(address, data),
            Instruction::RegWrite { address, data } => {
                self.servo.register_write(address, data).map(|()| 0)
            }
            Instruction::Action => self.servo.action(),
            Instruction::Reset => Ok(self.servo.reset()),
            Instruction::SyncWrite(list) => {
                let mine = list.servos().find(|(id, _)| *id == self.servo.id());
                mine.map_or(Ok(0), |(_, data)| self.servo.write(list.address(), data))
            }
        });
        let (eeprom_bytes, refusal) = match done {
            Ok(eeprom_bytes) => (eeprom_bytes, Errors::NONE),
            Err(refusal) => (0, refusal),
        };
        self.busy_ns = now_ns + EEPROM_BYTE_NS * eeprom_bytes as u64;
        let code = (self.servo.errors() | refusal).bits();
        let status = Packet { id: own, code, params: &params };
        let answer = status.encode(&mut [0; MAX_PACKET]).expect("registers fit a packet").to_vec();
        answered.then_some(answer)
    }
}
