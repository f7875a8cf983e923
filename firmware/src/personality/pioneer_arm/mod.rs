//! The Pioneer Arm's session with its host.
//!
//! ```text
//!  bytes -> TimedReceiver -> session (SYNC, OPEN, PULSE, CLOSE) -> Arm -> Joints -> Command
//!  bytes <-                  SYNC answers, SIPs                 <- Arm
//! ```
//!
//! Answers are pulled whenever the line is free and made from what is true then, so nothing is
//! queued: what is owed is a few flags.
//!
//! Rules (facts, "Session"):
//! - SYNC0, SYNC1 and SYNC2 are answered in this order only; each may be repeated, and SYNC0
//!   begins anew. A packet that is out of turn is counted and has no answer;
//! - in an open session 0 is PULSE, 1 is OPEN and 2 is CLOSE. A host that is restarted within 2 s of
//!   its last packet therefore has no answer to SYNC0, only standard packets. It must send CLOSE (or
//!   be silent for 2 s), and SYNC0 then;
//! - between OPEN and CLOSE a standard information packet comes every 100 ms, the first at once,
//!   whether the host speaks or not: some wait for one before they speak;
//! - 2 s without an intact packet stop the joints that move where they are, and they hold. Nothing
//!   else ends: AUTOPARK parks the arm. What goes home to be switched off goes on, since to hold it
//!   half way would keep the power on that the host wanted off;
//! - after these 2 s a 0 may be PULSE or SYNC0, so it is echoed and the session goes on. A 1 without
//!   an argument behind it, with nothing but 0s between, is SYNC1 and begins a new session: the arm
//!   holds as it is, times and requests of the old session are forgotten. Any other packet
//!   settles that it was PULSE;
//! - STATUS 1 and 2 are answered at once by an ARMpac; 2 then brings one before every standard
//!   packet. The latest STATUS counts: 1 ends a stream too;
//! - CLOSE ends the session: the arm goes home slowly and its power goes off. A handshake that is not
//!   finished is forgotten after 2 s;
//! - the board's own settings, health and faults are the extension's: answered behind all others,
//!   and forgotten when the session ends. Health comes at once, and then once a cycle;
//! - commands of the robot's base (motors, sonar, configuration) are counted and have no effect:
//!   there is no base.

mod arm;
mod counters;
mod joint;

use embassy_time::{Duration, Instant};
use protocol::arcos::{
    Arcos, Argument, ArmCommand, Dialect, MAX_RECEIVED, MotionBits, Names, Packet, Refusal, SYNC,
    Standard, StatusRequest, command, extension,
};
use protocol::extension::{Outcome, Request};
use protocol::pms5005::Repeat;

use super::extension::{Boot, Extension, Owed, Stream};
use super::{Effect, MAX_FRAME, Session, TimedReceiver, UpkeepRefused, View, count};
use crate::controller::Snapshot;
use crate::fmt::warning;
use crate::settings::Settings;
use arm::{Arm, Seen};
pub use counters::ArmCounters;
use joint::Limited;

/// How often a standard information packet comes.
pub const CYCLE: Duration = Duration::from_millis(100);
/// The silence that stops the joints.
pub const WATCHDOG: Duration = Duration::from_millis(2000);
/// The input that tells that the arm is connected: low. Inputs are pulled up, so that a cut cable
/// reads as no arm.
const ARM_LINE: u8 = 1 << 0;

const _: () = assert!(extension::MAX_ANSWER <= MAX_FRAME);

/// What satisfies hosts: they choose their parameters by class and subclass.
const NAMES: Names<'static> = Names { name: "Open arm", class: "Pioneer", subclass: "p3dx" };

/// Where the session stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// No host.
    Closed,
    /// The last SYNC was this one; after SYNC2 OPEN may come.
    Synchronised(u8),
    Open(Host),
}

/// What an open session has heard of its host lately.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Host {
    Speaks,
    /// Nothing for [`WATCHDOG`].
    Silent,
    /// 0s after such a silence, and nothing else.
    MaySynchronise,
}

/// A Pioneer Arm as its host sees it. See the [module](self).
pub struct PioneerArm {
    receiver: TimedReceiver<Arcos, MAX_RECEIVED>,
    /// Apart from the receiver, because a packet borrows that while it is answered.
    answers: Answers,
}

/// What a session owes its host.
struct Answers {
    /// What the settings were at the start, or what goes before them.
    dialect: Dialect,
    arm: Arm,
    extension: Extension,
    health: Stream,
    phase: Phase,
    /// When the last intact packet came.
    heard: Instant,
    /// SYNCs that wait for their answers: bit n is SYNCn.
    syncs: u8,
    info: bool,
    /// When an ARMpac is due.
    status_at: Option<Instant>,
    stream: bool,
    /// An ARMpac has been sent since the last standard packet: now others go first, so that no
    /// flood of STATUS keeps them from the line.
    status_said: bool,
    /// When the next standard packet is due.
    cycle_at: Instant,
    counters: ArmCounters,
}

