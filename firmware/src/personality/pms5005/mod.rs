//! The PMS5005's session with its host.
//!
//! Frames to send are pulled whenever the line is free, not queued, which keeps the transmit side
//! bounded: acknowledgements are all alike, so the queue of them is a number, and telemetry is
//! made when it is sent, from what is true then.
//!
//! Rules (facts and manual section III):
//! - every intact frame for us is acknowledged unless its reserved byte is 255; 255/1, which may
//!   be a host's acknowledgement, at most once in [`PING_ANSWER_PERIOD`];
//! - acknowledgements go before telemetry;
//! - telemetry that could not be sent before its next turn is skipped and counted, not queued;
//!   the three reports take turns, so that none starves;
//! - the host hears from us at least once a second: telemetry, or a ping;
//! - any intact frame is a sign of life of the host, those for other devices too, but what comes from a
//!   board (RID 0: an echo of our own) and what only asks to be told something;
//! - what the extension is asked for goes behind acknowledgements, before telemetry; blocks of a recording
//!   go when nothing else is due, and take their turn among reports that fill the line.

mod translate;

use embassy_time::{Duration, Instant};
/// What a session has counted; what the controller counts stays 0 here.
pub use protocol::extension::Counters as LinkCounters;
use protocol::extension::{Outcome, Request, Verdict, is_read};
use protocol::pms5005::{
    self as wire, ACK, Frame, PING, RES_NO_ACK, RID_HOST, RID_PMS5005, Refusal, Repeat, Report,
    Reports, did, encode_answer,
};

use super::extension::{Boot, Extension, Owed, Stream, block};
use super::{Effect, MAX_FRAME, Picture, Session, TimedReceiver, UpkeepRefused, View, count};
use crate::command::Command;
use crate::controller::Snapshot;
use crate::fmt::warning;
use crate::settings::Settings;
use translate::{motion, report, scope, with_parameters};

/// 255/1 is answered at most this often.
pub const PING_ANSWER_PERIOD: Duration = Duration::from_millis(200);
/// Without telemetry we send a ping this often; hosts give up after 2 s, and want to hear from us
/// every second.
pub const PING_PERIOD: Duration = Duration::from_millis(900);
/// Acknowledgements that may wait. They take a second at 115200 baud, half of what a host waits
/// for any frame at all; more of them are dropped.
const ACKS_WAITING: u16 = 1152;

/// A PMS5005 as its host sees it. See the [module](self).
pub struct Pms5005 {
    receiver: TimedReceiver<wire::Pms5005, { wire::MAX_FRAME }>,
    /// Apart from the receiver, because a frame borrows that while it is answered.
    answers: Answers,
}

/// What a session owes its host.
struct Answers {
    extension: Extension,
    /// In the order of [`TOPICS`].
    streams: [Stream; TOPICS.len()],
    /// The stream whose turn it is; behind the last it is a block's of the recording, then the first's.
    turn: usize,
    acks_waiting: u16,
    ping_answered: Option<Instant>,
    /// Counts frames that show that a host is there. It wraps.
    signs_of_life: u32,
    /// When the host last heard telemetry or a ping.
    spoke: Instant,
    /// What the last telemetry was about.
    moment: Moment,
    counters: LinkCounters,
}

/// A snapshot, when it was taken, and when the reports were due that tell of it.
struct Moment {
    due: Instant,
    taken: Instant,
    snapshot: Snapshot,
}

/// What a stream is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Topic {
    Telemetry(Reports),
    Health,
    State,
}

const TOPICS: [Topic; 5] = [
    Topic::Telemetry(Reports::Motors),
    Topic::Telemetry(Reports::CustomIo),
    Topic::Telemetry(Reports::Sensors),
    Topic::Health,
    Topic::State,
];

const _: () = assert!(Report::MAX_FRAME <= MAX_FRAME && wire::MAX_ANSWER <= MAX_FRAME);

