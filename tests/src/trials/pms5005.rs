//! A PMS5005 and its host, which says whatever a host can say, over a line that damages it.
//!
//! What must hold besides what `board` and `model` beside it say:
//! - every intact frame for us is acknowledged, once; every motion command reaches the controller;
//! - what the board sends is whole frames that can be read, and true;
//! - its host's silence is noticed.

use embassy_time::Instant;
use firmware::controller::Snapshot;
use firmware::personality::pms5005::Pms5005;
use firmware::settings::Settings;
use hal_mock::tasks::Task;
use protocol::extension::{Action, Answer, ChannelState, Mode, Request};
use protocol::pms5005::{
    Command, Data, Frame, MAX_FRAME, RES_NO_ACK, RID_PMS5005, Receiver, Report, Scope,
};

use super::board::Board;
use super::host::{command, moves_motors};
use super::{Choices, world};

/// Milliseconds in which a candidate that noise has made is given up, and the frames behind it come.
const DAMAGE_LASTS: u64 = 1100;
/// Milliseconds from a frame on the line to its acknowledgement, and from a reset to the first answer; a control
/// that is late meanwhile does not count.
const ANSWERED_WITHIN: u64 = 60;
/// Milliseconds from then until control, which may be late by 46, has seen a sign of life.
const SEEN_WITHIN: u64 = 50;

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

/// How often each does: a generator makes some 30 frames a second, a disturbance every 4 seconds, and
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
    board: Board<Pms5005>,
    wire: Wire,
    counted: Counted,
}

/// What has passed over the line.
#[derive(Clone, Copy, Debug, Default)]
struct Counted {
    frames: u64,
    /// Damaged ones, and pieces of noise.
    damaged: u64,
    acks: u64,
    /// Reports, answers and pings.
    told: u64,
}

/// What a trial has seen.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// Milliseconds.
    pub ms: u64,
    /// Frames that the host has sent; damaged ones, and pieces of noise.
    pub sent: [u64; 2],
    /// Acknowledgements, and other frames of the board.
    pub heard: [u64; 2],
    /// Times that each fault has tripped, by its number.
    pub faults: [u32; 32],
    /// Times that the board has started, and that settings were saved.
    pub starts_and_saves: [u32; 2],
}

/// The host's books.
#[derive(Default)]
struct Wire {
    receiver: Receiver,
    /// Acknowledgements that are owed, those that may come besides, and those that have come.
    owed: u32,
    may_come: u32,
    acks: u32,
    /// Motion commands sent.
    moves: u32,
    /// Nothing is counted until then: a candidate may swallow frames.
    dirty_until: u64,
    /// When all that was sent will have been answered.
    answered_by: u64,
    /// The board has heard a sign of life since it has started.
    has_been_heard: bool,
    /// The last time that the machine state told, and when.
    clock: Option<(u16, u64)>,
    starts: u32,
}

fn now() -> u64 {
    Instant::now().as_millis()
}

impl Trial {
    /// A board that has just been switched on, in a world and with settings that are chosen.
    pub fn new(choices: &mut Choices) -> Self {
        let mut settings = Settings::DEFAULT;
        let control = &mut settings.control;
        control.link_timeout = choices.weighed(&[(1, 100), (4, 2000), (1, 40)]);
        control.longest_move = choices.weighed(&[(1, 0), (4, 10_000), (1, 150)]);
        control.board_faults.motor_battery_high = 3000;
        control.board_faults.missed_periods = 1;
        control.channel_faults.thermal_s = 1; // or hardly any motor is hot before it is commanded anew
        control.channel_faults.over_current_ms = 500; // nor is any for long enough
        control.soft_limits[world::LIMITED] = world::SOFT;
        let board = Board::new(settings, choices, Pms5005::new);
        Self { board, wire: Wire::default(), counted: Counted::default() }
    }