impl PioneerArm {
    /// A session at boot.
    pub fn new(settings: Settings, boot: Boot, now: Instant) -> Self {
        Self {
            receiver: TimedReceiver::new(),
            answers: Answers {
                dialect: dialect(settings.arm.dialect),
                arm: Arm::new(settings.arm, now),
                extension: Extension::new(settings, boot, now),
                health: Stream { repeat: Repeat::Stop, due: now },
                phase: Phase::Closed,
                heard: now,
                syncs: 0,
                info: false,
                status_at: None,
                stream: false,
                status_said: false,
                cycle_at: now,
                counters: ArmCounters::default(),
            },
        }
    }

    /// The same session, but it tells the arm's state in this dialect, whatever the settings say.
    /// They stay as they are, and so are saved.
    pub fn with_dialect(mut self, dialect: Dialect) -> Self {
        self.answers.dialect = dialect;
        self
    }
}

/// The dialect that setting 112 stands for.
fn dialect(setting: u8) -> Dialect {
    match setting {
        1 => Dialect::Manual(MotionBits::ZeroToFive),
        2 => Dialect::Aria,
        _ => Dialect::Manual(MotionBits::OneToSix),
    }
}

impl Session for PioneerArm {
    type Counters = ArmCounters;

    fn receive(&mut self, bytes: &mut &[u8], now: Instant) -> Option<Effect> {
        // What the arm asks of the board is `advance`'s to tell.
        loop {
            let packet = self.receiver.receive(bytes, now)?;
            if let Some(packet) = Packet::parse(packet)
                && let Some(request) = self.answers.respond(&packet, now)
            {
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
        if self.answers.wakes_at() > now {
            return None;
        }
        let snapshot = snapshot();
        self.answers.watch(now);
        let told = self.answers.extension.look(now, &snapshot);
        self.answers.settle(told);
        let seen = Seen {
            present: snapshot.sensors.gpio_in & ARM_LINE == 0,
            stopped: snapshot.faults.stops_servos(),
            has_pulses: snapshot.outputs.servos.iter().all(Option::is_some),
            is_held: self.answers.extension.is_busy(),
            pulses: snapshot.servos,
        };
        self.answers.arm.advance(now, seen).map(Effect::Control)
    }

    fn wakes_at(&self) -> Option<Instant> {
        let wakes_at = self.answers.wakes_at();
        Some(self.receiver.gives_up_at().map_or(wakes_at, |at| at.min(wakes_at)))
    }

    fn transmit<'b>(
        &mut self,
        now: Instant,
        board: &impl View,
        out: &'b mut [u8; MAX_FRAME],
    ) -> Option<&'b [u8]> {
        let due = self.answers.next(now)?;
        let Answers { arm, extension, .. } = &self.answers;
        let packet = match due {
            Due::Sync2 => NAMES.encode(out),
            Due::Echo(packet) => packet.encode(out),
            Due::Status => {
                let Answers { dialect, arm, .. } = &mut self.answers;
                arm.look(now, &board.snapshot().servos);
                arm.status().encode(*dialect, out)
            }
            Due::Info => arm.info().encode(out),
            Due::Standard => standard(&board.snapshot()).encode(out),
            Due::Health => extension::encode_answer(&extension.health(now, &board.snapshot()), out),
            Due::Owed(owed) => {
                let counters = || self.counters().told();
                extension::encode_answer(&extension.answer(owed, board, counters)?, out)
            }
        };
        packet.ok().map(|packet| &*packet)
    }

    fn sends_at(&self) -> Instant {
        self.answers.due_at()
    }

    fn upkeep_done(&mut self, result: Result<(), UpkeepRefused>) -> Option<Effect> {
        let (answer, request) = self.answers.extension.done(result);
        self.answers.settle(answer);
        request
    }

    fn line_failed(&mut self) {
        count(&mut self.answers.counters.link.line_errors, 1);
    }

    fn counters(&self) -> ArmCounters {
        ArmCounters {
            link: self.receiver.counted(self.answers.counters.link),
            arms_lost: self.answers.arm.lost,
            power_lost: self.answers.arm.power_lost,
            arm: self.answers.arm.status(),
            ..self.answers.counters
        }
    }

    fn signs_of_life(&self) -> u32 {
        self.receiver.reception().frames_ok
    }
}

