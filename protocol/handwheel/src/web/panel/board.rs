//! Who the board is and how it is: asked when it is met, then once a second.

use std::num::NonZeroU8;
use std::time::Duration;

use protocol::arcos::{ArmCommand, ArmStatus, Packet, SYNC, Standard, StatusRequest, command};
use protocol::extension::{Counters, FaultRecord, Health, Identity, Refusals, Request};
use protocol::pms5005::Repeat;

use super::Panel;
use super::exchanges::Purpose;
use crate::Number;
use crate::session::{Event, Failure, Personality, Reply, Setting};
use crate::settings::{LINK_TIMEOUT, dialect};
use crate::state::{self, RENEW};

/// How often it is asked how it is, and an arm where its joints are.
const ASK: Duration = Duration::from_secs(1);
const ASK_ARM: Duration = Duration::from_millis(200);
/// How long an arm's line is listened to: a session that another host has open shows itself.
const LISTEN: Duration = Duration::from_millis(300);
/// For how long another host may ask an arm for nothing until it counts as silent.
const GUEST: Duration = Duration::from_secs(2);
/// Faults on record, with room for more.
const MOST_FAULTS: usize = 64;
/// An uptime that is near its end may wrap.
const WRAPS: u32 = u32::MAX - 60_000;

/// What was asked.
pub(super) enum Asked {
    Identity,
    LinkTimeout,
    Health,
    Counters,
    Refusals,
    Fault,
    Sync,
    Status,
}

/// What is known of it.
#[derive(Default)]
pub(super) struct Board {
    pub(super) identity: Option<Identity>,
    /// It has told who it is, or that it does not.
    is_met: bool,
    /// It is to be asked who it is.
    asks_who: bool,
    /// In ms.
    pub(super) link_timeout: Option<i32>,
    pub(super) health: Option<Health>,
    pub(super) counters: Option<Counters>,
    pub(super) refusals: Option<Refusals>,
    pub(super) faults: Vec<FaultRecord>,
    /// Those of the list that is being read.
    reading: Vec<FaultRecord>,
    /// When it is asked next, and whether answers are missing.
    due: Duration,
    is_asked: bool,
    /// When machine states are asked for anew.
    pub(super) renew: Duration,
    arm: Option<Arm>,
    /// Frames and bytes so far, when that was, and what that is in a second.
    counted: (u64, u64, Duration),
    pub(super) rates: (f64, f64),
}

/// The session of ARCOS.
struct Arm {
    /// Since when it is known that it is an arm, or when it told its state last.
    since: Duration,
    /// Another host's: it is only listened to.
    is_guest: bool,
    /// Ours is asked for, and open.
    is_begun: bool,
    is_open: bool,
}

impl Board {
    /// Whether it has settings, health, faults.
    pub(super) fn has_extension(&self) -> bool {
        self.identity.is_some() && self.arm.as_ref().is_none_or(|arm| !arm.is_guest)
    }

    pub(super) fn has_fault(&self, motor: Number) -> bool {
        self.faults.iter().any(|record| record.channel == Some(motor.channel().number()))
    }

    /// Its faults have changed, as far as is known.
    pub(super) fn look_soon(&mut self, now: Duration) {
        self.due = now;
    }

    /// Whether it has told who it is, or that it does not.
    pub(super) fn is_met(&self) -> bool {
        self.is_met
    }

    /// What was asked has no answer.
    pub(super) fn was_interrupted(&mut self) {
        self.is_asked = false;
        self.asks_who = !self.is_met;
        self.reading.clear();
        if let Some(arm) = &mut self.arm {
            arm.is_begun &= arm.is_open;
        }
    }
}

impl Panel {
    /// Whether the board tells its machine state.
    pub(super) fn has_state(&self) -> bool {
        let is_new = self.board.identity.is_some_and(|identity| identity.extension >= 2);
        is_new && self.personality() == Personality::Pms5005 && !self.link.is_slow()
    }

