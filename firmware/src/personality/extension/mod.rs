//! A session's part in the protocol's extension: settings by number, upkeep, health, faults. The
//! PMS5005's session and the Pioneer Arm's share it; each has its own packets around it.
//!
//! What a request asks of the session is done here, and what is to be answered waits here, as a
//! note of a few bytes; the answer itself is made when it is sent, from what is true then.

mod words;

use core::array;
use core::num::NonZeroU8;
use core::ops::Range;

use embassy_time::{Duration, Instant};
use heapless::Deque;
use protocol::extension::{
    Action, Answer, Assignments, BLOCK, Block, Counters, Health, Identity, Latched, MachineState,
    Outcome, Refusals, Request, VERSION, Verdict, did, flag,
};
use protocol::pms5005::Repeat;

use super::{Effect, Upkeep, UpkeepRefused, View, count};
use crate::channel::{Channel, ENCODERS, Scope};
use crate::command::Command;
use crate::controller::{self, ControlCounters, CountRefusal, CountSet, ShownFault, Snapshot};
use crate::ports::{Program, ResetCause};
use crate::safety::faults::Fault;
use crate::settings::store::Origin;
use crate::settings::{SettingRefused, Settings};
use crate::units::ServoPulse;
use words::{channel_state, description, fault_record, origin, recording, reset_cause, row, setup};

/// Answers that may wait. A host that waits for each before it asks again never has two.
const ANSWERS_WAITING: usize = 8;
/// A record of a fault is there two control periods after it was asked for, or when nothing holds
/// the controller's commands back any more.
const RECORD_SHOWN: Duration = Duration::from_millis(2);

/// How the board has started, and what only it knows.
#[derive(Clone, Copy, Debug)]
pub struct Boot {
    /// Why.
    pub reset: ResetCause,
    /// Where its settings come from.
    pub settings: Origin,
    /// The most stack that was ever used, in bytes; 0 is unknown.
    pub stack_used: fn() -> u16,
}

impl Boot {
    /// What has gone wrong before or during the start.
    pub fn faults(&self) -> impl Iterator<Item = Fault> + use<> {
        let corrupt = (self.settings == Origin::Corrupt).then_some(Fault::SettingsCorrupt);
        let watchdog = (self.reset == ResetCause::Watchdog).then_some(Fault::WatchdogReset);
        corrupt.into_iter().chain(watchdog)
    }
}

impl Default for Boot {
    /// Nothing is known, nothing was stored.
    fn default() -> Self {
        Self { reset: ResetCause::Unknown, settings: Origin::Defaults, stack_used: || 0 }
    }
}

/// What is told again and again: telemetry, health.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stream {
    pub repeat: Repeat,
    /// When it is next told, unless it has stopped.
    pub due: Instant,
}

impl Stream {
    /// Starts or stops it. One that runs keeps its rhythm, or a host that asks often would get more
    /// than a period allows.
    pub fn ask(&mut self, repeat: Repeat, now: Instant) {
        if self.repeat == Repeat::Stop {
            self.due = self.due.max(now);
        }
        self.repeat = repeat;
    }

    /// When it is next to be told, if at all.
    pub fn due_at(&self) -> Option<Instant> {
        (self.repeat != Repeat::Stop).then_some(self.due)
    }

    /// It has been told, and is again then.
    pub fn told(&mut self, due: Instant) {
        if let Repeat::Times(times) = self.repeat {
            let left = NonZeroU8::new(times.get() - 1);
            self.repeat = left.map_or(Repeat::Stop, Repeat::Times);
        }
        self.due = due;
    }
}

/// An answer that waits.
#[derive(Clone, Copy, Debug)]
pub(super) enum Owed {
    Setting(u16),
    Identity,
    Counters,
    Fault(u8),
    Refusals,
    Recording,
    Outcome(Outcome),
}

/// The extension's state.
pub(super) struct Extension {
    /// The settings in force. Only this session changes them.
    settings: Settings,
    boot: Boot,
    booted: Instant,
    owed: Deque<Owed, ANSWERS_WAITING>,
    /// What the board is doing for the host.
    upkeep: Option<Action>,
    /// The place of the fault whose record the host waits for, until it is told, and when to look
    /// whether the controller shows it.
    asked_fault: Option<(u8, Instant)>,
    /// The serial number of the last count that was to be set, and when to look what came of it, if that is
    /// not known yet.
    count_serial: u8,
    count_looked_at: Option<Instant>,
    /// The blocks of the recording that the host still waits for.
    blocks: Range<u16>,
    /// What the session has refused.
    pub(super) refusals: Refusals,
}

