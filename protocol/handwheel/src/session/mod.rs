//! A host's session without I/O: bytes and the time go in, bytes and events come out.
//!
//! Vocabulary: an *exchange* is something sent that wants an answer: a request of the extension, a command
//! that is acknowledged, a packet of ARCOS. One is under way at a time, the others wait; one that gets no
//! answer is sent again. A *sign of life* is what keeps a board's motors running.
//!
//! Promises:
//! - It writes nothing of itself but what was asked of it and, while [`drive`](Session::drive) is on, signs
//!   of life. Requests that only read are none.
//! - Which [`Personality`] is on the line it knows by what it hears, in a board's own frames; what could
//!   be noise is not taken for a board.
//! - Time is a [`Duration`] since anything, and never goes back. Everything is bounded by what is asked.

mod exchange;
mod greeting;
mod heard;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;
use std::time::Duration;

use protocol::arcos::{ArmCommand, Packet, Standard};
use protocol::cm5::{self, Feedback, Hello};
use protocol::extension::{Answer, Block, MachineState, Request};
use protocol::pms5005::{Command, Frame, MAX_FRAME, RES_NO_ACK, RID_HOST, Report, did};

pub use exchange::{Failure, Reply, Setting};
pub use greeting::{Greeting, HEAR};
pub use heard::Personality;

use exchange::{Exchange, Wants};
use heard::Ear;

/// The longest time between two signs of life; a board stops what moves after 2 s of silence unless its
/// setting 1 says otherwise.
pub const SIGN_OF_LIFE: Duration = Duration::from_millis(500);

/// How often a sign of life is due: four times in the silence that the board allows, in ms, if it is known;
/// 0 is any.
pub fn sign_of_life(link_timeout_ms: Option<i32>) -> Duration {
    match link_timeout_ms {
        Some(ms @ 1..) => {
            let quarter = Duration::from_millis(ms.unsigned_abs().into()) / 4;
            quarter.clamp(Duration::from_millis(10), SIGN_OF_LIFE)
        }
        _ => SIGN_OF_LIFE,
    }
}

/// Something that was heard.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// It is known what is on the line.
    Heard(Personality),
    /// Telemetry of a PMS5005.
    Report(Report),
    /// The machine state of a PMS5005, whoever has asked for it.
    State(MachineState),
    /// A block of the recording, whoever has asked for it.
    Block(Block),
    /// The exchange under way has its answer.
    Answered(Reply),
    /// It has none, or the board refuses.
    Failed(Failure),
    /// A robot's standard packet: a session of ARCOS is open.
    Standard(Standard),
    /// Another packet of ARCOS that nobody has asked for: its id and its data.
    Packet(u8, Vec<u8>),
    /// A CM-5 tells which servos there are.
    Servos(Vec<u8>),
    /// A CM-5 tells of its servos, `None` for one that does not answer.
    Feedback(Vec<Option<Feedback>>),
}

/// A host's end of a line. See the [module](self).
pub struct Session {
    ear: Ear,
    /// What is on the line, once it is known.
    personality: Option<Personality>,
    /// How many servos the CM-5 told of.
    servos: Option<usize>,
    exchanges: VecDeque<Exchange>,
    out: VecDeque<Vec<u8>>,
    events: VecDeque<Event>,
    /// How often a sign of life is due, and when the next one is.
    life: Option<(Duration, Duration)>,
    received: u64,
    frames: u64,
}

impl Session {
    /// A session that has heard nothing yet.
    pub fn new() -> Self {
        Self {
            ear: Ear::default(),
            personality: None,
            servos: None,
            exchanges: VecDeque::new(),
            out: VecDeque::new(),
            events: VecDeque::new(),
            life: None,
            received: 0,
            frames: 0,
        }
    }

    /// What is on the line, if it is known.
    pub fn personality(&self) -> Option<Personality> {
        self.personality
    }

    /// Bytes that have come so far.
    pub fn received(&self) -> u64 {
        self.received
    }

