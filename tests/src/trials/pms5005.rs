//! A PMS5005 on virtual time: its tasks, its world and its host, which says whatever a host can say,
//! over a line that damages it, and whose power fails.
//!
//! What must hold besides the [model](super::model)'s promises:
//! - every intact frame for us is acknowledged, once; every motion command reaches the controller;
//! - what the board sends is whole frames that can be read, and true;
//! - the board starts again only when its power failed, a task hung or its host has asked for it, and
//!   then with the settings that were saved last or were just being saved;
//! - settings are saved only while nothing is driven.

use embassy_time::{Duration, Instant};
use firmware::command::Command as Asked;
use firmware::controller::Snapshot;
use firmware::personality::pms5005::Pms5005;
use firmware::ports::ResetCause;
use firmware::settings::Settings;
use firmware::settings::store::Origin;
use hal_mock::board::{Make, VirtualBoard};
use hal_mock::flash::Flash;
use hal_mock::tasks::Task;
use protocol::extension::{Action, Answer, Mode, Request};
use protocol::pms5005::{
    Command, Data, Frame, MAX_FRAME, RES_NO_ACK, RID_PMS5005, Receiver, Report, Scope,
};

use super::choices::Choices;
use super::host::{command, moves_motors};
use super::model::Model;
use super::watched::{Event, Log, Watched};
use super::world;

/// Milliseconds in which a candidate that noise has made is given up, and the frames behind it come.
const DAMAGE_LASTS: u64 = 1100;
/// Milliseconds from a frame on the line to its acknowledgement, and from a reset to the first answer.
const ANSWERED_WITHIN: u64 = 60;

/// What befalls the board.
#[derive(Clone, Copy, Debug)]
enum Befalls {
    Pause,
    Frame,
    /// Several at once.
    Burst,
    Damage,
    Noise,
    World,
    WorldIsRight,
    Silence,
    LineFails,
    LineMended,
    Late,
    Hang,
    PowerFails,
}

/// How often each does: a generator makes some 60 frames a second, a disturbance every 4 seconds, and
/// a failure of power or a hang every few minutes.
const ALL: [(u32, Befalls); 14] = [
    (4000, Befalls::Pause),
    (2500, Befalls::Frame),
    (500, Befalls::Frame),
    (100, Befalls::Burst),
    (300, Befalls::Damage),
    (60, Befalls::Noise),
    (30, Befalls::World),
    (10, Befalls::WorldIsRight),
    (10, Befalls::Silence),
    (2, Befalls::LineFails),
    (20, Befalls::LineMended),
    (1, Befalls::Late),
    (1, Befalls::Hang),
    (1, Befalls::PowerFails),
];

/// See the [module](self).
pub struct Trial {
    board: VirtualBoard<Watched<Pms5005>>,
    log: Log,
    model: Model,
    before: Snapshot,
    settings: Settings,
    /// What the flash holds, and what was being saved when power failed.
    saved: Option<Settings>,
    being_saved: Option<Settings>,
    /// Its upkeep, under way.
    saving: Option<Settings>,
    is_starting: bool,
    /// How often the board has started, and how often it should have.
    starts: u32,
    reset: Option<ResetCause>,
    wire: Wire,
    /// What has happened, for whoever asks.
    pub seen: Seen,
}

/// What a trial has seen.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seen {
    /// Milliseconds.
    pub ms: u64,
    /// Frames that the host has sent, and those of them that arrived damaged.
    pub frames: u64,
    /// Damaged ones, and pieces of noise.
    pub damaged: u64,
    /// Acknowledgements, and other frames of the board.
    pub acks: u64,
    /// Reports and answers.
    pub told: u64,
    /// Times that each fault has tripped, by its number.
    pub faults: [u32; 32],
    /// Times that the board has started.
    pub starts: u64,
    /// Settings that were saved.
    pub saves: u64,
    /// Frames and commands that were refused, since the last start.
    pub refused: u32,
}

/// The host's books.
#[derive(Default)]
struct Wire {
    receiver: Receiver,
    /// Acknowledgements that are owed, those that may come besides, and those that have come.
    owed: u32,
    may_come: u32,
    acks: u32,
    /// Motion commands sent, and those that the controller was asked for.
    moves: u32,
    asked: u32,
    /// Nothing is counted until then: a candidate may swallow frames.
    dirty_until: u64,
    last_sent: u64,
    clock: Option<u16>,
}

