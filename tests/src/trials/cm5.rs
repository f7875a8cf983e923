//! A CM-5, its PC and its servos: answers to hellos, goals good and bad, servos that come and go, a bus
//! and a line that damage what they carry, a PC that falls silent, loops that hang.
//!
//! What must hold:
//! - what the PC hears is whole packets that are a hello or a report;
//! - no servo is driven before the PC has sent goals with its torque on, and what a servo is told to do is
//!   one whole goal of the PC's;
//! - the lock stays off, since the settings keep it off;
//! - a servo that turns endlessly is stopped when the PC has fallen silent;
//! - the bridge starts again only when a loop hangs.

use embassy_time::Duration;
use firmware::bridge::BridgeSettings;
use hal_mock::cm5_board::{Cm5Board, Loop, Make};
use hal_mock::plant::Ax12;
use hal_mock::servo_bus::Faults;
use protocol::cm5::{
    Goals, Hello, HelloAnswer, Limits, MAX_PACKET, Receiver, Report, ServoGoal, encode, params_of,
};
use protocol::dynamixel::Register;

use super::Choices;
use crate::cm5::goal;

/// Milliseconds after which the PC is silent, and in which a servo that hears is stopped then: a watch of
/// the IDs may come between, and a bus that is damaged needs more than one try.
const SILENT_AFTER: u64 = 1000;
const STOPPED_WITHIN: u64 = 400;

#[derive(Clone, Copy, Debug)]
enum Befalls {
    Pause,
    Answer,
    Goals,
    BadGoals,
    Damage,
    Noise,
    Plug,
    Bus,
    Silence,
    Hang,
}

const ALL: [(u32, Befalls); 12] = [
    (1000, Befalls::Pause),
    (100, Befalls::Answer),
    (1000, Befalls::Goals),
    (1000, Befalls::Goals),
    (30, Befalls::BadGoals),
    (100, Befalls::Damage),
    (30, Befalls::Noise),
    (4, Befalls::Plug),
    (4, Befalls::Plug),
    (4, Befalls::Bus),
    (2, Befalls::Silence),
    (1, Befalls::Hang),
];

/// See the [module](self).
pub struct Trial {
    board: Cm5Board,
    receiver: Receiver,
    servos: usize,
    plugged: Vec<bool>,
    /// Goals that the PC has sent for the servo at this place, and whatever damage may have made of them.
    goals: Vec<ServoGoal>,
    /// Something that nobody has sent may have come through.
    is_damaged: bool,
    /// When the PC last said anything, and when the bus, or who is on it, last changed.
    heard: u64,
    troubled: u64,
    hangs: u32,
    /// Milliseconds so far.
    pub ms: u64,
}

impl Trial {
    /// A board that is about to search a bus of up to three servos.
    pub fn new(choices: &mut Choices) -> Self {
        let servos = 1 + choices.below(3) as usize;
        let ids = [3, 1, 18];
        let make = Make {
            servos: ids.into_iter().take(servos).map(Ax12::new).collect(),
            line_rate: choices.among(&[1_000_000, 0]),
            settings: BridgeSettings { search_retries: 0, ..BridgeSettings::DEFAULT },
            ..Make::default()
        };
        Self {
            board: Cm5Board::new(make),
            receiver: Receiver::new(),
            servos,
            plugged: vec![true; servos],
            goals: Vec::new(),
            is_damaged: false,
            heard: 0,
            troubled: 0,
            hangs: 0,
            ms: 0,
        }
    }

    /// One more thing befalls it.
    pub fn go_on(&mut self, choices: &mut Choices) {
        match choices.weighed(&ALL) {
            Befalls::Pause => {
                let ms = match choices.are_a_fuzzers() {
                    true => choices.among(&[1, 3, 10, 40, 150]),
                    false => 1 + choices.below(60),
                };
                self.pass(ms.into());
            }
            Befalls::Answer => {
                let pairs = [(0, 1023), (0, 0), (200, 800), (5, 5)];
                let limits: Vec<_> = (0..choices.among(&[1, self.servos]))
                    .map(|_| choices.among(&pairs))
                    .map(|(cw, ccw)| Limits::new(cw, ccw).expect("limits that can be"))
                    .collect();
                let delay = choices.among(&[0, 1, 250]);
                let mut buffer = [0; MAX_PACKET];
                let bytes = HelloAnswer::encode(delay, &limits, &mut buffer).expect("it fits");
                self.send(bytes);
            }
            Befalls::Goals => {
                let goals = self.choose(choices);
                let mut buffer = [0; MAX_PACKET];
                let bytes = Goals::encode(&goals, &mut buffer).expect("it fits");
                self.goals.extend(goals);
                self.send(bytes);
            }
            Befalls::BadGoals => {
                // One byte more than goals, or a value that no servo takes: none of it is done.
                let mut goals = self.choose(choices);
                let at = choices.below(goals.len() as u32) as usize;
                let goal = goals[at];
                goals[at] = goal.with(Register::CW_SLOPE, 255);
                let params: Vec<u8> = goals.iter().flat_map(|goal| goal.0).collect();
                let mut buffer = [0; MAX_PACKET];
                self.send(encode([&params[..]], &mut buffer).expect("it fits"));
            }
            Befalls::Damage => {
                let goals = self.choose(choices);
                let mut buffer = [0; MAX_PACKET];
                let bytes = Goals::encode(&goals, &mut buffer).expect("it fits");
                let at = choices.below(bytes.len() as u32) as usize;
                bytes[at] ^= 1 << choices.below(8);
                let cut = if choices.one_in(2) { at } else { bytes.len() };
                self.damage(&bytes[..cut]);
            }
            Befalls::Noise => self.damage(&choices.bytes(40)),
            Befalls::Plug => {
                let servo = choices.below(self.servos as u32) as usize;
                self.plugged[servo] = !self.plugged[servo];
                match self.plugged[servo] {
                    true => self.board.bus.bus().plug(servo),
                    false => self.board.bus.bus().unplug(servo),
                }
                self.troubled = self.ms;
            }
            Befalls::Bus => {
                let ppm = choices.among(&[0, 0, 2000, 20_000]);
                let faults = Faults { dropped_ppm: ppm, flipped_ppm: ppm, stalled_ppm: ppm };
                self.board.bus.bus().set_faults(faults);
                self.is_damaged |= ppm > 0;
                self.troubled = if ppm > 0 { u64::MAX } else { self.ms };
            }
            Befalls::Silence => self.pass(SILENT_AFTER + choices.among(&[5, 100, 500])),
            Befalls::Hang => {
                let all = [Loop::Receive, Loop::Transmit, Loop::Bus];
                self.board.watchdog.hung.set(Some(choices.among(&all)));
                self.hangs += 1;
                self.troubled = self.troubled.max(self.ms + 600);
                self.pass(600);
                assert_eq!(self.board.restarts(), self.hangs, "a loop hangs, and nobody sees it");
            }
        }
    }