impl Pms5005 {
    /// A session at boot: "it will keep sending all sensor data to the host" (section III). It
    /// begins after one period, when there is something to tell.
    pub fn new(settings: Settings, boot: Boot, now: Instant) -> Self {
        let extension = Extension::new(settings, boot, now);
        let due = now.saturating_add(telemetry_period(&settings));
        let streams = TOPICS.map(|topic| match topic {
            Topic::Telemetry(_) => Stream { repeat: Repeat::Continuous, due },
            Topic::Health | Topic::State => Stream { repeat: Repeat::Stop, due },
        });
        Self {
            receiver: TimedReceiver::new(),
            answers: Answers {
                extension,
                streams,
                turn: 0,
                acks_waiting: 0,
                ping_answered: None,
                signs_of_life: 0,
                spoke: now,
                moment: Moment { due: Instant::MIN, taken: now, snapshot: Snapshot::BOOT },
                counters: LinkCounters::default(),
            },
        }
    }
}

impl Session for Pms5005 {
    type Counters = LinkCounters;

    fn receive(&mut self, bytes: &mut &[u8], now: Instant) -> Option<Effect> {
        loop {
            let frame = self.receiver.receive(bytes, now)?;
            if let Some(request) = self.answers.respond(frame, now) {
                return Some(request);
            }
        }
    }

    fn settings(&self) -> &Settings {
        self.answers.extension.settings()
    }

    fn to_save(&self) -> &Settings {
        self.answers.extension.to_save()
    }

    fn advance(&mut self, now: Instant, snapshot: impl FnOnce() -> Snapshot) -> Option<Effect> {
        if self.answers.extension.looks_at()? <= now {
            let answer = self.answers.extension.look(now, &snapshot());
            self.answers.settle(answer);
        }
        None
    }

    fn wakes_at(&self) -> Option<Instant> {
        let times = [self.receiver.gives_up_at(), self.answers.extension.looks_at()];
        times.into_iter().flatten().min()
    }

    fn transmit<'b>(
        &mut self,
        now: Instant,
        board: &impl View,
        out: &'b mut [u8; MAX_FRAME],
    ) -> Option<&'b [u8]> {
        let due = self.answers.next(now)?;
        let extension = &self.answers.extension;
        let frame = match due {
            Due::Ack => return Some(&ACK),
            Due::Ping => PING.encode(out),
            Due::Stream(Topic::Telemetry(reports), due) => {
                report(reports, self.answers.moment(due, now, board)).encode(out)
            }
            Due::Stream(Topic::State, _) => {
                let refused = self.answers.counters.refused;
                encode_answer(&extension.state(now, &board.snapshot(), refused), out)
            }
            Due::Stream(Topic::Health, _) => {
                encode_answer(&extension.health(now, &board.snapshot()), out)
            }
            Due::Answer(owed) => {
                encode_answer(&extension.answer(owed, board, || self.counters())?, out)
            }
            Due::Block(number) => encode_answer(&block(number, board), out),
        };
        frame.ok().map(|frame| &*frame)
    }

    fn upkeep_done(&mut self, result: Result<(), UpkeepRefused>) -> Option<Effect> {
        let (answer, request) = self.answers.extension.done(result);
        self.answers.settle(answer);
        request
    }

    fn sends_at(&self) -> Instant {
        self.answers.due_at()
    }

    fn line_failed(&mut self) {
        count(&mut self.answers.counters.line_errors, 1);
    }

    fn picture_dropped(&mut self) {
        count(&mut self.answers.counters.pictures_dropped, 1);
    }

    fn counters(&self) -> LinkCounters {
        self.receiver.counted(self.answers.counters)
    }

    fn signs_of_life(&self) -> u32 {
        self.answers.signs_of_life
    }
}

/// What a session says.
enum Due {
    Ack,
    Answer(Owed),
    /// What it is about, and when it was due.
    Stream(Topic, Instant),
    /// A block of the recording.
    Block(u16),
    Ping,
}

impl Answers {
    fn due_at(&self) -> Instant {
        if self.acks_waiting > 0 || self.extension.owes() || self.extension.has_blocks() {
            return Instant::MIN;
        }
        let ping = self.spoke.saturating_add(PING_PERIOD);
        self.streams.iter().filter_map(Stream::due_at).fold(ping, Instant::min)
    }

    /// What is to be said first, if anything; it counts as said.
    fn next(&mut self, now: Instant) -> Option<Due> {
        if let Some(waiting) = self.acks_waiting.checked_sub(1) {
            self.acks_waiting = waiting;
            count(&mut self.counters.acks_sent, 1);
            Some(Due::Ack)
        } else if let Some(owed) = self.extension.next() {
            count(&mut self.counters.answers_sent, 1);
            Some(Due::Answer(owed))
        } else if let Some(due) = self.next_turn(now) {
            self.spoke = now;
            Some(due)
        } else if now >= self.spoke.saturating_add(PING_PERIOD) {
            self.spoke = now;
            count(&mut self.counters.pings_sent, 1);
            Some(Due::Ping)
        } else {
            None
        }
    }