    /// Frames or packets of the board that have come so far.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Takes bytes that have come.
    pub fn receive(&mut self, bytes: &[u8]) {
        self.received += bytes.len() as u64;
        for (personality, frame) in self.ear.hear(bytes) {
            if self.personality.is_none() {
                self.personality = Some(personality);
                self.ear.listen_to(personality);
                self.events.push_back(Event::Heard(personality));
            }
            if self.personality == Some(personality) {
                self.frames += 1;
                match personality {
                    Personality::Pms5005 => self.receive_frame(&frame),
                    Personality::Arcos => self.receive_packet(&frame),
                    Personality::Cm5 => self.receive_cm5(&frame),
                }
            }
        }
    }

    /// What has to be written, if anything: one frame or packet (on UDP, one datagram).
    pub fn take_output(&mut self) -> Option<Vec<u8>> {
        self.out.pop_front()
    }

    /// The next thing that was heard.
    pub fn take_event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }

    /// Lets time pass: what has no answer is sent again or given up, and signs of life are sent.
    pub fn advance(&mut self, now: Duration) {
        if let Some(exchange) = self.exchanges.front_mut()
            && let Some(sent) = exchange.advance(now)
        {
            match sent {
                Ok(bytes) => self.out.push_back(bytes),
                Err(failure) => self.end(Event::Failed(failure), now),
            }
        }
        if let Some((period, due)) = self.life
            && now >= due
        {
            self.life = Some((period, now + period));
            self.send(&Command::Ping);
        }
    }

    /// Asks the board for what the extension offers, in its frames or in ARCOS packets.
    ///
    /// # Errors
    /// [`Failure::NotCarried`] if the line does not carry it.
    pub fn ask(&mut self, request: &Request<'_>, now: Duration) -> Result<(), Failure> {
        let personality = self.personality.ok_or(Failure::NotCarried)?;
        self.begin(Exchange::of_request(request, personality)?, now);
        Ok(())
    }

    /// Sends a command to a PMS5005, to be acknowledged.
    ///
    /// # Errors
    /// [`Failure::NotCarried`] for a value that has no form on the wire, or on another line.
    pub fn command(&mut self, command: &Command<'_>, now: Duration) -> Result<(), Failure> {
        if self.personality != Some(Personality::Pms5005) {
            return Err(Failure::NotCarried);
        }
        let mut buffer = [0; MAX_FRAME];
        let bytes = command.encode(0, &mut buffer).map_err(|_| Failure::NotCarried)?;
        self.begin(Exchange::new(bytes.to_vec(), Wants::Acknowledgement), now);
        Ok(())
    }

    /// Sends a packet of ARCOS that is answered by one with this id, or by nothing.
    ///
    /// # Errors
    /// [`Failure::NotCarried`] for a packet that is too long.
    pub fn packet(
        &mut self,
        packet: &Packet<'_>,
        answer: Option<u8>,
        now: Duration,
    ) -> Result<(), Failure> {
        let mut buffer = [0; MAX_FRAME];
        let bytes = packet.encode(&mut buffer).map_err(|_| Failure::NotCarried)?;
        self.carry(bytes.to_vec(), answer, now);
        Ok(())
    }

    /// Sends a command to a Pioneer Arm, in the same way.
    ///
    /// # Errors
    /// [`Failure::NotCarried`] for a value that has no form on the wire.
    pub fn arm(
        &mut self,
        command: ArmCommand,
        answer: Option<u8>,
        now: Duration,
    ) -> Result<(), Failure> {
        let mut buffer = [0; MAX_FRAME];
        let bytes = command.encode(&mut buffer).map_err(|_| Failure::NotCarried)?;
        self.carry(bytes.to_vec(), answer, now);
        Ok(())
    }

    fn carry(&mut self, bytes: Vec<u8>, answer: Option<u8>, now: Duration) {
        match answer {
            Some(id) => self.begin(Exchange::new(bytes, Wants::Packet(id)), now),
            None => self.out.push_back(bytes),
        }
    }

    /// Sends a command that wants no acknowledgement.
    pub fn send(&mut self, command: &Command<'_>) {
        let mut buffer = [0; MAX_FRAME];
        if let Ok(bytes) = command.encode(RES_NO_ACK, &mut buffer) {
            self.out.push_back(bytes.to_vec());
        }
    }

    /// Sends bytes as they are: one frame or packet.
    pub fn say(&mut self, bytes: Vec<u8>) {
        self.out.push_back(bytes);
    }

    /// Whether signs of life are sent, and how often. The caller's own commands are some too.
    pub fn drive(&mut self, period: Option<Duration>, now: Duration) {
        self.life = period.map(|period| (period, now + period));
    }

    /// Takes back the exchange at this place of those that have no answer yet. If it was sent, its answer may
    /// still come, and be taken for the next one's.
    pub fn withdraw(&mut self, place: usize) {
        self.exchanges.remove(place);
    }

    /// Forgets what has not been answered or sent: something more urgent is to be said.
    pub fn forget(&mut self) {
        self.exchanges.clear();
        self.out.clear();
        // What came of it meanwhile is not to be taken for what comes of the next.
        self.events.retain(|event| !matches!(event, Event::Answered(_) | Event::Failed(_)));
    }

    fn begin(&mut self, exchange: Exchange, now: Duration) {
        self.exchanges.push_back(exchange);
        if self.exchanges.len() == 1 {
            self.advance(now);
        }
    }

    /// The exchange under way is over.
    fn end(&mut self, event: Event, now: Duration) {
        self.exchanges.pop_front();
        self.events.push_back(event);
        if !self.exchanges.is_empty() {
            self.advance(now);
        }
    }

    fn is_wanted(&mut self, reply: &Wants) -> bool {
        self.exchanges.front().is_some_and(|exchange| exchange.wants == *reply)
    }

    fn receive_frame(&mut self, bytes: &[u8]) {
        let Some(frame) = Frame::parse(bytes) else { return };
        if frame.rid != RID_HOST {
            return;
        }
        if let Some(report) = Report::parse(frame.did, frame.data) {
            self.events.push_back(Event::Report(report));
        } else if let Some(answer) = Answer::parse(frame.did, frame.data) {
            self.receive_answer(&answer);
        } else if (frame.did, frame.data) == (did::SETUP, &[1])
            && self.is_wanted(&Wants::Acknowledgement)
        {
            self.answered(Reply::Done);
        }
    }

    fn receive_answer(&mut self, answer: &Answer<'_>) {
        match answer {
            Answer::State(state) => self.events.push_back(Event::State(*state)),
            Answer::Block(block) => self.events.push_back(Event::Block(*block)),
            _ => {}
        }
        let verdict = self.exchanges.front_mut().and_then(|exchange| exchange.judge(answer));
        match verdict {
            None => {}
            Some(Ok(reply)) => self.answered(reply),
            Some(Err(failure)) => {
                self.exchanges.pop_front();
                self.events.push_back(Event::Failed(failure));
            }
        }
    }

    /// The next exchange begins when time is told.
    fn answered(&mut self, reply: Reply) {
        self.exchanges.pop_front();
        self.events.push_back(Event::Answered(reply));
    }

    fn receive_packet(&mut self, bytes: &[u8]) {
        let Some(packet) = Packet::parse(bytes) else { return };
        if let Some(standard) = Standard::parse(&packet) {
            self.events.push_back(Event::Standard(standard));
        }
        if self.is_wanted(&Wants::Packet(packet.id)) {
            self.answered(Reply::Packet(packet.id, packet.data.to_vec()));
        } else if let Some(answer) = Answer::parse(packet.id, packet.data) {
            self.receive_answer(&answer);
        } else if packet.id != Standard::ID {
            self.events.push_back(Event::Packet(packet.id, packet.data.to_vec()));
        }
    }

    fn receive_cm5(&mut self, bytes: &[u8]) {
        let Some(params) = cm5::params_of(bytes) else { return };
        let report = self.servos.and_then(|servos| cm5::Report::parse(params, servos));
        if let Some(report) = report {
            self.events.push_back(Event::Feedback(report.iter().collect()));
        } else if let Some(hello) = Hello::parse(params) {
            self.servos = Some(hello.ids.len());
            self.events.push_back(Event::Servos(hello.ids.to_vec()));
        }
    }
}

impl Default for Session {
    fn default() -> Self {
        Self::new()
    }
}