/// What a session says.
enum Due {
    Echo(Packet<'static>),
    Sync2,
    Status,
    Info,
    Standard,
    Health,
    Owed(Owed),
}

impl Answers {
    fn due_at(&self) -> Instant {
        match self.phase {
            _ if self.syncs != 0 => Instant::MIN,
            Phase::Open(_) if self.info || self.extension.owes() => Instant::MIN,
            Phase::Open(_) => {
                let others = [self.status_at, self.health.due_at()];
                others.into_iter().flatten().fold(self.cycle_at, Instant::min)
            }
            Phase::Closed | Phase::Synchronised(_) => Instant::MAX,
        }
    }

    /// What is to be said first, if anything; it counts as said.
    fn next(&mut self, now: Instant) -> Option<Due> {
        let is_open = matches!(self.phase, Phase::Open(_));
        // So that no flood of 0s keeps a standard packet from the line.
        let standard_is_first = is_open && now >= self.cycle_at;
        if self.syncs != 0 && !standard_is_first {
            let first = self.syncs.trailing_zeros();
            self.syncs &= self.syncs - 1;
            return Some(match SYNC.get(first as usize) {
                Some(echo) if first < 2 => Due::Echo(*echo),
                _ => Due::Sync2,
            });
        }
        if !is_open {
            return None;
        }
        let status_is_due = self.status_at.is_some_and(|at| at <= now);
        if status_is_due && !self.status_said {
            return Some(self.say_status());
        }
        if now >= self.cycle_at {
            return Some(self.say_standard(now));
        }
        if core::mem::take(&mut self.info) {
            return Some(Due::Info);
        }
        if self.health.due_at().is_some_and(|at| at <= now) {
            self.health.told(self.cycle_at);
            return Some(Due::Health);
        }
        if let Some(owed) = self.extension.next() {
            // So that no flood of questions keeps an ARMpac from the line.
            self.status_said = false;
            count(&mut self.counters.link.answers_sent, 1);
            return Some(Due::Owed(owed));
        }
        status_is_due.then(|| self.say_status())
    }

    fn say_status(&mut self) -> Due {
        self.status_at = None;
        self.status_said = true;
        Due::Status
    }

    /// The standard packet of this cycle; the next is that of the next cycle that is not over.
    fn say_standard(&mut self, now: Instant) -> Due {
        let missed = now.saturating_duration_since(self.cycle_at).as_ticks() / CYCLE.as_ticks();
        let cycles = Duration::from_ticks((missed + 1) * CYCLE.as_ticks());
        self.cycle_at = self.cycle_at.saturating_add(cycles);
        self.status_said = false;
        if self.stream {
            self.status_at = Some(self.cycle_at);
        }
        count(&mut self.counters.link.telemetry_sent, 1);
        count(&mut self.counters.link.telemetry_skipped, missed as u32); // wraps, as documented
        Due::Standard
    }

    /// When time alone asks for something.
    fn wakes_at(&self) -> Instant {
        let times = [self.silent_at(), self.extension.looks_at()];
        times.into_iter().flatten().fold(self.arm.wakes_at(), Instant::min)
    }

    /// When the host will have been silent for too long.
    fn silent_at(&self) -> Option<Instant> {
        let is_awaited = !matches!(self.phase, Phase::Closed | Phase::Open(Host::Silent));
        is_awaited.then(|| self.heard.saturating_add(WATCHDOG))
    }

    /// Does what the silence of a host asks for.
    fn watch(&mut self, now: Instant) {
        if self.silent_at().is_none_or(|at| now < at) {
            return;
        }
        if let Phase::Open(_) = self.phase {
            self.phase = Phase::Open(Host::Silent);
            self.arm.hold();
            count(&mut self.counters.watchdogs, 1);
            warning!("the host is silent: {} ms", WATCHDOG.as_millis());
        } else {
            self.phase = Phase::Closed;
            self.syncs = 0;
        }
    }

    /// A session is over, or another one begins: what it was owed is forgotten.
    fn forget(&mut self) {
        self.syncs = 0;
        self.info = false;
        self.status_at = None;
        self.stream = false;
        self.health.repeat = Repeat::Stop;
        self.extension.forget();
        self.arm.forget_times();
    }