    /// What telemetry that was due then tells: reports that were due together, as those that one frame
    /// has asked for, tell of one moment. Unless that is a telemetry period ago.
    fn moment(&mut self, due: Instant, now: Instant, board: &impl View) -> &Snapshot {
        let fresh = now.checked_sub(telemetry_period(self.extension.settings()));
        if self.moment.due != due || fresh.is_some_and(|fresh| self.moment.taken <= fresh) {
            self.moment = Moment { due, taken: now, snapshot: board.snapshot() };
        }
        &self.moment.snapshot
    }

    /// What has its turn now: a stream that is due, or a block of the recording.
    fn next_turn(&mut self, now: Instant) -> Option<Due> {
        let is_due = |&turn: &usize| match self.streams.get(turn) {
            Some(stream) => stream.due_at().is_some_and(|at| at <= now),
            None => self.extension.has_blocks(),
        };
        let turn = (self.turn..=TOPICS.len()).chain(0..self.turn).find(is_due)?;
        self.turn = turn + 1;
        let Some(&topic) = TOPICS.get(turn) else {
            count(&mut self.counters.answers_sent, 1);
            return self.extension.next_block().map(Due::Block);
        };
        count(&mut self.counters.telemetry_sent, 1);
        Some(Due::Stream(topic, self.told(topic, turn, now)?))
    }

    /// Moves a stream on to its next period, past those that it has missed; since when it was due.
    fn told(&mut self, topic: Topic, turn: usize, now: Instant) -> Option<Instant> {
        let period = topic.period(self.extension.settings()).as_ticks() as u32; // 60 s at most
        let stream = self.streams.get_mut(turn)?;
        let due = stream.due;
        // 32 bits are over an hour; a line that was blocked for longer takes up a new rhythm.
        let late = u32::try_from(now.saturating_duration_since(due).as_ticks()).unwrap_or(u32::MAX);
        count(&mut self.counters.telemetry_skipped, late / period);
        let next = Duration::from_ticks((period - late % period).into());
        stream.told(now.saturating_add(next));
        Some(due)
    }

    /// Does what an intact frame asks of the session, and yields what it asks of the board.
    fn respond(&mut self, frame: &[u8], now: Instant) -> Option<Effect> {
        let frame = Frame::parse(frame)?;
        if frame.rid != RID_HOST && !is_read(frame.did) {
            count(&mut self.signs_of_life, 1);
        }
        if frame.rid != RID_PMS5005 {
            count(&mut self.counters.not_for_us, 1);
            return None;
        }
        count(&mut self.counters.frames_for_us, 1);
        let command = wire::Command::parse(frame.did, frame.data);
        if frame.res != RES_NO_ACK {
            self.acknowledge(command == Ok(wire::Command::PingOrAck), now);
        }
        if let Err(Refusal::Extension(verdict)) = command {
            let outcome = Outcome::of(frame.did, frame.data, verdict);
            self.extension.owe(Owed::Outcome(outcome), &mut self.counters);
        }
        match command {
            Ok(command) => self.carry_out(command, now),
            Err(unknown @ (Refusal::UnknownDid(_) | Refusal::Extension(Verdict::Unknown)))
                if frame.did != did::PARAMETERS =>
            {
                count(&mut self.counters.unknown, 1);
                warning!("frame ignored: {}", unknown);
                None
            }
            Err(refusal) => {
                count(&mut self.counters.refused, 1);
                self.count_refusal(refusal);
                warning!("frame not carried out: {}", refusal);
                None
            }
        }
    }

    /// Counts a frame that was refused, by reason.
    fn count_refusal(&mut self, refusal: Refusal) {
        let refusals = &mut self.extension.refusals;
        let counter = match refusal {
            Refusal::Extension(verdict) => return self.extension.refuse(verdict),
            Refusal::Length { .. } => &mut refusals.length,
            Refusal::NoSuchChannel(_) | Refusal::RepeatedChannel(_) => &mut refusals.channel,
            Refusal::Value { .. } => &mut refusals.value,
            // A DID that is not known is counted as such.
            Refusal::UnknownDid(_) | Refusal::UnknownSubCommand(_) => &mut refusals.sub_command,
        };
        count(counter, 1);
    }