    /// What has been seen so far.
    pub fn seen(&self) -> Seen {
        let Counted { frames, damaged, acks, told } = self.counted;
        let Board { ms, faults, starts, saves, .. } = self.board;
        Seen {
            ms,
            sent: [frames, damaged],
            heard: [acks, told],
            faults,
            starts_and_saves: [starts, saves],
        }
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
            Befalls::Burst => (0..1 + choices.below(6)).for_each(|_| self.say(choices)),
            Befalls::Damage => {
                let (mut data, mut buffer) = (Data::new(), [0; MAX_FRAME]);
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
            Befalls::Noise => self.damage(&choices.bytes(40)),
            Befalls::World => self.board.disturb(choices),
            Befalls::WorldIsRight => world::mend(&mut self.board.it.plant.borrow_mut()),
            Befalls::Silence => {
                let timeout = u64::from(self.board.settings.control.link_timeout);
                let ms = timeout + u64::from(choices.among(&[0u16, 1, 3, 20, 50, 90, 120]));
                self.pass(ms.min(3000));
            }
            Befalls::LineFails => {
                match choices.one_in(2) {
                    true => self.board.it.line.cut(true),
                    false => self.board.it.line.overrun(),
                }
                self.taint(DAMAGE_LASTS);
            }
            Befalls::LineMended => self.board.it.line.cut(false),
            Befalls::Late => {
                // Control comes too late. It is looked at again with the sensors, every 20 ms, and the
                // watchdog bears 50.
                let ms = 1 + u64::from(choices.below(25));
                if self.wire.acks < self.wire.owed || self.board.moves < self.wire.moves {
                    self.wire.answered_by += ms + 21;
                }
                self.board.it.watchdog.hung.set(Some(Task::Control));
                self.pass(ms);
                self.board.it.watchdog.hung.set(None);
                self.pass(21);
            }
            Befalls::Hang => {
                self.board.hang(choices);
                self.pass(200);
                assert!(self.board.has_started(), "a task hangs, and nobody starts the board");
            }
            Befalls::PowerFails => {
                if choices.one_in(2) && !self.board.it.line.is_cut() {
                    self.save_without_power(choices);
                }
                self.board.power_fails();
                self.pass(1);
                assert!(self.board.has_started(), "power is back, and the board does not start");
            }
        }
    }

    /// Power fails in the middle of a save.
    fn save_without_power(&mut self, choices: &mut Choices) {
        let most = if choices.one_in(4) { 20_000 } else { 1300 };
        self.board.it.flash.lose_power_after(choices.below(most) as usize, choices.one_in(2));
        self.send(&Command::Run { scope: Scope::All, run: false });
        self.pass(5);
        self.send(&Command::Extension(Request::Do(Action::Save)));
        self.pass(1 + u64::from(choices.below(8)));
    }

    /// The host says something.
    fn say(&mut self, choices: &mut Choices) {
        if !choices.one_in(24) {
            let mut data = Data::new();
            let command = command(choices, &mut data);
            return self.send(&command);
        }
        // What is for others, for nobody, or wants no acknowledgement.
        let (rid, res) = (choices.among(&[RID_PMS5005, 0, 7]), choices.among(&[0, RES_NO_ACK]));
        let did = choices.byte();
        let data = choices.bytes(12);
        let mut buffer = [0; MAX_FRAME];
        let bytes = Frame { rid, res, did, data: &data }.encode(&mut buffer).expect("it fits");
        let command = Command::parse(did, &data);
        let may_be_an_ack = command == Ok(Command::PingOrAck);
        let is_for_us = rid == RID_PMS5005;
        let is_move = is_for_us && command.is_ok_and(|command| moves_motors(&command));
        self.put(bytes, is_for_us && res != RES_NO_ACK, may_be_an_ack, is_move);
    }

    /// Sends a command.
    fn send(&mut self, command: &Command) {
        let mut buffer = [0; MAX_FRAME];
        let bytes = command.encode(0, &mut buffer).expect("a command that can be encoded");
        self.put(bytes, true, *command == Command::PingOrAck, moves_motors(command));
    }

    fn put(&mut self, bytes: &[u8], is_owed: bool, may_be_an_ack: bool, is_move: bool) {
        self.board.it.line.host_sends(bytes);
        self.counted.frames += 1;
        self.wire.answered_by = now() + ANSWERED_WITHIN;
        if !self.board.it.line.is_cut() {
            self.wire.owed += u32::from(is_owed && !may_be_an_ack);
            self.wire.may_come += u32::from(is_owed && may_be_an_ack);
            self.wire.moves += u32::from(is_move);
            self.wire.has_been_heard |= is_move && now() > self.wire.dirty_until;
        }
    }

    fn damage(&mut self, bytes: &[u8]) {
        self.board.it.line.host_sends(bytes);
        self.counted.damaged += 1;
        self.taint(DAMAGE_LASTS);
    }

    /// What is owed is not known for a while.
    fn taint(&mut self, ms: u64) {
        self.wire.dirty_until = self.wire.dirty_until.max(now() + ms);
        // What is under way may never arrive.
        self.wire.has_been_heard &= now() > self.wire.answered_by;
    }

    /// Lets time pass, and looks at the board after every millisecond.
    fn pass(&mut self, ms: u64) {
        for _ in 0..ms {
            self.board.pass();
            if self.wire.starts != self.board.starts {
                self.wire.starts = self.board.starts;
                (self.wire.has_been_heard, self.wire.clock) = (false, None);
                self.taint(DAMAGE_LASTS);
            }
            self.hear();
            self.board.looked();
        }
    }