    /// It is known what is on the line.
    pub(super) fn meet(&mut self, personality: Personality) {
        self.greeting = None;
        self.why = None;
        self.board.due = self.now + ASK / 2;
        match personality {
            Personality::Pms5005 => self.board.asks_who = true,
            Personality::Arcos => {
                let (is_guest, is_begun, is_open) = (false, false, false);
                self.board.arm = Some(Arm { since: self.now, is_guest, is_begun, is_open });
            }
            Personality::Cm5 => self.board.is_met = true,
        }
        self.tell_board();
    }

    /// Telemetry, states, packets.
    pub(super) fn take_news(&mut self, event: &Event) {
        match event {
            Event::State(state) => {
                self.see(event);
                self.job_sees(event);
                self.tell_state(state);
            }
            Event::Report(report) => {
                self.see(event);
                self.tell_report(report);
            }
            Event::Standard(_) => {
                if let Some(arm) = &mut self.board.arm
                    && !arm.is_begun
                {
                    arm.is_guest = true;
                    self.board.is_met = true;
                }
            }
            Event::Packet(id, data) => self.take_status(*id, data),
            Event::Servos(ids) => self.tell_servos(ids, &[]),
            Event::Feedback(told) => self.tell_servos(&[], told),
            Event::Block(_) => self.job_sees(event),
            Event::Heard(_) | Event::Answered(_) | Event::Failed(_) => {}
        }
    }

    /// Asks what is due.
    pub(super) fn poll(&mut self) {
        self.poll_states();
        self.open_arm();
        if std::mem::take(&mut self.board.asks_who) {
            self.ask(&Request::Identity, Purpose::Board(Asked::Identity));
        }
        if self.now < self.board.due || self.board.is_asked {
            return;
        }
        self.count();
        let is_open = self.board.arm.as_ref().is_some_and(|arm| arm.is_open);
        self.board.due = self.now + if is_open { ASK_ARM } else { ASK };
        if is_open {
            let status = ArmCommand::Status(StatusRequest::Once);
            self.queue(Purpose::Board(Asked::Status), |session, now| {
                session.arm(status, Some(ArmStatus::ID), now)
            });
        }
        if self.board.has_extension() {
            self.board.is_asked = true;
            let once = Repeat::Times(NonZeroU8::MIN);
            self.ask(&Request::Health(once), Purpose::Board(Asked::Health));
            self.ask(&Request::Counters, Purpose::Board(Asked::Counters));
            self.ask(&Request::Refusals, Purpose::Board(Asked::Refusals));
        } else {
            self.tell_health();
        }
    }

    /// Asks for machine states; a job has them while it wants them, as they take half of the line.
    fn poll_states(&mut self) {
        if let Some(running) = self.motion.job.as_mut().filter(|running| !running.is_stopped()) {
            if let Some(command) = running.renewal(self.now) {
                self.session.send(&command);
            }
        } else if self.has_state() && self.now >= self.board.renew {
            self.board.renew = self.now + RENEW;
            self.session.send(&state::ASK);
        }
    }