    /// Does what an intact packet asks for, and yields what the extension asks of the board.
    fn respond(&mut self, packet: &Packet<'_>, now: Instant) -> Option<Effect> {
        self.heard = now;
        if let Phase::Open(host) = self.phase {
            return self.respond_in_session(host, packet, now);
        }
        match (self.phase, packet.id, packet.data) {
            (Phase::Synchronised(2), command::OPEN, data) if opens(data) => {
                count(&mut self.counters.opened, 1);
                self.phase = Phase::Open(Host::Speaks);
                self.cycle_at = now;
            }
            // A host that begins anew wants no answers of before.
            (_, 0, []) => self.synchronise(0, 0),
            (Phase::Synchronised(0), number @ 1, [])
            | (Phase::Synchronised(1), number @ (1 | 2), [])
            | (Phase::Synchronised(2), number @ 2, []) => self.synchronise(number, self.syncs),
            _ => count(&mut self.counters.out_of_turn, 1),
        }
        None
    }

    /// The same in an open session, whose host was so before.
    fn respond_in_session(
        &mut self,
        host: Host,
        packet: &Packet<'_>,
        now: Instant,
    ) -> Option<Effect> {
        self.phase = Phase::Open(Host::Speaks);
        match (host, packet.id, packet.data) {
            (Host::Silent | Host::MaySynchronise, 0, []) => {
                self.phase = Phase::Open(Host::MaySynchronise);
                self.syncs = 1;
            }
            (Host::MaySynchronise, 1, []) => {
                // The echo of its SYNC0 may still wait.
                let waiting = self.syncs;
                self.forget();
                self.synchronise(1, waiting);
            }
            (_, command::PULSE | command::OPEN, _) => {}
            (_, command::CLOSE, _) => {
                self.forget();
                self.phase = Phase::Closed;
                self.arm.park_unhurried();
            }
            _ => match extension::parse_request(packet) {
                Some(request) => return self.extend(request, now),
                None => self.obey(packet, now),
            },
        }
        None
    }

    /// Does what a request of the extension asks of the session.
    fn extend(&mut self, request: Result<Request<'_>, Outcome>, now: Instant) -> Option<Effect> {
        let (answer, request) = match request {
            Ok(Request::Health(repeat)) => {
                self.health.ask(repeat, now);
                (None, None)
            }
            Ok(request) => self.extension.respond(request, now),
            Err(outcome) => (Some(Owed::Outcome(outcome)), None),
        };
        self.settle(answer);
        request
    }

    /// Notes an answer of the extension, if there is somebody to hear it.
    fn settle(&mut self, answer: Option<Owed>) {
        let answer = answer.filter(|_| matches!(self.phase, Phase::Open(_)));
        self.extension.settle(answer, &mut self.counters.link);
    }

    /// SYNC `number` has come, and these still wait for their answers.
    fn synchronise(&mut self, number: u8, waiting: u8) {
        self.syncs = waiting | (1 << number);
        self.phase = Phase::Synchronised(number);
    }

    /// Does what a packet of an open session asks for.
    fn obey(&mut self, packet: &Packet<'_>, now: Instant) {
        let command = match ArmCommand::parse(packet.id, packet.data) {
            Ok(command) => command,
            Err(Refusal::NotForTheArm(_)) => {
                return count(&mut self.counters.link.unknown, 1);
            }
            Err(refusal) => {
                warning!("packet not carried out: {}", refusal);
                let refusals = &mut self.extension.refusals;
                match refusal {
                    Refusal::MissingArgument(_) | Refusal::WrongArgument(_) => {
                        count(&mut refusals.length, 1);
                    }
                    Refusal::NoSuchJoint(_) => count(&mut refusals.channel, 1),
                    Refusal::Value { .. } | Refusal::NotForTheArm(_) => {
                        count(&mut refusals.value, 1);
                    }
                }
                return count(&mut self.counters.link.refused, 1);
            }
        };
        match command {
            ArmCommand::Info => self.info = true,
            ArmCommand::Status(request) => {
                self.stream = request == StatusRequest::Stream;
                self.status_at = (request != StatusRequest::Stop).then_some(now);
            }
            _ => {}
        }
        match self.arm.carry_out(command, now) {
            Ok(Limited(false)) => {}
            Ok(Limited(true)) => count(&mut self.counters.limited, 1),
            Err(reason) => {
                warning!("command ignored: {}", reason);
                count(&mut self.counters.ignored, 1);
                count(&mut self.extension.refusals.not_now, 1);
            }
        }
    }
}

/// Whether this is the argument of an OPEN.
fn opens(data: &[u8]) -> bool {
    matches!(Argument::parse(data), Ok(None | Some(Argument::Positive(1))))
}

/// What the robot tells of itself: it stands still, and its battery is the motors'.
fn standard(snapshot: &Snapshot) -> Standard {
    let [_, motors, _] = snapshot.sensors.battery;
    // 4095 counts are 24 V.
    let battery_dv = (u32::from(motors.min(4095)) * 240 + 2047) / 4095;
    Standard { battery_dv: battery_dv as u8, ..Standard::default() } // 240 at the most
}