impl Extension {
    pub(super) fn new(settings: Settings, boot: Boot, now: Instant) -> Self {
        Self {
            settings,
            boot,
            booted: now,
            owed: Deque::new(),
            upkeep: None,
            asked_fault: None,
            count_serial: 0,
            count_looked_at: None,
            blocks: 0..0,
            refusals: Refusals::default(),
        }
    }

    /// The settings in force.
    pub(super) fn settings(&self) -> &Settings {
        &self.settings
    }

    /// What is to be saved.
    pub(super) fn to_save(&self) -> &Settings {
        match self.upkeep {
            Some(Action::FactoryReset) => &Settings::DEFAULT,
            _ => &self.settings,
        }
    }

    /// Whether the board is doing upkeep, and carries out no command until it is done.
    pub(super) fn is_busy(&self) -> bool {
        self.upkeep.is_some()
    }

    /// Whether an answer waits.
    pub(super) fn owes(&self) -> bool {
        !self.owed.is_empty()
    }

    /// The answer that has waited longest; it counts as given.
    pub(super) fn next(&mut self) -> Option<Owed> {
        let owed = self.owed.pop_front();
        if matches!(owed, Some(Owed::Fault(_))) {
            self.asked_fault = None;
        }
        owed
    }

    /// Whether blocks of the recording wait.
    pub(super) fn has_blocks(&self) -> bool {
        !self.blocks.is_empty()
    }

    /// The number of the next block to be told; it counts as told.
    pub(super) fn next_block(&mut self) -> Option<u16> {
        self.blocks.next()
    }

    /// Owes nobody anything any more: the host has gone. Upkeep under way is still done.
    pub(super) fn forget(&mut self) {
        self.owed.clear();
        self.blocks = 0..0;
        (self.asked_fault, self.count_looked_at) = (None, None);
    }

    /// When to [`look`](Self::look) at a snapshot.
    pub(super) fn looks_at(&self) -> Option<Instant> {
        if self.asked_fault.is_none() {
            return self.count_looked_at;
        }
        let is_waiting = |owed: &Owed| matches!(owed, Owed::Fault(_));
        let fault = self.asked_fault.filter(|_| !self.owed.iter().any(is_waiting));
        [fault.map(|(_, at)| at), self.count_looked_at].into_iter().flatten().min()
    }

    /// What a snapshot has an answer to, as soon as there is room for it.
    pub(super) fn look(&mut self, now: Instant, snapshot: &Snapshot) -> Option<Owed> {
        if self.looks_at()? > now {
            return None;
        }
        let later = now.saturating_add(RECORD_SHOWN);
        if let Some((_, at)) = &mut self.asked_fault {
            *at = later;
        }
        if let Some(at) = &mut self.count_looked_at {
            *at = later;
        }
        if self.owed.is_full() {
            return None;
        }
        let CountSet { serial, refused } = snapshot.count_set;
        if self.count_looked_at.is_some() && serial == self.count_serial {
            self.count_looked_at = None;
            return Some(Owed::Outcome(Outcome::of_count(match refused {
                None => Verdict::Done,
                Some(CountRefusal::NotOff) => Verdict::OutputsOn,
                Some(CountRefusal::NoEncoder) => Verdict::NotAvailable,
            })));
        }
        let (place, _) = self.asked_fault?;
        let is_waiting = |owed: &Owed| matches!(owed, Owed::Fault(_));
        let is_due = !self.owed.iter().any(is_waiting) && snapshot.shown_fault.place == place;
        is_due.then_some(Owed::Fault(place))
    }

    /// Notes what came of a request that could be read, if that is known already.
    pub(super) fn settle(&mut self, answer: Option<Owed>, counters: &mut Counters) {
        let Some(answer) = answer else { return };
        if let Owed::Outcome(Outcome { verdict, .. }) = answer
            && verdict != Verdict::Done
        {
            count(&mut counters.refused, 1);
            self.refuse(verdict);
        }
        self.owe(answer, counters);
    }

    /// Notes an answer, if there is room for it.
    pub(super) fn owe(&mut self, answer: Owed, counters: &mut Counters) {
        if self.owed.push_back(answer).is_err() {
            count(&mut counters.answers_dropped, 1);
        }
    }

    /// Counts a request that was refused, by reason.
    pub(super) fn refuse(&mut self, verdict: Verdict) {
        let refusals = &mut self.refusals;
        let counter = match verdict {
            Verdict::Done => return,
            Verdict::Unknown => &mut refusals.sub_command,
            Verdict::BadLength => &mut refusals.length,
            Verdict::NoSuchSetting | Verdict::OutOfRange | Verdict::Contradiction => {
                &mut refusals.setting
            }
            Verdict::OutputsOn | Verdict::Busy => &mut refusals.not_now,
            Verdict::NotAvailable | Verdict::FlashFailed => &mut refusals.not_available,
        };
        count(counter, 1);
    }