    /// What came of a question.
    pub(super) fn board_tells(&mut self, asked: Asked, result: Result<Reply, Failure>) {
        match (asked, result) {
            (Asked::Identity, result) => {
                if let Ok(Reply::Identity(identity)) = result {
                    self.board.identity = Some(identity);
                }
                self.board.is_met = true;
                if self.board.has_extension() {
                    self.ask(&Request::Setting(LINK_TIMEOUT), Purpose::Board(Asked::LinkTimeout));
                    self.read_settings();
                }
                self.tell_board();
            }
            (Asked::LinkTimeout, Ok(Reply::Setting(setting))) => self.learn(&setting),
            (Asked::Health, Ok(Reply::Health(health))) => {
                let before = self.board.health.replace(health).map_or(0, |h| h.uptime_ms);
                if health.uptime_ms < before && before < WRAPS {
                    // What is known of it is of its last life.
                    self.listen("the board has started again".into());
                }
            }
            (Asked::Counters, Ok(Reply::Counters(told))) => self.board.counters = Some(told),
            (Asked::Refusals, result) => {
                // The last of the round.
                if let Ok(Reply::Refusals(refusals)) = result {
                    self.board.refusals = Some(refusals);
                }
                self.tell_health();
                let some = self.board.health.is_some_and(|health| health.faults > 0);
                if some || !self.board.faults.is_empty() {
                    self.board.reading.clear();
                    self.ask(&Request::Fault(0), Purpose::Board(Asked::Fault));
                } else {
                    self.board.is_asked = false;
                }
            }
            (Asked::Fault, Ok(Reply::Fault(latched))) => match latched.record {
                Some(record) if self.board.reading.len() < MOST_FAULTS => {
                    self.board.reading.push(record);
                    let next = u8::try_from(self.board.reading.len()).unwrap_or(u8::MAX);
                    self.ask(&Request::Fault(next), Purpose::Board(Asked::Fault));
                }
                _ => {
                    self.board.is_asked = false;
                    let faults = std::mem::take(&mut self.board.reading);
                    if faults != self.board.faults {
                        self.board.faults = faults;
                        self.tell_faults();
                    }
                }
            },
            (Asked::Fault, _) => self.board.was_interrupted(),
            (Asked::Sync, Ok(Reply::Packet(id, _))) => {
                if id == Standard::ID
                    && let Some(arm) = &mut self.board.arm
                {
                    arm.is_open = true;
                    self.board.asks_who = true;
                }
            }
            (Asked::Status, Ok(Reply::Packet(id, data))) => self.take_status(id, &data),
            _ => {}
        }
    }

    /// A setting that matters here was read or set.
    pub(super) fn learn(&mut self, setting: &Setting) {
        if setting.number == LINK_TIMEOUT {
            self.board.link_timeout = Some(setting.value);
            self.live();
        }
    }

    /// What comes on the link in a second.
    fn count(&mut self) {
        let (frames, bytes, at) = self.board.counted;
        let (now_frames, now_bytes) = (self.session.frames(), self.session.received());
        let time = (self.now.saturating_sub(at)).as_secs_f64();
        if time > 0.5 {
            let rate = |now: u64, before: u64| (now.saturating_sub(before)) as f64 / time;
            self.board.rates = (rate(now_frames, frames), rate(now_bytes, bytes));
            self.board.counted = (now_frames, now_bytes, self.now);
        }
    }

    /// Opens a session of ARCOS, unless another host has; one whose host is silent is used. It is not closed
    /// again: CLOSE would send the arm home.
    fn open_arm(&mut self) {
        let Some(arm) = &mut self.board.arm else { return };
        if arm.is_guest && self.now >= arm.since + GUEST {
            (arm.is_guest, arm.is_begun, arm.is_open) = (false, true, true);
            self.board.asks_who = true;
            return;
        }
        if arm.is_guest || arm.is_begun || self.now < arm.since + LISTEN {
            return;
        }
        arm.is_begun = true;
        let open = Packet { id: command::OPEN, data: &[] };
        let asked = SYNC.iter().map(|sync| (*sync, sync.id)).chain([(open, Standard::ID)]);
        for (packet, answer) in asked {
            let purpose = Purpose::Board(Asked::Sync);
            self.queue(purpose, |session, now| session.packet(&packet, Some(answer), now));
        }
    }

    fn take_status(&mut self, id: u8, data: &[u8]) {
        let dialect = dialect(self.settings.value_of("arm dialect"));
        if let Some(status) = ArmStatus::parse(&Packet { id, data }, dialect) {
            if let Some(arm) = &mut self.board.arm {
                arm.since = self.now;
            }
            self.arm_moves(status.moving != [false; 6]);
            self.tell_joints(&status);
        }
    }
}