    /// Queues an acknowledgement, unless the frame may be one itself and another such frame was
    /// answered just now.
    fn acknowledge(&mut self, may_be_an_ack: bool, now: Instant) {
        if may_be_an_ack {
            let is_answered = |at: Instant| now < at.saturating_add(PING_ANSWER_PERIOD);
            if self.ping_answered.is_some_and(is_answered) {
                return;
            }
            self.ping_answered = Some(now);
        }
        if self.acks_waiting < ACKS_WAITING {
            self.acks_waiting += 1;
        } else {
            count(&mut self.counters.acks_dropped, 1);
        }
    }

    /// Does what a command asks of the session. Apart: an acknowledgement must not wait for what
    /// only commands need.
    #[inline(never)]
    fn carry_out(&mut self, command: wire::Command<'_>, now: Instant) -> Option<Effect> {
        let control = |command| Some(Effect::Control(command));
        match command {
            wire::Command::Move(command) => control(motion(&command)),
            wire::Command::Parameters(parameters) => {
                let settings = with_parameters(self.extension.settings(), parameters);
                if settings.check().is_err() {
                    count(&mut self.counters.refused, 1);
                    self.extension.refuse(Verdict::Contradiction);
                    warning!("frame not carried out: a channel has no such sensor");
                    return None;
                }
                Some(self.extension.force(settings))
            }
            wire::Command::GpioOutputs(outputs) => control(Command::Gpio(outputs)),
            wire::Command::Lcd(frame) => {
                Some(Effect::Show(Picture { number: frame.number, columns: *frame.columns }))
            }
            wire::Command::Run { scope: whom, run } => {
                control(Command::Run { scope: scope(whom), run })
            }
            wire::Command::Telemetry { reports, repeat } => {
                let asked = |topic| match topic {
                    Topic::Telemetry(of) => reports == of || reports == Reports::All,
                    Topic::Health | Topic::State => false,
                };
                self.stream(asked, repeat, now);
                None
            }
            wire::Command::Extension(Request::Health(repeat)) => {
                self.stream(|topic| topic == Topic::Health, repeat, now);
                None
            }
            wire::Command::Extension(Request::State(repeat)) => {
                self.stream(|topic| topic == Topic::State, repeat, now);
                None
            }
            wire::Command::Extension(request) => {
                let (answer, request) = self.extension.respond(request, now);
                self.settle(answer);
                self.hasten(now);
                request
            }
            wire::Command::PingOrAck | wire::Command::Ping => None,
        }
    }

    /// Starts or stops the streams that one frame asks for, which are due together from then on.
    fn stream(&mut self, asked: impl Fn(Topic) -> bool, repeat: Repeat, now: Instant) {
        let mut due = Instant::MIN;
        for (stream, _) in self.streams.iter_mut().zip(TOPICS).filter(|(_, of)| asked(*of)) {
            stream.ask(repeat, now);
            due = due.max(stream.due);
        }
        for (stream, _) in self.streams.iter_mut().zip(TOPICS).filter(|(_, of)| asked(*of)) {
            stream.due = due;
        }
    }

    /// Brings the streams forward to a period that may have become shorter.
    fn hasten(&mut self, now: Instant) {
        for (stream, topic) in self.streams.iter_mut().zip(TOPICS) {
            let latest = now.saturating_add(topic.period(self.extension.settings()));
            stream.due = stream.due.min(latest);
        }
    }

    /// Notes what is to be answered, if anything.
    fn settle(&mut self, answer: Option<Owed>) {
        self.extension.settle(answer, &mut self.counters);
    }
}

impl Topic {
    /// How often it is told.
    fn period(self, settings: &Settings) -> Duration {
        match self {
            Self::Telemetry(_) | Self::Health => telemetry_period(settings),
            Self::State => Duration::from_millis(settings.link.state_period_ms.max(1).into()),
        }
    }
}

fn telemetry_period(settings: &Settings) -> Duration {
    Duration::from_millis(settings.link.telemetry_period_ms.max(1).into())
}