    /// Goals for all servos, each with its torque on or off.
    fn choose(&self, choices: &mut Choices) -> Vec<ServoGoal> {
        let one = |choices: &mut Choices| {
            goal(choices.word() % 1024)
                .with(Register::TORQUE_ENABLE, choices.among(&[1, 1, 0]))
                .with(Register::MOVING_SPEED, choices.among(&[200, 0, 1023]))
                .with(Register::LOCK, u16::from(choices.one_in(8)))
        };
        (0..self.servos).map(|_| one(choices)).collect()
    }

    fn send(&mut self, bytes: &[u8]) {
        self.board.line.host_sends(bytes);
        self.heard = self.ms;
    }

    fn damage(&mut self, bytes: &[u8]) {
        self.send(bytes);
        self.is_damaged = true; // a sum of one byte lets one in 256 through
    }

    fn pass(&mut self, ms: u64) {
        for _ in 0..ms {
            self.board.run_for(Duration::from_millis(1));
            self.ms += 1;
            self.look();
            self.hear();
        }
    }

    fn look(&mut self) {
        assert!(self.board.restarts() <= self.hangs, "the bridge starts again");
        let silent_for = self.ms.saturating_sub(self.heard);
        let untroubled_for = self.ms.saturating_sub(self.troubled);
        let mut bus = self.board.bus.bus();
        for servo in 0..self.servos {
            let it = bus.servo(servo);
            assert!(it.position().is_finite() && it.speed().is_finite());
            let torque = it.get(Register::TORQUE_ENABLE);
            let motion = [Register::GOAL_POSITION, Register::MOVING_SPEED, Register::TORQUE_ENABLE];
            let told = motion.map(|register| it.get(register));
            let is_endless = it.get(Register::CW_LIMIT) == 0 && it.get(Register::CCW_LIMIT) == 0;
            if self.is_damaged {
                continue;
            }
            assert_eq!(it.get(Register::LOCK), 0, "a lock that no setting allows");
            // Off is not the PC's alone: what is not safe is switched off.
            let is_the_pcs = |goal: &ServoGoal| motion.map(|register| goal.get(register)) == told;
            assert!(torque == 0 || self.goals.iter().any(is_the_pcs), "servo {servo}: {told:?}");
            let must_stand = silent_for > SILENT_AFTER + STOPPED_WITHIN
                && untroubled_for > SILENT_AFTER + STOPPED_WITHIN
                && self.plugged[servo];
            assert!(!must_stand || !is_endless || torque == 0, "servo {servo} turns endlessly");
        }
    }

    fn hear(&mut self) {
        while let Some((_, bytes)) = self.board.line.host_receives() {
            let mut rest = &bytes[..];
            let whole = self.receiver.receive(&mut rest).expect("a whole packet");
            assert!(rest.is_empty() && whole == bytes, "one packet at once");
            let params = params_of(&bytes).expect("it is whole");
            let is_hello = Hello::parse(params).is_some_and(|hello| hello.ids.is_sorted());
            let is_report = (1..=100).any(|servos| Report::parse(params, servos).is_some());
            assert!(is_hello || is_report, "{params:?}");
        }
    }

    /// The PC has said all.
    pub fn end(&mut self) {
        self.pass(20);
    }
}

/// A fuzzer's session, at first behind the search.
pub(super) fn trial(choices: &mut Choices) {
    let mut trial = Trial::new(choices);
    trial.pass(if choices.one_in(8) { 10 } else { 450 });
    for _ in 0..200 {
        trial.go_on(choices);
        if choices.are_over() || trial.ms > 4500 {
            break;
        }
    }
    trial.end();
}