impl Trial {
    /// A board that has just been switched on, in a world and with settings that are chosen.
    pub fn new(choices: &mut Choices) -> Self {
        let mut settings = Settings::DEFAULT;
        let control = &mut settings.control;
        control.link_timeout = choices.weighed(&[(1, 100), (4, 2000), (1, 40)]);
        control.longest_move = choices.weighed(&[(1, 0), (4, 10_000), (1, 150)]);
        control.board_faults.motor_battery_high = 3000;
        control.channel_faults.thermal_s = 1; // or hardly any motor is hot before it is commanded anew
        control.soft_limits[world::LIMITED] = world::SOFT;
        let seed = u64::from(choices.byte());
        let make = Make { settings, line_rate: 0, seed, ..Make::default() };
        let log = Log::default();
        let listens = log.clone();
        let board = VirtualBoard::with_session(make, Flash::empty(), move |settings, boot, now| {
            Watched::new(Pms5005::new(settings, boot, now), boot, &listens)
        });
        Self {
            board,
            log,
            model: Model::new(settings.control),
            before: Snapshot::BOOT,
            settings,
            saved: None,
            being_saved: None,
            saving: None,
            is_starting: false,
            starts: 0,
            reset: Some(ResetCause::Power),
            wire: Wire::default(),
            seen: Seen::default(),
        }
    }

    fn now(&self) -> u64 {
        Instant::now().as_millis()
    }

    /// One more thing befalls it.
    pub fn go_on(&mut self, choices: &mut Choices) {
        match choices.weighed(&ALL) {
            Befalls::Pause => {
                let ms = match choices.are_a_fuzzers() {
                    true => choices.among(&[1, 1, 2, 5, 10, 20, 45, 60, 110, 250]),
                    false => 1 + choices.below(50),
                };
                self.pass(ms.into());
            }
            Befalls::Frame => self.say(choices),
            Befalls::Burst => {
                for _ in 0..1 + choices.below(6) {
                    self.say(choices);
                }
            }
            Befalls::Damage => {
                let mut data = Data::new();
                let mut buffer = [0; MAX_FRAME];
                let command = command(choices, &mut data);
                let mut frame = command.encode(0, &mut buffer).expect("it can be encoded").to_vec();
                let at = choices.below(frame.len() as u32) as usize;
                match choices.below(3) {
                    0 => frame.truncate(at),
                    1 => drop(frame.drain(..at)),
                    _ => frame[at] ^= 1 << choices.below(8),
                }
                self.damage(&frame);
            }
            Befalls::Noise => {
                let noise = choices.bytes(40);
                self.damage(&noise);
            }
            Befalls::World => world::disturb(&mut self.board.plant.borrow_mut(), choices),
            Befalls::WorldIsRight => world::mend(&mut self.board.plant.borrow_mut()),
            Befalls::Silence => {
                let timeout = u64::from(self.settings.control.link_timeout);
                let ms = timeout + u64::from(choices.among(&[0u16, 1, 3, 20, 50, 90, 120]));
                self.pass(ms.min(3000));
            }
            Befalls::LineFails => {
                if choices.one_in(2) {
                    self.board.line.cut(true);
                } else {
                    self.board.line.overrun();
                }
                self.taint(DAMAGE_LASTS);
            }
            Befalls::LineMended => self.board.line.cut(false),
            Befalls::Late => {
                // Control comes too late, but the watchdog bears it.
                self.board.watchdog.hung.set(Some(Task::Control));
                self.pass(1 + u64::from(choices.below(45)));
                self.board.watchdog.hung.set(None);
                self.taint(ANSWERED_WITHIN);
            }
            Befalls::Hang => {
                let tasks = [Task::Control, Task::Sensors, Task::Display, Task::Link];
                self.board.watchdog.hung.set(Some(choices.among(&tasks)));
                self.reset = Some(ResetCause::Watchdog);
                self.model.is_held = true;
                self.taint(DAMAGE_LASTS);
                self.pass(200);
                assert_eq!(self.reset, None, "a task hangs, and nobody starts the board again");
            }
            Befalls::PowerFails => self.power_fails(choices),
        }
    }

    /// Power fails; it may be in the middle of a save.
    fn power_fails(&mut self, choices: &mut Choices) {
        let in_a_save = choices.one_in(2) && !self.board.line.is_cut();
        if in_a_save {
            let most = if choices.one_in(4) { 20_000 } else { 1300 };
            self.board.flash.lose_power_after(choices.below(most) as usize, choices.one_in(2));
            self.send(&Command::Run { scope: Scope::All, run: false });
            self.pass(5);
            self.send(&Command::Extension(Request::Do(Action::Save)));
            self.pass(1 + u64::from(choices.below(8)));
        }
        self.reset = Some(ResetCause::Power);
        if self.board.flash.restore_power() {
            self.being_saved = self.being_saved.or(self.saving.take());
        }
        self.board.start_again(ResetCause::Power);
        self.taint(DAMAGE_LASTS);
        self.pass(1);
        assert_eq!(self.reset, None, "power is back, and the board has not started");
    }