    /// Carries out a request for anything but health and the machine state, which are streams: what is to
    /// be answered, if it is known yet, and what is asked of the board.
    pub(super) fn respond(
        &mut self,
        request: Request<'_>,
        now: Instant,
    ) -> (Option<Owed>, Option<Effect>) {
        match request {
            Request::Setting(number) if self.settings.describe(number).is_none() => {
                let asked = number.to_le_bytes();
                let verdict = Verdict::NoSuchSetting;
                let outcome = Outcome::of(did::SETTING, &asked, verdict);
                (Some(Owed::Outcome(Outcome { setting: number, ..outcome })), None)
            }
            Request::Setting(number) => (Some(Owed::Setting(number)), None),
            Request::Identity => (Some(Owed::Identity), None),
            Request::Counters => (Some(Owed::Counters), None),
            Request::Fault(place) if self.asked_fault.is_some() => {
                let outcome = Outcome::of(did::FAULT, &[place], Verdict::Busy);
                (Some(Owed::Outcome(outcome)), None)
            }
            Request::Fault(place) => {
                self.asked_fault = Some((place, now.saturating_add(RECORD_SHOWN)));
                (None, Some(Effect::Control(Command::ShowFault(place))))
            }
            Request::Refusals => (Some(Owed::Refusals), None),
            Request::Recording => (Some(Owed::Recording), None),
            Request::Record(wanted) => {
                self.blocks = 0..0;
                (Some(Owed::Recording), Some(Effect::Record(setup(wanted))))
            }
            Request::Blocks { first, count } => {
                self.blocks = first..first.saturating_add(count);
                (None, None)
            }
            Request::SetCount { channel, count } => {
                let verdict = match Channel::ALL.get(usize::from(channel)) {
                    Some(channel) if channel.index() >= ENCODERS => Verdict::NotAvailable,
                    None => Verdict::OutOfRange,
                    Some(_) if self.count_looked_at.is_some() => Verdict::Busy,
                    Some(&channel) => {
                        self.count_serial = self.count_serial.wrapping_add(1);
                        self.count_looked_at = Some(now.saturating_add(RECORD_SHOWN));
                        let serial = self.count_serial;
                        let set = Command::SetCount { channel, count, serial };
                        return (None, Some(Effect::Control(set)));
                    }
                };
                (Some(Owed::Outcome(Outcome::of_count(verdict))), None)
            }
            Request::Health(_) | Request::State(_) => (None, None),
            Request::Set(assignments) => self.set(assignments),
            Request::Do(action) => self.act(action),
        }
    }

    /// Sets all of them or none. None while a factory reset is pending, which would undo them.
    fn set(&mut self, assignments: Assignments<'_>) -> (Option<Owed>, Option<Effect>) {
        let outcome = Outcome::of(did::PARAMETERS, assignments.as_bytes(), Verdict::Done);
        if self.upkeep == Some(Action::FactoryReset) {
            return (Some(Owed::Outcome(Outcome { verdict: Verdict::Busy, ..outcome })), None);
        }
        let mut settings = self.settings;
        let set = assignments
            .iter()
            .try_for_each(|(number, value)| settings.set(number, value))
            .and_then(|()| settings.check());
        let (verdict, setting) = match set {
            Ok(()) => {
                let adopt = self.force(settings);
                return (Some(Owed::Outcome(outcome)), Some(adopt));
            }
            Err(SettingRefused::NoSuchSetting(number)) => (Verdict::NoSuchSetting, number),
            Err(SettingRefused::OutOfRange(number)) => (Verdict::OutOfRange, number),
            Err(SettingRefused::Contradiction(number)) => (Verdict::Contradiction, number),
        };
        (Some(Owed::Outcome(Outcome { verdict, setting, ..outcome })), None)
    }

    /// Puts settings into force here, and yields what does so in the controller.
    pub(super) fn force(&mut self, settings: Settings) -> Effect {
        self.settings = settings;
        Effect::Control(Command::Adopt)
    }

    fn act(&mut self, action: Action) -> (Option<Owed>, Option<Effect>) {
        let upkeep = match action {
            Action::ClearFaults => {
                let outcome = Outcome::of_action(action, Verdict::Done);
                let clear = Effect::Control(Command::ClearFaults(Scope::All));
                return (Some(Owed::Outcome(outcome)), Some(clear));
            }
            _ if self.upkeep.is_some() => {
                return (Some(Owed::Outcome(Outcome::of_action(action, Verdict::Busy))), None);
            }
            Action::Save | Action::FactoryReset => Upkeep::Save,
            Action::Reboot => Upkeep::Start(Program::Firmware),
            Action::RebootIntoDfu => Upkeep::Start(Program::DfuLoader),
        };
        self.upkeep = Some(action);
        (None, Some(Effect::Upkeep(upkeep)))
    }