    /// Reads what the board has sent, and keeps the books.
    fn hear(&mut self) {
        while let Some((at, bytes)) = self.board.it.line.host_receives() {
            let mut rest = &bytes[..];
            let frame = self.wire.receiver.receive(&mut rest).expect("a whole frame");
            assert!(rest.is_empty() && frame == bytes, "one frame at once");
            let Frame { rid, res, did, data } = Frame::parse(&bytes).expect("it is whole");
            assert_eq!(rid, 0);
            if (res, did, data) == (0, 255, &[1]) {
                self.wire.acks += 1;
                self.counted.acks += 1;
                continue;
            }
            self.counted.told += 1;
            match (Report::parse(did, data), Answer::parse(did, data)) {
                (Some(_), _) => assert_eq!(res, RES_NO_ACK),
                // What the session before a start has said, nobody can compare any more.
                (_, Some(answer)) if at > self.board.started => self.heard(&answer),
                (_, Some(_)) => {}
                _ => assert_eq!((did, data), (255, &[0][..]), "neither telemetry nor ping"),
            }
        }
        let time = u64::from(self.board.settings.control.link_timeout);
        // The last frame of a damaged line takes its time too.
        let last = self.wire.answered_by.max(self.wire.dirty_until + ANSWERED_WITHIN);
        let is_silent = now() > last + time + SEEN_WITHIN;
        if is_silent && time > 0 && self.wire.has_been_heard && !self.board.model.is_held {
            assert!(self.board.now.link_loss, "its host has been silent for {time} ms");
        }
        let wire = &mut self.wire;
        let asked = self.board.moves;
        let is_under_way = self.board.model.is_held || now() < wire.answered_by;
        if now() > wire.dirty_until {
            assert!(wire.acks <= wire.owed + wire.may_come, "more acknowledgements than frames");
            assert!(asked <= wire.moves, "more motion than was asked for");
            if is_under_way {
                return;
            }
            assert!(wire.acks >= wire.owed, "{} of {} acknowledged", wire.acks, wire.owed);
            assert_eq!(asked, wire.moves, "a motion command is lost");
        } else if is_under_way {
            // The books are opened when nothing is on its way that is not in them.
            self.taint(1);
        }
        let wire = &mut self.wire;
        (wire.owed, wire.may_come, wire.acks, wire.moves) = (0, 0, 0, 0);
        self.board.moves = 0;
    }

    /// What an answer says is so.
    fn heard(&mut self, answer: &Answer) {
        match answer {
            Answer::State(state) => {
                if let Some((before, at)) = self.wire.clock {
                    let passed = u64::from(state.time_ms.wrapping_sub(before));
                    let is_so = ((now() - at) % 0x1_0000).abs_diff(passed) <= 1;
                    assert!(is_so, "{passed} ms of the board's in {} ms", now() - at);
                }
                self.wire.clock = Some((state.time_ms, now()));
                let is_news = self.wire.dirty_until >= now();
                let Board { now, between, before, .. } = &self.board;
                for (i, told) in state.channels.iter().enumerate() {
                    let is_so =
                        [now, between, before].iter().any(|told_of| is_so(told, i, told_of));
                    assert!(is_so || is_news, "it is not so: {told:?}");
                }
            }
            Answer::Counters(counters) => {
                assert!(counters.frames_for_us <= counters.frames_ok, "{counters:?}");
                assert!(counters.acks_sent <= counters.frames_for_us, "{counters:?}");
            }
            Answer::Refusals(refusals) => {
                let by_reason: u32 = refusals.named().map(|(_, count)| count).sum();
                let all = self.board.it.link().refused + self.board.refused();
                assert!(by_reason <= all, "{refusals:?}: of {all}");
            }
            _ => {}
        }
    }

    /// The host has said all: what it is owed comes, and nothing is left.
    pub fn end(&mut self) {
        self.board.it.line.cut(false);
        self.pass(ANSWERED_WITHIN + 5);
    }
}

/// Whether what a channel's state tells is in this snapshot.
fn is_so(told: &ChannelState, channel: usize, snapshot: &Snapshot) -> bool {
    let (output, channel) = (snapshot.outputs.motors[channel], snapshot.channels[channel]);
    output.duty.raw() == told.duty
        && output.enabled == (told.mode != Mode::Off)
        && channel.position == told.position
}

/// A fuzzer's session: some hundred events, a few seconds.
pub(super) fn trial(choices: &mut Choices) {
    let mut trial = Trial::new(choices);
    for _ in 0..300 {
        trial.go_on(choices);
        if choices.are_over() || trial.board.ms > 4000 {
            break;
        }
    }
    trial.end();
}