    /// The host says something.
    fn say(&mut self, choices: &mut Choices) {
        let mut data = Data::new();
        if !choices.one_in(24) {
            let command = command(choices, &mut data);
            return self.send(&command);
        }
        // What is for others, for nobody, or wants no acknowledgement.
        let (rid, res) = (choices.among(&[1, 0, 7]), choices.among(&[0, 255]));
        let did = choices.byte();
        let data = choices.bytes(12);
        let bytes = Frame { rid, res, did, data: &data };
        let (is_for_us, wants_an_ack) = (rid == RID_PMS5005, res != RES_NO_ACK);
        let mut buffer = [0; MAX_FRAME];
        let bytes = bytes.encode(&mut buffer).unwrap();
        let command = Command::parse(did, &data);
        let may_be_an_ack = command == Ok(Command::PingOrAck);
        let is_move = command.is_ok_and(|command| moves_motors(&command));
        let is_owed = is_for_us && wants_an_ack;
        self.put(bytes, is_owed && !may_be_an_ack, is_owed && may_be_an_ack, is_for_us && is_move);
    }

    /// Sends a command.
    fn send(&mut self, command: &Command) {
        let mut buffer = [0; MAX_FRAME];
        let bytes = command.encode(0, &mut buffer).expect("a command that can be encoded");
        let may_be_an_ack = *command == Command::PingOrAck;
        self.put(bytes, !may_be_an_ack, may_be_an_ack, moves_motors(command));
    }

    fn put(&mut self, bytes: &[u8], is_owed: bool, may_come: bool, is_move: bool) {
        self.board.line.host_sends(bytes);
        self.seen.frames += 1;
        self.wire.last_sent = self.now();
        if !self.board.line.is_cut() {
            self.wire.owed += u32::from(is_owed);
            self.wire.may_come += u32::from(may_come);
            self.wire.moves += u32::from(is_move);
        }
    }

    fn damage(&mut self, bytes: &[u8]) {
        self.board.line.host_sends(bytes);
        self.seen.damaged += 1;
        self.taint(DAMAGE_LASTS);
    }

    /// What is owed is not known for a while.
    fn taint(&mut self, ms: u64) {
        self.wire.dirty_until = self.wire.dirty_until.max(self.now() + ms);
    }

    /// Lets time pass, and looks at the board after every millisecond.
    pub fn pass(&mut self, ms: u64) {
        for _ in 0..ms {
            self.board.run_for(Duration::from_millis(1));
            self.look();
        }
        self.seen.ms += ms;
    }

    fn look(&mut self) {
        let now = self.board.snapshot();
        loop {
            let Some(event) = self.log.borrow_mut().pop_front() else { break };
            self.heed(event, &now);
        }
        let plant = self.board.plant.borrow();
        // A start and a period may fall into the same millisecond.
        if now.counters.periods < self.before.counters.periods {
            self.before = Snapshot::BOOT;
        }
        self.model.look(&now, &plant);
        drop(plant);
        if now.faults != self.before.faults {
            for (fault, channel) in now.faults.iter() {
                if !self.before.faults.has(fault, channel) {
                    self.seen.faults[usize::from(fault.number())] += 1;
                }
            }
        }
        self.hear(&now);
        self.before = now;
    }

    /// What has come of the session.
    fn heed(&mut self, event: Event, now: &Snapshot) {
        match event {
            Event::Started(settings, boot) => {
                self.starts += 1;
                self.seen.starts += 1;
                let is_expected = self.reset.take() == Some(boot.reset)
                    || (std::mem::take(&mut self.is_starting) && boot.reset == ResetCause::Software);
                assert!(is_expected, "the board starts again: {:?}", boot.reset);
                self.is_starting = false;
                self.check_stored(&settings, boot.settings);
                self.settings = *settings;
                self.saving = None;
                self.model = Model::new(settings.control);
                self.taint(ANSWERED_WITHIN);
                self.wire.clock = None;
            }
            Event::Asked(command) => {
                self.wire.asked += u32::from(matches!(command, Asked::MoveMotors { .. }));
                self.model.asked(&command, now);
            }
            Event::Adopted(settings) => {
                self.settings.control = *settings;
                self.model.adopted(&settings, now);
            }
            Event::Saving(settings) => {
                self.model.is_held = true;
                self.saving = Some(*settings);
            }
            Event::Starting => {
                self.model.is_held = true;
                self.is_starting = true;
            }
            Event::Done(result) => {
                self.model.is_held = false;
                let saving = self.saving.take();
                match (result, saving) {
                    (Ok(()), Some(settings)) => {
                        assert!(self.before.outputs.are_off(), "saved while something is driven");
                        (self.saved, self.being_saved) = (Some(settings), None);
                        self.seen.saves += 1;
                    }
                    (Err(_), Some(settings)) => {
                        // What a flash without power has taken of them is known after the next start.
                        self.being_saved = Some(settings);
                    }
                    (Ok(()), None) => self.model.is_held = true, // until it starts again
                    (Err(_), None) => self.is_starting = false,
                }
            }
        }
    }