    /// What came of the upkeep: the answer to it, and what is asked of the board.
    pub(super) fn done(
        &mut self,
        result: Result<(), UpkeepRefused>,
    ) -> (Option<Owed>, Option<Effect>) {
        let Some(action) = self.upkeep.take() else { return (None, None) };
        let verdict = match result {
            Ok(()) => Verdict::Done,
            Err(UpkeepRefused::OutputsOn) => Verdict::OutputsOn,
            Err(UpkeepRefused::NotAvailable) => Verdict::NotAvailable,
            Err(UpkeepRefused::FlashFailed) => Verdict::FlashFailed,
        };
        let is_reset = action == Action::FactoryReset && result.is_ok();
        let adopt = is_reset.then(|| self.force(Settings::DEFAULT));
        (Some(Owed::Outcome(Outcome::of_action(action, verdict))), adopt)
    }

    /// An answer as it is now; `None` for a setting that is none.
    pub(super) fn answer(
        &self,
        owed: Owed,
        board: &impl View,
        counters: impl FnOnce() -> Counters,
    ) -> Option<Answer<'static>> {
        Some(match owed {
            Owed::Setting(number) => Answer::Setting(description(self.settings.describe(number)?)),
            Owed::Identity => Answer::Identity(Identity {
                version: FIRMWARE,
                extension: VERSION,
                reset: reset_cause(self.boot.reset),
                settings: origin(self.boot.settings),
            }),
            Owed::Counters => {
                let ControlCounters { refused, links_lost, .. } = board.snapshot().counters;
                let commands_refused = refused.total();
                Answer::Counters(Counters { commands_refused, links_lost, ..counters() })
            }
            Owed::Fault(place) => {
                let ShownFault { total, record, .. } = board.snapshot().shown_fault;
                Answer::Fault(Latched { place, total, record: record.and_then(fault_record) })
            }
            Owed::Refusals => {
                let controller::Refusals { method, scale } = board.snapshot().counters.refused;
                Answer::Refusals(Refusals { method, scale, ..self.refusals })
            }
            Owed::Recording => Answer::Recording(recording(board.recording())),
            Owed::Outcome(outcome) => Answer::Outcome(outcome),
        })
    }

    /// The machine state now, of a session that has refused so many frames.
    pub(super) fn state(&self, now: Instant, snapshot: &Snapshot, refused: u32) -> Answer<'static> {
        let has_fault = snapshot.faults.count() > 0;
        let bit = |set: bool, bit: u8| if set { bit } else { 0 };
        let Snapshot { channels, outputs, motion, .. } = snapshot;
        Answer::State(MachineState {
            time_ms: now.saturating_duration_since(self.booted).as_millis() as u16, // the low 16 bits
            flags: bit(snapshot.link_loss, flag::LINK_LOST)
                | bit(snapshot.obstacle, flag::OBSTACLE)
                | bit(has_fault, flag::FAULT),
            refused: refused.wrapping_add(snapshot.counters.refused.total()) as u8, // wraps
            battery: snapshot.sensors.battery,
            channels: array::from_fn(|i| {
                channel_state(&channels[i], &outputs.motors[i], motion.currents[i])
            }),
            servos: outputs.servos.map(|pulse| pulse.map_or(0, ServoPulse::raw)),
        })
    }

    /// How the board is now.
    pub(super) fn health(&self, now: Instant, snapshot: &Snapshot) -> Answer<'static> {
        Answer::Health(Health {
            uptime_ms: now.saturating_duration_since(self.booted).as_millis() as u32, // wraps
            worst_latency_us: snapshot.worst_latency_us,
            stack_used: (self.boot.stack_used)(),
            faults: snapshot.faults.count() as u8, // 47 at the most
            periods_missed: snapshot.counters.periods_missed,
        })
    }
}

/// A block of the recording.
pub(super) fn block(number: u16, board: &impl View) -> Answer<'static> {
    let first = usize::from(number) * BLOCK;
    let (serial, rows) = board.rows(first..first.saturating_add(BLOCK));
    Answer::Block(Block::new(serial, number, rows.iter().copied().map(row)))
}

/// The firmware's version.
const FIRMWARE: [u8; 3] = [
    version(env!("CARGO_PKG_VERSION_MAJOR")),
    version(env!("CARGO_PKG_VERSION_MINOR")),
    version(env!("CARGO_PKG_VERSION_PATCH")),
];

const fn version(number: &str) -> u8 {
    match u8::from_str_radix(number, 10) {
        Ok(number) => number,
        Err(_) => panic!("each part of the version fits a byte"), // when it is compiled
    }
}