    /// The settings of a start are those that were saved last, or were just being saved.
    fn check_stored(&mut self, settings: &Settings, origin: Origin) {
        let being_saved = self.being_saved.take();
        match origin {
            Origin::Defaults => assert_eq!(self.saved, None, "what was saved is lost"),
            Origin::Stored if being_saved == Some(*settings) => self.saved = being_saved,
            Origin::Stored => assert_eq!(self.saved, Some(*settings), "nobody has saved these"),
            Origin::Corrupt => panic!("what was saved is damaged"),
        }
    }

    /// Reads what the board has sent, and keeps the books.
    fn hear(&mut self, now: &Snapshot) {
        while let Some((_, bytes)) = self.board.line.host_receives() {
            let mut rest = &bytes[..];
            let frame = self.wire.receiver.receive(&mut rest).expect("a whole frame").to_vec();
            assert!(rest.is_empty() && frame == bytes, "one frame at once");
            let Frame { rid, res, did, data } = Frame::parse(&frame).unwrap();
            assert_eq!(rid, 0);
            if (res, did, data) == (0, 255, &[1]) {
                self.wire.acks += 1;
                self.seen.acks += 1;
                continue;
            }
            self.seen.told += 1;
            match (Report::parse(did, data), Answer::parse(did, data)) {
                (Some(_), _) => assert_eq!(res, 255),
                (_, Some(answer)) => self.heard(&answer, now),
                _ => assert_eq!((did, data), (255, &[0][..]), "neither telemetry nor ping"),
            }
        }
        let time = self.now();
        let wire = &mut self.wire;
        let is_busy = self.model.is_held || time < wire.last_sent + ANSWERED_WITHIN;
        if time <= wire.dirty_until {
            (wire.owed, wire.may_come, wire.acks, wire.moves, wire.asked) = (0, 0, 0, 0, 0);
            return;
        }
        assert!(wire.acks <= wire.owed + wire.may_come, "more acknowledgements than frames");
        assert!(wire.asked <= wire.moves, "more motion than was asked for");
        if !is_busy {
            assert!(wire.acks >= wire.owed, "{} of {} acknowledged", wire.acks, wire.owed);
            assert_eq!(wire.asked, wire.moves, "a motion command is lost");
            (wire.owed, wire.may_come, wire.acks, wire.moves, wire.asked) = (0, 0, 0, 0, 0);
        }
    }

    /// What an answer says is so.
    fn heard(&mut self, answer: &Answer, now: &Snapshot) {
        match answer {
            Answer::State(state) => {
                if let Some(before) = self.wire.clock {
                    let passed = state.time_ms.wrapping_sub(before);
                    assert!(passed < 0x8000, "time runs backwards: {before}, {}", state.time_ms);
                }
                self.wire.clock = Some(state.time_ms);
                for (i, told) in state.channels.iter().enumerate() {
                    let is_so = |snapshot: &Snapshot| {
                        let (output, channel) = (snapshot.outputs.motors[i], snapshot.channels[i]);
                        output.duty.raw() == told.duty
                            && output.enabled == (told.mode != Mode::Off)
                            && channel.position == told.position
                    };
                    // Between two periods that a trial looks at there may have been more.
                    let is_now = is_so(now) || is_so(&self.before);
                    assert!(is_now || self.wire.dirty_until >= self.now(), "not so: {told:?}");
                }
            }
            Answer::Health(health) => {
                assert!(health.faults as u32 <= 47, "{health:?}");
            }
            Answer::Counters(counters) => {
                assert!(counters.frames_for_us <= counters.frames_ok, "{counters:?}");
                assert!(counters.acks_sent <= counters.frames_for_us, "{counters:?}");
            }
            Answer::Refusals(refusals) => {
                let by_reason: u32 = refusals.named().map(|(_, count)| count).sum();
                let all = self.refused();
                assert!(by_reason <= all, "{refusals:?}: of {all}");
            }
            _ => {}
        }
        self.seen.refused = self.refused();
    }

    /// Frames and commands refused since the start.
    fn refused(&self) -> u32 {
        self.board.link().refused + self.board.snapshot().counters.refused.total()
    }

    /// The host has said all: what it is owed comes, and nothing is left.
    pub fn end(&mut self) {
        self.board.line.cut(false);
        self.pass(ANSWERED_WITHIN + 5);
    }
}

/// A fuzzer's session: some hundred events, a few seconds.
pub(super) fn trial(choices: &mut Choices) {
    let mut trial = Trial::new(choices);
    for _ in 0..300 {
        trial.go_on(choices);
        if choices.are_over() || trial.seen.ms > 4000 {
            break;
        }
    }
    trial.end();
}
